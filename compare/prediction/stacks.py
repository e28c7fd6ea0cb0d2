"""Surfaces one behind the other, as far as depth buffers have to tell them apart."""

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
    """What depth buffers have to tell apart in the true image of an aperture.

    Attributes
    ----------
    judged
        Number of pixels whose truth is no tie.
    distance, gap
        By camera: (N,) |z| of the surfaces that it shows there, and how far behind each of them it sees
        the next one, see `Reference.gaps`.
    """

    judged: int
    distance: Mapping[Camera, Floats]
    gap: Mapping[Camera, Floats]

    @classmethod
    def of(cls, truth: HogelImage, gaps: Floats) -> Stacks:
        """Return those of a true image and its gaps, (H, W)."""
        judged = judged_pixels(truth)
        height = truth.height.astype(np.float64)
        shown = {Camera.C: judged & (height <= 0), Camera.C_STAR: judged & (height > 0)}
        return cls(
            judged=int(judged.sum()),
            distance={camera: np.abs(height[here]) for camera, here in shown.items()},
            gap={camera: gaps[here] for camera, here in shown.items()},
        )
