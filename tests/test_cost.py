"""What accuracy costs: the front, the answers, and that nothing else can be had for less."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xfrustum.cli import main
from xfrustum.compare import compare_images
from xfrustum.compare.display import LEVELS, encoded
from xfrustum.compare.pixel_bands import ALONE_PIXELS, BAND_PIXELS, in_bands
from xfrustum.raster import Rasterizer
from xfrustum.reference import TRACERS, Reference
from xfrustum.reports import cost_ways
from xfrustum.reports.images import _levels
from xfrustum.reports.timing import Spread
from xfrustum.reports.trade_off import MAX_WRONG, Option, answers, cheapest, pareto
from xfrustum.scenes import builtin
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.hogel_image import Certainty

from .views import view


def option(seconds: float, moved: float, wrong: float = 0.0, slowest: float = 0.0) -> Option:
    return Option(
        renderer="raster",
        label=f"{seconds} s",
        configuration={},
        displacement_p99_px=moved,
        surface_fraction=wrong,
        time_s=Spread(median=seconds, lowest=seconds, highest=max(seconds, slowest), repetitions=3),
    )


numbers = st.integers(1, 4).map(float)


@given(st.lists(st.builds(option, numbers, numbers, numbers), min_size=1, max_size=12))
def test_the_front_is_what_nothing_beats(options: list[Option]) -> None:
    front = [one for one, best in zip(options, pareto(options), strict=True) if best]
    assert front
    assert not any(one.beats(other) for one in options for other in front)
    assert all(one in front or any(other.beats(one) for other in front) for one in options)


def test_the_cheapest_is_fast_enough_and_within_the_tolerance() -> None:
    fast, slow, wrong = option(1, 0.4), option(2, 0.01), option(0.5, 0.0, wrong=2 * MAX_WRONG)
    assert cheapest([slow, fast, wrong], 0.5) is fast
    assert cheapest([slow, fast, wrong], 0.1) is slow
    assert cheapest([fast, wrong], 0.1) is None


def test_of_times_that_cannot_be_told_apart_the_least_error_is_named() -> None:
    noisy, better = option(1, 0.4, slowest=1.5), option(1.2, 0.1)
    assert cheapest([noisy, better], 0.5) is better
    assert cheapest([noisy, replace(better, time_s=Spread.of([1.6]))], 0.5) is noisy


def test_the_answers_are_sentences_about_the_tolerance_and_a_fifth_of_it() -> None:
    loose, strict = answers([option(1, 0.4), option(3, 0.05)], 0.5)
    assert "under 0.5 px: 1 s" in loose.sentence
    assert "0.1 px would cost 3.00 times" in strict.sentence
    assert "Nothing" in answers([option(1, 0.4)], 0.5)[1].sentence


@pytest.mark.parametrize("tracer", TRACERS)
def test_a_tracer_alone_shows_the_truth_but_for_what_float32_cannot_tell(tracer: str) -> None:
    scene = view("car", (64, 48))
    reference = Reference(scene, tracer=tracer)
    truth, proposed = (f(scene.plate.middle) for f in (reference.trace, reference.propose))
    assert proposed.certainty is not None
    assert (proposed.certainty == Certainty.UNEXAMINED).all()
    judged = compare_images(truth, proposed, reference, radiance=False)
    assert judged.displacement_px is not None
    assert judged.displacement_px.max < 1e-6
    assert judged.surface_wrong is not None
    assert judged.surface_wrong < 10


@pytest.mark.parametrize("near_per_reach", [1e-1, 1e-3, 1e-7])
def test_what_the_truth_has_proven_to_be_seen_needs_no_second_ray(near_per_reach: float) -> None:
    scene = view("car-recentered", (160, 120))
    reference = Reference(scene)
    for aperture in scene.default_apertures()[:2]:
        truth = reference.trace(aperture)
        with Rasterizer(scene) as rasterizer:
            settings = DoubleFrustum(near=near_per_reach * scene.frustum.longest_reach)
            drawn = rasterizer.render(aperture, settings)
        asked = replace(truth, certainty=np.full_like(truth.certainty, Certainty.UNEXAMINED))
        found, again = (compare_images(one, drawn, reference) for one in (truth, asked))
        assert found.maps.surface is not None and again.maps.surface is not None
        np.testing.assert_array_equal(found.maps.surface, again.maps.surface & found.maps.judged)


def test_bands_join_to_the_image_whether_one_thread_makes_them_or_many() -> None:
    scene = view("car", (64, 48))
    image = Reference(scene).trace(scene.plate.middle)
    for copies in (1, ALONE_PIXELS // (64 * 48) + 1):
        tall = replace(image, triangle=np.tile(image.triangle, (copies, 1)), companions=None, overruled=None)
        bands = in_bands(tall, tall, lambda truth, raster, rows: truth.triangle)
        np.testing.assert_array_equal(np.concatenate(bands), tall.triangle)
        assert all(band.size <= BAND_PIXELS for band in bands)


def test_levels_from_a_table_are_those_of_the_curve() -> None:
    colors = np.linspace(0, 1, 1_000_003, dtype=np.float32)
    np.testing.assert_array_equal(_levels(colors), np.rint(LEVELS * encoded(colors)))
    # The floats on both sides of where two levels meet.
    edges = np.interp(np.arange(255) + 0.5, LEVELS * encoded(colors), colors).astype(np.float32)
    near = np.concatenate([np.nextafter(edges, np.float32(to)) for to in (0, 1)] + [edges])
    np.testing.assert_array_equal(_levels(near), np.rint(LEVELS * encoded(near)))


def test_the_device_s_time_is_part_of_the_frame() -> None:
    scene = builtin.build("sheets")
    with Rasterizer(scene) as rasterizer:
        rasterizer.render(scene.plate.middle, DoubleFrustum(near=1.0))
        assert list(rasterizer.times) == ["draw", "read"]
        assert rasterizer.times["draw"].gpu_s > 0


def test_cost_prints_one_object_and_writes_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cost_ways, "NEARS_PER_REACH", (1e-2, 1e-5))
    scene = "grating"
    arguments = ["cost", scene, "--repeat", "1", "--quiet", "--json", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {"raster", "embree", "mitsuba", "certified"} == {row["renderer"] for row in printed["rows"]}
    for row in printed["rows"]:
        assert set(row["error"]) == {"displacement_p99_px", "surface_fraction"}
        assert row["time_s"]["low"] <= row["time_s"]["median"] <= row["time_s"]["high"]
    assert any(row["pareto"] for row in printed["rows"])
    assert [answer["tolerance_px"] for answer in printed["answers"]] == pytest.approx([0.5, 0.1])
    page = (tmp_path / "out" / "index.html").read_text()
    # The answer stands before the first figure.
    words = printed["answers"][0]["sentence"].split(":")[0]
    assert words in page[: page.index('id="plot"')]
    assert json.loads((tmp_path / "out" / "cost.json").read_text())["answers"] == printed["answers"]
    assert main(["cost", scene, "--tolerance-px", "0"]) == 2
