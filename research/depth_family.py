"""Scenes that differ only in depth: the same picture on the film, from shallow to deep.

For C*, objects are reflected through the aperture. This moves no point on the film, but along a
line C shows the surface nearest to the aperture, and C* shows the farthest surface.
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
#: largest |z| of any surface, scene units; below the reach, which therefore cuts no surface
FARTHEST = 0.999 * REACH
#: ratio of the farthest to the nearest |z| of one car; no scene of cars is shallower
CAR_RATIO = 1.5
#: Shift of the aperture off the middle, along both axes, as a share of the reach: cars nearer than
#: about this distance lie outside the film of the middle aperture.
SHIFT_PER_REACH = 0.05
#: Shear of the recentered frustum over the slope of the film's half-extent, k / t, along both axes;
#: at 1 the aperture lies over a corner of the screen.
SHEAR_PER_SLOPE = 1.0
_FOV = math.radians(50)
_PLATE = Plate(size=(1.0, 1.0), hogels=(1, 1))
#: Centers of the cars, in halves of the film's half-extent: the centers of the film's quarters, so
#: that no car hides another at any depth; then the centers of the cars in front of the plate, if
#: there are cars on both sides.
_QUARTERS, _BETWEEN_QUARTERS = ((-1, 1), (1, 1), (-1, -1), (1, -1)), ((-1, 0), (1, 0))
#: Reach (mm) and full angle of the built-in scene `car`; the y (mm) of a row of the plate in which
#: the car's body crosses the plate; and the depth (mm) of the screen of `car-recentered`.
_CAR_REACH, _CAR_FOV, _CAR_ROW, _CAR_SCREEN = 150.0, math.radians(60), -10.0, 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenScene:
    """A scene and the aperture from which it is seen."""

    scene: Scene
    aperture: Aperture


def cars(ratio: float, camera: Camera, resolution: tuple[int, int]) -> Scene:
    """Return cars at geometric distances before the plate (`C_STAR`) or behind it (`C`).

    Each car fills a quarter of the film. It is scaled about the aperture, so that its picture stays
    the same. The farthest surface lies at `FARTHEST`, the nearest at `FARTHEST` / `ratio`. Raises
    InputError below `CAR_RATIO`.
    """
    return _scene(f"cars of depth {ratio:g}", resolution, _cars(ratio, camera, _QUARTERS))


def cars_on_both_sides(ratio: float, resolution: tuple[int, int]) -> SeenScene:
    """Return `cars` behind the plate, partly hidden by two cars before it at the same |z|."""
    objects = _cars(ratio, Camera.C, _QUARTERS) + _cars(ratio, Camera.C_STAR, _BETWEEN_QUARTERS)
    scene = _scene(f"cars of depth {ratio:g} on both sides", resolution, objects)
    return SeenScene(scene=scene, aperture=scene.plate.middle)


def cars_off_the_middle(ratio: float, resolution: tuple[int, int], *, in_middle: bool) -> SeenScene:
    """Return `cars` behind the plate, seen from an aperture off the middle or in the middle.

    Seen from the middle aperture, the nearest cars lie outside the film.
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
    """Return `cars` behind the plate, sheared so that a recentered frustum shows the same picture.

    The screen lies among the cars, at `balanced_height`; the aperture lies over the screen's corner
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
    """Return the |z| of a fit that displaces nearest and farthest cars equally, scene units.

    To first order in n, a fit to zf displaces points by u W/2 n |1/|z| - 1/zf|. The two
    displacements are equal if 1/zf is the mean of the two values of 1/|z|.
    """
    return 2 * FARTHEST / (ratio + 1)


def car_through_plate(
    distance: float, resolution: tuple[int, int], *, recentered: bool = False
) -> SeenScene:
    """Return the built-in car, seen from an aperture beside its body's crossing with the plate.

    `distance` is the distance from the crossing along x, as a share of the reach. If `recentered`,
    the car is sheared so that a recentered frustum, with the aperture over a corner of the screen,
    shows the picture of the centered frustum. The shear does not move the crossing.
    """
    size = REACH / _CAR_REACH
    parts, y = _moved(car(), lambda points: size * points), _CAR_ROW * size
    # Find the points where edges of triangles cross the plate, z = 0.
    triangles = np.concatenate([part.vertices[part.faces] for part in parts])
    starts, ends = triangles.reshape(-1, 3), np.roll(triangles, -1, axis=1).reshape(-1, 3)
    crosses = (starts[:, 2] < 0) != (ends[:, 2] < 0)
    share = np.divide(
        starts[:, 2], starts[:, 2] - ends[:, 2], out=np.zeros(len(starts)), where=crosses
    )
    points = starts[:, :2] + share[:, None] * (ends - starts)[:, :2]
    # A triangle crosses the plate along a segment between two of its edges. The largest x of these
    # segments in the row is the outermost crossing.
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
    """Return a scene of the family without objects; `resolution` is W, H of the film."""
    return _scene("empty", resolution, [])


def _scene(name: str, resolution: tuple[int, int], objects: list[SceneObject]) -> Scene:
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(_FOV, _FOV))
    return Scene(name=name, plate=_PLATE, frustum=frustum, objects=tuple(objects))


def _moved(parts: Sequence[SceneObject], move: Callable[[Floats], Floats]) -> list[SceneObject]:
    return [replace(part, vertices=move(part.vertices)) for part in parts]


@lru_cache(8)
def _cars(ratio: float, camera: Camera, places: Sequence[tuple[float, float]]) -> list[SceneObject]:
    """Return cars at geometric distances, the farthest first, each centered on one of `places`."""
    if not (math.isfinite(ratio) and ratio >= CAR_RATIO):
        raise InputError(f"the depth of a scene of cars must be at least {CAR_RATIO}, not {ratio}")
    # Place a car on the axis, seen from above a corner, with its nearest point at the |z| = x for
    # which its farthest point lies at CAR_RATIO x; then scale the car.
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
        # Find the shift that centers the car's picture on its place. Depths of a car differ by half
        # at most, so that each step more than halves the remaining distance.
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
