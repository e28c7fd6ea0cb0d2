"""What near offset, depth buffer, shear and band limiting do at each depth of a scene, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.extent.content import DepthBin, depth_bins
from xfrustum.compare.prediction.band_limiting import band_limit, contrast_of
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture
from xfrustum.tolerances import TOLERANCE_PX


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
        Displacement by the near offset at the corner of the film, of the nearest content, pixels.
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
        scene units; None where content touches the plate.
    tolerance_px
        Displacement that is tolerated.
    contrast
        Bound of the change of radiance at an edge, from 0 to 1, that sub-apertures are counted for.
    sub_apertures
        Largest number of all rows; None where one of them has none.
    """

    rows: tuple[DepthRow, ...]
    near: float
    largest_near: float | None
    tolerance_px: float
    contrast: float
    sub_apertures: int | None


def depths(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> Depths:
    """Return the content of an aperture's frustum by depth, with errors in closed form.

    Rows are those of the first slab's cameras without cuts; slabs and fits make errors smaller.
    """
    bins = depth_bins(scene, [aperture])
    contrast = contrast_of(scene, [aperture])
    rows = tuple(_row(scene, aperture, settings, one, contrast) for one in bins)
    nearest = min((row.nearest for row in rows), default=0.0)
    corner = math.hypot(*scene.frustum.resolution) / 2
    largest = nearest * TOLERANCE_PX / max(corner - TOLERANCE_PX, TOLERANCE_PX)
    counts = [row.sub_apertures for row in rows]
    return Depths(
        rows=rows,
        near=settings.near,
        largest_near=largest or None,
        tolerance_px=TOLERANCE_PX,
        contrast=contrast,
        sub_apertures=None if None in counts else max((count for count in counts if count), default=1),
    )


def _row(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, content: DepthBin, contrast: float
) -> DepthRow:
    frustum, n = scene.frustum, settings.near
    reach = frustum.reach[1 if content.behind else 0]
    band = band_limit(scene, content, contrast)
    largest, least = (blur if math.isfinite(blur) else None for blur in band.blur_px)
    moved = n / (content.nearest + n)
    separation = smallest_separation(
        np.array([content.farthest + n]), n, n + reach, settings.depth, settings.mapping
    )
    return DepthRow(
        side="behind" if content.behind else "before",
        heights=content.heights,
        nearest=content.nearest,
        farthest=content.farthest,
        triangles=content.triangles,
        share=content.share,
        near_px=math.hypot(*frustum.resolution) / 2 * moved,
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
