"""Globes about a plate, which show the same picture in any number of triangles."""

from __future__ import annotations

import math

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.geometry.shapes import lathe
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate

REACH = 100.0
"""Reach on both sides, scene units; every globe lies within it."""

GLOBES = (
    ((-14.0, 8.0, 45.0), (10.0, 10.0, 10.0)),
    ((12.0, -12.0, 60.0), (11.0, 11.0, 11.0)),
    ((9.0, 2.0, 0.0), (6.0, 6.0, 40.0)),
    ((-16.0, -8.0, -50.0), (13.0, 13.0, 13.0)),
    ((18.0, 14.0, -70.0), (15.0, 15.0, 15.0)),
)
"""Center and semi-axes of each globe: two before the plate, one across it beside the aperture, two behind."""

MAX_FACTOR_RATIO = 2.5
"""Largest ratio of sectors to rings: a number whose factors differ more is refused."""

_PLATE = Plate(size=(1.0, 1.0), hogels=(1, 1))
_FOV = math.radians(60)


def globes(triangles: int, resolution: tuple[int, int]) -> Scene:
    """Return closed globes before, across and behind the plate, seen through an aperture at the origin.

    Vertices lie on the same ellipsoids whatever their number. With m sectors or bands a silhouette is
    off by at most 1 - cos(pi / m) of a semi-axis.

    Parameters
    ----------
    triangles
        Number of triangles of all globes together, exactly: each globe has 2 sectors (bands - 1).
    resolution
        W, H of the film.

    Raises
    ------
    InputError
        No globe has that many triangles.
    """
    sectors, rings = _factors(triangles)
    polar = np.linspace(0.0, np.pi, rings + 2)
    vertices, faces = lathe(0.5 * np.sin(polar), -0.5 * np.cos(polar), sectors=sectors)
    objects = tuple(_globe(vertices, faces, center, semi_axes) for center, semi_axes in GLOBES)
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(_FOV, _FOV))
    return Scene(name=f"globes of {triangles} triangles", plate=_PLATE, frustum=frustum, objects=objects)


def _factors(triangles: int) -> tuple[int, int]:
    """Return sectors, and rings of vertices between the poles, of each globe."""
    product, rest = divmod(triangles, 2 * len(GLOBES))
    if not rest:
        rings = max((n for n in range(2, math.isqrt(max(product, 0)) + 1) if product % n == 0), default=0)
        if rings and product <= MAX_FACTOR_RATIO * rings**2:
            return product // rings, rings
    raise InputError(
        f"{triangles} triangles cannot be shared among {len(GLOBES)} even globes; take such as 10000, "
        "32000 or 100000"
    )


def _globe(
    vertices: Floats,
    faces: Indices,
    center: tuple[float, float, float],
    semi_axes: tuple[float, float, float],
) -> SceneObject:
    placed = 2.0 * np.array(semi_axes) * vertices + np.array(center)
    return SceneObject(name="globe", vertices=placed, faces=faces)
