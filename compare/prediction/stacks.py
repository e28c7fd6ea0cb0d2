"""Surfaces one behind the other that a depth buffer has to tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera


@dataclass(frozen=True, kw_only=True, eq=False)
class Stacks:
    """Distances and gaps of the surfaces in the true image of an aperture.

    Attributes
    ----------
    judged
        Number of pixels whose truth is no tie.
    distance
        For each camera, (N,) |z| of the surfaces that it shows in judged pixels, scene units.
    gap
        For each camera, (N,) distance from each of these surfaces to the next one on the same line, scene
        units; see `Reference.gaps`.
    """

    judged: int
    distance: Mapping[Camera, Floats]
    gap: Mapping[Camera, Floats]

    def of_camera(self, camera: Camera) -> tuple[Floats, Floats]:
        """Return the distances and the gaps of a camera's surfaces, (N,) each."""
        return self.distance[camera], self.gap[camera]

    @cached_property
    def paired(self) -> Stacks:
        """The same surfaces but for those that have no other one behind them."""
        kept = {camera: np.isfinite(gap) for camera, gap in self.gap.items()}
        if all(one.all() for one in kept.values()):
            return self
        return Stacks(
            judged=self.judged,
            distance={camera: one[kept[camera]] for camera, one in self.distance.items()},
            gap={camera: one[kept[camera]] for camera, one in self.gap.items()},
        )

    @cached_property
    def ends(self) -> Mapping[Camera, tuple[float, float]]:
        """For each camera, distances of its nearest and of its farthest surface; NaN where it has none."""
        return {
            camera: (float(one.min()), float(one.max())) if one.size else (np.nan, np.nan)
            for camera, one in self.distance.items()
        }

    @classmethod
    def of(cls, truth: HogelImage, gaps: Floats) -> Stacks:
        """Return the stacks of a true image and its gaps, (H, W)."""
        judged = judged_pixels(truth).ravel()
        height, gaps = truth.height.astype(np.float64).ravel(), gaps.ravel()
        shown = {Camera.C: judged & (height <= 0), Camera.C_STAR: judged & (height > 0)}
        return cls(
            judged=int(judged.sum()),
            distance={camera: np.abs(height[here]) for camera, here in shown.items()},
            gap={camera: gaps[here] for camera, here in shown.items()},
        )
