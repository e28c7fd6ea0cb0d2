"""Table 1 of the paper is measured in its terms, on a car in its numbers of triangles."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from xfrustum.cli.main import main
from xfrustum.raster.drawing import reflecting
from xfrustum.reports.benchmarks.table1 import PAPER, Database, benchmark_table1
from xfrustum.reports.benchmarks.table1 import table as table_1
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.timing import race
from xfrustum.scenes import InputError, SceneObject
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.studio import mirrored, tessellated_car
from xfrustum.scenes.model.effects import Effect, needed


def test_contestants_take_turns_and_the_first_turn_does_not_count() -> None:
    order: list[str] = []
    done: list[None] = []
    runs = {name: partial(order.append, name) for name in "ab"}
    seconds = race(runs, 2, lambda: done.append(None))
    assert order == list("ababab") and len(done) == 6
    assert {name: spread.repetitions for name, spread in seconds.items()} == {"a": 2, "b": 2}


@pytest.mark.parametrize(
    "paper",
    [PAPER[0], *(pytest.param(paper, marks=pytest.mark.slow) for paper in PAPER[1:])],
    ids=lambda paper: str(paper.polygons),
)
def test_the_car_has_the_papers_counts_and_the_same_surface(paper: Database) -> None:
    car = tessellated_car(paper.polygons, paper.reflective_share)
    assert len(car.scene.faces) == paper.polygons
    assert np.count_nonzero(car.reflective) == round(paper.reflective_share * paper.polygons)
    assert car.reflective[: np.count_nonzero(car.reflective)].all()
    for part, original in zip(car.scene.objects, builtin.build("car").objects, strict=True):
        assert area(part) == pytest.approx(area(original), rel=1e-12)
        # The mesh has neither cracks nor vertices in the middle of an edge.
        assert boundary(part) == pytest.approx(boundary(original), rel=1e-12)
        assert euler(part) == euler(original)


def area(part: SceneObject) -> float:
    a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def edges_of(part: SceneObject) -> tuple[np.ndarray, np.ndarray]:
    sides = np.stack([part.faces, np.roll(part.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, uses = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    return edges, uses


def boundary(part: SceneObject) -> float:
    """Return the length of all edges that bound one face only."""
    edges, uses = edges_of(part)
    ends = part.vertices[edges[uses == 1]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())


def euler(part: SceneObject) -> int:
    return len(np.unique(part.faces)) - len(edges_of(part)[0]) + len(part.faces)


def test_a_car_of_fewer_triangles_is_refused() -> None:
    with pytest.raises(InputError, match="at least 41,896"):
        tessellated_car(1000, 0.3)


def test_table_1_is_measured_in_the_papers_terms() -> None:
    found = benchmark_table1(8, 1, PAPER[:1])
    text, told = table_1(found), json_ready(found)
    assert text.count("42,382") == 4
    assert "antialiasing on (4 samples)" in text
    assert re.search(r"RealityEngine2 \(1996\), antialiasing on", text)
    assert re.search(r"Maximum Impact \(1996\), antialiasing off", text)
    (row,) = told["rows"]
    assert told["antialiasing"] is False
    assert (row["polygons"], round(row["reflective_share"], 3)) == (42382, 0.312)
    rate, on = row["frames_per_second"], row["antialiased"]
    assert row["polygons_per_second"] == pytest.approx(row["polygons"] * rate)
    for name, machine in row["paper"].items():
        assert row["factors"][name] == pytest.approx(rate / machine["frames_per_second"])
    # Every triangle is somewhere in the frusta, and none is drawn more than twice.
    assert 0 < row["submitted_polygons_per_second"] < 2 * row["polygons_per_second"]
    assert on["samples"] == 4
    assert on["frames_per_second"] == pytest.approx(1 / on["seconds_per_frame"]["median"])
    old = row["paper"]["RealityEngine2"]["frames_per_second"]
    assert on["factor"] == pytest.approx(on["frames_per_second"] / old)
    without = on["seconds_per_frame_without"]["median"]
    assert on["slowdown"] == pytest.approx(on["seconds_per_frame"]["median"] / without)


@pytest.mark.slow
def test_the_command_prints_both_cars_of_table_1(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "table1", "--resolution", "8", "--repeat", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [row["polygons"] for row in rows] == [42382, 272074]
    assert [round(row["reflective_share"], 3) for row in rows] == [0.312, 0.479]
    assert all(set(row["paper"]) == {"RealityEngine2", "Maximum Impact"} for row in rows)


def test_the_papers_numbers_are_the_papers(shared_data: Path) -> None:
    text = (shared_data / "paper.txt").read_text()
    for row in PAPER:
        old = row.machines["RealityEngine2"], row.machines["Maximum Impact"]
        speeds = " | ".join(f"{m.frames_per_second} | {m.polygons_per_second:,}" for m in old)
        assert f"| {row.polygons:,} | {100 * row.reflective_share:.1f}% | {speeds} |" in text


def test_the_reflective_triangles_are_the_mirrors_of_the_picture() -> None:
    """In the same triangles in the same order, so that the first of them are reflective."""
    car = tessellated_car(42_382, 0.312)
    scene = mirrored(car)
    np.testing.assert_array_equal(scene.triangles, car.scene.triangles)
    assert reflecting(scene) == [(0, int(car.reflective.sum()))]
    assert Effect.REFLECTION in needed(scene) and Effect.SMOOTH_NORMALS in needed(scene)
