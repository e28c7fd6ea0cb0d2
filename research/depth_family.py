"""Scenes that differ only in depth: the same picture on the film, from shallow to deep.

For C* objects are reflected through the aperture: no point moves on the film, but C keeps the
nearest surface of a line and C* the farthest.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from xfrustum.scenes import Aperture, Camera, Frustum, InputError, Plate, Scene, SceneObject, Screen
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.library.objects import car
from xfrustum.scenes.shapes import place, placement

REACH = 1000.0
#: Reach on both sides, scene units, and the largest |z| of any surface: the reach cuts nothing.
FARTHEST = 0.999 * REACH
#: ratio of the farthest to the nearest |z| of one car; no scene of cars is shallower
CAR_RATIO = 1.5
#: Shift of the aperture off the middle, along both axes, as a share of the reach: cars nearer than
#: about this distance lie outside the film of the middle aperture.
SHIFT_PER_REACH = 0.05
#: Shear of the recentered frustum over the film's half-extent slope, k / t, in both axes: an
#: aperture over a corner of the screen.
SHEAR_PER_SLOPE = 1.0
_FOV = math.radians(50)
_PLATE = Plate(size=(1.0, 1.0), hogels=(1, 1))
#: Places of the cars, in halves of the film's half-extent: the middles of its quarters, so that
#: none hides another at any depth; then the places in front of the plate if there are cars on both
#: sides.
_QUARTERS, _BETWEEN_QUARTERS = ((-1, 1), (1, 1), (-1, -1), (1, -1)), ((-1, 0), (1, 0))
#: Reach in millimeters and full angle of the built-in scene `car`, and the y in millimeters of a
#: row of the plate in which its body crosses the plate; and the depth of the screen of
#: `car-recentered`, in millimeters.
_CAR_REACH, _CAR_FOV, _CAR_ROW, _CAR_SCREEN = 150.0, math.radians(60), -10.0, 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenScene:
    """A scene, and the aperture that it is seen from."""

    scene: Scene
    aperture: Aperture


def cars(ratio: float, camera: Camera, resolution: tuple[int, int]) -> Scene:
    """Return cars at geometric distances before (`C_STAR`) or behind the plate (`C`).

    Each fills a quarter of the film and is scaled about the aperture, which keeps its picture. The
    farthest surface lies at `FARTHEST`, the nearest at the ratio's part of that. Raises InputError
    below `CAR_RATIO`.
    """
    return _scene(f"cars of depth {ratio:g}", resolution, _cars(ratio, camera, _QUARTERS))


def cars_on_both_sides(ratio: float, resolution: tuple[int, int]) -> SeenScene:
    """Return `cars` behind the plate and two before it, at the same |z|, that hide parts."""
    objects = _cars(ratio, Camera.C, _QUARTERS) + _cars(ratio, Camera.C_STAR, _BETWEEN_QUARTERS)
    scene = _scene(f"cars of depth {ratio:g} on both sides", resolution, objects)
    return SeenScene(scene=scene, aperture=scene.plate.middle)


def cars_off_the_middle(ratio: float, resolution: tuple[int, int], *, in_middle: bool) -> SeenScene:
    """Return `cars` behind the plate, seen from an aperture off the middle or the middle one.

    From the middle, the nearest cars lie beside the film.
    """
    shift = SHIFT_PER_REACH * REACH
    # The aperture at the top right is one cell, the whole shift, from the middle one.
    plate = Plate(size=(3 * shift, 3 * shift), hogels=(3, 3))
    moved = _moved(
        _cars(ratio, Camera.C, _QUARTERS), lambda points: points + np.array([shift, shift, 0.0])
    )
    scene = replace(_scene(f"cars of depth {ratio:g}, shifted", resolution, moved), plate=plate)
    return SeenScene(scene=scene, aperture=plate.middle if in_middle else plate.aperture(2, 0))


def recentered_cars(ratio: float, resolution: tuple[int, int]) -> SeenScene:
    """Return `cars` behind the plate, sheared so that a recentered frustum shows their picture.

    The screen lies among the cars at `balanced_height`, the aperture over its corner
    (`SHEAR_PER_SLOPE`).
    """
    height, slope = balanced_height(ratio), math.tan(_FOV / 2)
    half_size = slope * height
    shift = SHEAR_PER_SLOPE * half_size
    plate = Plate(size=(3 * shift, 3 * shift), hogels=(3, 3))
    aperture = plate.aperture(2, 0)
    # The line of a pixel goes sideways by the shear for each unit of distance behind the plate.
    shear = -SHEAR_PER_SLOPE * slope

    def sheared(points: Floats) -> Floats:
        x, y, z = points.T
        return np.column_stack([x + aperture.x - shear * z, y + aperture.y - shear * z, z])

    moved = _moved(_cars(ratio, Camera.C, _QUARTERS), sheared)
    screen = Screen(height=-height, center=(0.0, 0.0), size=(2 * half_size, 2 * half_size))
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), screen=screen)
    name = f"cars of depth {ratio:g}, recentered"
    scene = Scene(name=name, plate=plate, frustum=frustum, objects=tuple(moved))
    return SeenScene(scene=scene, aperture=aperture)


def balanced_height(ratio: float) -> float:
    """Return the |z| of a fit that displaces nearest and farthest cars alike, scene units.

    A fit to zf displaces by u W/2 n |1/|z| - 1/zf|, to first order in n: alike where 1/zf is the
    mean of both 1/|z|.
    """
    return 2 * FARTHEST / (ratio + 1)


def car_through_plate(
    distance: float, resolution: tuple[int, int], *, recentered: bool = False
) -> SeenScene:
    """Return the built-in car, seen from an aperture beside where its body crosses the plate.

    `distance` is that along x, as a share of the reach. Recentered, the car is sheared so that a
    recentered frustum, with the aperture over a corner of the screen, shows the picture of the
    centered one; the shear keeps where the car crosses the plate.
    """
    size = REACH / _CAR_REACH
    parts, y = _moved(car(), lambda points: size * points), _CAR_ROW * size
    # The edges of triangles that cross the plate, z = 0, and where they do.
    triangles = np.concatenate([part.vertices[part.faces] for part in parts])
    starts, ends = triangles.reshape(-1, 3), np.roll(triangles, -1, axis=1).reshape(-1, 3)
    crosses = (starts[:, 2] < 0) != (ends[:, 2] < 0)
    share = np.divide(
        starts[:, 2], starts[:, 2] - ends[:, 2], out=np.zeros(len(starts)), where=crosses
    )
    points = starts[:, :2] + share[:, None] * (ends - starts)[:, :2]
    # A triangle crosses the plate along a segment between two of its edges: the outermost x in that
    # row.
    low, high = points[crosses].reshape(-1, 2, 2).transpose(1, 0, 2)
    across = (low[:, 1] < y) != (high[:, 1] < y)
    low, step = low[across], (high - low)[across]
    x = float((low[:, 0] + step[:, 0] * ((y - low[:, 1]) / step[:, 1])).max())
    aperture = Aperture(column=0, row=0, x=x + distance * REACH, y=y)
    name = "car through the plate"
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(_CAR_FOV, _CAR_FOV))
    if recentered:
        slope, height = math.tan(_CAR_FOV / 2), _CAR_SCREEN * size
        shear = SHEAR_PER_SLOPE * slope
        parts = _moved(
            parts, lambda points: points + shear * points[:, 2:] * np.array([1.0, 1.0, 0.0])
        )
        center = aperture.x - shear * height, aperture.y - shear * height
        screen = Screen(
            height=-height, center=center, size=(2 * slope * height, 2 * slope * height)
        )
        name, frustum = f"{name}, recentered", replace(frustum, fov=None, screen=screen)
    scene = Scene(name=name, plate=_PLATE, frustum=frustum, objects=tuple(parts))
    return SeenScene(scene=scene, aperture=aperture)


def empty_scene(resolution: tuple[int, int]) -> Scene:
    """Return plate and frustum of the family, with nothing in it; W, H of the film."""
    return _scene("empty", resolution, [])


def _scene(name: str, resolution: tuple[int, int], objects: list[SceneObject]) -> Scene:
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(_FOV, _FOV))
    return Scene(name=name, plate=_PLATE, frustum=frustum, objects=tuple(objects))


def _moved(parts: Sequence[SceneObject], move: Callable[[Floats], Floats]) -> list[SceneObject]:
    return [replace(part, vertices=move(part.vertices)) for part in parts]


@lru_cache(8)
def _cars(ratio: float, camera: Camera, places: Sequence[tuple[float, float]]) -> list[SceneObject]:
    """Return cars at geometric distances, the farthest first, each in a place on the film."""
    if not (math.isfinite(ratio) and ratio >= CAR_RATIO):
        raise InputError(f"the depth of a scene of cars must be at least {CAR_RATIO}, not {ratio}")
    # A car on the axis, seen from above a corner: its nearest point is put at |z| = x such that the
    # farthest lies at CAR_RATIO x; then all is scaled.
    turned = [place(part, placement(rotate_deg=(25.0, 20.0, 0.0))) for part in car()]
    corners = np.concatenate([part.vertices for part in turned])
    low, high = corners.min(axis=0), corners.max(axis=0)
    nearest = (high[2] - low[2]) / (CAR_RATIO - 1)
    size = FARTHEST / (CAR_RATIO * nearest)
    to_place = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2] + nearest])
    # The middle of the car lies on the axis, its farthest point at `FARTHEST`.
    parts = _moved(turned, lambda points: size * (points - to_place))
    corners = np.concatenate([part.vertices for part in parts])
    objects = []
    for at, scale in zip(
        places, np.geomspace(1.0, CAR_RATIO / ratio, len(places)).tolist(), strict=True
    ):
        # The shift that brings the picture to the middle of its place. Depths differ by half at
        # most, so that each step leaves less than half of the distance.
        shift, middle = np.zeros(3), np.array(at) * math.tan(_FOV / 2) / 2
        for _ in range(60):
            seen = (corners[:, :2] + shift[:2]) / -corners[:, 2:]
            shift[:2] += (middle - (seen.min(axis=0) + seen.max(axis=0)) / 2) * -corners[:, 2].max()
        for part in parts:
            vertices = scale * (part.vertices + shift)
            if camera is Camera.C:
                objects.append(replace(part, vertices=vertices))
            else:
                # Reflection through the aperture reverses the visible winding: reverse the corners.
                objects.append(replace(part, vertices=-vertices, faces=part.faces[:, ::-1]))
    return objects
