"""Benchmarks describe their measures, and contestants agree; no test measures speed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.support.commands import Command
from tests.support.views import view
from xfrustum import HogelImage, InputError, Reference
from xfrustum.raster.drawing import reflecting
from xfrustum.reference.llvm import array_device, mitsuba_backend
from xfrustum.reports.common.outputs import json_ready
from xfrustum.research import benchmarks, paper
from xfrustum.research.paper import PAPER, mirrored, tessellated_car
from xfrustum.scenes import NOTHING
from xfrustum.scenes.library import builtin
from xfrustum.scenes.model.effects import Effect, needed


@pytest.mark.parametrize(
    ("words", "key", "meanings"),
    [
        ("truth crossing --resolution=8,12", "mpixel_per_s", benchmarks.TRUTH_MEANINGS),
        (
            "judge crossing --resolution=8 --hogels=2",
            "hogels_per_second",
            benchmarks.JUDGE_MEANINGS,
        ),
        pytest.param(
            # The plate is averaged over the grating's sub-apertures; the plain loop is not.
            "plate grating --resolution=8",
            "hogels_per_second",
            benchmarks.PLATE_MEANINGS,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_benchmark_prints_a_rate_of_each_contestant(
    words: str, key: str, meanings: dict[str, str], command: Command
) -> None:
    result = command(f"bench {words} --repeat=1 --json").record
    assert result["arrays"] == array_device() and result["renderer"]
    assert result["meanings"] == meanings
    scenes = result.get("scenes", [result])
    for race in (race for scene in scenes for race in scene.get("races", [scene])):
        rates = race[key]
        assert set(rates) == set(meanings)
        for name, rate in rates.items():
            assert rate["median"] > 0 if rate else name == "mitsuba" and mitsuba_backend().scalar
        for pair, ratio in race["ratios"].items():
            item, other = pair.split("/")
            assert ratio is None or ratio == pytest.approx(
                rates[item]["median"] / rates[other]["median"]
            )


def test_all_contestants_for_the_truth_answer_for_the_same_lines() -> None:
    scene = view("asymmetric-recentered", (40, 30))
    aperture = scene.plate.middle
    result: dict[str, Callable[[], Any]] = dict(benchmarks.truth_contestants(scene, aperture))
    image = result["truth"]()
    assert isinstance(image, HogelImage) and image.overruled is not None
    # The bare tracers have no far plane: only they return hits beyond it.
    same = ~image.overruled & image.covered
    assert same.mean() > 0.05
    bands = list(Reference(scene).decide(aperture))
    np.testing.assert_array_equal(np.concatenate([band.triangle for band in bands]), image.triangle)
    first = np.asarray(result["embree"]()).reshape(30, 40)
    np.testing.assert_array_equal(first[same], image.triangle[same])
    _, ray, hit = result["trimesh"]()
    seen = np.full(same.size, NOTHING)
    seen[ray] = hit
    # Outside robust mode, Embree may miss a line near an edge.
    assert (seen.reshape(30, 40) == image.triangle)[same].mean() > 0.99
    if "mitsuba" in result:
        met = result["mitsuba"]().prim_index.numpy()
        np.testing.assert_array_equal(met.reshape(30, 40)[same], image.triangle[same])


@pytest.mark.parametrize("row", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_the_car_has_the_counts_and_mirrors_of_the_paper_and_its_own_area(row: int) -> None:
    polygons, share, _ = PAPER[row]
    car = tessellated_car(polygons, share)
    mirrors = round(share * polygons)
    assert len(car.scene.faces) == polygons and np.count_nonzero(car.reflective) == mirrors

    def area(triangles: Any) -> float:
        a, b, c = np.moveaxis(triangles, 1, 0)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    for part, original in zip(car.scene.objects, builtin.build("car").objects, strict=True):
        before = area(original.vertices[original.faces])
        assert area(part.vertices[part.faces]) == pytest.approx(before, rel=1e-12)
    # Drawn with mirrors: the same triangles in the same order, the first ones reflective
    scene = mirrored(car)
    np.testing.assert_array_equal(scene.triangles, car.scene.triangles)
    assert reflecting(scene) == [(0, mirrors)]
    assert {Effect.REFLECTION, Effect.SMOOTH_NORMALS} <= needed(scene)


def test_a_car_of_fewer_triangles_is_refused() -> None:
    with pytest.raises(InputError, match="at least 41,896"):
        tessellated_car(1000, 0.3)


@pytest.mark.slow
def test_table_1_is_measured_in_the_terms_of_the_paper() -> None:
    result = paper.benchmark_table1(8, 1, 1)
    assert "RealityEngine2 (1996), antialiasing on" in paper.table1_table(result)
    (row,) = json_ready(result)["rows"]
    assert (row["polygons"], round(row["reflective_share"], 3)) == (42382, 0.312)
    rate, on = row["frames_per_second"], row["antialiased"]
    assert row["polygons_per_second"] == pytest.approx(row["polygons"] * rate)
    # Every triangle is in the frusta; none is drawn more than twice.
    assert 0 < row["submitted_polygons_per_second"] < 2 * row["polygons_per_second"]
    old = row["paper"]["RealityEngine2"]["frames_per_second"]
    assert on["factor"] == pytest.approx(on["frames_per_second"] / old)


def test_the_published_numbers_are_those_of_the_paper(shared_data: Path) -> None:
    text = (shared_data / "paper.txt").read_text()
    for polygons, share, machines in PAPER:
        speeds = " | ".join(f"{frames} | {rate:,}" for frames, rate in machines.values())
        assert f"| {polygons:,} | {100 * share:.1f}% | {speeds} |" in text


def test_rays_are_raced_on_a_mesh_of_a_file(tmp_path: Path, command: Command) -> None:
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.stl")
    line = f"bench rays {tmp_path}/ball.stl --rays=50 --repeat=1"
    races = command(f"{line} --json").record["races"]
    assert [race["kind"] for race in races] == ["random", "coherent", "grazing"]
    for race in races:
        assert (race["mesh"], race["triangles"], race["rays"]) == ("ball", 80, 50)
        assert race["ratios"]["exact/embree"] > 0
    assert "exact/embree" in command(line).out
    command(f"bench rays {tmp_path}/none.stl", status=2)
