"""Tests against chance: a picture against a noisy reference, and wrong pixels of a pair of pictures.

A reference that samples light paths knows its mean and, from the samples' spread, the variance of that
mean. Where the picture is the mean's expectation, (mean - picture) / standard error follows Student's t
with one degree of freedom less than there are samples. Of hundreds of thousands of pixels some lie far out by
chance alone; Sidak's correction accounts for it.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Mask

if TYPE_CHECKING:
    from xfrustum.reference.transport.transport import RadianceEstimate

ALPHA = 0.01
"""Chance that a test of a whole picture fails although nothing is wrong."""


CONFIDENCE = 0.95
"""Probability that no picture among those compared is called worse than another by chance."""


@dataclass(frozen=True, kw_only=True)
class NoiseNumbers:
    """The numbers of a test of a picture against a noisy reference, as `compare --json` prints them.

    A picture agrees if no pixel differs at the level `alpha` of the whole picture. The p-value is the chance
    that some pixel of the whole picture lies as far out as the farthest does, if the picture is what the
    reference converges to. It is exact where the tests are independent; where they depend on each other, as
    the channels of one pixel do, the true chance is smaller (Sidak's inequality).
    """

    agrees: bool
    differ: int  # pixels
    alpha: float
    tests: int  # pixels times channels
    p_value: float
    farthest: float  # deviation in standard errors; infinite where a pixel without noise differs
    without_noise: int  # tested pixels in which no channel varies from sample to sample
    bias: float  # mean of picture minus reference over the tested pixels
    bias_error: float  # one standard error of it, from the variances


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseTest:
    """What a per-pixel test says of a picture against a noisy reference."""

    numbers: NoiseNumbers
    differs: Mask  # (H, W) pixels that differ at the level of the whole picture
    deviation: Floats  # (H, W, 3) standard errors, positive where the picture is brighter; NaN if not tested


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


# Pairs of pictures ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class PixelSet:
    """A set of pixels of a film: their number, and one bit for each pixel of the film, compressed."""

    count: int
    packed: bytes = field(repr=False)

    @classmethod
    def of(cls, mask: Mask) -> PixelSet:
        """Return the pixels where a mask is set."""
        return cls(count=int(mask.sum()), packed=zlib.compress(np.packbits(mask).tobytes(), level=1))

    def shared_with(self, other: PixelSet) -> int:
        """Return how many pixels are in both sets, of one film."""
        one, two = (np.frombuffer(zlib.decompress(each.packed), np.uint8) for each in (self, other))
        return int(np.bitwise_count(one & two).sum())


def is_worse(only_here: int, only_there: int, comparisons: int = 1) -> bool:
    """Return whether more pixels are wrong in one picture than in another, beyond chance.

    This is the exact test of McNemar (1947). Pixels that are wrong in both pictures, or in neither, say
    nothing. If neither picture were worse, each other pixel would be wrong in the one or in the other
    with equal chances. Pixels along one contour change together, so that the test sees differences too soon
    rather than too late; callers ask for a smallest difference besides. `CONFIDENCE` holds for all
    `comparisons` with the other picture together (Bonferroni).
    """
    by_chance = scipy.stats.binom.sf(only_here - 1, only_here + only_there, 0.5)
    return bool(only_here > only_there and by_chance < (1 - CONFIDENCE) / comparisons)
