"""Surface points that an image shows, and of which it is asked whether something hides them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Indices, Numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points that an image shows.

    Attributes
    ----------
    position
        (M, 3) scene units, z not that of the point from which they are seen.
    triangle
        (M,) number of the triangle that each point lies on, `NOTHING` where that is not known.
    tolerance
        (M,) distance within which each point is known, scene units: a triangle whose plane passes within
        this distance of a point does not hide it. Thus a mesh's tessellation makes no difference.
    asked
        (N,) numbers of the points that are asked about; None for all of them.
    """

    position: NDArray[np.floating]
    triangle: Numbers
    tolerance: Floats
    asked: Indices | None = None

    def __len__(self) -> int:
        """Return the number of the points that are asked about."""
        return len(self.position) if self.asked is None else len(self.asked)

    def at(self, some: Indices) -> tuple[Floats, Floats]:
        """Return positions (K, 3) and tolerances (K,) of some of the points that are asked about."""
        rows = some if self.asked is None else self.asked[some]
        return self.position[rows].astype(np.float64, copy=False), self.tolerance[rows]

    def taken(self) -> SurfacePoints:
        """Return the points that are asked about, and no others, in double precision."""
        rows = slice(None) if self.asked is None else self.asked
        return SurfacePoints(
            position=self.position[rows].astype(np.float64, copy=False),
            triangle=self.triangle[rows],
            tolerance=self.tolerance[rows],
        )
