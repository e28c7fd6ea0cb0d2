"""Mistakes of the scene are found from images: axes, and objects left out, moved, turned or resized."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import xfrustum
from tests.wrong_renderers.ray_caster import picture
from tests.wrong_renderers.worlds import Floats, Part, World, attic
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.changed_scene import SceneChange, changed
from xfrustum.reference import Reference
from xfrustum.scenes import open_scene

Move = tuple[float, float, float]
AXES = {"x, y, -z": (0, 1, 2), "x, z, y": (0, 2, 1)}


@cache
def world() -> World:
    return replace(attic(), hogels=(2, 2), resolution=(40, 40))


def with_object(number: int, scale: float = 1.0, turn: Move = (0, 0, 0), move: Move = (0, 0, 0)) -> World:
    """Return the world with one object resized and turned about its middle, and moved."""

    def changed(part: Part) -> Part:
        corners: Floats = part.corners
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        turned = (corners - middle) @ Rotation.from_rotvec(np.radians(turn)).as_matrix().T
        return replace(part, corners=turned * scale + middle + move)

    parts = [changed(part) if number == place else part for place, part in enumerate(world().parts)]
    return replace(world(), parts=tuple(parts), drawn={})


def found_in(drawn: World, folder: Path, encoding: str = "triangle-id", **pixels: int) -> list[Fault]:
    """Return what `verify` finds in pictures of a changed world."""
    scene = world().write(folder)
    for i, j in world().apertures:
        Image.fromarray(np.ascontiguousarray(picture(drawn, i, j, encoding))).save(folder / f"{i}-{j}.png")
    found = xfrustum.verify(str(scene), str(folder / "{i}-{j}.png"), encoding=encoding)
    assert not found.passed
    summary = found.summary()
    assert not found.diagnosis.faults or summary["corrected"]["wrong"] < 0.1 * summary["as_found"]["wrong"]
    return list(found.diagnosis.faults)


@pytest.mark.parametrize("encoding", ["triangle-id", "object-id"])
def test_an_object_that_is_left_out_has_its_name(tmp_path: Path, encoding: str) -> None:
    (fault,) = found_in(with_object(1, move=(0.0, 0.0, -1e3)), tmp_path, encoding)
    assert (fault.fault, fault.value) == ("object-missing", "object 1 (scarf)")
    assert fault.words == "object 1 (scarf) is missing: it is not drawn"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "change", "fault", "value", "words"),
    [
        (1, {"move": (0.6, 0.0, 0.0)}, "object-moved", 0.6, "object 1 (scarf) is 0.6 mm to the right"),
        (2, {"turn": (0.0, 0.0, 25.0)}, "object-turned", 25.0, "turned by 25 degrees about z"),
        (0, {"scale": 1.1}, "object-scale", 1.1, "times as large as asked, about its middle"),
    ],
)
def test_an_object_that_is_elsewhere_has_its_name(
    tmp_path: Path, number: int, change: dict[str, Move], fault: str, value: float, words: str
) -> None:
    (found,) = found_in(with_object(number, **change), tmp_path)  # type: ignore[arg-type]
    assert found.fault == fault
    assert float(found.value) == pytest.approx(value, rel=0.02)
    assert words in found.words


@pytest.mark.slow
@pytest.mark.parametrize("axes", AXES)
def test_axes_that_are_exchanged_are_named(tmp_path: Path, axes: str) -> None:
    order = list(AXES[axes])
    signs = [-1.0 if one.startswith("-") else 1.0 for one in axes.split(", ")]
    parts = tuple(replace(part, corners=part.corners[:, order] * signs) for part in world().parts)
    found = found_in(replace(world(), parts=parts, drawn={}), tmp_path)
    name = "z-negated" if axes == "x, y, -z" else "axes-exchanged"
    assert [(fault.fault, fault.value) for fault in found] == [(name, axes)]


def test_changes_keep_numbers_and_leave_the_scene_as_it_is(tmp_path: Path) -> None:
    reference = Reference(open_scene(str(world().write(tmp_path))))
    scene, before = reference.scene, reference.scene.vertices.copy()
    changes = (SceneChange(part=1, missing=True), SceneChange(part=0, offset=(1.0, 0.0, 0.0)))
    other = changed(reference, changes).scene
    assert (other.faces == scene.faces).all() and (scene.vertices == before).all()
    assert np.allclose(other.objects[0].vertices - scene.objects[0].vertices, (1.0, 0.0, 0.0))
    assert other.objects[1].vertices[:, 2].max() < -max(scene.frustum.reach)
    assert (
        other.objects[2].vertices is not None
        and (other.objects[2].vertices == scene.objects[2].vertices).all()
    )
    assert changed(reference, ()) is reference
