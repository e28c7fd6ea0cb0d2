"""A car of about 42,000 triangles: plain, and in a studio.

In the car's coordinates x is to the side, y up and z forward, in millimeters. The wheels stand on
y = 0, and the car is 100 long, 42 wide and 32 high. It was modeled for this project: `car.npz`
beside this module has vertices in nanometers, faces, and the faces of wheels that belong to rims.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes import SceneObject
from xfrustum.scenes.appearance.appearance import (
    Appearance,
    DirectionalLight,
    Environment,
    Material,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry import shapes

_PER_MILLIMETER = 1e6  # units of stored coordinates


@cache
def _stored() -> dict[str, NDArray[Any]]:
    with np.load(Path(__file__).with_name("car.npz")) as file:
        return dict(file)


def car() -> tuple[SceneObject, ...]:
    """Return the car across the plate, turned by 35 degrees, its hood below the middle aperture.

    Its parts are body, glass, wheels and trim.
    """
    scene_from_car, stored = (
        shapes.placement(1.0, (0.0, 35.0, 0.0), (-14.0, -27.0, -17.0)),
        _stored(),
    )
    parts = []
    for name in ("body", "glass", "wheels", "trim"):
        mesh = stored[f"{name}_vertices"] / _PER_MILLIMETER, stored[f"{name}_faces"]
        parts.append(shapes.place(shapes.as_object(f"car {name}", mesh), scene_from_car))
    return tuple(parts)


_MATERIALS = MappingProxyType({
    "paint": Material(ambient=(0.03, 0.006, 0.008), diffuse=(0.42, 0.045, 0.05),
                      specular=(0.35,) * 3,
                      exponent=50.0, reflectivity=(0.16,) * 3),
    "glass": Material(ambient=(0.004, 0.006, 0.007), diffuse=(0.015, 0.022, 0.025),
                      specular=(0.6,) * 3,
                      exponent=200.0, reflectivity=(0.3, 0.32, 0.34)),
    "tire": Material(ambient=(0.008,) * 3, diffuse=(0.035,) * 3, specular=(0.04,) * 3,
                     exponent=8.0),
    "metal": Material(ambient=(0.02,) * 3, diffuse=(0.12, 0.12, 0.13), specular=(0.5,) * 3,
                      exponent=80.0, reflectivity=(0.55, 0.55, 0.58)),
})  # fmt: skip

_LIGHTS = (
    DirectionalLight(direction=(-2.0, 3.0, 2.0), color=(0.9, 0.87, 0.8)),
    DirectionalLight(direction=(3.0, 1.0, 1.5), color=(0.2, 0.24, 0.32)),
    DirectionalLight(direction=(0.5, 1.5, -3.0), color=(0.3, 0.3, 0.28)),
)


def studio_car() -> tuple[SceneObject, ...]:
    """Return the car with smooth normals, a material on every part, and rims apart from tires."""
    body, glass, wheels, trim = map(shapes.smoothed, car())
    rims = _stored()["rims"]
    return (
        replace(body, material="paint"),
        replace(glass, material="glass"),
        replace(wheels, name="car tires", faces=wheels.faces[~rims], material="tire"),
        replace(wheels, name="car rims", faces=wheels.faces[rims], material="metal"),
        replace(trim, material="metal"),
    )


def studio() -> Appearance:
    """Return the studio's materials, lights and surroundings."""
    return Appearance(materials=_MATERIALS, lights=_LIGHTS, environment=surroundings())


def surroundings(height: int = 256) -> Environment:
    """Return sky, ground and softboxes as a map of 2 height x height pixels."""
    rows = (np.arange(height) + 0.5) / height
    columns = (np.arange(2 * height) + 0.5) / (2 * height)
    latitude, longitude = 90 - 180 * rows[:, None], 360 * columns[None, :] - 180
    rise = np.clip(latitude / 90, 0, 1)[..., None]
    sky = (1 - rise) * [0.62, 0.66, 0.7] + rise * [0.12, 0.2, 0.42]
    # The ground is brighter toward the right, but uniform at the pole, where all longitudes meet.
    aside = np.sin(np.radians(longitude)) * np.cos(np.radians(latitude))
    ground = (0.16 + 0.05 * aside)[..., None] * [1.0, 0.85, 0.7]
    horizon = _smooth_step(latitude, 0.0, width=6.0)[..., None]
    radiance = horizon * sky + (1 - horizon) * ground
    for (left, right), (low, high), color in (
        ((-170.0, -95.0), (28.0, 46.0), (5.0, 5.0, 4.6)),
        ((105.0, 165.0), (12.0, 18.0), (2.4, 2.0, 1.5)),
        ((-60.0, 20.0), (60.0, 72.0), (2.0, 2.3, 2.8)),
    ):
        across = _smooth_step(longitude, left, width=4.0) * (
            1 - _smooth_step(longitude, right, width=4.0)
        )
        up = _smooth_step(latitude, low, width=4.0) * (1 - _smooth_step(latitude, high, width=4.0))
        radiance = radiance + (across * up)[..., None] * color
    return Environment(radiance=radiance.astype(np.float32), name="studio")


def _smooth_step(angle: Floats, edge: float, *, width: float) -> Floats:
    """Return a smooth cubic step from 0 to 1 about an edge; all angles in degrees."""
    share = np.clip((angle - edge) / width + 0.5, 0, 1)
    return np.asarray(share**2 * (3 - 2 * share))
