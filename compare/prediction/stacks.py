"""Surfaces one behind the other that a depth buffer has to tell apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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

    @classmethod
    def of(cls, truth: HogelImage, gaps: Floats) -> Stacks:
        """Return the stacks of a true image and its gaps, (H, W)."""
        judged = judged_pixels(truth)
        height = truth.height.astype(np.float64)
        shown = {Camera.C: judged & (height <= 0), Camera.C_STAR: judged & (height > 0)}
        return cls(
            judged=int(judged.sum()),
            distance={camera: np.abs(height[here]) for camera, here in shown.items()},
            gap={camera: gaps[here] for camera, here in shown.items()},
        )
