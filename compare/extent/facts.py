"""Size, heights, area within the reach and apertures of every object of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.compare.extent.layers import areas, share_between, triangles_in_chunks
from xfrustum.compare.extent.sight import apertures_in_sight
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate

Point = tuple[float, float, float]

PLATE_ROUNDING = 2.0**-24
"""Distance from the plate, as a share of an object's largest coordinate, that rounding makes of 0: half a
unit in the last place of the single precision in which rasterizers and mesh files hold coordinates."""


@dataclass(frozen=True, kw_only=True)
class Sight:
    """The apertures of a plate whose crossed frusta hold some part of an object, whatever hides it.

    Attributes
    ----------
    apertures, of
        Number of apertures that hold some part, and number of all apertures.
    columns, rows
        First and last column and row of the apertures that hold some part; None where there are none.
    middle
        Whether the middle aperture holds some part.
    corners
        Whether the apertures at the top left, top right, bottom left and bottom right hold some part.
    """

    apertures: int
    of: int
    columns: tuple[int, int] | None
    rows: tuple[int, int] | None
    middle: bool
    corners: tuple[bool, bool, bool, bool]

    @classmethod
    def of_flags(cls, flags: Mask, plate: Plate) -> Sight:
        """Count the (rows, columns) flags of a plate's apertures."""
        seeing = np.argwhere(flags)
        some = len(seeing) > 0
        column, row = plate.middle.index
        return cls(
            apertures=len(seeing),
            of=flags.size,
            columns=(int(seeing[:, 1].min()), int(seeing[:, 1].max())) if some else None,
            rows=(int(seeing[:, 0].min()), int(seeing[:, 0].max())) if some else None,
            middle=bool(flags[row, column]),
            corners=(bool(flags[0, 0]), bool(flags[0, -1]), bool(flags[-1, 0]), bool(flags[-1, -1])),
        )


@dataclass(frozen=True, kw_only=True)
class ObjectExtent:
    """The place and the size of one object.

    Attributes
    ----------
    number, name
        Number and name of the object in its scene.
    triangles
        Number of its triangles.
    low, high
        Corners of the box around the object, scene units; its heights run from low[2] to high[2].
    share_in_reach
        Share of the object's surface between the ends of the reach; None where the surface has no area.
    sight
        Apertures that may see some part of the object.
    """

    number: int
    name: str
    triangles: int
    low: Point
    high: Point
    share_in_reach: float | None
    sight: Sight

    @property
    def size(self) -> Point:
        """Lengths of the box around the object along x, y and z, scene units."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z


def extents(scene: Scene) -> tuple[ObjectExtent, ...]:
    """Return the place and the size of each object of a scene."""
    return tuple(
        ObjectExtent(
            number=number,
            name=part.name,
            triangles=len(part.faces),
            low=box(part)[0],
            high=box(part)[1],
            share_in_reach=share_in_reach(part, scene.frustum),
            sight=Sight.of_flags(apertures_in_sight(part, scene.frustum, scene.plate), scene.plate),
        )
        for number, part in enumerate(scene.objects)
    )


def box(part: SceneObject) -> tuple[Point, Point]:
    """Return the lowest and the highest coordinates of an object's triangles."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for triangles in triangles_in_chunks(part):
        low = np.minimum(low, triangles.min(axis=(0, 1)))
        high = np.maximum(high, triangles.max(axis=(0, 1)))
    (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
    return (x0, y0, z0), (x1, y1, z1)


def in_plate(part: SceneObject) -> int:
    """Return how many triangles of an object lie in the plate, within `PLATE_ROUNDING`."""
    if not len(part.faces):
        return 0
    allowed = PLATE_ROUNDING * float(np.abs(part.vertices).max())
    return sum(
        int(np.count_nonzero((np.abs(one[..., 2]) <= allowed).all(axis=1)))
        for one in triangles_in_chunks(part)
    )


def share_in_reach(part: SceneObject, frustum: Frustum) -> float | None:
    """Return the share of an object's surface between the ends of the reach; None where it has no area."""
    toward, back = frustum.reach
    whole = within = 0.0
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    size = max(float(np.abs(part.vertices).max()), np.finfo(np.float64).tiny)
    for triangles in triangles_in_chunks(part):
        area = areas(triangles / size)
        whole += float(area.sum())
        within += float((area * share_between(triangles, -back, toward)).sum())
    return within / whole if whole > 0 else None
