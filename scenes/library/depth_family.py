"""Scenes whose depth alone changes: the same picture on the film, from shallow to deep.

All objects lie on one side of the plate. For C* they are reflected through the middle aperture, which moves
no point on the film and only changes the camera: C keeps the nearest surface of a line, C* the farthest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.placement import place, placement
from xfrustum.scenes.library.car import car
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.double_frustum import Camera
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate

REACH = 1000.0
"""Reach on both sides, scene units."""

FARTHEST = 0.999 * REACH
"""Largest |z| of any surface, so that the reach cuts nothing."""

CAR_RATIO = 1.5
"""Ratio of the farthest to the nearest |z| of one car; no scene of cars is shallower."""

CARS = 4
"""Number of cars, one in each quarter of the film, so that none hides another at any depth."""

_FOV = math.radians(50)
_PLATE = Plate(size=(1.0, 1.0), hogels=(1, 1))


def cars(ratio: float, camera: Camera, resolution: tuple[int, int]) -> Scene:
    """Return cars at geometric distances, of a given depth, before or behind the plate.

    Each car fills a quarter of the film and is scaled about the aperture, which changes its distance
    and not its picture: scenes of any two ratios show C the same triangles.

    Parameters
    ----------
    ratio
        Ratio of the farthest to the nearest |z| of all surfaces, at least `CAR_RATIO`. The farthest surface
        lies at `FARTHEST`.
    camera
        `C` for cars behind the plate, `C_STAR` for cars before it.
    resolution
        W, H of the film.

    Raises
    ------
    InputError
        The ratio is smaller than that of one car.
    """
    if not (math.isfinite(ratio) and ratio >= CAR_RATIO):
        raise InputError(f"the depth of a scene of cars must be at least {CAR_RATIO}, not {ratio}")
    parts = _car_behind_plate()
    scales = np.geomspace(1.0, CAR_RATIO / ratio, CARS)
    objects = []
    for aside, scale in zip(_into_quarters(parts), scales.tolist(), strict=True):
        moved = [replace(part, vertices=scale * (part.vertices + aside)) for part in parts]
        objects += [_on_side_of(camera, part) for part in moved]
    return _scene(f"cars of depth {ratio:g}", resolution, objects)


def empty_scene(resolution: tuple[int, int]) -> Scene:
    """Return plate and frustum of the family, with nothing in it; W, H of the film."""
    return _scene("empty", resolution, [])


def _scene(name: str, resolution: tuple[int, int], objects: list[SceneObject]) -> Scene:
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(_FOV, _FOV))
    return Scene(name=name, plate=_PLATE, frustum=frustum, objects=tuple(objects))


def _car_behind_plate() -> list[SceneObject]:
    """Return the parts of a car, seen from above a corner, on the axis of the film at full distance."""
    turned = [place(part, placement(rotate_deg=(25.0, 20.0, 0.0))) for part in car()]
    corners = np.concatenate([part.vertices for part in turned])
    low, high = corners.min(axis=0), corners.max(axis=0)
    # The nearest point is put at |z| = x such that the farthest lies at CAR_RATIO x; then all is scaled.
    nearest = (high[2] - low[2]) / (CAR_RATIO - 1)
    size = FARTHEST / (CAR_RATIO * nearest)
    middle = (low + high) / 2
    to_place = np.array([middle[0], middle[1], high[2] + nearest])
    return [replace(part, vertices=size * (part.vertices - to_place)) for part in turned]


def _into_quarters(parts: list[SceneObject]) -> list[Floats]:
    """Return the shifts (3,) along x and y that bring a car's picture to the middle of each quarter."""
    corners = np.concatenate([part.vertices for part in parts])
    depth = -corners[:, 2:]
    shifts = []
    for turn in np.array([(-1, 1), (1, 1), (-1, -1), (1, -1)]):
        middle = turn * math.tan(_FOV / 2) / 2
        shift = np.zeros(2)
        # Depths differ by half at most, so that each step leaves less than half of the distance.
        for _ in range(60):
            seen = (corners[:, :2] + shift) / depth
            shift += (middle - (seen.min(axis=0) + seen.max(axis=0)) / 2) * depth.min()
        shifts.append(np.append(shift, 0.0))
    return shifts


def _on_side_of(camera: Camera, part: SceneObject) -> SceneObject:
    """Return a part as it is for C, reflected through the aperture for C*."""
    if camera is Camera.C:
        return part
    # A point reflection reverses the winding as it is seen; reversing the corners restores it.
    return replace(part, vertices=-part.vertices, faces=part.faces[:, ::-1])
