"""How far each link of a chain displaces what is shown, where every image shows a surface off the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.displacement import root_mean_square
from xfrustum.scenes.arrays import Floats, Indices, Mask


@dataclass(frozen=True, kw_only=True)
class StepSize:
    """Root mean square and 99th percentile of the lengths of some displacements, in pixels."""

    rms: float
    p99: float

    @classmethod
    def of(cls, values: Floats) -> StepSize | None:
        """Return the size of lengths (N,), the numbers of a `Spread`; None where there is none."""
        if not values.size:
            return None
        with np.errstate(invalid="ignore"):
            return cls(rms=root_mean_square(values), p99=float(np.percentile(values, 99)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """What links add to displacement, where each image before and after them shows a surface off the plate.

    Attributes
    ----------
    known
        (H W,) whether a pixel is one of these.
    lengths
        (H W,) lengths in pixels for each link; None for a link that changes no image.
    """

    known: Mask
    lengths: tuple[Floats | None, ...]

    @classmethod
    def between(cls, shifts: Sequence[Floats]) -> Steps:
        """Return the steps from image to image.

        Parameters
        ----------
        shifts
            Displacement (2, H W) of each image, see `film_shifts`; that of the same image is the same array.
        """
        lengths = tuple(
            None if after is before else np.hypot(*(after - before)) for before, after in pairwise(shifts)
        )
        known: Mask = np.asarray(np.isfinite(shifts[0]).all(axis=0))
        for length in lengths:
            if length is not None:
                known &= np.isfinite(length)
        return cls(known=known, lengths=lengths)

    def sizes(self) -> tuple[StepSize | None, ...]:
        """Return the size of the steps of each link."""
        still = StepSize(rms=0.0, p99=0.0) if self.known.any() else None
        return tuple(still if one is None else StepSize.of(one[self.known]) for one in self.lengths)

    def with_last(self, pixels: Indices, step: Floats) -> Steps:
        """Return the steps with one more link, which displaces nothing but some pixels.

        Parameters
        ----------
        pixels
            (M,) flat numbers of pixels that this link may displace.
        step
            (M,) lengths; not finite where the image before or after the link shows no surface off the plate.
        """
        known, last = self.known.copy(), np.zeros(self.known.size)
        known[pixels] &= np.isfinite(step)
        last[pixels] = step
        return Steps(known=known, lengths=(*self.lengths, last))
