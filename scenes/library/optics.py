"""Objects whose shading is known in closed form: mirror spheres, and gratings near the aperture's limit.

Lengths are millimeters; the plate is 80 x 60 with 81 x 61 apertures, the reach 150 on both sides.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from xfrustum.scenes.appearance.appearance import Appearance
from xfrustum.scenes.appearance.material import Material
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.geometry.shapes import lathe, open_grid
from xfrustum.scenes.library.studio import surroundings
from xfrustum.scenes.model.scene import SceneObject

Vector = tuple[float, float, float]

MIRROR_SPHERES: tuple[tuple[Vector, float], ...] = (((-11.0, 7.0, -72.0), 24.0), ((-20.0, 17.0, 60.0), 10.0))
"""Center and radius of each sphere: one behind the plate, one before it, neither hiding the other."""

_BLACK = (0.0, 0.0, 0.0)


def mirror_spheres() -> tuple[SceneObject, ...]:
    """Return the mirror spheres, in facets of about two degrees.

    The normals at the vertices are those of the spheres, as long as the radius: interpolated over a
    facet they point from the center to the facet's point exactly.
    """
    polar = np.linspace(0, np.pi, 97)
    spheres = []
    for number, (center, radius) in enumerate(MIRROR_SPHERES):
        outward, faces = lathe(radius * np.sin(polar), -radius * np.cos(polar), sectors=192)
        spheres.append(
            SceneObject(
                name=f"mirror sphere {number}",
                vertices=outward + center,
                faces=faces,
                material="mirror",
                vertex_normals=outward,
            )
        )
    return tuple(spheres)


def mirror() -> Appearance:
    """Return a mirror and nothing else, in the surroundings of the studio."""
    pure = Material(ambient=_BLACK, diffuse=_BLACK, reflectivity=(1.0, 1.0, 1.0))
    return Appearance(materials=MappingProxyType({"mirror": pure}), lights=(), environment=surroundings())


GRATING_LEAN = 0.07
"""Slope of the bars against the rows and columns of pixels: no column lies on an edge all along."""
GRATING_HEIGHT = 30.0
BACKDROP_HEIGHT = -60.0
FINE, COARSE = 0.5, 4.0
"""Periods of the two gratings in hogel pitches. A centered frustum averages over one pitch at every height.
The mean of a grating whose period divides the pitch is constant; one with four times the pitch keeps 0.9 of
its contrast (the sinc function of 1/4)."""


def gratings(pitch: tuple[float, float]) -> tuple[SceneObject, ...]:
    """Return a sheet of almost upright bars before the plate, and one of almost level bars behind it.

    Brightness rises and falls linearly from 0 to 1, one period after the other: to the left of the middle
    (above it, behind the plate) `FINE`, to the right (below) `COARSE`. At the middle both are black.

    Parameters
    ----------
    pitch
        Distances of neighboring hogels along x and y, in millimeters.
    """
    return (
        _bars("upright bars", -_periods(pitch[0], 21.0)[::-1], GRATING_HEIGHT, (-12.0, 7.0), upright=True),
        _bars("level bars", _periods(pitch[1], 30.0), BACKDROP_HEIGHT, (-38.0, 31.0), upright=False),
    )


def _periods(pitch: float, extent: float) -> Floats:
    """Return where brightness turns: coarse on the negative side, fine on the positive, 0 among them."""
    coarse = np.arange(-int(extent / (COARSE * pitch / 2)), 0) * COARSE / 2
    fine = np.arange(int(extent / (FINE * pitch / 2)) + 1) * FINE / 2
    return np.concatenate([coarse, fine]) * pitch


def _bars(name: str, turns: Floats, z: float, span: tuple[float, float], *, upright: bool) -> SceneObject:
    """Return a sheet parallel to the plate, black where `turns` has 0 and white at the next."""
    straight, across = np.meshgrid(turns, np.array(span), indexing="ij")
    along = straight + GRATING_LEAN * across
    # Rows times columns of the grid point to the viewer.
    x, y = (along, across) if upright else (across[:, ::-1], along[:, ::-1])
    vertices, faces = open_grid(np.stack([x, y, np.full(along.shape, z)], axis=-1))
    brightness = np.abs(np.arange(len(turns)) - int(np.argmin(np.abs(turns)))) % 2
    colors = np.repeat(brightness.astype(np.float64), len(span))
    return SceneObject(
        name=name,
        vertices=vertices,
        faces=faces,
        material="plain",
        vertex_colors=np.repeat(colors[:, None], 3, axis=1),
    )


def plain() -> Appearance:
    """Return a material that shows the vertex colors as they are, without any light."""
    own_color = Material(ambient=(1.0, 1.0, 1.0), diffuse=_BLACK)
    return Appearance(materials=MappingProxyType({"plain": own_color}), lights=())
