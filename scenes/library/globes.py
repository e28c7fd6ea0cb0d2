"""Globes about a plate, which show the same picture in any number of triangles."""

from __future__ import annotations

import math

import numpy as np

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


def globes(triangles: int, resolution: tuple[int, int]) -> Scene:
    """Return closed globes before, across and behind the plate, seen through an aperture at the origin.

    All together have exactly that number of triangles: each globe has 2 sectors (bands - 1). Vertices lie on
    the same ellipsoids whatever their number: with m sectors or bands a silhouette is off by at most
    1 - cos(pi / m) of a semi-axis.

    Raises
    ------
    InputError
        No globe has that many triangles.
    """
    # A product of sectors, and of rings of vertices between the poles, as even as it can be.
    product, rest = divmod(triangles, 2 * len(GLOBES))
    factors = range(2, math.isqrt(max(product, 0)) + 1) if not rest else range(0)
    rings = max((n for n in factors if product % n == 0), default=0)
    if not rings or product > MAX_FACTOR_RATIO * rings**2:
        raise InputError(
            f"{triangles} triangles cannot be shared among {len(GLOBES)} even globes; take such as 10000, "
            "32000 or 100000"
        )
    polar = np.linspace(0.0, np.pi, rings + 2)
    unit, faces = lathe(0.5 * np.sin(polar), -0.5 * np.cos(polar), sectors=product // rings)
    objects = tuple(
        SceneObject(name="globe", vertices=2.0 * np.array(semi_axes) * unit + np.array(center), faces=faces)
        for center, semi_axes in GLOBES
    )
    fov = math.radians(60)
    frustum = Frustum(resolution=resolution, reach=(REACH, REACH), fov=(fov, fov))
    plate = Plate(size=(1.0, 1.0), hogels=(1, 1))
    return Scene(name=f"globes of {triangles} triangles", plate=plate, frustum=frustum, objects=objects)
