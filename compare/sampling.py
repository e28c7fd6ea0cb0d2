"""Samples of a plate's hogels, and bounds on the share of all hogels beyond a tolerance.

`survey` uses the bound `share_beyond` with the risk `risk_of_claim`; `plan` uses `share_at_most`.

**One sample.** A path runs to and fro over the rows of the plate. It is divided into n equal runs,
and the sample has one random hogel from each run. Let p be the mean over the runs of the share of
hogels with the property. The number of sampled hogels with the property is a sum of independent
trials whose probabilities have the mean p. The lower tail of this sum is lighter than the binomial
tail (Hoeffding 1956): if P(binomial <= c) <= alpha < 1/4, then P(number <= c) <= P(binomial <= c).
Hence the bound of Clopper and Pearson is conservative, also for simple random samples without
replacement (Hoeffding 1963). The theorem excludes samples in which all hogels but one have the
property; no bound is claimed there. The lengths of runs differ by at most one hogel, and
`share_beyond` accounts for this difference.

**Growing samples.** Each further sample has twice as many hogels: every run is halved, one half
contains the sampled hogel, and another hogel is drawn from the other half. Each sample thus has one
uniform and independent hogel from each run.

**Beyond.** A hogel is beyond the tolerance if the 99th percentile of its displacements exceeds it
or is undefined, or if more than 1 % of its judged pixels show the wrong surface (`CONVENTIONS.md`,
"Beyond"). Every command that judges hogels uses this definition.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, overload

import numpy as np
import scipy

from xfrustum.scenes.arguments import InputError, real, settle, whole
from xfrustum.scenes.arrays import Indices, Mask
from xfrustum.scenes.plate import Aperture, Plate
from xfrustum.tolerances import MAX_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from xfrustum.compare.comparison import ComparisonNumbers


PERCENTILE = 99.0  #: percentile of displacement that a tolerance limits

#: Largest share of pixels in the plate itself, where displacement is undefined, that leaves the
#: percentile defined: the same pixels that the percentile leaves out.
MAX_UNDEFINED = 1 - PERCENTILE / 100


def displacement_p99(numbers: ComparisonNumbers) -> float:
    """Return a hogel's 99th percentile of displacement, pixels; 0 for a drawing without surface.

    Infinite if the percentile is undefined: if all surfaces lie in the plate itself, or if surfaces
    in the plate fill more than `MAX_UNDEFINED` of the judged pixels.
    """
    spread = numbers.displacement_px
    if numbers.at_plate > MAX_UNDEFINED * numbers.judged or (numbers.at_plate and spread is None):
        return math.inf
    return 0.0 if spread is None else spread.p99


def is_beyond(
    displacement_p99_px: float | None,
    surface_fraction: float,
    tolerance_px: float,
    max_wrong: float = MAX_WRONG,
) -> bool:
    """Return whether a hogel is beyond a tolerance.

    A displacement of None or NaN is undefined and counts as beyond.
    """
    if displacement_p99_px is None or not math.isfinite(displacement_p99_px):
        return True
    return displacement_p99_px > tolerance_px or surface_fraction > max_wrong


CONFIDENCE = 0.95  #: probability that the bound on the share of hogels holds


def aperture_at(plate: Plate, place: int) -> Aperture:
    """Return the aperture at a place (from 0) on the path to and fro over the plate's rows."""
    columns = plate.hogels[0]
    row, along = divmod(int(place), columns)
    return plate.aperture(columns - 1 - along if row % 2 else along, row)


@dataclass(frozen=True, eq=False)
class PathApertures(Sequence[Aperture]):
    """Apertures at places of the path of `aperture_at`, created on access."""

    plate: Plate
    places: Sequence[int]

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> Aperture: ...
    @overload
    def __getitem__(self, index: slice) -> PathApertures: ...
    def __getitem__(self, index: int | slice) -> Aperture | PathApertures:
        """Return one aperture by its number, or a slice of apertures."""
        if isinstance(index, slice):
            return PathApertures(self.plate, self.places[index])
        return aperture_at(self.plate, self.places[index])


def places_of(chosen: Mask) -> Indices:
    """Return the places on the path of the hogels that a mask (rows, columns) marks, ascending."""
    path = chosen.copy()
    path[1::2] = chosen[1::2, ::-1]
    return np.flatnonzero(path)


def place_of(plate: Plate, aperture: Aperture) -> int:
    """Return the place of an aperture on the path of `aperture_at`."""
    columns, (column, row) = plate.hogels[0], aperture.index
    return row * columns + (columns - 1 - column if row % 2 else column)


@dataclass(frozen=True, kw_only=True)
class RandomSample:
    """Number of random hogels, >= 1, and the seed of the random numbers, >= 0."""

    hogels: int = SAMPLED_HOGELS
    seed: int = 0

    def __post_init__(self) -> None:
        hogels, seed = whole(self.hogels), whole(self.seed)
        if hogels < 1:
            raise InputError(f"a sample must have at least one hogel, not {hogels!r}")
        if seed < 0:
            raise InputError(f"a seed must be a count from 0, not {seed!r}")
        settle(self, hogels=hogels, seed=seed)

    def next(self) -> RandomSample:
        """Return an independent sample of the same size."""
        return replace(self, seed=self.seed + 1)


def sample_hogels(
    plate: Plate, sample: RandomSample, without: Sequence[Aperture]
) -> list[Aperture]:
    """Divide the path, without the apertures `without`, into equal runs; draw a hogel from each."""
    taken = [place_of(plate, aperture) for aperture in without]
    path = np.setdiff1d(np.arange(math.prod(plate.hogels)), np.array(taken, dtype=np.int64))
    random = np.random.default_rng(sample.seed)
    runs = np.array_split(path, min(sample.hogels, len(path))) if len(path) else []
    return [aperture_at(plate, random.choice(run)) for run in runs]


@dataclass(frozen=True, kw_only=True)
class GrowingSample:
    """Nested samples of hogels, each twice the size of the previous; `first` is the first size."""

    hogels: int
    first: int
    seed: int = 0

    def __post_init__(self) -> None:
        sample = RandomSample(hogels=self.first, seed=self.seed)
        settle(self, first=min(sample.hogels, self.hogels), seed=sample.seed)

    @property
    def looks(self) -> int:
        """Number of nested samples; the last contains all hogels."""
        return 1 + math.ceil(math.log2(self.hogels / self.first))

    def places(self, look: int) -> Indices:
        """Return the numbers of the hogels of a sample, (n,) in ascending order."""
        places = np.zeros(0, dtype=np.int64)
        for number in range(look + 1):
            runs = self.first << number
            ends = np.arange(runs + 1, dtype=np.int64) * self.hogels // runs
            random = np.random.default_rng((self.seed, number))
            drawn = random.integers(ends[:-1], np.maximum(ends[1:], ends[:-1] + 1))
            drawn[np.searchsorted(ends, places, side="right") - 1] = places
            # With more runs than hogels, some runs are empty and other runs have one hogel each.
            places = np.asarray(drawn[ends[1:] > ends[:-1]], dtype=np.int64)
        return places

    def new_places(self, look: int) -> Indices:
        """Return the elements of `places` that are not in the previous sample."""
        places = self.places(look)
        return np.setdiff1d(places, self.places(look - 1), assume_unique=True) if look else places


def share_at_most(beyond: int, sampled: int, confidence: float = CONFIDENCE) -> float:
    """Return the upper bound by Clopper and Pearson (1934) on the share with a property."""
    if beyond >= sampled:
        return 1.0
    test = scipy.stats.binomtest(beyond, sampled, alternative="less")
    return float(test.proportion_ci(confidence, method="exact").high)


def share_beyond(beyond: int, judged: int, hogels: int, risk: float = 1 - CONFIDENCE) -> float:
    """Return an upper bound on the share of the plate's hogels beyond the limits.

    The bound is wrong with at most the probability `risk`.
    """
    possible = (hogels - judged + beyond) / hogels
    if judged == hogels or (judged > 1 and beyond >= judged - 1):
        return possible
    # A long run has one hogel more than a short run, but counts as one hogel of the sample as well.
    # If only long runs are beyond the limits, the plate's share exceeds the mean share of the runs,
    # by at most this factor.
    longest = math.ceil(hogels / judged) * judged / hogels
    return min(possible, longest * share_at_most(beyond, judged, 1 - risk))


def share_beyond_at_least(
    beyond: int, judged: int, hogels: int, risk: float = 1 - CONFIDENCE
) -> float:
    """Return the lower bound on a share: one minus the upper bound on its complement."""
    return 1 - share_beyond(judged - beyond, judged, hogels, risk)


def risk_of_claim(settings: int = 1, look: int | None = None) -> float:
    """Return the error probability of a single bound, so that all bounds hold together.

    Settings share the risk equally (Bonferroni). Looks (successive samples) share it in the parts
    1/2, 1/6, 1/12, .. 1/(k (k + 1)), which add up to one: all bounds hold together, wherever the
    survey stops. This is the union bound, and needs no independence. `look` is 0 for the first
    look, None for a single sample.
    """
    risk = (1 - CONFIDENCE) / settings
    return risk if look is None else risk / ((look + 1) * (look + 2))


def clean_sample(share: float, hogels: int, risk: float) -> int:
    """Return the smallest sample that proves a share if no sampled hogel is beyond the limits."""
    if share <= 0:
        return hogels
    size = min(hogels, max(1, math.floor(math.log(risk) / math.log1p(-min(share, 1 - 1e-9)))))
    while size < hogels and share_beyond(0, size, hogels, risk) > share:
        size += 1
    return size


#: Default number of sampled hogels. If none of them is beyond the limits, at most 1 % of all hogels
#: are beyond the limits, with 95 % confidence (0.05 to the power 1/299 is 0.99).
DEFAULT_SAMPLE = 300


@dataclass(frozen=True, kw_only=True)
class SampleRequest:
    """Number of hogels to judge: all, a sample, or growing samples until a bound is reached."""

    sample: int | None = DEFAULT_SAMPLE  #: hogels of a sample, >= 1; None for all
    #: Share of the plate, 0 to 1, at which growing samples stop. The first sample is the smallest
    #: that bounds this share if none of its hogels is beyond the limits.
    until: float | None = None
    seed: int = 0  #: seed of the random numbers, >= 0

    def __post_init__(self) -> None:
        if self.until is not None and not 0 < real(self.until) < 1:
            raise InputError(f"--until must be a share between 0 and 100 %, not {self.until}")


@dataclass(frozen=True, kw_only=True)
class PlateSample:
    """Hogels to judge: a whole population, or samples that grow from look to look."""

    hogels: int  #: number of hogels of the plate
    population: Indices | range  #: places on the path of `aperture_at`; other hogels are empty
    growing: GrowingSample | None  #: samples of the population; None for the whole population
    until: float | None  #: share of the plate at which growing samples stop
    claims: int = 1  #: number of settings, each with a bound; all bounds hold together

    @classmethod
    def from_request(
        cls,
        hogels: int,
        request: SampleRequest,
        population: Indices | range | None = None,
        claims: int = 1,
    ) -> PlateSample:
        """Return the sample of a plate, or of the population of hogels that may show something."""
        population, first = range(hogels) if population is None else population, request.sample
        if request.until is not None:
            share = min(1.0, request.until * hogels / len(population))
            first = clean_sample(share, len(population), risk_of_claim(claims, look=0))
        growing = None
        if first is not None and first < len(population):
            growing = GrowingSample(hogels=len(population), first=first, seed=request.seed)
        return cls(
            hogels=hogels,
            population=population,
            growing=growing,
            until=request.until,
            claims=claims,
        )

    @property
    def looks(self) -> int:
        """Largest number of looks; each look extends the previous sample."""
        return 1 if self.growing is None or self.until is None else self.growing.looks

    @property
    def first_size(self) -> int:
        """Number of hogels of the first sample."""
        return len(self.population) if self.growing is None else self.growing.first

    @property
    def description(self) -> dict[str, int | float | None]:
        """Parameters that determine the sampled hogels, in JSON types."""
        seed = None if self.growing is None else self.growing.seed
        sizes = {"hogels": self.hogels, "population": len(self.population)}
        return {**sizes, "first": self.first_size, "until": self.until, "seed": seed}

    def new_places(self, look: int) -> Sequence[int]:
        """Return the places that a look adds to the previous sample."""
        if self.growing is not None:
            chosen = np.asarray(self.population)[self.growing.new_places(look)]
            return chosen.tolist()  # type: ignore[no-any-return]
        # Return a range unchanged: plates have millions of hogels, and a range needs no memory.
        return self.population if isinstance(self.population, range) else self.population.tolist()

    def extent(self, judged: int, look: int = 0, *, complete: bool = True) -> SampleExtent:
        """Return the number of judged hogels, with the resulting bounds."""
        return SampleExtent(sample=self, judged=judged, look=look, complete=complete)


@dataclass(frozen=True, kw_only=True)
class SampleExtent:
    """Number of judged hogels, and the resulting bounds on shares of the plate."""

    sample: PlateSample
    judged: int  #: number of judged hogels
    look: int  #: number of the latest look, >= 0
    complete: (
        bool  #: whether all hogels of the look are judged; parts of a job array may be missing
    )

    @property
    def everything(self) -> bool:
        """True if every hogel of the plate was judged or shows nothing."""
        return self.judged == len(self.sample.population)

    @property
    def confidence(self) -> float:
        """Probability that all bounds hold together; 1 if every hogel was judged."""
        return 1.0 if self.everything else CONFIDENCE

    @property
    def looks(self) -> int | None:
        """Number of looks that share the risk; None for a single sample and for all hogels."""
        grows = self.sample.growing is not None and self.sample.until is not None
        return self.look + 1 if grows else None

    def at_most(self, beyond: int) -> float | None:
        """Return the upper bound on the share beyond the limits; None if incomplete."""
        seeing, hogels = len(self.sample.population), self.sample.hogels
        if self.everything:
            return beyond / hogels
        if not self.complete:
            return None
        return share_beyond(beyond, self.judged, seeing, self._risk) * seeing / hogels

    def decides(self, beyond: int) -> bool:
        """Return whether the share is certainly within or certainly above the limit `until`.

        Stopping above the limit adds no risk, because only the upper bounds are claimed, and they
        hold at all looks together.
        """
        bound, limit = self.at_most(beyond), self.sample.until
        if limit is None or bound is None or self.everything or bound <= limit:
            return limit is None or bound is not None
        seeing = len(self.sample.population)
        least = share_beyond_at_least(beyond, self.judged, seeing, self._risk)
        return least * seeing / self.sample.hogels > limit

    @property
    def _risk(self) -> float:
        return risk_of_claim(self.sample.claims, None if self.looks is None else self.look)
