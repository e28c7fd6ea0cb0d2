"""By how much a measure may differ from accepted runs: learnt from repeated runs, or stated.

A renderer with noise, such as a path tracer, gives other numbers each time. Repeated runs of one state of it,
an edition, say how much they vary: if n runs of a measure have the mean m and the standard deviation s with f
degrees of freedom, and the noise is normal, the next run exceeds

    m + t s sqrt(1 + 1/n)

with a chosen probability, t being the quantile of Student's distribution (the prediction interval of one
further observation). As many measures of many hogels are compared at once, that probability is
`FALSE_ALARMS` divided by their number (Bonferroni).

Few runs say little of one hogel, and repeat by chance now and then. What they say of all hogels together is
much more: s is never smaller than that of the same measure over all hogels (root of the mean variance), whose
degrees of freedom add up. A hogel that is noisier than that beyond chance keeps its own. The variance of a
plate's sum is no smaller than the sum of its hogels' variances, and the noise of a plate's largest distance
no smaller than that of its hogels.

Small counts are not normal. The part of a count that varies is taken to be a Poisson variable at least, whose
mean is its variance: if it was K in n runs together, the next exceeds y with at most the probability that a
negative binomial variable, the successes of probability 1/(n + 1) before failure K + 1, does. That is exact,
as the next is binomial given the sum of all.

Noise stays when a change is accepted: s^2 is the variance within editions, of all that were accepted (f is
the sum of their numbers of runs, less one each). Where all repeated runs are alike in a measure, in all
hogels, or none was repeated, that measure has no noise, and counts are compared exactly.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import betainc, chdtri, fdtri, stdtrit

from xfrustum.reports.baselines.measures import NAMES, is_count
from xfrustum.scenes.errors import InputError

FALSE_ALARMS = 0.01
"""Share of the verifications of an unchanged renderer that may fail by chance."""

NOISIER_CHANCE = 0.01
"""Probability with which chance alone makes one of many hogels of one noise look noisier than all together.
It has its own degrees of freedom only then, and a wide limit: that is to be as rare as `FALSE_ALARMS`."""

VARIANCE_CHANCE = 0.05
"""Probability with which the variance of a count is above the bound that is taken for it. The bound only says
how skewed small counts may be, and a count's own mean limits it too: the usual level of a test is enough."""

MIN_FREEDOM = 4
"""Degrees of freedom below which a limit says little: Student's quantile at 1e-4 is 13 for 4 freedoms, 22 for
3, 71 for 2 and 3183 for one."""

ROUNDING_PX = 1e-6
"""Difference of two displacements, in pixels, that is rounding: a root mean square of a million terms, each
up to 1e4 px, summed in another order by another processor differs by up to 1e4 x 1e6 x 1e-16."""


@dataclass(frozen=True, kw_only=True)
class Allowed:
    """Mean of the accepted values of a measure, and the interval in which the next may lie."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Tolerances that the user states; measures without one have that which is learnt.

    Attributes
    ----------
    share
        Part of the accepted value by which any measure may differ; None where none is stated.
    amounts
        Amounts by name of measure, pixels.
    """

    share: float | None = None
    amounts: Mapping[str, float]

    def __post_init__(self) -> None:
        for name in self.amounts:
            if name not in NAMES:
                raise InputError(f"baseline tolerance: {name!r} is not one of {', '.join(NAMES)}")
        numbers = (*self.amounts.values(), 0.0 if self.share is None else self.share)
        if not all(math.isfinite(number) and number >= 0 for number in numbers):
            raise InputError("baseline tolerance: tolerances are numbers that are not negative")

    def allowed(self, name: str, values: Sequence[float]) -> Allowed | None:
        """Return the interval of a measure; None where nothing is stated of it."""
        mean = math.fsum(values) / len(values)
        amount = self.amounts.get(name, None if self.share is None else self.share * abs(mean))
        return None if amount is None else _about(mean, amount + _rounding(name))

    @classmethod
    def of(cls, text: str) -> Stated:
        """Read `5%`, or amounts such as `wrong_surfaces=3,displacement_p99_px=0.01`, or both with a comma.

        Raises
        ------
        InputError
            The text is none of these.
        """
        share, amounts = None, {}
        for part in (part.strip() for part in text.split(",")):
            name, equals, number = part.rpartition("=")
            try:
                if equals:
                    amounts[name.strip().replace("-", "_")] = float(number)
                elif part.endswith("%"):
                    share = float(part[:-1]) / 100
                else:
                    raise ValueError
            except ValueError as error:
                raise InputError(
                    f"baseline tolerance {part!r}: write a share such as 5%, or NAME=AMOUNT such as "
                    f"{NAMES[1]}=3; names are {', '.join(NAMES)}"
                ) from error
        return cls(share=share, amounts=amounts)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviation of repeated runs of one measure, and its degrees of freedom.

    Without repeated runs both are 0.
    """

    deviation: float
    freedom: float

    @classmethod
    def of(cls, editions: Sequence[Sequence[float]]) -> Noise:
        """Return the noise within editions, each of which has a value for each of its runs."""
        freedom = sum(len(values) - 1 for values in editions)
        # Equal numbers have exactly no variance, whatever their mean is rounded to.
        squares = [
            (len(values) - 1) * statistics.variance(values)
            for values in editions
            if min(values) < max(values)
        ]
        return cls(deviation=math.sqrt(sum(squares) / freedom) if squares else 0.0, freedom=freedom)

    @classmethod
    def over_hogels(cls, several: Sequence[Noise]) -> Noise:
        """Return the noise that one measure has in all hogels together: the root of the mean variance."""
        repeated = [one for one in several if one.freedom]
        weights = [one.freedom for one in repeated]
        return cls._mixed(repeated, weights, sum(weights))

    @classmethod
    def of_sum(cls, several: Sequence[Noise]) -> Noise:
        """Return the noise of the sum over hogels whose noises have nothing to do with one another."""
        repeated = [one for one in several if one.freedom]
        return cls._mixed(repeated, [1.0] * len(repeated), 1.0)

    @classmethod
    def _mixed(cls, several: Sequence[Noise], weights: Sequence[float], whole: float) -> Noise:
        """Return the root of a weighted sum of variances over a whole.

        Its degrees of freedom are those of Satterthwaite (1946), (sum w v)^2 / sum (w v)^2/f, with estimates
        of the two sums that are not biased: v^2 f/(f + 2) for the square of a variance v. Where all noises
        are alike they are the sum of the freedoms; where one hogel alone has noise, its own.
        """
        squares = [weight * one.deviation**2 for weight, one in zip(weights, several, strict=True)]
        if not any(squares):
            return cls(deviation=0.0, freedom=sum(one.freedom for one in several))
        spread = sum(square**2 / (one.freedom + 2) for square, one in zip(squares, several, strict=True))
        freedoms = [one.freedom for one in several]
        freedom = min(max(sum(squares) ** 2 / spread - 2, min(freedoms)), sum(freedoms))
        return cls(deviation=math.sqrt(sum(squares) / whole), freedom=freedom)

    def at_least(self, floor: Noise, floors: int = 1) -> Noise:
        """Return this noise, but no less than a floor; the floor's freedom counts where this may be chance.

        Parameters
        ----------
        floor
            Noise of many hogels together.
        floors
            Number of measures that are compared with their floors at once.
        """
        if not self.freedom or floor.deviation == 0:
            return self if self.freedom else floor
        chance = float(fdtri(self.freedom, floor.freedom, 1 - NOISIER_CHANCE / floors))
        if self.deviation**2 > chance * floor.deviation**2:
            return self
        return Noise(deviation=max(self.deviation, floor.deviation), freedom=max(self.freedom, floor.freedom))


def learnt(name: str, values: Sequence[float], noise: Noise, compared: int) -> Allowed:
    """Return the interval of the next run of a measure.

    Parameters
    ----------
    name
        Name of the measure.
    values
        Its accepted values, one for each run of the newest edition.
    noise
        Noise that it is taken to have.
    compared
        Number of measures with noise that are compared at once.
    """
    mean, count = math.fsum(values) / len(values), len(values)
    if noise.deviation == 0:
        return _about(mean, _rounding(name))
    chance = FALSE_ALARMS / max(compared, 1)
    quantile = -float(stdtrit(noise.freedom, chance))
    amount = quantile * noise.deviation * math.sqrt(1 + 1 / count)
    if is_count(name):
        variance = noise.deviation**2 * noise.freedom / float(chdtri(noise.freedom, 1 - VARIANCE_CHANCE))
        counted = count * min(mean, variance)
        amount = max(amount, _next_count(counted, count, chance) - counted / count)
    return _about(mean, amount + _rounding(name))


def _next_count(counted: float, runs: int, chance: float) -> int:
    """Return the smallest number that the next count of a Poisson variable exceeds by chance at most.

    Parameters
    ----------
    counted
        Sum of the counts of the runs that are known.
    runs
        Number of these runs.
    chance
        Probability with which the next run may exceed the number.
    """

    def exceeds(number: int) -> bool:
        # Successes before failure K + 1 are more than y with the probability I_q(y + 1, K + 1).
        return float(betainc(number + 1, counted + 1, 1 / (runs + 1))) > chance

    low, high = -1, 1
    while exceeds(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if exceeds(middle) else (low, middle)
    return high


def _about(mean: float, amount: float) -> Allowed:
    return Allowed(mean=mean, low=mean - amount, high=mean + amount)


def _rounding(name: str) -> float:
    return 0.0 if is_count(name) else ROUNDING_PX
