"""Growth and crossovers of known curves are found; how fast anything is, is no test's business."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from xfrustum.cli.main import main
from xfrustum.reference import Reference
from xfrustum.reports.benchmarks.scaling import scaling
from xfrustum.reports.benchmarks.scaling.contestants import (
    CONTESTANTS,
    RASTERIZERS,
    UnavailableError,
    contestants_along,
)
from xfrustum.reports.benchmarks.scaling.expected import EXPECTED, MEMORY, SECONDS, finding
from xfrustum.reports.benchmarks.scaling.extent import FULL, QUICK
from xfrustum.reports.benchmarks.scaling.fit import Exponents, Overtaking
from xfrustum.reports.benchmarks.scaling.page import scaling_figure, staged
from xfrustum.reports.benchmarks.scaling.process import Job, Measured, measure, measure_apart, peak_mib
from xfrustum.reports.benchmarks.scaling.scaling import LIMIT_MIB
from xfrustum.reports.benchmarks.scaling.table import growth_sentence, runs_sentence, table
from xfrustum.reports.common.timing import Timing
from xfrustum.scenes import NOTHING, InputError
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.library.globes import GLOBES, REACH, globes

SIZES = (1e4, 1e5, 1e6, 1e7)
AXES = {axis.unit: axis for axis in FULL.axes}


@pytest.mark.parametrize("power", [0.0, 0.3, 1.0, 1.5])
def test_a_fit_recovers_the_exponent_of_a_power_law(power: float) -> None:
    found = Exponents.of(SIZES, [3e-4 * size**power for size in SIZES])
    assert found.overall == pytest.approx(power, abs=1e-12)
    assert found.large_end == pytest.approx(power, abs=1e-12)
    assert found.growth == pytest.approx(1000**power)


def test_a_constant_that_dominates_small_sizes_shows_less_at_the_large_end() -> None:
    found = Exponents.of(SIZES, [1.0 + 1e-5 * size for size in SIZES])
    assert found.overall is not None and found.large_end is not None
    assert found.overall < found.large_end < 1


@pytest.mark.parametrize(
    ("costs", "known"),
    [
        ((0.0, 1.0, 10.0, 100.0), (False, True, False)),
        ((1.0, 0.0, 10.0, 100.0), (False, False, True)),
        ((0.0, 0.0, 0.0, 0.0), (False, False, False)),
    ],
)
def test_a_cost_of_zero_has_no_exponent(costs: tuple[float, ...], known: tuple[bool, bool, bool]) -> None:
    """A small size may take no more memory than what was imported."""
    found = finding("apertures", MEMORY, "embree", SIZES, costs)
    exponents = found.exponents
    assert (
        tuple(one is not None for one in (exponents.overall, exponents.large_end, exponents.growth)) == known
    )
    assert (found.as_expected is not None) is known[1]
    text = growth_sentence("embree", found)
    assert text.startswith("embree: unknown, as a cost is zero, at the large end ")
    assert ("NOT AS EXPECTED" in text) is known[1]
    assert ("an unknown number of times" in text) is not known[2]


def runs(*medians: float, spread: float = 1.0) -> list[Timing]:
    return [Timing.of([median / spread, median, median * spread]) for median in medians]


def test_curves_that_cross_do_so_where_the_power_laws_are_equal() -> None:
    raster = runs(*(1e-3 * size for size in SIZES))
    traced = runs(*(20 * size**0.25 for size in SIZES))
    found = Overtaking.of(SIZES, raster, traced)
    # 1e-3 s = 20 s^(1/4) at s = 20000^(4/3).
    assert found.from_size == pytest.approx(20000 ** (4 / 3))
    assert [one.tracing_wins for one in found.crossings] == [True]
    assert found.sentence("triangles") == "rasterizing is faster at first, tracing from 540,000 triangles on"


def test_the_other_way_round_rasterizing_overtakes_and_tracing_never_does() -> None:
    found = Overtaking.of(SIZES, runs(2, 2, 2, 2), runs(1, 1, 4, 4))
    assert found.from_size is None
    assert [one.tracing_wins for one in found.crossings] == [False]
    assert found.crossings[0].size == pytest.approx(10**5.5)
    assert found.sentence("pixels") == "tracing is faster at first, rasterizing from 320,000 pixels on"


def test_curves_that_do_not_cross_have_no_crossover() -> None:
    everywhere = "is faster everywhere from 10,000 to 10,000,000 triangles"
    slower = Overtaking.of(SIZES, runs(1, 1, 1, 1), runs(2, 2, 2, 2))
    assert slower.from_size is None and not slower.crossings
    assert slower.sentence("triangles") == f"rasterizing {everywhere}"
    faster = Overtaking.of(SIZES, runs(2, 2, 2, 2), runs(1, 1, 1, 1))
    assert faster.from_size == SIZES[0] and not faster.crossings
    assert faster.sentence("triangles") == f"tracing {everywhere}"


def test_curves_that_overlap_do_not_cross_where_their_runs_cannot_be_told_apart() -> None:
    raster = runs(1.0, 1.0, 1.0, 1.0, spread=1.2)
    to_and_fro = Overtaking.of(SIZES, raster, runs(1.1, 0.9, 1.1, 0.9, spread=1.2))
    assert to_and_fro.tracing_first is None and to_and_fro.from_size is None and not to_and_fro.crossings
    assert "neither is faster" in to_and_fro.sentence("triangles")
    # The lead that lasts began at the last change of the medians.
    found = Overtaking.of(SIZES, raster, runs(2.0, 0.9, 1.25, 0.5, spread=1.2))
    assert len(found.crossings) == 1 and found.crossings[0].tracing_wins
    assert 1e6 < found.crossings[0].size < 1e7


@pytest.mark.parametrize("power,as_expected", [(1.0, True), (0.3, False), (1.4, False)])
def test_an_exponent_outside_the_range_of_its_sentence_is_flagged(power: float, as_expected: bool) -> None:
    found = finding("triangles", SECONDS, "raster", SIZES, [1e-7 * size**power for size in SIZES])
    assert found.as_expected is as_expected
    if as_expected:
        assert found.sentence == "both cameras transform every triangle, shown or not: 100 ns each"


def test_every_contestant_has_an_expectation_along_each_of_its_axes() -> None:
    for (axis, quantity), expected in EXPECTED.items():
        assert set(expected) == set(contestants_along(axis)), (axis, quantity)
        assert all(one.low < one.high for one in expected.values())
    assert set(EXPECTED) == {(axis, quantity) for axis in AXES for quantity in (SECONDS, MEMORY)}


@pytest.mark.parametrize("triangles", [n for n in (1000, 4000, *AXES["triangles"].sizes) if n <= 1_000_000])
def test_globes_have_exactly_as_many_triangles_as_they_say(triangles: int) -> None:
    scene = globes(triangles, (8, 8))
    assert len(scene.faces) == triangles
    # There are neither slivers without area nor triangles beyond the reach.
    assert (np.linalg.norm(scene.normals, axis=1) > 0.5).all()
    assert np.abs(scene.vertices[:, 2]).max() < REACH


def test_globes_lie_before_across_and_behind_the_plate() -> None:
    low, high = globes(1000, (8, 8)).height_ranges
    assert (low > 0).any() and (high < 0).any() and ((low < 0) & (high > 0)).any()


def test_every_vertex_lies_on_its_ellipsoid_whatever_the_number() -> None:
    for triangles in (1000, 32_000):
        for part, (center, semi_axes) in zip(globes(triangles, (8, 8)).objects, GLOBES, strict=True):
            radius = np.linalg.norm((part.vertices - np.array(center)) / np.array(semi_axes), axis=1)
            # The unit globe's coordinates are rounded to 1e-6 of its diameter.
            np.testing.assert_allclose(radius, 1, atol=2 * math.sqrt(3) * 0.5e-6)


def test_silhouettes_of_globes_do_not_depend_on_the_number() -> None:
    """Pixels change only within what the coarsest facets cut off."""
    size = (128, 128)

    def shown(triangles: int) -> Numbers:
        scene = globes(triangles, size)
        return Reference(scene).propose(scene.plate.middle).object

    fine = shown(320_000)
    assert set(np.unique(fine)) == {NOTHING, *range(len(GLOBES))}
    # The length of all outlines in pixels, in steps along rows and columns: never less than it is.
    outline = np.count_nonzero(fine[1:] != fine[:-1]) + np.count_nonzero(fine[:, 1:] != fine[:, :-1])
    # 40 sectors cut off 1 - cos(pi / 40) of a semi-axis, and none is longer than half of the film.
    cut_off_px = (1 - math.cos(math.pi / 40)) * size[0] / 2
    for triangles in (10_000, 32_000):
        assert np.count_nonzero(shown(triangles) != fine) <= cut_off_px * outline
    # Ten sectors cut off sixteen times as much: the bound tells.
    assert np.count_nonzero(shown(1000) != fine) > cut_off_px * outline


@pytest.mark.parametrize("triangles", [0, 10, 9999, 10_010, 10_000_001])
def test_a_number_that_globes_cannot_share_evenly_is_refused(triangles: int) -> None:
    with pytest.raises(InputError, match="cannot be shared"):
        globes(triangles, (8, 8))


def test_an_axis_changes_one_thing() -> None:
    for axis in FULL.axes:
        jobs = [asdict(axis.job("embree", size, 1)) for size in axis.sizes]
        changed = {key for key in jobs[0] if len({job[key] for job in jobs}) > 1}
        assert len(changed) == 1
        assert list(axis.sizes) == sorted(set(axis.sizes))
    assert AXES["triangles"].sizes[-1] == 10_000_000 and AXES["pixels"].counts[-1] == 4096**2
    assert AXES["apertures"].sizes[-1] == 81


def test_a_process_of_its_own_answers_and_its_memory_is_its_own() -> None:
    """A child inherits what getrusage calls the most memory; a large parent must not show in it."""
    ballast = np.ones(2**26)
    assert peak_mib() > ballast.nbytes / 2**20
    found = measure_apart(Job(contestant="embree", triangles=1000, resolution=16, hogels=1, repeat=3))
    assert found.triangles == 1000 and found.seconds.repetitions == 3 and "embreex" in found.made_of
    assert 0 < found.imported_mib <= found.scene_mib <= found.peak_mib < ballast.nbytes / 2**20


def test_what_a_process_refuses_is_an_input_error_here() -> None:
    with pytest.raises(InputError, match="cannot be shared"):
        measure_apart(Job(contestant="embree", triangles=9999, resolution=16, hogels=1, repeat=1))
    with pytest.raises(InputError, match="ended with 1"):
        measure_apart(Job(contestant="nobody", triangles=1000, resolution=16, hogels=1, repeat=1))


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every point be measured in this process, whose memory then means nothing."""

    def in_this_process(job: Job) -> Measured:
        return replace(measure(job), imported_mib=1.0)

    monkeypatch.setattr(scaling, "measure_apart", in_this_process)


@pytest.mark.usefixtures("here")
def test_quick_returns_all_there_is_as_json_and_as_a_page(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "scaling"
    assert main(["bench", "scaling", "--quick", "--quiet", "--json", "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["axes"]) == {"triangles", "pixels", "apertures"}
    for axis in QUICK.axes:
        one = found["axes"][axis.unit]
        names = set(contestants_along(axis.unit)) - set(found["unavailable"])
        assert one["sizes"] == list(axis.sizes) and set(one["contestants"]) == names
        for points in one["contestants"].values():
            assert len(points) == len(axis.sizes)
            for point in points:
                spread = point["seconds"]
                assert 0 < spread["lowest"] <= spread["median"] <= spread["highest"]
                assert point["set_up_s"] >= 0 and 0 < point["scene_mib"] <= point["peak_mib"]
        for quantity in (SECONDS, MEMORY):
            growth = one["growth"][quantity]
            assert set(growth) == names
            assert all(
                {"exponent", "exponent_large_end", "as_expected", "sentence"} <= set(of)
                for of in growth.values()
            )
        assert set(one["tracing_overtakes"]) == names - set(RASTERIZERS)
    memory = found["memory_with_most_triangles"]
    assert memory["triangles"] == QUICK.axes[0].sizes[-1] and memory["limit_mib"] == LIMIT_MIB
    assert found["asymptotic"] is False and set(found["meanings"]) == set(CONTESTANTS)
    assert set(found["machine"]) >= {"processor", "cores"} and "moderngl" in found["versions"]
    assert json.loads((out / "scaling.json").read_text()) == found
    page = (out / "index.html").read_text()
    assert "apertures-memory" in page and "too small for exponents" in page
    assert "Exponents of" not in page and "NOT AS EXPECTED" not in page and "Times are of one run" in page


@pytest.mark.usefixtures("here")
def test_the_table_names_every_contestant_size_and_reason() -> None:
    measured = scaling.benchmark_scaling(replace(QUICK, axes=QUICK.axes[:1]))
    text = table(measured)
    lines = text.splitlines()
    for name, points in measured.axes[0].measured.items():
        assert points[-1].triangles == 4000
        assert sum(line.startswith(f"{name}: ") for line in lines) == 1
        assert sum(line.startswith(f"  {name}: ") for line in lines) == (name not in RASTERIZERS)
    assert "every contestant fits in 8 GiB" in text or "need more than 8 GiB" in text
    assert "imported alone" in text and text.count("too small for exponents") == 1
    assert "exponents of time" not in text and "NOT AS EXPECTED" not in text
    large = table(replace(measured, extent=replace(measured.extent, asymptotic=True)))
    assert "too small for exponents" not in large and "exponents of time in triangles" in large
    assert all(large.count(f"\n  {name}: ") >= 2 for name in measured.axes[0].measured)


@pytest.mark.usefixtures("here")
def test_the_page_says_what_its_numbers_are(tmp_path: Path) -> None:
    measured = scaling.benchmark_scaling(replace(QUICK, axes=QUICK.axes[:1]))
    with staged(tmp_path / "out") as write:
        write(replace(measured, extent=replace(FULL, axes=measured.extent.axes)))
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<h3>Exponents of time</h3>" in page and "<h3>Exponents of memory" in page
    assert "of 9 runs" in page and "too small for exponents" not in page
    figure = scaling_figure(measured.axes[0], SECONDS)
    # Both sizes are labeled, though only one is a power of ten.
    assert figure.layout.xaxis.tickvals == (1000, 4000) and figure.layout.xaxis.ticktext == ("1,000", "4,000")


@pytest.mark.parametrize("repeat", [1, 2, 9])
def test_the_number_of_runs_is_said_as_it_is(repeat: int) -> None:
    said = runs_sentence(replace(QUICK, repeat=repeat))
    assert said.startswith(
        "times are of one run," if repeat == 1 else "times are medians (lowest to highest)"
    )
    assert (f"of {repeat} runs" in said) is (repeat > 1)
    assert ("of fewer, but at least 2, where these take 2 s" in said) is (repeat == 9)


def test_a_contestant_that_does_not_run_here_is_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def pretend(job: Job) -> Measured:
        asked.append(job.contestant)
        if job.contestant == "mitsuba":
            raise UnavailableError("not on this machine")
        return Measured(
            seconds=Timing.of([1e-3 * (job.triangles or 1)]),
            set_up_s=0.0,
            imported_mib=100.0,
            scene_mib=200.0,
            peak_mib=9000.0 if job.contestant == "truth" else 300.0,
            triangles=job.triangles or 1,
            made_of={},
        )

    monkeypatch.setattr(scaling, "measure_apart", pretend)
    measured = scaling.benchmark_scaling(replace(QUICK, axes=QUICK.axes[:1]))
    assert measured.unavailable == {"mitsuba": "not on this machine"}
    # Sizes follow each other, and a missing contestant is not asked again.
    others = ["raster", "embree", "certified", "truth"]
    assert asked == ["raster", "embree", "mitsuba", "certified", "truth", *others]
    assert "mitsuba" not in measured.axes[0].measured
    text = table(measured)
    assert "mitsuba: not here, not on this machine" in text
    assert "truth need more than 8 GiB; the most takes truth, 9,000 MiB" in text


def test_a_page_that_cannot_be_written_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not a folder"), staged(tmp_path / "file"):
        raise AssertionError("nothing may be measured")
