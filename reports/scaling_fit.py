"""How does a cost grow? Exponents of power laws, and where one curve crosses another."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LARGE_END = 3
"""Sizes at the large end that the local exponent is fitted to: there constants no longer dominate."""


@dataclass(frozen=True, kw_only=True)
class Exponents:
    """Exponents p of cost ~ size^p, fitted to the logarithms by least squares.

    Attributes
    ----------
    overall
        Over all sizes.
    large_end
        Over the largest `LARGE_END` sizes.
    growth
        Cost at the largest size over that at the smallest.
    """

    overall: float
    large_end: float
    growth: float

    @classmethod
    def of(cls, sizes: Sequence[float], costs: Sequence[float]) -> Exponents:
        """Fit costs, all positive, at two ascending sizes or more."""
        return cls(
            overall=exponent(sizes, costs),
            large_end=exponent(sizes[-LARGE_END:], costs[-LARGE_END:]),
            growth=costs[-1] / costs[0],
        )


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Return the slope of the straight line through log cost over log size, by least squares."""
    x, y = np.log(sizes), np.log(costs)
    x = x - x.mean()
    return float(x @ y / (x @ x))


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A size beyond which another is faster.

    Attributes
    ----------
    size
        Where both take as long, interpolated between the logarithms.
    tracing_wins
        Whether tracing is faster beyond it, else rasterizing.
    """

    size: float
    tracing_wins: bool


@dataclass(frozen=True, kw_only=True)
class Overtaking:
    """Who is faster over a range of sizes.

    Attributes
    ----------
    smallest, largest
        The range.
    tracing_first
        Whether tracing is faster at the smallest size.
    crossings
        In ascending order.
    """

    smallest: float
    largest: float
    tracing_first: bool
    crossings: tuple[Crossing, ...]

    @property
    def from_size(self) -> float | None:
        """The size from which on tracing is faster, up to the largest; None where it is not, there."""
        if not self.crossings:
            return self.smallest if self.tracing_first else None
        last = self.crossings[-1]
        return last.size if last.tracing_wins else None

    @classmethod
    def of(cls, sizes: Sequence[float], raster: Sequence[float], traced: Sequence[float]) -> Overtaking:
        """Compare two curves of positive costs at the same ascending sizes."""
        lead = [math.log(one / other) for one, other in zip(raster, traced, strict=True)]
        crossings = []
        for (low, before), (high, after) in itertools.pairwise(zip(sizes, lead, strict=True)):
            if (before > 0) != (after > 0):
                share = before / (before - after)
                size = math.exp(math.log(low) + share * math.log(high / low))
                crossings.append(Crossing(size=size, tracing_wins=after > 0))
        return cls(
            smallest=sizes[0], largest=sizes[-1], tracing_first=lead[0] > 0, crossings=tuple(crossings)
        )

    def sentence(self, unit: str) -> str:
        """Say who is faster from where on; `unit` names the sizes."""
        ends = f"from {round(self.smallest):,} to {round(self.largest):,} {unit}"
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
