"""Mistakes of single hogels and rows are named, and hide no diagnosis of the others."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import xfrustum
from tests.wrong_renderers.ray_caster import RIGHT, Mistakes, Picture, picture
from tests.wrong_renderers.worlds import World, harbor
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.conventions import Orientation
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reports.verification.verdict import render_page, table

Draw = Callable[[World, int, int], Picture]


def found_in(draw: Draw, folder: Path) -> dict[str, Fault]:
    """Return what `verify` finds in the triangle numbers that somebody draws."""
    world = replace(harbor(), resolution=(48, 36), drawn={})
    scene = world.write(folder)
    for i, j in world.apertures:
        Image.fromarray(np.ascontiguousarray(draw(world, i, j))).save(folder / f"{i}-{j}.png")
    found = xfrustum.verify(str(scene), str(folder / "{i}-{j}.png"), encoding="triangle-id")
    assert not found.passed
    summary = found.summary()
    assert summary["corrected"]["wrong"] < 0.1 * summary["as_found"]["wrong"]
    return {fault.fault: fault for fault in found.diagnosis.faults}


def drawn(world: World, i: int, j: int, wrong: Mistakes = RIGHT) -> Picture:
    return picture(world, i, j, "triangle-id", wrong)


def test_a_stale_hogel_is_named_beside_what_is_wrong_with_all(tmp_path: Path) -> None:
    def draw(world: World, i: int, j: int) -> Picture:
        return drawn(world, *((0, 1) if (i, j) == (1, 1) else (i, j)))[:, ::-1]

    found = found_in(draw, tmp_path)
    assert set(found) == {"orientation", "stale-hogel"}
    assert found["stale-hogel"].words == "hogel 1,1 shows 0,1's image"


@pytest.mark.slow
def test_exchanged_hogels_are_named(tmp_path: Path) -> None:
    def draw(world: World, i: int, j: int) -> Picture:
        return drawn(world, *{(1, 1): (2, 0), (2, 0): (1, 1)}.get((i, j), (i, j)))

    (fault,) = found_in(draw, tmp_path).values()
    assert fault.fault == "hogels-exchanged"
    assert fault.words == "hogel 2,0 shows 1,1's image; hogel 1,1 shows 2,0's image"


@pytest.mark.slow
def test_rows_that_are_shifted_are_named(tmp_path: Path) -> None:
    def draw(world: World, i: int, j: int) -> Picture:
        right = drawn(world, i, j)
        right[1::2, 1:] = right[1::2, :-1].copy()
        return right

    (fault,) = found_in(draw, tmp_path).values()
    assert (fault.fault, fault.value) == ("rows-shifted", 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("staggered", [True, False])
def test_apertures_with_offsets_of_their_own_are_named(tmp_path: Path, *, staggered: bool) -> None:
    def draw(world: World, i: int, j: int) -> Picture:
        right, up = np.random.default_rng([i, j]).normal(0, 0.2, 2).tolist()
        return drawn(world, i, j, Mistakes(aperture=(0.0, 0.5 * (i % 2)) if staggered else (right, up)))

    (fault,) = found_in(draw, tmp_path).values()
    assert fault.fault == ("columns-shifted" if staggered else "jitter")
    assert not staggered or "odd columns" in fault.words


@pytest.mark.parametrize("scale", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_where_nothing_is_named_it_is_said_where_it_is_wrong(tmp_path: Path, scale: int) -> None:
    width, height = 24 * scale, 18 * scale
    world = replace(harbor(), resolution=(width, height), drawn={})
    scene = world.write(tmp_path)
    noise = np.random.default_rng(0).integers(0, 3, (height, width, 3), dtype=np.uint8)
    for i, j in world.apertures:
        right = drawn(world, i, j)
        broken = np.where(right.any(axis=2, keepdims=True), noise, right) if (i, j) == (2, 0) else right
        Image.fromarray(broken).save(tmp_path / f"{i}-{j}.png")
    found = xfrustum.verify(str(scene), str(tmp_path / "{i}-{j}.png"), encoding="triangle-id")
    where = found.summary()["where"]
    assert not found.diagnosis.faults
    assert where["shares"]["column"]["0"]["wrong"] == where["shares"]["row"]["1"]["wrong"] == 0
    wrong = where["shares"]["row"]["0"]["wrong"]
    assert where["shares"]["column"]["2"]["wrong"] == sum(where["sides"].values()) == wrong > 0
    assert where["sides"]["front"] > 0 and where["sides"]["back"] > 0 and "3 (buoy)" in where["objects"]
    assert where["hogels"] == [[wrong if (i, j) == (2, 0) else 0 for i in range(3)] for j in range(2)]
    assert "wrong by column of hogels: 2 " in table(found)
    assert "by column of hogels: 2 " in render_page(found)


def test_shifted_lines_are_undone() -> None:
    found = np.arange(42).reshape(6, 7)
    for axis in (0, 1):
        model = DrawnModel(orientation=Orientation(True, False, True), odd_lines=(axis, 2))
        assert np.array_equal(model.applied(model.upright(found)), found)
        assert not np.array_equal(model.upright(found), replace(model, odd_lines=None).upright(found))
