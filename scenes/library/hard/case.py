"""The class of hard cases, and the frustum that most of them share, whose lines doubles hold exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum, Screen
from xfrustum.scenes.plate.plate import Plate

REACH = 128.0
"""Reach on both sides, in millimeters."""

PLATE = Plate(size=(40.0, 40.0), hogels=(5, 5))
"""Plate whose apertures lie at x and y of -16, -8, 0, 8 and 16; the middle one lies at the origin."""

FRUSTUM = Frustum(
    resolution=(64, 64),
    reach=(REACH, REACH),
    screen=Screen(height=-64.0, center=(0.0, 0.0), size=(64.0, 64.0)),
)
"""Frustum in which every slope is a multiple of 1/128: through the origin, an odd one from -63/128 to 63/128.

It has a screen and not an angle, because no angle in radians has the tangent 1/2 exactly.
"""


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """One scene at which a renderer of crossed frusta may fail, and the true image that is expected.

    Attributes
    ----------
    name
        Name on the command line: `hard/...`.
    why
        Reason why the scene is hard, in one line.
    expected
        Content of the true image, in one line.
    triangles
        Number of triangles of all objects, stated so that the cases can be listed without being built.
    objects
        Function that makes the meshes, in scene coordinates.
    plate, frustum
        Plate and frustum, as in a scene file.
    apertures
        Column and row of the apertures that matter.
    giant
        Whether the case takes minutes or gigabytes.
    """

    name: str
    why: str
    expected: str
    triangles: int
    objects: Callable[[], tuple[SceneObject, ...]]
    plate: Plate = PLATE
    frustum: Frustum = FRUSTUM
    apertures: tuple[tuple[int, int], ...] = ((2, 2),)
    giant: bool = False

    def build(self) -> Scene:
        """Return the scene; the same on every machine."""
        return Scene(
            name=self.name,
            units="mm",
            plate=self.plate,
            frustum=self.frustum,
            objects=self.objects(),
            source=self.name,
        )


def on_line(column: ArrayLike, row: ArrayLike, s: ArrayLike) -> Floats:
    """Return the points (..., 3) at s on lines of `FRUSTUM` through the middle aperture.

    They are exact for whole and half pixels and every s of at most 45 bits. Fractions of columns and rows
    mean lines between those of pixels.
    """
    columns, rows, along = np.broadcast_arrays(
        np.asarray(column, dtype=np.float64), np.asarray(row, dtype=np.float64), np.asarray(s, np.float64)
    )
    return np.stack(((2 * columns - 63) / 128 * along, (63 - 2 * rows) / 128 * along, -along), axis=-1)


def loose(name: str, triangles: Sequence[ArrayLike] | Floats) -> SceneObject:
    """Return an object of triangles (F, 3, 3) that share no vertices."""
    corners = np.asarray(triangles, dtype=np.float64).reshape(-1, 3)
    return SceneObject(name=name, vertices=corners, faces=np.arange(len(corners)).reshape(-1, 3))


def film_rectangle(columns: tuple[float, float], rows: tuple[float, float], s: ArrayLike) -> Floats:
    """Return two triangles (2, 3, 3) over a rectangle of the film.

    Parameters
    ----------
    columns, rows
        First and last column and row, in pixels.
    s
        Place along the line of all corners, or of top left, top right, bottom right and bottom left.
    """
    left, right = columns
    top, bottom = rows
    corners = on_line([left, right, right, left], [top, top, bottom, bottom], s)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def wall(z: float = -100.0) -> SceneObject:
    """Return one triangle parallel to the plate that fills the film of every aperture."""
    return loose("wall", [[(-400.0, -400.0, z), (400.0, -400.0, z), (0.0, 600.0, z)]])
