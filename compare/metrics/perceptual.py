"""How different two pictures look: FLIP and SSIM.

Both judge pictures as they are shown, clipped and in sRGB (`display.encoded`), never the radiance
itself: FLIP in its mode for such pictures (LDR), SSIM with the window of its inventors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import flip_evaluator
import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from xfrustum.scenes.appearance.display import encoded
from xfrustum.scenes.arrays import Singles

PIXELS_PER_DEGREE = 0.7 * (3840 / 0.7) * math.pi / 180
"""FLIP's own viewing condition: a screen 3840 pixels and 0.7 m wide, seen from 0.7 m. It is that of a
picture on a screen; through a plate one aperture's picture is not seen as a whole."""

SSIM_SIGMA_PX, SSIM_WINDOW_PX = 1.5, 11
"""Standard deviation and width of SSIM's Gaussian window (Wang, Bovik, Sheikh, Simoncelli, 2004)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceptualDifference:
    """How different two pictures look.

    Attributes
    ----------
    flip
        Mean FLIP over the picture, 0 (the same) to 1 (Andersson et al., 2020).
    ssim
        Mean structural similarity over the picture and its channels, 1 for equal pictures; None for
        pictures smaller than its window.
    flip_map
        (H, W) float32, FLIP of each pixel.
    """

    flip: float
    ssim: float | None
    flip_map: Singles


def perceptual_difference(
    truth: NDArray[np.floating],
    raster: NDArray[np.floating],
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> PerceptualDifference:
    """Return how different two pictures look.

    Parameters
    ----------
    truth, raster
        (H, W, 3) linear RGB.
    pixels_per_degree
        Number of pixels that a degree of the viewer's sight holds, on which FLIP depends.
    """
    shown = [np.ascontiguousarray(encoded(color), dtype=np.float32) for color in (truth, raster)]
    # FLIP's neighborhoods reach over the whole picture, so no pixel can be left out.
    flip_map, _, _ = flip_evaluator.evaluate(
        *shown, "LDR", applyMagma=False, computeMeanError=False, parameters={"ppd": pixels_per_degree}
    )
    flip_map = np.asarray(flip_map, dtype=np.float32)[..., 0]
    ssim = None
    if min(flip_map.shape) >= SSIM_WINDOW_PX:
        ssim = float(
            structural_similarity(
                *shown,
                data_range=1.0,
                channel_axis=-1,
                gaussian_weights=True,
                sigma=SSIM_SIGMA_PX,
                use_sample_covariance=False,
            )
        )
    return PerceptualDifference(flip=float(flip_map.mean(dtype=np.float64)), ssim=ssim, flip_map=flip_map)
