"""Stratified samples that grow and keep what they have, and bounds that hold wherever one stops.

A path runs to and fro over the rows of the plate. The first sample has one hogel from each of n equal runs of
this path. Each later sample has twice as many: every run is halved, the half that has a hogel keeps it, and
one is drawn from the other half. A hogel drawn uniformly from a run, given the half that it lies in, is drawn
uniformly from that half, so that every sample is again one uniform and independent hogel from each run.

Let p be the mean over the runs of their share of hogels with a property. The number found in a sample is a
sum of independent trials whose probabilities have the mean p, and such a sum falls far below its mean less
often than a binomial number does (Hoeffding 1956): where P(binomial <= c) <= alpha < 1/4, P(found <= c) is no
larger. So the bound of Clopper and Pearson, made for the binomial number, is conservative. It is so for
simple random samples without replacement too (Hoeffding 1963): both know more of a finite plate than trials
with replacement would. The theorem leaves out the case in which all hogels but one are found; there nothing
is claimed. Runs of unequal length differ by one hogel: `share_beyond` allows for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.scouting.sample import CONFIDENCE, aperture_at, share_at_most
from xfrustum.scenes.arguments import settle, whole
from xfrustum.scenes.arrays import Indices
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Aperture, Plate


@dataclass(frozen=True, kw_only=True)
class GrowingSample:
    """Stratified samples of a plate, each twice as large as the one before.

    Attributes
    ----------
    plate
        The plate whose hogels are drawn.
    first
        Number of hogels of the first sample; as many as the plate has where it has fewer.
    seed
        Start of the random numbers.

    Raises
    ------
    InputError
        There are none, or the seed is negative.
    """

    plate: Plate
    first: int
    seed: int = 0

    def __post_init__(self) -> None:
        first, seed = whole(self.first), whole(self.seed)
        if first < 1:
            raise InputError(f"a sample must have at least one hogel, not {self.first!r}")
        if seed < 0:
            raise InputError(f"a seed must be a count from 0, not {self.seed!r}")
        settle(self, first=min(first, math.prod(self.plate.hogels)), seed=seed)

    @property
    def hogels(self) -> int:
        """Number of hogels of the plate."""
        return math.prod(self.plate.hogels)

    @property
    def looks(self) -> int:
        """Number of samples until there is no hogel left."""
        return 1 + math.ceil(math.log2(self.hogels / self.first))

    def size(self, look: int) -> int:
        """Return the number of hogels of a sample, 0 for the first."""
        return min(self.first << look, self.hogels)

    def places(self, look: int) -> Indices:
        """Return where the hogels of a sample lie on the path, (n,) in ascending order."""
        places = np.zeros(0, dtype=np.int64)
        for number in range(look + 1):
            places = self._doubled(places, number)
        return places

    def new_places(self, look: int) -> Indices:
        """Return those of `places` that the sample before does not have."""
        places = self.places(look)
        return np.setdiff1d(places, self.places(look - 1), assume_unique=True) if look else places

    def aperture(self, place: int) -> Aperture:
        """Return the aperture of a place on the path."""
        return aperture_at(self.plate, int(place))

    def _doubled(self, before: Indices, look: int) -> Indices:
        """Return the sample of a look from the one before, which is empty before the first."""
        runs = self.first << look
        ends = np.arange(runs + 1, dtype=np.int64) * self.hogels // runs
        # With more runs than hogels some are empty, and the others have one hogel each.
        there = ends[1:] > ends[:-1]
        random = np.random.default_rng((self.seed, look))
        drawn = random.integers(ends[:-1], np.maximum(ends[1:], ends[:-1] + 1))
        drawn[np.searchsorted(ends, before, side="right") - 1] = before
        return np.asarray(drawn[there], dtype=np.int64)


def confidence_of_each_setting(settings: int, confidence: float = CONFIDENCE) -> float:
    """Return the confidence of the claim about each of several settings, which share the risk (Bonferroni).

    All claims hold together with the confidence that is given, whatever the settings have to do with each
    other. Sidak's correction, `confidence_of_each`, is safe only for claims that tend to hold or fail
    together; of two settings one may be wrong just where the other is right.
    """
    return 1 - (1 - confidence) / settings


def risk_of_look(look: int, confidence: float = CONFIDENCE) -> float:
    """Return the probability with which the bound of one look, 0 for the first, may be wrong.

    The looks share the risk of all, 1 - confidence, in the parts 1/2, 1/6, 1/12, .. 1/(k (k + 1)), which add
    up to one. So all bounds hold together with this confidence, however many looks there are, and also the
    last one, wherever the survey stops (the union bound, which asks for no independence).
    """
    return (1 - confidence) / ((look + 1) * (look + 2))


def share_beyond(beyond: int, judged: int, hogels: int, risk: float = 1 - CONFIDENCE) -> float:
    """Return the upper bound on a share of a plate's hogels from a `GrowingSample`.

    Parameters
    ----------
    beyond, judged
        Number of sampled hogels with the property, and of all sampled hogels.
    hogels
        Number of hogels of the plate. Where all were sampled, the share itself is returned.
    risk
        Probability with which the bound may be wrong.
    """
    possible = (hogels - judged + beyond) / hogels
    if judged == hogels or (judged > 1 and beyond >= judged - 1):
        return possible
    # A run may hold more hogels than the mean one, all with the property: then the plate's share is larger
    # than the mean of the runs' shares, by this factor at most.
    longest = math.ceil(hogels / judged) * judged / hogels
    return min(possible, longest * share_at_most(beyond, judged, 1 - risk))


def share_beyond_at_least(beyond: int, judged: int, hogels: int, risk: float = 1 - CONFIDENCE) -> float:
    """Return the lower bound on a share of a plate's hogels: all but the upper bound on those without it.

    Parameters
    ----------
    beyond, judged, hogels, risk
        As for `share_beyond`.
    """
    return 1 - share_beyond(judged - beyond, judged, hogels, risk)


def clean_sample(share: float, hogels: int, risk: float) -> int:
    """Return the size of the smallest first sample that bounds a share where no hogel has the property.

    The whole plate where no smaller one does.
    """
    if share <= 0:
        return hogels
    size = min(hogels, max(1, math.floor(math.log(risk) / math.log1p(-min(share, 1 - 1e-9)))))
    while size < hogels and share_beyond(0, size, hogels, risk) > share:
        size += 1
    return size
