"""Wrong surfaces beyond snapped creases, compared with closed-form lengths and drawn images."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.support.views import at, reversed_d32f
from xfrustum.compare.attribution import make_budget
from xfrustum.compare.prediction.predict import make_chain
from xfrustum.compare.prediction.silhouettes import crease_pixels
from xfrustum.compare.rounding.triangles import POSITION_TOLERANCE
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Frustum, Plate, Scene, SceneObject
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.shapes import build_shape, refine

AXIS = at(0.0, 0.0)
PIXELS, SLOPE = 256, 0.5
SUBPIXEL_BITS = 8


def pleated(heights: list[float], turned: float = 17.0, depth: float = 40.0) -> Scene:
    """Return a sheet behind the plate, with creases across the film at heights above its middle."""
    angle = math.radians(turned)
    along, across = np.array(
        [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    )
    places = np.linspace(-8.0, 8.0, len(heights))
    ends = np.array([-11.0, 11.0])
    xy = places[:, None, None] * across + ends[:, None] * along
    z = np.broadcast_to(np.array(heights)[:, None, None] - depth, (len(heights), 2, 1))
    first = 2 * np.arange(len(heights) - 1)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [2, 1, 3]])).reshape(-1, 3)
    vertices = np.concatenate((xy, z), axis=-1).reshape(-1, 3)
    return Scene(
        name="pleated",
        plate=Plate(size=(1.0, 1.0), hogels=(1, 1)),
        frustum=Frustum(
            resolution=(PIXELS, PIXELS), reach=(100.0, 100.0), fov=(2 * math.atan(SLOPE),) * 2
        ),
        objects=(SceneObject(name="sheet", vertices=vertices, faces=faces),),
    )


def predicted(scene: Scene) -> float:
    return crease_pixels(Reference(scene).trace(AXIS), scene, SUBPIXEL_BITS)


@cache
def snapped_shifts() -> Floats:
    """Return shifts of random edges along their normals, in px, when their ends snap."""
    random, count = np.random.default_rng(1), 200_000
    ends, place = random.uniform(0, 300, (2, count, 2)), random.uniform(0, 1, (count, 1))
    off = np.rint(ends * 2**SUBPIXEL_BITS) / 2**SUBPIXEL_BITS - ends
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0], axis=1)[:, None]
    moved = off[0] + place * (off[1] - off[0])
    return np.asarray(np.abs(along[:, 0] * moved[:, 1] - along[:, 1] * moved[:, 0]))


@pytest.mark.parametrize(("turned", "side"), [(0.0, -1.0), (17.0, -1.0), (61.0, 1.0)])
def test_a_valley_counts_its_length_and_a_ridge_nothing(turned: float, side: float) -> None:
    """The whole crease is visible and lies 3 behind the edges of the sheet, or 3 before them.

    Both sides lean by an angle b: a point of one side, shown at x beyond the crease, is 2 x sin(b)
    off the other side's plane.
    """
    valley, ridge = ([0.0, sign * 3.0, 0.0] for sign in (-1, 1))
    # Before the plate, the viewer sees a valley from the same side, and it is 6 nearer.
    distance = 43.0 if side < 0 else 37.0
    pixel = 2 * SLOPE * distance / PIXELS
    seen = POSITION_TOLERANCE * max(distance, 40.0) / (2 * math.sin(math.atan(3 / 8)) * pixel)
    expected = 22.0 / pixel * np.maximum(snapped_shifts() - seen, 0.0).mean()
    assert predicted(pleated(valley, turned, -40.0 * side)) == pytest.approx(expected, rel=0.02)
    assert predicted(pleated(ridge, turned, -40.0 * side)) == 0


def test_the_number_of_triangles_makes_no_difference() -> None:
    scene = pleated([0.0, -3.0] * 4 + [0.0])
    assert predicted(refine(scene, 3)) == pytest.approx(predicted(scene), rel=0.02)


def test_a_crease_that_hides_points_by_less_than_their_tolerance_counts_nothing() -> None:
    """Half a subpixel beyond the crease, the other plane is only 1e-6 behind."""
    assert predicted(pleated([0.0, -1e-3, 0.0])) == 0


def test_pleats_are_drawn_with_as_many_wrong_pixels_as_predicted() -> None:
    """The tolerance allows for chance if wrong pixels come in pairs; ridges have none."""
    measured, expected = 0, 0.0
    for turned in np.linspace(5, 85, 10):
        scene = pleated([0.0, -0.6] * 60 + [0.0], float(turned))
        reference = Reference(scene)
        with Rasterizer(scene) as rasterizer:
            chain = make_chain(reference, rasterizer, AXIS, reversed_d32f(1e-4))
            cause = make_budget(reference, chain).causes[-2]
        assert cause.name == "rasterization" and cause.predicted_surface is not None
        measured, expected = measured + cause.surface, expected + cause.predicted_surface
    assert expected > 50
    assert abs(measured - expected) < 3 * math.sqrt(2 * expected)


def test_sides_have_their_twins() -> None:
    """Check twins in a closed box, in a box without one triangle, and at an edge of three wings."""

    def twins(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        part = SceneObject(name="part", vertices=vertices, faces=faces)
        return replace(pleated([0.0, 0.0]), objects=(part,)).twins.ravel()

    box = build_shape("box")
    closed = twins(box.vertices, box.faces)
    sides = np.arange(closed.size)
    assert (closed[closed] == sides).all() and (closed != sides).all()
    assert (twins(box.vertices, box.faces[1:]) < 0).sum() == 3
    wings = np.concatenate((np.zeros((1, 3)), np.eye(3), [[0.0, -1.0, 0.0]]))
    assert (twins(wings, np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])) < 0).all()
