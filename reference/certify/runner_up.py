"""The distance between the first surface of each line and the next one on the same side.

A camera's depth buffer chooses between these two. C keeps the nearest surface behind the plate, and C* the
farthest one before it; for the viewer, each is the first of its side along the line. The next surface, which
the camera must not show, lies behind the first on the same side of the plate.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Protocol

import numpy as np

from xfrustum.reference.certify.exact import ExactPencil
from xfrustum.reference.certify.footprints import Footprints, footprints
from xfrustum.reference.certify.narrow_numpy import NumpyNarrowPhase
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
    triangles, pencil
        (F, 3, 3) corners of the scene's triangles, in scene units, and the lines of the image.
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
        """Yield each phase with the triangles that it looks at.

        Rows of a triangle whose box contains the center are not cut by its edges (`Rows.orientation`).
        Only the phase on NumPy settles coverage of such rows.
        """
        if not compiled():
            yield NumpyRunnersUp, self._footprints
            return
        around = self._footprints.side == 0
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
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
    """Second surfaces on NumPy, where every pair that surely meets is kept, some 30 bytes each."""

    def __init__(self, pencil: Pencil, rows: range) -> None:
        super().__init__(pencil, rows)
        self._met: list[Pairs] = []

    def add(self, rows: Rows) -> None:
        """Take more triangles into account."""
        for found in self._pairs_of(rows):
            self._met.append(found[found.sure])

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
