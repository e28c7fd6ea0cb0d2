"""Radiance error: how far colors are off, in linear RGB, raster minus truth.

See docs/method.md, "What is compared".
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from xfrustum.compare.metrics.noise import NoiseTest, compare_with_noise
from xfrustum.compare.metrics.perceptual import PIXELS_PER_DEGREE, PerceptualDifference, perceptual_difference
from xfrustum.reference.transport.transport import RadianceEstimate
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelImage

STEP = 1 / 255
"""One level of 8-bit output, in linear radiance; what two shaded answers may differ by."""


@dataclass(frozen=True, kw_only=True)
class RadianceSpread:
    """How the radiance error is distributed over some pixels.

    Attributes
    ----------
    pixels
        How many there are.
    rms, mean
        Over the pixels' channels; the mean is signed, positive where the raster is brighter.
    p99, max
        Over the pixels, of the channel that is farthest off.
    above_step
        Share of pixels with a channel that is off by more than `STEP`.
    channels
        The first four of red, green and blue alone.
    """

    pixels: int
    rms: float
    mean: float
    p99: float
    max: float
    above_step: float
    channels: dict[str, tuple[float, float, float]]

    @classmethod
    def of(cls, error: NDArray[np.floating]) -> RadianceSpread | None:
        """Return the spread of signed errors (N, 3), None where there are none."""
        if len(error) == 0:
            return None
        error = np.asarray(error, dtype=np.float64)
        size = np.abs(error)
        worst: Floats = size.max(axis=1)
        squares = np.mean(error**2, axis=0)
        channels = {
            "rms": np.sqrt(squares),
            "mean": error.mean(axis=0),
            "p99": np.percentile(size, 99, axis=0),
            "max": size.max(axis=0),
        }
        return cls(
            pixels=len(error),
            rms=float(np.sqrt(squares.mean())),
            mean=float(error.mean()),
            p99=float(np.percentile(worst, 99)),
            max=float(worst.max()),
            above_step=float(np.mean(worst > STEP)),
            channels={name: (float(r), float(g), float(b)) for name, (r, g, b) in channels.items()},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RadianceError:
    """How far the colors of a raster image are from the truth's.

    Attributes
    ----------
    judged
        Over all judged pixels with a color in both.
    away_from_edges
        Of those, over the pixels of `away_from_edges`; None where there are none.
    perceptual
        None unless asked for.
    noise
        Where the truth is a mean of light paths: which pixels differ by more than `STEP` and its noise.
    error
        (H, W, 3) raster minus truth, NaN where not judged.
    """

    judged: RadianceSpread
    away_from_edges: RadianceSpread | None
    perceptual: PerceptualDifference | None
    noise: NoiseTest | None
    error: Floats

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        looks = self.perceptual
        return {
            **asdict(self.judged),
            "away_from_edges": asdict(self.away_from_edges) if self.away_from_edges else None,
            "flip": looks.flip if looks else None,
            "ssim": looks.ssim if looks else None,
            "pixels_per_degree": PIXELS_PER_DEGREE if looks else None,
            "noise": self.noise.summary() if self.noise else None,
        }


def compare_radiance(
    truth: HogelImage, raster: HogelImage, *, perceptual: bool = False
) -> RadianceError | None:
    """Return the radiance error of an image; None where an image has no color, or nothing is judged.

    Parameters
    ----------
    truth, raster
        Of one aperture and size. Pixels whose truth is a tie are not judged.
    perceptual
        Whether to compute how different the pictures look, too, which takes longer than all else.
    """
    if truth.color is None or raster.color is None:
        return None
    error = raster.color.astype(np.float64) - truth.color
    judged = np.asarray(np.isfinite(error).all(axis=-1))
    if truth.certainty is not None:
        judged &= truth.certainty != Certainty.TIE
    spread = RadianceSpread.of(error[judged])
    if spread is None:
        return None
    error[~judged] = np.nan
    inside = judged & away_from_edges(truth, raster)
    return RadianceError(
        judged=spread,
        away_from_edges=RadianceSpread.of(error[inside]),
        perceptual=perceptual_difference(truth.color, raster.color) if perceptual else None,
        noise=_noise(truth, raster, judged),
        error=error,
    )


def _noise(truth: HogelImage, raster: HogelImage, judged: Mask) -> NoiseTest | None:
    """Test a raster image against a truth that knows its own variance."""
    paths = truth.camera.light_paths
    if truth.variance is None or paths is None or truth.color is None or raster.color is None:
        return None
    estimate = RadianceEstimate(
        mean=truth.color.astype(np.float64),
        variance_of_mean=truth.variance.astype(np.float64),
        samples=paths,
    )
    return compare_with_noise(raster.color, estimate, judged, STEP)


def away_from_edges(truth: HogelImage, raster: HogelImage, margin: int = 0) -> Mask:
    """Return the pixels that show the same triangle in both images, (H, W).

    What such a pixel's center shows is shaded continuously from one image to the other, however
    coarse the mesh. Where images give no triangle numbers, no pixel is away from edges.

    Parameters
    ----------
    margin
        For colors that are averaged over a pixel's area, or over the aperture: pixels at whose
        side another triangle is shown, up to so many pixels away, are left out too.
    """
    same = (truth.triangle == raster.triangle) & truth.covered & (truth.triangle != NOTHING)
    if margin > 0:
        size = 2 * margin + 1
        for number in (truth.triangle, raster.triangle):
            same &= maximum_filter(number, size) == minimum_filter(number, size)
    return np.asarray(same)
