"""Random samples of hogels, and what they bound: the share of a plate's hogels with a property."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from xfrustum.scenes.arguments import settle, whole
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Aperture, Plate
from xfrustum.tolerances import SAMPLED_HOGELS

CONFIDENCE = 0.95
"""Probability that the bound on the share of hogels holds."""


@dataclass(frozen=True, kw_only=True)
class RandomSample:
    """Which hogels are drawn at random.

    Attributes
    ----------
    hogels
        How many are drawn.
    seed
        Start of the random numbers.

    Raises
    ------
    InputError
        There are none, or the seed is negative.
    """

    hogels: int = SAMPLED_HOGELS
    seed: int = 0

    def __post_init__(self) -> None:
        hogels, seed = whole(self.hogels), whole(self.seed)
        if hogels < 1:
            raise InputError(f"a sample must have at least one hogel, not {self.hogels!r}")
        if seed < 0:
            raise InputError(f"a seed must be a count from 0, not {self.seed!r}")
        settle(self, hogels=hogels, seed=seed)

    def next(self) -> RandomSample:
        """Return another sample, as large and independent of this one."""
        return replace(self, seed=self.seed + 1)


def confidence_of_each(claims: int, confidence: float = CONFIDENCE) -> float:
    """Return the confidence of each of several claims that hold together with some confidence (Sidak 1967).

    This is exact for independent claims and safe for those that tend to hold or fail together.
    """
    return float(confidence ** (1 / claims))


def share_at_most(beyond: int, sampled: int, confidence: float = CONFIDENCE) -> float:
    """Return the upper bound of a share from a random sample (Clopper and Pearson 1934).

    Parameters
    ----------
    beyond, sampled
        How many of the sample have the property, and how many there are.
    confidence
        Probability that the bound holds.
    """
    if beyond >= sampled:
        return 1.0
    return float(scipy.stats.beta.ppf(confidence, beyond + 1, sampled - beyond))


def sample_hogels(plate: Plate, sample: RandomSample, without: Sequence[Aperture]) -> list[Aperture]:
    """Draw hogels at random, one from each of as many equal parts of the plate.

    The parts are runs of the path of `aperture_at`. All hogels where there are no more.

    Parameters
    ----------
    sample
        How many, and where the random numbers start.
    without
        Apertures that are not to be drawn.
    """
    taken = [place_of(plate, aperture) for aperture in without]
    path = np.setdiff1d(np.arange(math.prod(plate.hogels)), np.array(taken, dtype=np.int64))
    random = np.random.default_rng(sample.seed)
    parts = np.array_split(path, min(sample.hogels, len(path))) if len(path) else []
    return [aperture_at(plate, int(random.choice(part))) for part in parts]


def aperture_at(plate: Plate, place: int) -> Aperture:
    """Return the aperture at a place of the path that goes to and fro over the rows of a plate, from 0."""
    columns = plate.hogels[0]
    row, along = divmod(place, columns)
    return plate.aperture(columns - 1 - along if row % 2 else along, row)


def place_of(plate: Plate, aperture: Aperture) -> int:
    """Return the place of an aperture on the path of `aperture_at`."""
    columns, (column, row) = plate.hogels[0], aperture.index
    return row * columns + (columns - 1 - column if row % 2 else column)
