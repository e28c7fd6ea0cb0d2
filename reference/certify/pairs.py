"""Pixels and the triangles that their lines meet, or may meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices, Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Pixels (N,), row * W + column, and triangle numbers (N,), in NumPy.

    The true place where the line meets the triangle's plane lies in s +- error; `sure` says whether the line
    surely meets the triangle, inside the pencil's range.
    """

    pixel: Indices
    triangle: Indices
    s: Floats
    error: Floats
    sure: Mask

    def __getitem__(self, chosen: Mask | Indices) -> Pairs:
        """Return some of the pairs."""
        return Pairs(**{name: values[chosen] for name, values in vars(self).items()})

    @property
    def nearest(self) -> Floats:
        """Smallest s that is possible."""
        return self.s - self.error

    @property
    def farthest(self) -> Floats:
        """Largest s that is possible."""
        return self.s + self.error

    @staticmethod
    def joined(parts: Sequence[Pairs]) -> Pairs:
        """Return the pairs of all parts, one part after the other."""
        return Pairs(
            **{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])}
        )


_NONE = np.zeros(0, dtype=np.int64)
NO_PAIRS = Pairs(pixel=_NONE, triangle=_NONE, s=np.zeros(0), error=np.zeros(0), sure=np.zeros(0, np.bool_))
