"""Radiance error: how far colors are off in linear RGB, raster minus truth, and how different pictures look.

See docs/method.md, "What is compared". FLIP and SSIM judge pictures as they are shown, clipped and in sRGB
(`display.encoded`), never the radiance itself: FLIP in its mode for such pictures (LDR), SSIM with the window
of its inventors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import flip_evaluator
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter
from skimage.metrics import structural_similarity

from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.noise import NoiseNumbers, compare_with_noise
from xfrustum.reference.transport.transport import RadianceEstimate
from xfrustum.scenes.appearance.display import encoded
from xfrustum.scenes.arrays import Floats, Mask, Singles
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.notebook import Brief

PIXELS_PER_DEGREE = 0.7 * (3840 / 0.7) * math.pi / 180
"""FLIP's own viewing condition: a screen 3840 pixels and 0.7 m wide, seen from 0.7 m. It is that of a
picture on a screen; through a plate one aperture's picture is not seen as a whole."""

SSIM_SIGMA_PX, SSIM_WINDOW_PX = 1.5, 11
"""Standard deviation and width of SSIM's Gaussian window (Wang, Bovik, Sheikh, Simoncelli, 2004)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerceptualDifference:
    """How different two pictures look."""

    flip: float  # mean FLIP over the picture, 0 (the same) to 1 (Andersson et al., 2020)
    ssim: float | None  # mean over picture and channels, 1 for equal; None if smaller than its window
    flip_map: Singles  # (H, W) float32


def perceptual_difference(
    truth: NDArray[np.floating],
    raster: NDArray[np.floating],
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> PerceptualDifference:
    """Return how different two pictures (H, W, 3) of linear RGB look.

    FLIP depends on the number of pixels that a degree of the viewer's field of view holds.
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


STEP = 1 / 255
"""One level of 8-bit output, in linear radiance: the difference that two shaded answers may have."""

Rgb = tuple[float, float, float]
"""One number for each of red, green and blue."""


@dataclass(frozen=True, kw_only=True)
class ChannelSpread:
    """How the radiance error is distributed in red, green and blue alone; see `RadianceSpread`."""

    rms: Rgb
    mean: Rgb
    p99: Rgb
    max: Rgb


@dataclass(frozen=True, kw_only=True)
class RadianceSpread:
    """How the radiance error is distributed over some pixels.

    Root mean square and mean are over the pixels' channels; the mean is signed, positive where the raster is
    brighter. 99th percentile and maximum are over the pixels; the channel that is farthest off counts.
    """

    pixels: int
    rms: float
    mean: float
    p99: float
    max: float
    above_step: float  # share of pixels with a channel that is off by more than `STEP`
    channels: ChannelSpread

    @staticmethod
    def of(error: Floats) -> RadianceSpread | None:
        """Return the spread of signed errors (3, N), None where there are none."""
        if error.shape[1] == 0:
            return None
        size = np.abs(error)
        worst, squares, means = size.max(axis=0), np.square(error).mean(axis=1), error.mean(axis=1)
        return RadianceSpread(
            pixels=error.shape[1],
            rms=float(np.sqrt(squares.mean())),
            mean=float(means.mean()),
            p99=float(np.percentile(worst, 99)),
            max=float(worst.max()),
            above_step=float(np.mean(worst > STEP)),
            channels=ChannelSpread(
                rms=_rgb(np.sqrt(squares)),
                mean=_rgb(means),
                p99=_rgb(np.percentile(size, 99, axis=1)),
                max=_rgb(size.max(axis=1)),
            ),
        )


def _rgb(values: Floats) -> Rgb:
    red, green, blue = (float(value) for value in values)
    return red, green, blue


@dataclass(frozen=True, kw_only=True)
class RadianceNumbers(RadianceSpread):
    """The radiance error over all judged pixels with a color in both images, as `compare --json` prints it.

    How different the pictures look, and the viewing condition of FLIP, are None unless asked for.
    """

    away_from_edges: RadianceSpread | None  # over those pixels that the function of that name returns
    flip: float | None
    ssim: float | None
    pixels_per_degree: float | None
    noise: NoiseNumbers | None  # whether pixels differ by more than `STEP` and the noise of light paths


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RadianceError(Brief):
    """How far the colors of a raster image are from the truth's, in numbers and at judged pixels (H, W)."""

    numbers: RadianceNumbers
    truth: HogelImage
    raster: HogelImage
    judged: Mask

    @cached_property
    def error(self) -> Floats:
        """(H, W, 3) raster minus truth, NaN where not judged, made when it is first asked for."""
        assert self.raster.color is not None and self.truth.color is not None, "compared colors"
        error = self.raster.color.astype(np.float64) - self.truth.color
        error[~self.judged] = np.nan
        return error


def compare_radiance(
    truth: HogelImage, raster: HogelImage, *, perceptual: bool = False
) -> RadianceError | None:
    """Return the radiance error of an image; None where an image has no color, or nothing is judged.

    Pixels whose truth is a tie are not judged. How different the pictures look takes longer than all else.
    """
    if truth.color is None or raster.color is None:
        return None
    # A plane for each channel: along rows of three numbers, NumPy takes several times as long.
    error = np.moveaxis(raster.color, -1, 0).astype(np.float64, order="C") - np.moveaxis(truth.color, -1, 0)
    judged = np.isfinite(error).all(axis=0) & judged_pixels(truth)
    channels = error.reshape(3, -1)
    spread = RadianceSpread.of(channels.compress(judged.ravel(), axis=1))
    if spread is None:
        return None
    inside = judged & away_from_edges(truth, raster)
    looks = perceptual_difference(truth.color, raster.color) if perceptual else None
    noise, paths = None, truth.camera.light_paths
    if truth.variance is not None and paths is not None:
        mean, variance = (values.astype(np.float64) for values in (truth.color, truth.variance))
        estimate = RadianceEstimate(mean=mean, variance_of_mean=variance, samples=paths)
        noise = compare_with_noise(raster.color, estimate, judged, STEP).numbers
    numbers = RadianceNumbers(
        **vars(spread),
        away_from_edges=RadianceSpread.of(channels.compress(inside.ravel(), axis=1)),
        flip=looks.flip if looks else None,
        ssim=looks.ssim if looks else None,
        pixels_per_degree=PIXELS_PER_DEGREE if looks else None,
        noise=noise,
    )
    return RadianceError(numbers=numbers, truth=truth, raster=raster, judged=judged)


def away_from_edges(truth: HogelImage, raster: HogelImage, margin: int = 0) -> Mask:
    """Return the pixels that show the same triangle in both images, (H, W).

    What such a pixel's center shows is shaded continuously from one image to the other, however
    coarse the mesh. Where images give no triangle numbers, no pixel is away from edges. Pixels within a
    margin about another triangle are left out too, where colors are averaged over a pixel's area or over the
    aperture.
    """
    same = (truth.triangle == raster.triangle) & truth.covered & (truth.triangle != NOTHING)
    if margin > 0:
        size = 2 * margin + 1
        for number in (truth.triangle, raster.triangle):
            same &= maximum_filter(number, size) == minimum_filter(number, size)
    return np.asarray(same)
