"""What lies at which depth in the frusta of some apertures, in bins of |z|, hidden surfaces included."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.compare.extent.layers import areas, share_between, triangles_in_chunks
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.region import Region
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

HALVINGS = 6
"""Number of halvings of the reach at which bins end. The innermost bin, from the plate to 1/64 of the reach,
has every error that grows as 1/|z|."""


@dataclass(frozen=True, kw_only=True)
class DepthBin:
    """The content of the frusta between two distances from the plate, on one side of it.

    Attributes
    ----------
    behind
        Whether the bin lies behind the plate and not before it.
    heights
        Distances |z| between which the bin lies, scene units.
    nearest, farthest
        Range of |z| of the content, scene units, from the boxes about its triangles.
    triangles
        Number of triangles that reach into the bin, inside the frusta.
    share
        Share of their surface, by area, of that of all bins; 0 where all of it has no area.
    """

    behind: bool
    heights: tuple[float, float]
    nearest: float
    farthest: float
    triangles: int
    share: float


def depth_bins(scene: Scene, apertures: Iterable[Aperture] | None = None) -> tuple[DepthBin, ...]:
    """Return the bins that have content, from the farthest behind the plate to the farthest before it.

    Parameters
    ----------
    scene
        Scene that is asked about.
    apertures
        Apertures whose frusta count, each with its whole cell; None for all of the plate.
    """
    region = Region.true(scene, apertures)
    toward, back = scene.frustum.reach
    found = [
        _Counted(behind=behind, heights=heights)
        for behind, reach in ((True, back), (False, toward))
        for heights in pairwise([0.0, *(reach / 2**k for k in range(HALVINGS, -1, -1))])
    ]
    for part in scene.objects:
        for triangles in triangles_in_chunks(part):
            for one in found:
                one.count(triangles, region)
    whole = sum(one.area for one in found)
    bins = [one.bin(whole) for one in found if one.triangles]
    return tuple(sorted(bins, key=lambda one: one.heights[1] * (-1 if one.behind else 1)))


@dataclass(kw_only=True)
class _Counted:
    """A bin while its content is counted."""

    behind: bool
    heights: tuple[float, float]
    nearest: float = np.inf
    farthest: float = 0.0
    triangles: int = 0
    area: float = 0.0

    def count(self, triangles: Floats, region: Region) -> None:
        """Count those of some triangles (F, 3, 3) that reach into the bin, inside the region."""
        near, far = self.heights
        low_z, high_z = (-far, -near) if self.behind else (near, far)
        inside = triangles[self._reach_into(triangles)]
        if not len(inside):
            return
        low, high = inside.min(axis=1), inside.max(axis=1)
        low[:, 2], high[:, 2] = np.maximum(low[:, 2], low_z), np.minimum(high[:, 2], high_z)
        held = region.holds(low, high)
        if not held.any():
            return
        distances = np.abs(np.stack((low[held, 2], high[held, 2])))
        self.nearest = min(self.nearest, float(distances.min()))
        self.farthest = max(self.farthest, float(distances.max()))
        self.triangles += int(held.sum())
        kept = inside[held]
        self.area += float((areas(kept) * share_between(kept, low_z, high_z)).sum())

    def _reach_into(self, triangles: Floats) -> Mask:
        """Return which triangles (F, 3, 3) have more than a border in the bin.

        One that lies between two bins belongs to the inner one; one in the plate, to both sides.
        """
        near, far = self.heights
        distances = triangles[..., 2] * (-1 if self.behind else 1)
        least, most = distances.min(axis=1), distances.max(axis=1)
        outer_end = np.where(least == most, least <= far, least < far)
        inner_end = (most > near) | ((least == most) & (most == 0) & (near == 0))
        return np.asarray(outer_end & inner_end)

    def bin(self, whole: float) -> DepthBin:
        """Return the bin, where all bins have some area in all."""
        return DepthBin(
            behind=self.behind,
            heights=self.heights,
            nearest=self.nearest,
            farthest=self.farthest,
            triangles=self.triangles,
            share=self.area / whole if whole > 0 else 0.0,
        )
