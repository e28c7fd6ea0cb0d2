"""Lines that have no common point: those of pixels that are taken from many hogels, by columns and rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.arrays import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class LineGrid:
    """Lines in columns and rows, each through a point of the plate of its own.

    The line of column c, row r is P(s) = (x[c], y[r], 0) + s (dx[c], dy[r], -1), so that z = -s.

    Attributes
    ----------
    x, dx
        (W,) where the columns' lines meet the plate, and their slopes.
    y, dy
        (H,) the same of the rows.
    s_range
        Only surfaces with s in this closed interval are imaged; the smallest s is seen first.
    """

    x: Floats
    dx: Floats
    y: Floats
    dy: Floats
    s_range: tuple[float, float]

    @property
    def resolution(self) -> tuple[int, int]:
        """W, H: number of columns and rows."""
        return len(self.dx), len(self.dy)

    def points(self) -> Floats:
        """Return where the lines meet the plate, (H, W, 3)."""
        return _spread(self.x, self.y, 0.0)

    def directions(self) -> Floats:
        """Return d of every line, (H, W, 3)."""
        return _spread(self.dx, self.dy, -1.0)


def _spread(across: Floats, down: Floats, height: float) -> Floats:
    values = np.empty((len(down), len(across), 3))
    values[..., 0], values[..., 1], values[..., 2] = across, down[:, None], height
    return values
