"""Where to cut: each height as near to the plate as a separation allows.

With k cuts, the first one, z1, is minimised. Outside of z1 nothing is displaced, and within it the less
the smaller z1 is, so that near may be larger; and a first slab that is shallow needs the smaller near for its
depths. How near to the plate z1 can be is decided from the far end
inward. The outermost slab ends at the reach, and its cut may be as low as the separation at the farthest
surface that is seen in it allows: lower, depths would be coarser. A lower cut only helps the next slab,
which then ends sooner and sees nothing farther. So each slab in turn takes as much as it may, and no other
k cuts have a smaller z1.
"""

from __future__ import annotations

from collections.abc import Iterator

from xfrustum.compare.planning.numbers import index_below, round_number, smallest_index
from xfrustum.compare.planning.views import Views
from xfrustum.compare.prediction.share import Slab
from xfrustum.scenes.plate.double_frustum import Camera, DepthFormat, DepthMapping, DoubleFrustum

SMALLEST_PER_REACH = 1e-8
"""Smallest near and cut, as a part of the larger reach: in float32, n this small beside the reach is
nothing."""


class Cutter:
    """Places the cuts of a scene's frusta.

    Parameters
    ----------
    views
        Views of the scene: what is seen, and at which heights.

    Attributes
    ----------
    lowest, highest
        Indices of the smallest and the largest length that near and cuts may have; see `plan_numbers`.
    """

    def __init__(self, views: Views) -> None:
        frustum = views.scene.frustum
        self._views = views
        self._sides = ((Camera.C, frustum.reach[1]), (Camera.C_STAR, frustum.reach[0]))
        self.lowest = index_below(SMALLEST_PER_REACH * frustum.longest_reach)
        self.highest = index_below(frustum.longest_reach, strictly=True)

    def cuts(
        self, depth: DepthFormat, mapping: DepthMapping, count: int, separation: float
    ) -> tuple[float, ...]:
        """Return up to some number of heights, ascending, each as near to the plate as can be.

        Parameters
        ----------
        depth, mapping
            Format of the depth buffer, and what it stores.
        count
            Largest number of cuts; there are fewer where they come as near to the plate as any may.
        separation
            Separation that sheets at the farthest visible surface of every slab but the first must be ordered
            at.
        """
        cuts: list[float] = []
        highest = self.highest
        while len(cuts) < count and highest >= self.lowest:
            outer = cuts[-1] if cuts else None

            def fine_enough(height: float, outer: float | None = outer) -> bool:
                return self.separation(depth, mapping, height, outer) <= separation

            index = smallest_index(self.lowest, highest, fine_enough)
            cuts.append(round_number(index))
            highest = index - 1
        return tuple(reversed(cuts))

    def separation(self, depth: DepthFormat, mapping: DepthMapping, low: float, high: float | None) -> float:
        """Return the smallest separation at the farthest surface seen between cuts, or up to the reach."""
        settings = DoubleFrustum(near=low, depth=depth, mapping=mapping)
        found = (self._views.separation_in(slab, settings) for slab in self._slabs(low, high))
        return max(found, default=0.0)

    def finest(self, depth: DepthFormat, mapping: DepthMapping) -> float:
        """Return the smallest separation at each camera's farthest surface, in a slab made for it alone."""
        settings = DoubleFrustum(near=1.0, depth=depth, mapping=mapping)
        found = [0.0]
        for camera, reach in self._sides:
            far = max((float(view.seen[camera].max(initial=0)) for view in self._views.views), default=0.0)
            if far > 0:
                index = index_below(far, strictly=True)
                low, high = round_number(index), min(round_number(index + 2), reach)
                slab = Slab(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
                found.append(self._views.separation_in(slab, settings))
        return max(found)

    def _slabs(self, low: float, outer: float | None) -> Iterator[Slab]:
        """Yield the slabs of both cameras between two cuts, or a cut and the reach."""
        for camera, reach in self._sides:
            high = reach if outer is None else min(outer, reach)
            if low < high:
                yield Slab(camera=camera, low=low, high=high, step=0.0, near=low, far=high)
