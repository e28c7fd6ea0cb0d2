"""How does a cost grow? Exponents of power laws, and where one curve crosses another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.reports.common.timing import Timing

LARGE_END = 3
"""Sizes at the large end that the local exponent is fitted to: there constants no longer dominate."""


@dataclass(frozen=True, kw_only=True)
class Exponents:
    """Exponents p of cost ~ size^p, fitted to the logarithms by least squares.

    A cost of zero, as of memory that no more of was ever taken, has no logarithm: what would rest on it
    is None.

    Attributes
    ----------
    overall
        Exponent over all sizes.
    large_end
        Exponent over the largest `LARGE_END` sizes.
    growth
        Cost at the largest size over that at the smallest.
    """

    overall: float | None
    large_end: float | None
    growth: float | None

    @classmethod
    def of(cls, sizes: Sequence[float], costs: Sequence[float]) -> Exponents:
        """Fit costs, none negative, at two ascending sizes or more."""
        return cls(
            overall=exponent(sizes, costs),
            large_end=exponent(sizes[-LARGE_END:], costs[-LARGE_END:]),
            growth=costs[-1] / costs[0] if costs[0] > 0 else None,
        )


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float | None:
    """Return the slope of the straight line through log cost over log size, by least squares.

    None where a cost is not positive.
    """
    if min(costs) <= 0:
        return None
    x, y = np.log(sizes), np.log(costs)
    x = x - x.mean()
    return float(x @ y / (x @ x))


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A size beyond which another is faster.

    Attributes
    ----------
    size
        Size at which both take as long, interpolated between the logarithms.
    tracing_wins
        Whether tracing is faster beyond it, else rasterizing.
    """

    size: float
    tracing_wins: bool


@dataclass(frozen=True, kw_only=True)
class Overtaking:
    """Whether tracing or rasterizing is faster over a range of sizes.

    Attributes
    ----------
    smallest, largest
        The range.
    tracing_first
        Whether tracing is faster before the first crossing; None where runs of both overlap at every size.
    crossings
        Sizes at which the lead changes, ascending.
    """

    smallest: float
    largest: float
    tracing_first: bool | None
    crossings: tuple[Crossing, ...]

    @property
    def from_size(self) -> float | None:
        """The size from which on tracing is faster, up to the largest; None where it is not, there."""
        if not self.crossings:
            return self.smallest if self.tracing_first else None
        last = self.crossings[-1]
        return last.size if last.tracing_wins else None

    @classmethod
    def of(cls, sizes: Sequence[float], raster: Sequence[Timing], traced: Sequence[Timing]) -> Overtaking:
        """Compare two curves at the same ascending sizes.

        Only a size at which every run of one is faster than every run of the other says who is ahead;
        the medians say where the lead changed before.
        """
        lead = [math.log(one.median / other.median) for one, other in zip(raster, traced, strict=True)]
        first: bool | None = None
        ahead: bool | None = None
        crossings, change = [], sizes[0]
        for place, (one, other) in enumerate(zip(raster, traced, strict=True)):
            if place and (lead[place - 1] > 0) != (lead[place] > 0):
                share = lead[place - 1] / (lead[place - 1] - lead[place])
                change = sizes[place - 1] * (sizes[place] / sizes[place - 1]) ** share
            if one.lowest <= other.highest and other.lowest <= one.highest:
                continue
            tracing = lead[place] > 0
            if ahead is None:
                first = tracing
            elif tracing != ahead:
                crossings.append(Crossing(size=change, tracing_wins=tracing))
            ahead = tracing
        return cls(smallest=sizes[0], largest=sizes[-1], tracing_first=first, crossings=tuple(crossings))

    def sentence(self, unit: str) -> str:
        """Say who is faster from where on; `unit` names the sizes."""
        ends = f"from {round(self.smallest):,} to {round(self.largest):,} {unit}"
        if self.tracing_first is None:
            return f"neither is faster by more than runs differ, {ends}"
        if not self.crossings:
            return f"{_name(self.tracing_first)} is faster everywhere {ends}"
        parts = [f"{_name(self.tracing_first)} is faster at first"]
        # Two digits: runs differ by more.
        parts += [
            f"{_name(one.tracing_wins)} from {float(f'{one.size:.2g}'):,.0f} {unit} on"
            for one in self.crossings
        ]
        return ", ".join(parts)


def _name(tracing: bool) -> str:
    return "tracing" if tracing else "rasterizing"
