"""Whether one picture of a pair has more wrong pixels than the other, beyond chance."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np
import scipy

from xfrustum.scenes.arrays import Mask

CONFIDENCE = 0.95
"""Probability that no picture among those compared is called worse than another by chance."""


@dataclass(frozen=True, kw_only=True)
class PixelSet:
    """A set of pixels of a film, which takes a few bytes where the pixels are few.

    Attributes
    ----------
    count
        Number of pixels.
    packed
        One bit for each pixel of the film, compressed.
    """

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
    rather than too late; callers ask for a smallest difference besides.

    Parameters
    ----------
    only_here, only_there
        Number of pixels that are wrong in this picture alone, and in the other one alone.
    comparisons
        Number of pictures that are compared with the other one; `CONFIDENCE` holds for all of them together
        (Bonferroni).
    """
    by_chance = scipy.stats.binom.sf(only_here - 1, only_here + only_there, 0.5)
    return bool(only_here > only_there and by_chance < (1 - CONFIDENCE) / comparisons)
