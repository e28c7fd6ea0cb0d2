"""By how much a measure may differ from accepted runs: learnt from repeated runs, or stated.

A renderer with noise, such as a path tracer, gives other numbers each time. Repeated runs of one state of it,
an edition, say how much they vary: if n runs of a measure have the mean m and the standard deviation s with f
degrees of freedom, and the noise is normal, the next run exceeds

    m + t s sqrt(1 + 1/n)

with a chosen probability, t being the quantile of Student's distribution (the prediction interval of one
further observation). As many measures of many hogels are compared at once, that probability is
`FALSE_ALARMS` divided by their number (Bonferroni), so that an unchanged renderer fails one verification in a
hundred at most.

Noise stays when a change is accepted: s^2 is the variance within editions, of all that were accepted (f is
the sum of their numbers of runs, less one each). Few runs repeat by chance now and then: s is never taken to
be smaller than that of the same measure over all hogels together (root of the mean variance). Where all
repeated runs are alike, or none was repeated, there is no noise, and counts are compared exactly.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import stdtrit

from xfrustum.reports.baselines.measures import NAMES, is_count
from xfrustum.scenes.errors import InputError

FALSE_ALARMS = 0.01
"""Share of the verifications of an unchanged renderer that may fail by chance."""

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
    freedom: int

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
        """Return the noise of one measure over all hogels together, with the freedom that one hogel has."""
        repeated = [one for one in several if one.freedom]
        if not repeated:
            return cls(deviation=0.0, freedom=0)
        mean = sum(one.deviation**2 for one in repeated) / len(repeated)
        return cls(deviation=math.sqrt(mean), freedom=max(one.freedom for one in repeated))

    def at_least(self, other: Noise) -> Noise:
        """Return this noise, but no less than another; all of the other where nothing was repeated here."""
        return Noise(deviation=max(self.deviation, other.deviation), freedom=self.freedom or other.freedom)


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
    quantile = float(stdtrit(noise.freedom, 1 - FALSE_ALARMS / max(compared, 1)))
    return _about(mean, quantile * noise.deviation * math.sqrt(1 + 1 / count) + _rounding(name))


def _about(mean: float, amount: float) -> Allowed:
    return Allowed(mean=mean, low=mean - amount, high=mean + amount)


def _rounding(name: str) -> float:
    return 0.0 if is_count(name) else ROUNDING_PX
