"""Benchmarks say what they measured; how fast anything is, is no test's business."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.raster.drawing import reflecting
from xfrustum.reference import Reference
from xfrustum.reference.llvm import array_device, mitsuba_backend
from xfrustum.reports.common.outputs import json_ready
from xfrustum.research import benchmarks, table1
from xfrustum.research.benchmarks import GLOBE_REACH, GLOBES, globes
from xfrustum.research.table1 import PAPER, mirrored, tessellated_car
from xfrustum.scenes import NOTHING, HogelImage, InputError
from xfrustum.scenes.library import builtin
from xfrustum.scenes.model.effects import Effect, needed

Told = Callable[..., tuple[dict[str, Any], str]]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Told:
    """Run a benchmark by its command; return the object that it prints, and the same measurement as text."""

    def run(kind: str, *words: str) -> tuple[dict[str, Any], str]:
        measure, records = getattr(benchmarks, f"benchmark_{kind}"), []

        def measured(*what: Any, **given: Any) -> Any:
            records.append(measure(*what, **given))
            return records[0]

        monkeypatch.setattr(benchmarks, f"benchmark_{kind}", measured)
        assert main(["bench", kind, *words, "--json"]) == 0
        return json.loads(capsys.readouterr().out), getattr(benchmarks, f"{kind}_table")(records[0])

    return run


def assert_table(text: str, heading: str, names: dict[str, str], found: dict[str, Any]) -> None:
    """See that a table names the scene, and every contestant with its meaning."""
    lines = text.splitlines()
    assert any(line.startswith(heading) for line in lines)
    assert all(any(line.startswith(name) for line in lines) for name in names)
    assert set(found["machine"]) >= {"processor", "cores"} and "moderngl" in found["versions"]
    assert found["arrays"] == array_device() and found["renderer"] in text


def assert_race(
    made: dict[str, Any], key: str, meanings: dict[str, str], ends: tuple[str, str]
) -> None:
    rates = made[key]
    assert set(rates) == set(meanings)
    for name, rate in rates.items():
        if rate is None:
            assert name == "mitsuba" and mitsuba_backend().scalar
        else:
            assert 0 < rate[ends[0]] <= rate["median"] <= rate[ends[1]]
    for pair, ratio in made["ratios"].items():
        one, other = pair.split("/")
        assert ratio is None or ratio == pytest.approx(
            rates[one]["median"] / rates[other]["median"]
        )


def test_truth_says_every_rate(told: Told) -> None:
    found, text = told("truth", "crossing", "--resolution", "8,12", "--repeat", "2")
    assert_table(text, "crossing, 10,598 triangles", benchmarks.TRUTH_MEANINGS, found)
    assert {"scene", "repeat", "meanings", "devices", "races", "machine", "versions"} < set(found)
    assert set(found["devices"]) == set(benchmarks.TRUTH_MEANINGS)
    assert found["devices"]["truth"] == found["machine"]["arrays"] == array_device()
    assert found["scene"]["name"] == "crossing" and found["repeat"] == 2
    assert [one["resolution"] for one in found["races"]] == [[8, 8], [12, 12]]
    for one in found["races"]:
        assert_race(one, "mpixel_per_s", benchmarks.TRUTH_MEANINGS, ("slowest", "fastest"))
        assert set(one["ratios"]) >= {"certified/mitsuba", "certified/trimesh"}


def test_judge_says_every_rate_and_stage(told: Told) -> None:
    sizes = ("--resolution", "8", "--hogels", "2", "--repeat", "1", "--triangles", "1000")
    found, text = told("judge", "crossing", *sizes)
    names = benchmarks.JUDGE_MEANINGS | benchmarks.STAGES
    assert_table(text, "globes", names, found)
    assert found["hogels"] == 2 and found["repeat"] == 1
    assert [one["scene"]["triangles"] for one in found["scenes"]] == [10598, 1000]
    for one in (each for scene in found["scenes"] for each in scene["races"]):
        assert one["resolution"] == [8, 8]
        assert_race(one, "hogels_per_second", benchmarks.JUDGE_MEANINGS, ("lowest", "highest"))
        assert set(one["devices"]) == set(benchmarks.JUDGE_MEANINGS)
        assert set(one["cpu_s"]) == set(benchmarks.STAGES) and min(one["cpu_s"].values()) >= 0
        assert set(one["judging_over_drawing"]) == {"without radiance", "with radiance"}


@pytest.mark.slow
def test_plate_says_every_rate_and_stage(told: Told) -> None:
    """Also of a scene that asks for sub-apertures, over which plates are averaged and plain loops are not."""
    found, text = told("plate", "grating", "--resolution", "8", "--repeat", "1")
    assert_table(text, "grating, ", benchmarks.PLATE_MEANINGS, found)
    assert_race(found, "hogels_per_second", benchmarks.PLATE_MEANINGS, ("lowest", "highest"))
    plate = view("grating").plate
    assert (found["hogels"], found["row"], found["resolution"]) == (
        plate.hogels[0],
        plate.middle.row,
        [8, 8],
    )
    assert found["devices"] == dict.fromkeys(benchmarks.PLATE_MEANINGS, found["device"])
    assert set(found["stages_s"]) == {"upload", "C", "C*", "read-back"}
    assert all(set(clocks) == {"gpu_s", "wall_s"} for clocks in found["stages_s"].values())


def test_all_contestants_for_the_truth_answer_for_the_same_lines() -> None:
    """Where the truth is proven and no tracer was overruled, all see the same triangles."""
    scene = view("asymmetric-recentered", (40, 30))
    aperture = scene.plate.middle
    found: dict[str, Callable[[], Any]] = dict(benchmarks.truth_contestants(scene, aperture))
    image = found["truth"]()
    assert isinstance(image, HogelImage) and image.overruled is not None
    # The bare tracers know no far end: a hit beyond it is theirs alone.
    same = ~image.overruled & image.covered
    assert same.mean() > 0.05
    bands = list(Reference(scene).decide(aperture))
    np.testing.assert_array_equal(np.concatenate([band.triangle for band in bands]), image.triangle)
    first = np.asarray(found["embree"]()).reshape(30, 40)
    np.testing.assert_array_equal(first[same], image.triangle[same])
    _, ray, hit = found["trimesh"]()
    seen = np.full(same.size, NOTHING)
    seen[ray] = hit
    # Not in robust mode, it may miss a line near an edge.
    assert (seen.reshape(30, 40) == image.triangle)[same].mean() > 0.99
    if "mitsuba" in found:
        met = found["mitsuba"]().prim_index.numpy()
        np.testing.assert_array_equal(met.reshape(30, 40)[same], image.triangle[same])


@pytest.mark.parametrize("triangles", [1000, 100_000])
def test_globes_have_exactly_as_many_triangles_as_they_say_on_the_same_ellipsoids(
    triangles: int,
) -> None:
    scene = globes(triangles)
    assert len(scene.faces) == triangles
    # There are neither slivers without area nor triangles beyond the reach.
    assert (np.linalg.norm(scene.normals, axis=1) > 0.5).all()
    assert np.abs(scene.vertices[:, 2]).max() < GLOBE_REACH
    ends = [
        np.sign([one.vertices[:, 2].min(), one.vertices[:, 2].max()]).tolist()
        for one in scene.objects
    ]
    assert ends == [[1, 1], [1, 1], [-1, 1], [-1, -1], [-1, -1]], (
        "before, across and behind the plate"
    )
    for part, (center, semi_axes) in zip(scene.objects, GLOBES, strict=True):
        radius = np.linalg.norm((part.vertices - np.array(center)) / np.array(semi_axes), axis=1)
        # The unit globe's coordinates are rounded to 1e-6 of its diameter.
        np.testing.assert_allclose(radius, 1, atol=2 * math.sqrt(3) * 0.5e-6)


@pytest.mark.parametrize("triangles", [0, 10, 9999, 10_010, 10_000_001])
def test_a_number_that_globes_cannot_share_evenly_is_refused(triangles: int) -> None:
    with pytest.raises(InputError, match="cannot be shared"):
        globes(triangles)


# Table 1 of the paper, on a car in its numbers of triangles


@pytest.mark.parametrize("row", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_the_car_has_the_papers_counts_and_the_same_area(row: int) -> None:
    polygons, share, _ = PAPER[row]
    car = tessellated_car(polygons, share)
    assert len(car.scene.faces) == polygons
    assert np.count_nonzero(car.reflective) == round(share * polygons)
    assert car.reflective[: np.count_nonzero(car.reflective)].all()
    for part, original in zip(car.scene.objects, builtin.build("car").objects, strict=True):
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        edges = original.vertices[original.faces][:, 1:] - original.vertices[original.faces][:, :1]
        before = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
        assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(
            before, rel=1e-12
        )


def test_a_car_of_fewer_triangles_is_refused() -> None:
    with pytest.raises(InputError, match="at least 41,896"):
        tessellated_car(1000, 0.3)


@pytest.mark.slow
def test_table_1_is_measured_in_the_papers_terms() -> None:
    found = table1.benchmark_table1(8, 1, 1)
    assert "RealityEngine2 (1996), antialiasing on" in table1.table1_table(found)
    (row,) = json_ready(found)["rows"]
    assert (row["polygons"], round(row["reflective_share"], 3)) == (42382, 0.312)
    rate, on = row["frames_per_second"], row["antialiased"]
    assert row["polygons_per_second"] == pytest.approx(row["polygons"] * rate)
    for name, machine in row["paper"].items():
        assert row["factors"][name] == pytest.approx(rate / machine["frames_per_second"])
    # Every triangle is somewhere in the frusta, and none is drawn more than twice.
    assert 0 < row["submitted_polygons_per_second"] < 2 * row["polygons_per_second"]
    old = row["paper"]["RealityEngine2"]["frames_per_second"]
    assert on["factor"] == pytest.approx(on["frames_per_second"] / old)


def test_the_papers_numbers_are_the_papers(shared_data: Path) -> None:
    text = (shared_data / "paper.txt").read_text()
    for polygons, share, machines in PAPER:
        speeds = " | ".join(f"{frames} | {rate:,}" for frames, rate in machines.values())
        assert f"| {polygons:,} | {100 * share:.1f}% | {speeds} |" in text


def test_the_reflective_triangles_are_the_mirrors_of_the_picture() -> None:
    """In the same triangles in the same order, so that the first of them are reflective."""
    car = tessellated_car(42_382, 0.312)
    scene = mirrored(car)
    np.testing.assert_array_equal(scene.triangles, car.scene.triangles)
    assert reflecting(scene) == [(0, int(car.reflective.sum()))]
    assert Effect.REFLECTION in needed(scene) and Effect.SMOOTH_NORMALS in needed(scene)
