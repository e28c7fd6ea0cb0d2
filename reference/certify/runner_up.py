"""How far behind the first surface of each line is the next one that the same camera sees?

Depth buffers choose between those two. C keeps the nearest surface behind the plate, C* the farthest one
before it; along a line, seen from the viewer, both are the first, and what a camera chooses it from lies
behind that, on the same side of the plate.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Protocol

import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import Footprints, footprints
from xfrustum.reference.certify.narrow_numpy import PAIRS_PER_CHUNK, NumpyNarrowPhase, Spans
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.certify.rows import Rows, boxed_rows
from xfrustum.reference.certify.sides import sorted_by_side
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.lines.pairs import Pairs
from xfrustum.scenes.arrays import Floats, Mask


class RunnerUpPhase(Protocol):
    """A narrow phase that also finds the second surface."""

    def __init__(self, pencil: Pencil, rows: range) -> None: ...

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        ...

    def first(self) -> Floats:
        """Return the largest s at which the first surface of each pixel can lie; infinite without one."""
        ...

    def behind(self, first: Floats) -> Floats:
        """Return the smallest s of what surely lies behind, on the same side; infinite without any."""
        ...


class RunnersUp:
    """Finds second surfaces along the lines of one image.

    Parameters
    ----------
    triangles
        (F, 3, 3) corners in scene units.
    pencil
        The lines.
    """

    def __init__(self, triangles: Floats, pencil: Pencil) -> None:
        self._triangles = triangles
        self._pencil = pencil
        self._footprints = footprints(
            sorted_by_side(triangles, pencil), pencil, ExactPencil(triangles, pencil)
        )

    def gaps(self, rows: range) -> Floats:
        """Return the gaps of some rows of the image, (rows, W); see `Reference.gaps`."""
        phases = []
        for kind, part in self._parts():
            phase = kind(self._pencil, rows)
            for boxed in boxed_rows(self._triangles, self._pencil, part, rows):
                phase.add(boxed)
            phases.append(phase)
        first = np.minimum.reduce([phase.first() for phase in phases])
        second = np.minimum.reduce([phase.behind(first) for phase in phases])
        gaps = np.subtract(second, first, out=np.full_like(first, np.inf), where=np.isfinite(second))
        return np.asarray(gaps.reshape(len(rows), -1))

    def _parts(self) -> Iterator[tuple[type[RunnerUpPhase], Footprints]]:
        """Yield which phase looks at which triangles.

        Rows of a triangle whose box contains the center are not cut by its edges (`Rows.orientation`),
        and what is left of them is only settled on NumPy.
        """
        if not compiled():
            yield NumpyRunnersUp, self._footprints
            return
        around = self._footprints.side == 0
        # Only now: importing Dr.Jit's arrays needs the LLVM that `compiled` chose.
        yield (
            import_module("xfrustum.reference.certify.runner_up_jit").JitRunnersUp,
            _some(self._footprints, ~around),
        )
        if around.any():
            yield NumpyRunnersUp, _some(self._footprints, around)


def _some(found: Footprints, chosen: Mask) -> Footprints:
    return Footprints(
        number=found.number[chosen],
        side=found.side[chosen],
        holds_center=found.holds_center[chosen],
        box=found.box[:, chosen],
    )


class NumpyRunnersUp(NumpyNarrowPhase):
    """Second surfaces on NumPy: every pair that surely meets is kept, some 30 bytes each."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        super().__init__(pencil, rows)
        self._met: list[Pairs] = []

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        spans = Spans.of(rows, self._pencil)
        planes = spans.planes(self._pencil)
        lengths = spans.last - spans.first + 1
        ends, start = np.cumsum(lengths), 0
        while start < len(lengths):
            before = ends[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(ends, before + PAIRS_PER_CHUNK)))
            found = self._evaluated(spans, planes, np.repeat(np.arange(start, stop), lengths[start:stop]))
            self._met.append(found[found.sure])
            start = stop

    def first(self) -> Floats:
        """Return the largest s at which the first surface of each pixel can lie; infinite without one."""
        first = np.full_like(self._limit, np.inf)
        for met in self._met:
            np.minimum.at(first, met.pixel - self._base, met.farthest)
        return first

    def behind(self, first: Floats) -> Floats:
        """Return the smallest s of what surely lies behind, on the same side; infinite without any."""
        second = np.full_like(first, np.inf)
        for met in self._met:
            before = first[met.pixel - self._base]
            chosen = (met.nearest > before) & ((before >= 0) | (met.farthest <= 0))
            np.minimum.at(second, met.pixel[chosen] - self._base, met.s[chosen])
        return second
