"""Benchmarks say what they measured; how fast anything is, is no test's business."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from tests.support.views import view
from xfrustum import Judge
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.llvm import mitsuba_backend
from xfrustum.reports.benchmarks import judge, plate, truth
from xfrustum.reports.benchmarks.common import ratios_of
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.timing import Timing
from xfrustum.scenes import NOTHING, HogelImage


def assert_rates(found: dict[str, Any], meanings: dict[str, str], ends: tuple[str, str]) -> None:
    assert set(found) == set(meanings)
    for name, rate in found.items():
        if rate is None:
            assert name == truth.MITSUBA and mitsuba_backend().scalar
        else:
            assert 0 < rate[ends[0]] <= rate["median"] <= rate[ends[1]]


def assert_ratios(ratios: dict[str, float | None], rates: dict[str, Any]) -> None:
    for pair, ratio in ratios.items():
        one, other = pair.split("/")
        assert ratio is None or ratio == pytest.approx(rates[one]["median"] / rates[other]["median"])


def told(found: dict[str, Any], table: Callable[[Any], str], names: Iterable[str], heading: str) -> Any:
    """See that a table names the scene and every contestant; return the record as JSON has it."""
    lines = table(found).splitlines()
    assert any(line.startswith(heading) for line in lines)
    for name in names:
        assert sum(line.lstrip().startswith(name) for line in lines) >= 2, name
    assert set(found["machine"]) >= {"processor", "cores"} and "moderngl" in found["versions"]
    return json_ready(found)


def test_truth_says_every_rate() -> None:
    heading = "crossing, 10,598 triangles"
    found = told(truth.benchmark_truth(view("crossing"), (8, 12), 2), truth.table, truth.MEANINGS, heading)
    assert set(found) == {"scene", "repeat", "meanings", "races", "machine", "versions"}
    assert found["scene"]["name"] == "crossing" and found["repeat"] == 2
    assert [race["resolution"] for race in found["races"]] == [[8, 8], [12, 12]]
    for race in found["races"]:
        assert_rates(race["mpixel_per_s"], truth.MEANINGS, ("slowest", "fastest"))
        assert_ratios(race["ratios"], race["mpixel_per_s"])
        assert set(race["ratios"]) >= {"certified/mitsuba", "certified/trimesh"}


@pytest.mark.parametrize("kind", ["truth", "judge", "plate"])
def test_the_command_prints_one_object(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    sizes = ["--resolution", "8", "--repeat", "2"]
    more = ["--hogels", "2", "--triangles", "1000"] if kind == "judge" else []
    assert main(["bench", kind, "crossing", *sizes, *more, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["machine"]) >= {"processor", "cores"} and "moderngl" in found["versions"]
    scenes = found["scenes"] if kind == "judge" else [found]
    assert [one["scene"]["triangles"] for one in scenes] == ([10598, 1000] if kind == "judge" else [10598])


def test_judge_says_every_rate_and_stage() -> None:
    scene = judge.globes_through_a_plate(1000)
    measured = judge.benchmark_judge([scene], (8,), 2, 1)
    names = judge.MEANINGS | judge.STAGES
    found = told(measured, judge.table, names, f"{scene.name}, 1,000 triangles")
    assert found["hogels"] == 2 and found["repeat"] == 1
    for race in found["scenes"][0]["races"]:
        assert race["resolution"] == [8, 8]
        assert_rates(race["hogels_per_second"], judge.MEANINGS, ("lowest", "highest"))
        assert_ratios(race["ratios"], race["hogels_per_second"])
        assert set(race["cpu_s"]) == set(judge.STAGES) and min(race["cpu_s"].values()) >= 0
        assert set(race["judging_over_drawing"]) == {"without radiance", "with radiance"}


def test_plate_says_every_rate_and_stage() -> None:
    """Also of a scene that asks for sub-apertures, over which plates are averaged and plain loops are not."""
    scene = view("grating")
    found = told(plate.benchmark_plate(scene, 8, 1), plate.table, plate.MEANINGS, "grating, ")
    assert_rates(found["hogels_per_second"], plate.MEANINGS, ("lowest", "highest"))
    assert_ratios(found["ratios"], found["hogels_per_second"])
    assert found["hogels"] == scene.plate.hogels[0] and found["resolution"] == [8, 8]
    assert found["row"] == scene.plate.middle.row
    assert set(found["stages_s"]) == {"upload", "C", "C*", "read-back"}
    assert all(set(clocks) == {"gpu_s", "wall_s"} for clocks in found["stages_s"].values())


def test_the_ratio_to_a_contestant_that_does_not_run_here_is_open() -> None:
    rates = {name: Timing.of([rate]) for name, rate in {"a": 2.0, "b": 8.0}.items()}
    assert ratios_of(rates, [("b", "a"), ("b", "c")]) == {"b/a": 4.0, "b/c": None}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["truth", "crossing", "--resolution", "512,-1"], "--resolution"),
        (["truth", "crossing", "--resolution", "0"], "positive whole numbers"),
        (["truth", "crossing", "--resolution", "many"], "--resolution"),
        (["truth", "crossing", "--resolution", "8", "--repeat", "0"], "--repeat"),
        (["truth", "empty"], "has no triangles to measure"),
        (["plate", "empty"], "has no triangles to measure"),
        (["judge", "empty", "--resolution", "8"], "has no triangles to measure"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *words]) == 2
    printed = capsys.readouterr()
    assert told in printed.err
    assert printed.out == "" and printed.err.count("\n") == 1


@pytest.mark.parametrize("name", ["car", "asymmetric-recentered"])
def test_all_contestants_for_the_truth_answer_for_the_same_lines(name: str) -> None:
    """Where the truth is proven and no tracer was overruled, all see the same triangles."""
    scene = view(name, (40, 30))
    aperture = scene.plate.middle
    found: dict[str, Callable[[], Any]] = dict(truth.truth_contestants(scene, aperture))
    image = found[truth.TRUTH]()
    assert isinstance(image, HogelImage) and image.overruled is not None
    # The bare tracers know no far end: a hit beyond it is theirs alone.
    same = ~image.overruled & image.covered
    assert same.mean() > 0.05
    bands = list(Reference(scene).decide(aperture))
    np.testing.assert_array_equal(np.concatenate([band.triangle for band in bands]), image.triangle)
    first = np.asarray(found[truth.EMBREE]()).reshape(30, 40)
    np.testing.assert_array_equal(first[same], image.triangle[same])
    _, ray, hit = found[truth.TRIMESH]()
    seen = np.full(same.size, NOTHING)
    seen[ray] = hit
    # Not in robust mode, it may miss a line near an edge.
    assert (seen.reshape(30, 40) == image.triangle)[same].mean() > 0.99
    if truth.MITSUBA in found:
        met = found[truth.MITSUBA]().prim_index.numpy()
        np.testing.assert_array_equal(met.reshape(30, 40)[same], image.triangle[same])


def test_all_contestants_for_judging_find_the_same_and_a_plain_loop_nearly() -> None:
    """On a scene without edges between objects nearby, a plain loop miscounts few pixels."""
    scene = view("asymmetric", (48, 48))
    apertures = judge.spread_over(scene, 3)
    with Judge(scene) as judging, Rasterizer(scene) as rasterizer:
        streamed = judge.judged_in_stream(judging, apertures)
        assert streamed == judge.judged_in_loop(judging.reference, rasterizer, apertures)
        mesh = RayMeshIntersector(Trimesh(scene.vertices, scene.faces, process=False))
        plain = judge.judged_plainly(scene, rasterizer, mesh, apertures)
    for (wrong, p99), judged in zip(plain, streamed, strict=True):
        assert judged.displacement_px is not None
        assert p99 == pytest.approx(judged.displacement_px.p99, abs=1e-3)
        # It counts displaced silhouettes, whose points the true frustum sees all the same.
        assert wrong < 0.05


def test_stages_are_what_each_part_takes_beyond_the_parts_within_it() -> None:
    parts = dict(zip(judge.STAGES, (1.0, 8.0, 6.0, 1.0, 4.0, 2.0, 5.0), strict=True))
    stages = judge.stages_of(parts)
    assert list(stages.values()) == [1.0, 2.0, 5.0, 1.0, 3.0, 2.0, 3.0]
    assert judge.stages_of({**parts, judge.POINTS: 0.5})[judge.POINTS] == 0.0
    ratios = judge.judging_over_drawing(stages)
    assert ratios == {"without radiance": 8.0 / 4.0, "with radiance": 11.0 / 4.0}
