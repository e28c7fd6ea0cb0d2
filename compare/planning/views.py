"""True images of some apertures, and the errors that closed forms predict of settings.

A plan is measured over the pixels of the drawn picture, which show other surfaces than the truth
at contours. The closed form of displacement therefore gives each pixel of the truth the largest
displacement of itself and its neighbors: a picture displaced by less than a pixel shows nothing
else there. Surfaces that no pixel of the truth shows are left to the reference, which traces the
offset cameras: a camera that has stepped back by n sees farther aside where |z| <= n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist

import numpy as np
from scipy.ndimage import maximum_filter

from xfrustum.compare.beyond import PERCENTILE, displacement_p99
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.planning.requirement import Quality
from xfrustum.compare.prediction import depth
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, in_first_slab
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture, Frustum

#: Relative distance from a cut within which a surface counts on both of its sides: rounding moves
#: the surfaces of a refined mesh by 1e-16 of their coordinates, and cuts have three digits.
HEIGHT_TOLERANCE_RATIO = 1e-9

#: width of a neighborhood in pixels: one to each side
NEIGHBORHOOD_PX = 3
#: progress, called with a number of hogels
Done = Callable[[int], object]


def displacement_bound(truth: HogelImage, frustum: Frustum, settings: DoubleFrustum) -> float:
    """Return the 99th percentile of displacement that a drawn picture does not exceed, in pixels.

    It is 0 where the truth shows no surface, and infinite where more than one pixel in a hundred
    shows a surface in the aperture itself, whose displacement no n makes small.

    With zf the height that is drawn exactly, a surface at |z| is displaced by u n / (|z| + n) (1 -
    |z| / zf) where it belongs (`displacements`), and where it is drawn by (1 + n / |z|) / (1 + n /
    zf) times that.
    """
    if not truth.covered.any():
        return 0.0
    points = TruePoints.from_image(truth)
    moved = displacement_lengths(points, frustum, settings)
    if settings.offset is Offset.PLATE:
        fitted = settings.fitted_height(frustum)
        per_fit = 0.0 if fitted is None else 1 / fitted
        bent = in_first_slab(points.height, frustum, settings)
        moved[bent] *= (1 + settings.near / np.abs(points.height[bent])) / (
            1 + settings.near * per_fit
        )
    moved = np.where(truth.covered & (truth.height == 0), np.inf, np.nan_to_num(moved, nan=0.0))
    largest = maximum_filter(moved, size=NEIGHBORHOOD_PX)[truth.covered]
    return float(np.percentile(largest, PERCENTILE, method="higher"))


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """True image of one aperture, and its gaps; see `Reference.trace` and `Reference.gaps`."""

    aperture: Aperture
    truth: HogelImage
    gaps: Floats

    @cached_property
    def seen(self) -> dict[Camera, Floats]:
        """Heights |z| of all visible surfaces by the camera that sees them, ascending."""
        height = np.sort(self.truth.height[self.truth.covered].astype(np.float64))
        return {Camera.C: -height[height <= 0][::-1], Camera.C_STAR: height[height > 0]}

    @cached_property
    def layers(self) -> depth.DepthLayers:
        """Surfaces that depth buffers must order."""
        return depth.DepthLayers.from_truth(self.truth, self.gaps)

    def farthest(self, camera: Camera, low: float = 0.0, high: float = math.inf) -> float | None:
        """Return the largest |z| visible to a camera between two heights; None for none."""
        seen = self.seen[camera]
        count = int(np.searchsorted(seen, high * (1 + HEIGHT_TOLERANCE_RATIO), side="right"))
        if not count or seen[count - 1] < low * (1 - HEIGHT_TOLERANCE_RATIO):
            return None
        return min(float(seen[count - 1]), high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """True images of some apertures of a scene, and errors that are predicted of settings."""

    reference: Reference
    views: tuple[View, ...]
    device: DeviceModel | None = (
        None  #: device that draws; None for one that stores the nearest step
    )

    @classmethod
    def traced(
        cls,
        reference: Reference,
        apertures: Sequence[Aperture],
        done: Done = lambda hogels: None,
        device: DeviceModel | None = None,
    ) -> Views:
        """Trace apertures; `done` is called with 1 after each."""
        views = []
        for aperture in apertures:
            views.append(
                View(
                    aperture=aperture,
                    truth=reference.trace(aperture),
                    gaps=reference.gaps(aperture),
                )
            )
            done(1)
        return cls(reference=reference, views=tuple(views), device=device)

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.reference.scene

    def farthest(self, camera: Camera) -> float:
        """Return the largest |z| that a camera sees from any aperture; 0 where it sees nothing."""
        return max((view.farthest(camera) or 0.0 for view in self.views), default=0.0)

    def displaced(self, settings: DoubleFrustum, limit: float = math.inf) -> float:
        """Return the largest `displacement_bound`, or the first one beyond a limit."""
        worst = 0.0
        for view in self.views:
            worst = max(worst, displacement_bound(view.truth, self.scene.frustum, settings))
            if worst > limit:
                break
        return worst

    def traced_errors(self, settings: DoubleFrustum) -> tuple[float, float]:
        """Return the worst displacement (px) and wrong share of cameras that round nothing."""
        moved, wrong = [0.0], [0.0]
        for view in self.views:
            model = self.reference.trace_model(view.aperture, settings)
            comparison = compare_images(view.truth, model, self.reference, radiance=False)
            assert comparison.surface is not None, "the reference has the scene at hand"
            moved.append(displacement_p99(comparison))
            wrong.append(comparison.surface.fraction)
        return max(moved), max(wrong)

    def depth_wrong(self, settings: DoubleFrustum) -> float:
        """Return the predicted share of pixels wrong by depth, for the worst draw order."""
        arguments = self.scene.frustum, [settings], self.device or depth.ANY
        shares = (
            depth.depth_wrong_shares(view.layers, *arguments, unlucky=True)[0]
            for view in self.views
        )
        return max(shares, default=0.0)

    def separation(self, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at the farthest surface of all slabs."""
        every = depth.slabs(self.scene.frustum, settings)
        return max((self.separation_in(slab, settings) for slab in every), default=0.0)

    def separation_in(self, slab: depth.DepthRange, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at a slab's farthest surface; 0 without any."""
        ends = [view.farthest(slab.camera, slab.low, slab.high) for view in self.views]
        seen = np.array([end for end in ends if end is not None])
        if not len(seen):
            return 0.0
        w = np.clip(seen + slab.step, slab.near, slab.far)
        arguments = slab.near, slab.far, settings.depth, settings.mapping, self.device
        return float(depth.smallest_separation(w, *arguments).max())

    def predicted(self, settings: DoubleFrustum, separation: float) -> Quality:
        """Return the predicted errors of settings, with sheets of a separation."""
        smallest, depth_wrong = self.separation(settings), self.depth_wrong(settings)
        certain = NormalDist().inv_cdf(1 - depth.MAX_MISORDERED_FRACTION)
        return Quality(
            displacement_p99_px=self.displaced(settings),
            surface_fraction=depth_wrong,
            depth_wrong=depth_wrong,
            misordered=NormalDist().cdf(-certain * separation / smallest) if smallest else 0.0,
            separation=smallest,
        )
