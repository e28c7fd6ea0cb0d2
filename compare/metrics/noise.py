"""Is a picture what a noisy reference converges to? A test per pixel, corrected for their number.

A reference that samples light paths knows its mean and, from the samples' spread, the variance of that
mean. Where the picture is the mean's expectation, (mean - picture) / standard error follows Student's t
with one degree of freedom less than there are samples. Of hundreds of thousands of pixels some lie far out by
chance alone; Sidak's correction accounts for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from xfrustum.scenes.arrays import Floats, Mask

if TYPE_CHECKING:
    from xfrustum.reference.transport.transport import RadianceEstimate

ALPHA = 0.01
"""Chance that a test of a whole picture fails although nothing is wrong."""

COLOR_ROUNDING = 3 * 2.0**-24
"""Of colors that are computed in double precision, relative to their size: the picture and the reference's
mean are each stored in float32, one rounding each. What double precision leaves before that is less than
a third one, unless it is amplified 2^29 times."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseTest:
    """What a per-pixel test says of a picture against a noisy reference.

    Attributes
    ----------
    tests
        Pixels times channels that were tested.
    p_value
        Of the whole: chance that some pixel lies as far out as the farthest does, if the picture is what
        the reference converges to. Exact where the tests are independent; where they hang together,
        as the channels of one pixel do, the true one is smaller (Sidak's inequality).
    farthest
        The largest deviation in standard errors; infinite where a pixel without noise differs.
    without_noise
        Tested pixels in which no channel varies from sample to sample.
    bias
        Mean of picture minus reference over the tested pixels.
    bias_error
        One standard error of the same, from the variances.
    differs
        (H, W) pixels that differ at the level `ALPHA` of the whole.
    deviation
        (H, W, 3) deviation in standard errors, signed, positive where the picture is brighter; NaN
        where not tested.
    """

    tests: int
    p_value: float
    farthest: float
    without_noise: int
    bias: float
    bias_error: float
    differs: Mask
    deviation: Floats

    @property
    def agrees(self) -> bool:
        """Whether no pixel differs at the level `ALPHA` of the whole."""
        return not self.differs.any()

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `compare --json` prints them."""
        names = ("tests", "p_value", "farthest", "without_noise", "bias", "bias_error")
        numbers: dict[str, Any] = {name: getattr(self, name) for name in names}
        return {"agrees": self.agrees, "differ": int(self.differs.sum()), "alpha": ALPHA, **numbers}


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
    estimate
        The reference's mean, its variance, and how many samples they are made from.
    judged
        (H, W) pixels to be tested. Where an edge crosses a pixel so that few of its samples meet a
        surface, chance may miss it altogether, and then neither mean nor variance know of it: leave out
        pixels of which a share of surface below 1 - (level of one test)^(1 / samples) may be missed.
    rounding
        Radiance by which the two may differ for other reasons than noise, such as `COLOR_ROUNDING`
        times their size. It alone decides where samples do not vary.
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
    chance = 2 * stats.t.sf(np.abs(scaled), estimate.samples - 1)
    deviation = np.full(picture.shape, np.nan)
    deviation[tested] = scaled
    differs = np.zeros(tested.shape, dtype=np.bool_)
    differs[tested] = (chance < of_one(ALPHA, chance.size)).any(axis=-1)
    return NoiseTest(
        tests=chance.size,
        p_value=of_all(float(chance.min(initial=1.0)), chance.size),
        farthest=float(np.abs(scaled).max(initial=0.0)),
        without_noise=int((~noisy).all(axis=-1).sum()),
        bias=float(difference.mean()) if len(difference) else 0.0,
        bias_error=float(np.sqrt(variance.sum()) / variance.size) if variance.size else 0.0,
        differs=differs,
        deviation=deviation,
    )


def of_all(chance: float, tests: int) -> float:
    """Return the chance that the least of so many independent p-values is as small as one given (Sidak)."""
    if chance >= 1:
        return 1.0
    return float(-np.expm1(tests * np.log1p(-chance)))


def of_one(chance: float, tests: int) -> float:
    """Return the level of one test, so that all together have a given one (Sidak)."""
    return float(-np.expm1(np.log1p(-chance) / max(tests, 1)))
