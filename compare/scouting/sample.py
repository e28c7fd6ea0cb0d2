"""Random samples of hogels, and what they bound: the share of a plate's hogels with a property."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta

from xfrustum.scenes.plate.plate import Aperture, Plate

SAMPLED_HOGELS = 59
"""Hogels of the random sample unless another number is asked for: if none of them is beyond what is required,
no more than one hogel in twenty is, with a confidence of 95 % (0.95^59 < 0.05)."""

CONFIDENCE = 0.95
"""Probability that the bound on the share of hogels holds."""


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
    return float(beta.ppf(confidence, beyond + 1, sampled - beyond))


def sample_hogels(plate: Plate, count: int, seed: int, without: Sequence[Aperture]) -> list[Aperture]:
    """Draw hogels at random, one from each of as many equal parts of the plate.

    The parts are runs of a path that goes to and fro over the rows. All hogels where there are no more.

    Parameters
    ----------
    count
        Number of hogels.
    seed
        Start of the random numbers.
    without
        Apertures that are not to be drawn.
    """
    columns, rows = plate.hogels
    taken = {aperture.index for aperture in without}
    path = [
        (column if row % 2 == 0 else columns - 1 - column, row)
        for row in range(rows)
        for column in range(columns)
    ]
    path = [index for index in path if index not in taken]
    random = np.random.default_rng(seed)
    parts = np.array_split(np.arange(len(path)), min(count, len(path))) if path else []
    return [plate.aperture(*path[int(random.choice(part))]) for part in parts]
