"""A test of whether a picture is what a noisy reference converges to, per pixel, corrected for their number.

A reference that samples light paths knows its mean and, from the samples' spread, the variance of that
mean. Where the picture is the mean's expectation, (mean - picture) / standard error follows Student's t
with one degree of freedom less than there are samples. Of hundreds of thousands of pixels some lie far out by
chance alone; Sidak's correction accounts for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Mask

if TYPE_CHECKING:
    from xfrustum.reference.transport.transport import RadianceEstimate

ALPHA = 0.01
"""Chance that a test of a whole picture fails although nothing is wrong."""


@dataclass(frozen=True, kw_only=True)
class NoiseNumbers:
    """The numbers of a test of a picture against a noisy reference, as `compare --json` prints them.

    Attributes
    ----------
    agrees
        Whether no pixel differs at the level `ALPHA` of the whole picture.
    differ
        Number of pixels that differ at this level.
    tests
        Pixels times channels that were tested.
    p_value
        Chance that some pixel of the whole picture lies as far out as the farthest does, if the picture is
        what the reference converges to. It is exact where the tests are independent; where they depend on
        each other, as the channels of one pixel do, the true chance is smaller (Sidak's inequality).
    farthest
        The largest deviation in standard errors; infinite where a pixel without noise differs.
    without_noise
        Tested pixels in which no channel varies from sample to sample.
    bias
        Mean of picture minus reference over the tested pixels.
    bias_error
        One standard error of `bias`, from the variances.
    """

    agrees: bool
    differ: int
    alpha: float
    tests: int
    p_value: float
    farthest: float
    without_noise: int
    bias: float
    bias_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseTest:
    """What a per-pixel test says of a picture against a noisy reference.

    Attributes
    ----------
    differs
        (H, W) pixels that differ at the level `ALPHA` of the whole picture.
    deviation
        (H, W, 3) deviation in standard errors, signed, positive where the picture is brighter; NaN
        where not tested.
    """

    numbers: NoiseNumbers
    differs: Mask
    deviation: Floats


def compare_with_noise(
    picture: NDArray[np.floating],
    estimate: RadianceEstimate,
    judged: Mask,
    rounding: Floats | float = 0.0,
) -> NoiseTest:
    """Test whether a picture is what a noisy reference converges to.

    Parameters
    ----------
    picture
        (H, W, 3) linear RGB, without noise.
    judged
        (H, W) pixels to be tested. Where an edge crosses a pixel so that few of its samples meet a
        surface, chance may miss that surface altogether, and then neither mean nor variance knows of it:
        leave out pixels in which a surface may cover less than 1 - (level of one test)^(1 / samples).
    rounding
        Radiance by which picture and mean may differ for other reasons than noise, such as their rounding
        to float32. It alone decides where samples do not vary.
    """
    tested = judged & np.isfinite(picture).all(axis=-1) & np.isfinite(estimate.mean).all(axis=-1)
    difference = (np.asarray(picture, dtype=np.float64) - estimate.mean)[tested]
    variance = np.asarray(estimate.variance_of_mean, dtype=np.float64)[tested]
    excess = np.sign(difference) * np.maximum(
        np.abs(difference) - np.broadcast_to(rounding, picture.shape)[tested], 0.0
    )
    noisy = variance > 0
    scaled = np.where(excess == 0, 0.0, np.copysign(np.inf, excess))
    np.divide(excess, np.sqrt(variance), out=scaled, where=noisy)
    chance = 2 * scipy.stats.t.sf(np.abs(scaled), estimate.samples - 1)
    deviation = np.full(picture.shape, np.nan)
    deviation[tested] = scaled
    differs = np.zeros(tested.shape, dtype=np.bool_)
    differs[tested] = (chance < single_level(ALPHA, chance.size)).any(axis=-1)
    numbers = NoiseNumbers(
        agrees=not differs.any(),
        differ=int(differs.sum()),
        alpha=ALPHA,
        tests=chance.size,
        p_value=joint_chance(float(chance.min(initial=1.0)), chance.size),
        farthest=float(np.abs(scaled).max(initial=0.0)),
        without_noise=int((~noisy).all(axis=-1).sum()),
        bias=float(difference.mean()) if len(difference) else 0.0,
        bias_error=float(np.sqrt(variance.sum()) / variance.size) if variance.size else 0.0,
    )
    return NoiseTest(numbers=numbers, differs=differs, deviation=deviation)


def joint_chance(chance: float, tests: int) -> float:
    """Return the chance that the least of several independent p-values is at most `chance` (Sidak)."""
    if chance >= 1:
        return 1.0
    return float(-np.expm1(tests * np.log1p(-chance)))


def single_level(chance: float, tests: int) -> float:
    """Return the level of each single test for which all tests together have the level `chance` (Sidak)."""
    return float(-np.expm1(np.log1p(-chance) / max(tests, 1)))
