"""The one kind of image that every renderer returns: what one aperture shows, pixel by pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Bytes, Indices, Mask, Numbers, Singles
from xfrustum.scenes.model.rendering import Rendering
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

NOTHING = -1
"""Triangle and object number of a pixel that shows no surface."""


class Certainty(IntEnum):
    """How the truth of a pixel was decided."""

    PROVEN = 0
    """In floating point, with an error bound that separates it from every other outcome."""
    EXACT = 1
    """In rational arithmetic."""
    TIE = 2
    """Equal in exact arithmetic: coincident surfaces, or a line exactly through a shared edge."""
    UNEXAMINED = 3


@dataclass(frozen=True, kw_only=True)
class HogelCamera:
    """The crossed frustum that an image answers for, in full double precision.

    Attributes
    ----------
    aperture
        The aperture; its lines are P(s) = (x, y, 0) + s (kx + u tx, ky + v ty, -1).
    resolution
        W, H in pixels.
    shear, half_extent
        k and t, slopes per unit of depth.
    reach
        Toward the viewer and behind the plate, scene units.
    scene, scene_hash
        Where the scene can be had again, and the hash that proves it the same.
    renderer
        Who made the image, with versions or devices, for people.
    settings
        Of the double frustum, where one drew the image.
    light_paths
        Samples per pixel that the color is a mean of, where light paths were sampled.
    """

    aperture: Aperture
    resolution: tuple[int, int]
    shear: tuple[float, float]
    half_extent: tuple[float, float]
    reach: tuple[float, float]
    scene: str
    scene_hash: str
    renderer: str
    settings: DoubleFrustum | None = None
    light_paths: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class HogelImage:
    """What one aperture shows. Row 0 is at the top; arrays are (H, W) or (H, W, 3).

    Attributes
    ----------
    camera
        The frustum it answers for.
    triangle, object
        int32 numbers, `NOTHING` where there is no surface.
    position
        Visible surface point in scene units, NaN where there is none: float64 from a
        reference, float32 from a rasterizer.
    normal
        Unit normal as stored in the mesh winding, NaN where there is no surface.
    color
        Linear RGB, float32.
    variance
        (H, W, 3) float32 variance of the color, where that is the mean of sampled light paths; None where
        it has no noise.
    certainty
        uint8 `Certainty` per pixel; None where nobody claims the truth.
    companions
        (N, 3) row, column and triangle number of every surface that shares a tie; None likewise.
    overruled
        Pixels where the float32 tracer alone would have shown another triangle; None likewise.
    rendering
        What made the color; None where nobody says, or where there is none.
    """

    camera: HogelCamera
    triangle: Numbers
    object: Numbers
    position: NDArray[np.floating]
    normal: NDArray[np.floating] | None = None
    color: Singles | None = None
    variance: Singles | None = None
    certainty: Bytes | None = None
    companions: Indices | None = None
    overruled: Mask | None = None
    rendering: Rendering | None = None

    @cached_property
    def covered(self) -> Mask:
        """Pixels that show a surface, by number or, where a foreign image has none, by position."""
        covered: Mask = (self.triangle != NOTHING) | np.isfinite(self.height)
        covered.flags.writeable = False
        return covered

    @cached_property
    def off_plate(self) -> Mask:
        """Pixels that show a surface off the plate, and say where it is."""
        # Coordinate by coordinate: numpy reduces over so short an axis ten times slower.
        x, y, z = (self.position[..., axis] for axis in range(3))
        found: Mask = self.covered & np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (z != 0)
        found.flags.writeable = False
        return found

    @property
    def height(self) -> NDArray[np.floating]:
        """Height above the plate, NaN where there is no surface."""
        return self.position[..., 2]

    def rows(self, some: slice) -> HogelImage:
        """Return a band of rows, without what is known of ties and of tracers."""
        mine = {f.name: getattr(self, f.name) for f in fields(HogelImage)}
        arrays = {name: value[some] for name, value in mine.items() if isinstance(value, np.ndarray)}
        return HogelImage(**mine | arrays | {"companions": None, "overruled": None})


def stacked(bands: Sequence[HogelImage]) -> HogelImage:
    """Join bands of rows of one image, from the top. What one of them lacks, the image lacks."""

    def joined(name: str) -> Any:
        parts = [getattr(band, name) for band in bands]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    whole = {name: getattr(bands[0], name) for name in ("camera", "rendering")}
    arrays = [item.name for item in fields(HogelImage) if item.name not in whole]
    return HogelImage(**whole, **{name: joined(name) for name in arrays})
