"""The one kind of image that every renderer returns: what one aperture shows, pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Bytes, Indices, Mask, Numbers, Singles
from xfrustum.scenes.model.image_facts import (
    Labels,
    ShownImage,
    labels_of_hogel,
    said_of_hogel,
    table_of_hogel,
)
from xfrustum.scenes.model.rendering import Rendering
from xfrustum.scenes.notebook.shown import Table
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

NOTHING = -1
"""Triangle and object number of a pixel that shows no surface."""


class Certainty(IntEnum):
    """The way in which the truth of a pixel was decided."""

    PROVEN = 0
    """Decided in floating point, with an error bound that separates it from every other outcome."""
    EXACT = 1
    """Decided in rational arithmetic."""
    TIE = 2
    """Equal in exact arithmetic: coincident surfaces, or a line exactly through a shared edge."""
    UNEXAMINED = 3
    """Not decided: a tracer's proposal."""


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
        Reach toward the viewer and behind the plate, scene units.
    scene, scene_hash
        Name or path by which the scene can be opened again, and the hash that proves it the same.
    renderer
        Name of the renderer, with versions or devices, for people.
    settings
        Settings of the double frustum that drew the image; None for other renderers.
    light_paths
        Light paths per pixel over which color was averaged; None where none were traced.
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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HogelImage(ShownImage):
    """The image of one aperture. Row 0 is at the top; arrays are (H, W) or (H, W, 3).

    Attributes
    ----------
    camera
        The crossed frustum that the image answers for.
    triangle, object
        int32 numbers, `NOTHING` where there is no surface.
    position
        Visible surface point in scene units, NaN where there is none: float64 from a
        reference, float32 from a rasterizer. Points of our own rasterizers and models lie coordinate by
        coordinate in memory.
    normal
        Unit normal of the triangle by the mesh's winding, NaN where there is no surface.
    color
        Linear RGB, float32.
    variance
        (H, W, 3) float32 variance of the color where it is a mean over light paths; None where it has no
        noise.
    certainty
        uint8 `Certainty` per pixel; None in images that are not certified.
    companions
        (N, 3) row, column and triangle number of every surface that shares a tie; None in images that are
        not certified.
    second_opinion
        Function that returns `overruled`, which asks a float32 tracer; None in images that are not
        certified. Nothing is traced before `overruled` is read.
    rendering
        Effects and samples of the color; None where they are unknown or there is no color.
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
    second_opinion: Callable[[], Mask] | None = None
    rendering: Rendering | None = None

    @cached_property
    def overruled(self) -> Mask | None:
        """Pixels where the float32 tracer alone would have shown another triangle than the truth.

        None in images that are not certified. The tracer is asked when this is first read.
        """
        return None if self.second_opinion is None else self.second_opinion()

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the second opinion itself, not a function that holds the whole scene."""
        overruled = self.overruled
        return vars(self) | {"second_opinion": None if overruled is None else partial(_itself, overruled)}

    @cached_property
    def covered(self) -> Mask:
        """Pixels that show a surface, by number or, in foreign images without numbers, by position."""
        covered: Mask = (self.triangle != NOTHING) | np.isfinite(self.height)
        covered.flags.writeable = False
        return covered

    @cached_property
    def off_plate(self) -> Mask:
        """Pixels that show a surface off the plate at a known position."""
        # Coordinate by coordinate, because numpy reduces over so short an axis ten times slower.
        x, y, z = (self.position[..., axis] for axis in range(3))
        found: Mask = self.covered & np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (z != 0)
        found.flags.writeable = False
        return found

    @property
    def height(self) -> NDArray[np.floating]:
        """Height above the plate, NaN where there is no surface."""
        return self.position[..., 2]

    def rows(self, some: slice) -> HogelImage:
        """Return a band of rows, without `companions` and `second_opinion`."""
        return self._mapped(lambda array: array[some])

    def at(self, pixels: Indices) -> HogelImage:
        """Return some pixels, given by their flat numbers, side by side in one row: surfaces without colors.

        The row has neither normals nor `companions` and `second_opinion`.
        """

        def taken(array: NDArray[Any]) -> NDArray[Any]:
            return array.reshape(-1, *array.shape[2:])[pixels][None]

        return HogelImage(
            camera=self.camera,
            triangle=taken(self.triangle),
            object=taken(self.object),
            position=taken(self.position),
            certainty=None if self.certainty is None else taken(self.certainty),
        )

    def _said(self) -> str:
        return said_of_hogel(self)

    def _tables(self) -> Sequence[Table]:
        return (table_of_hogel(self),)

    def _labels(self, units: str) -> Labels:
        return labels_of_hogel(self, units)

    def _mapped(self, part: Callable[[NDArray[Any]], NDArray[Any]]) -> HogelImage:
        mine = {f.name: getattr(self, f.name) for f in fields(HogelImage)}
        mine |= {"companions": None, "second_opinion": None}
        arrays = {name: part(value) for name, value in mine.items() if isinstance(value, np.ndarray)}
        return HogelImage(**mine | arrays)


def stacked(bands: Sequence[HogelImage]) -> HogelImage:
    """Join bands of rows of one image, from the top. The image has the arrays that all bands have."""
    if len(bands) == 1:
        return bands[0]
    whole: dict[str, Any] = {name: getattr(bands[0], name) for name in ("camera", "rendering")}
    opinions = [band.second_opinion for band in bands if band.second_opinion is not None]
    whole["second_opinion"] = partial(_joined, opinions) if len(opinions) == len(bands) else None

    def joined(name: str) -> Any:
        parts = [getattr(band, name) for band in bands]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    arrays = [item.name for item in fields(HogelImage) if item.name not in whole]
    return HogelImage(**whole, **{name: joined(name) for name in arrays})


def _joined(opinions: Sequence[Callable[[], Mask]]) -> Mask:
    return np.concatenate([opinion() for opinion in opinions])


def _itself(mask: Mask) -> Mask:
    return mask
