"""Pixels and the triangles that their lines meet, or may meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices, Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Pixels and triangles that their lines meet, or may meet.

    Attributes
    ----------
    pixel
        (N,) pixel numbers, row * W + column.
    triangle
        (N,) triangle numbers.
    s, error
        (N,) place where the line meets the triangle's plane: the true s lies in s +- error.
    sure
        (N,) whether the line surely meets the triangle, inside the pencil's range.
    """

    pixel: Indices
    triangle: Indices
    s: Floats
    error: Floats
    sure: Mask

    def __getitem__(self, chosen: Mask | Indices) -> Pairs:
        """Return some of the pairs."""
        return Pairs(
            pixel=self.pixel[chosen],
            triangle=self.triangle[chosen],
            s=self.s[chosen],
            error=self.error[chosen],
            sure=self.sure[chosen],
        )

    @property
    def nearest(self) -> Floats:
        """Smallest s that is possible."""
        return self.s - self.error

    @property
    def farthest(self) -> Floats:
        """Largest s that is possible."""
        return self.s + self.error

    @staticmethod
    def joined(parts: list[Pairs]) -> Pairs:
        """Return the pairs of all parts, one part after the other."""
        return Pairs(
            pixel=np.concatenate([p.pixel for p in parts]),
            triangle=np.concatenate([p.triangle for p in parts]),
            s=np.concatenate([p.s for p in parts]),
            error=np.concatenate([p.error for p in parts]),
            sure=np.concatenate([p.sure for p in parts]),
        )


NO_PAIRS = Pairs(
    pixel=np.zeros(0, dtype=np.int64),
    triangle=np.zeros(0, dtype=np.int64),
    s=np.zeros(0),
    error=np.zeros(0),
    sure=np.zeros(0, dtype=np.bool_),
)
