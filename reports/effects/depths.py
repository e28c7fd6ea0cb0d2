"""What near offset, depth buffer, shear and band limiting do at each depth of a scene, in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.extent.content import DepthBin, depth_bins
from xfrustum.compare.prediction.band_limiting import (
    LEVEL,
    band_limit,
    contrast_of,
    error_bound,
    widest_blur,
)
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX

EXAMPLE_SUB_APERTURES = (1, 16, 256, 4096)
"""Numbers of sub-apertures whose errors are told: none but the middle, and what one might pay for."""


@dataclass(frozen=True, kw_only=True)
class BandError:
    """Bound of the error of a mean over sub-apertures, at the worst pixel of an edge, in levels of 8 bits."""

    sub_apertures: int
    levels: float


@dataclass(frozen=True, kw_only=True)
class DepthRow:
    """One bin of depth, and the largest errors that its content can have in an image.

    Attributes
    ----------
    side
        `behind` the plate or `before` it.
    heights
        Distances |z| between which the bin lies, scene units.
    nearest, farthest
        Range of |z| of its content, scene units.
    triangles, share
        Number of triangles that reach into the bin inside the frustum, and the share of their surface, by
        area, of that of all bins.
    near_px
        Displacement by the near offset at the corner of the film, of the nearest content, pixels; 0 beyond
        the first cut.
    shear_px
        What the pivot `camera` adds to it, pixels; 0 for centered frusta.
    separation
        Smallest separation of two surfaces that the depth buffer orders at the farthest content, scene units.
    blur_px
        Smallest and largest blur by the hogel's area, pixels; None of what lies in the plate.
    sub_apertures
        Points of that area that keep the error of band limiting under a level of 8 bits; None where more than
        65,536 would be needed.
    """

    side: str
    heights: tuple[float, float]
    nearest: float
    farthest: float
    triangles: int
    share: float
    near_px: float
    shear_px: float
    separation: float
    blur_px: tuple[float | None, float | None]
    sub_apertures: int | None


@dataclass(frozen=True, kw_only=True)
class Depths:
    """The content of one aperture's frustum by depth, and what bounds its errors.

    Attributes
    ----------
    rows
        Bins with content, from the farthest behind the plate to the farthest before it.
    near
        Near offset that the rows are computed for, scene units.
    largest_near
        Largest near that displaces no content by more than `tolerance_px`, wherever it lies on the film;
        scene units; None where content touches the plate. With cuts it is the height of the first at most.
    tolerance_px
        Displacement that is tolerated.
    contrast
        Bound of the change of radiance at an edge, from 0 to 1, that sub-apertures are counted for.
    sub_apertures
        Largest number of all rows; None where one of them has none.
    cuts
        Heights |z| at which the frusta are cut, scene units.
    band_errors
        Largest errors over all rows with the numbers of `EXAMPLE_SUB_APERTURES`, from the bound.
    """

    rows: tuple[DepthRow, ...]
    near: float
    largest_near: float | None
    tolerance_px: float
    contrast: float
    sub_apertures: int | None
    cuts: tuple[float, ...]
    band_errors: tuple[BandError, ...]


def depths(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> Depths:
    """Return the content of an aperture's frustum by depth, with errors in closed form.

    The near offset displaces what lies below the first cut, and a fit makes that less: without an own one the
    first slab is fitted to its cut. Cameras of the other slabs stand in the aperture.
    """
    bins = depth_bins(scene, [aperture])
    contrast = contrast_of(scene, [aperture])
    rows = tuple(_row(scene, aperture, settings, one, contrast) for one in bins)
    blurs = [widest_blur(scene, one) for one in bins]
    counts = [row.sub_apertures for row in rows]
    return Depths(
        rows=rows,
        near=settings.near,
        largest_near=_largest_near(scene, settings, bins),
        tolerance_px=TOLERANCE_PX,
        contrast=contrast,
        sub_apertures=None if None in counts else max((count for count in counts if count), default=1),
        cuts=settings.slabs,
        band_errors=tuple(
            BandError(
                sub_apertures=count,
                levels=max((error_bound(count, blur, contrast) for blur in blurs), default=0.0) / LEVEL,
            )
            for count in EXAMPLE_SUB_APERTURES
        ),
    )


def _largest_near(scene: Scene, settings: DoubleFrustum, bins: Sequence[DepthBin]) -> float | None:
    """Return the largest near that displaces nothing too much; see `Depths.largest_near`."""
    corner = math.hypot(*scene.frustum.resolution) / 2
    nears = [
        one.nearest * TOLERANCE_PX / max(corner * _of_fit(scene, settings, one) - TOLERANCE_PX, TOLERANCE_PX)
        for one in bins
        if one.nearest < _first_slab(scene, settings, one)
    ]
    return min((*nears, *settings.slabs), default=0.0) or None


def _first_slab(scene: Scene, settings: DoubleFrustum, content: DepthBin) -> float:
    """Return the height |z| at which the slab that touches the plate ends, on the side of a bin."""
    low_and_high = settings.sections(scene.frustum.reach[1 if content.behind else 0])[0]
    return low_and_high[1]


def _of_fit(scene: Scene, settings: DoubleFrustum, content: DepthBin) -> float:
    """Return by what a fit to the first cut multiplies the displacement of a bin's nearest content."""
    if not settings.slabs:
        return 1.0
    fitted = settings.fitted_height(scene.frustum)
    return 1.0 if fitted is None else abs(1 - content.nearest / fitted)


def _row(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, content: DepthBin, contrast: float
) -> DepthRow:
    frustum, n = scene.frustum, settings.near
    reach = frustum.reach[1 if content.behind else 0]
    band = band_limit(scene, content, contrast)
    largest, least = (blur if math.isfinite(blur) else None for blur in band.blur_px)
    displaced = content.nearest < _first_slab(scene, settings, content)
    moved = n / (content.nearest + n) if displaced else 0.0
    low, high = next(one for one in settings.sections(reach) if content.farthest <= one[1] or one[1] == reach)
    # The first slab's camera has stepped back; those of the others stand in the aperture.
    back, near = (n, n) if low == 0 else (0.0, low)
    separation = smallest_separation(
        np.array([content.farthest + back]), near, high + back, settings.depth, settings.mapping
    )
    return DepthRow(
        side="behind" if content.behind else "before",
        heights=content.heights,
        nearest=content.nearest,
        farthest=content.farthest,
        triangles=content.triangles,
        share=content.share,
        near_px=math.hypot(*frustum.resolution) / 2 * moved * _of_fit(scene, settings, content),
        shear_px=_shear_px(scene, aperture) * moved,
        separation=float(separation[0]),
        blur_px=(least, largest),
        sub_apertures=band.sub_apertures,
    )


def _shear_px(scene: Scene, aperture: Aperture) -> float:
    """Return the length of (W/2 kx/tx, H/2 ky/ty): pixels by which a shear of n per depth moves the film."""
    screen = scene.frustum.screen
    if screen is None:
        return 0.0
    # k/t is the distance from aperture to the screen's middle, in half sizes of the screen.
    return math.hypot(
        *(
            pixels / 2 * (center - place) / (size / 2)
            for pixels, center, place, size in zip(
                scene.frustum.resolution, screen.center, (aperture.x, aperture.y), screen.size, strict=True
            )
        )
    )
