"""What a plan must keep, what some apertures truly show, and what any settings are predicted to make of it.

A plan must hold when it is measured, over the pixels of the drawn picture, which at contours show
another surface than the truth's. So the closed form of displacement gives each of the truth's
pixels the largest displacement of itself and its neighbors: a picture displaced by less than a
pixel shows nothing else there. That form cannot know what no pixel of the truth shows: a camera
that has stepped back by n sees farther to the side where |z| is no larger than n. That is left to
the reference, which traces the offset cameras.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import ClassVar

import numpy as np
from scipy.ndimage import maximum_filter

from xfrustum.compare.beyond import PERCENTILE, displacement_p99, is_beyond
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.compare.prediction import depth
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, in_first_slab
from xfrustum.reference import Reference
from xfrustum.scenes.arguments import real, settle
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum, Offset
from xfrustum.scenes.plate.plate import Aperture, Frustum
from xfrustum.tolerances import MAX_DEPTH_WRONG, MAX_WRONG, TOLERANCE_PX

SEPARATION_PER_REACH = 1e-3
"""Separation that is asked for where none is given, as a part of the larger reach."""

HEIGHT_TOLERANCE_RATIO = 1e-9
"""Relative distance from a cut within which a surface counts on both sides of it. Rounding moves the surfaces
of a refined mesh by 1e-16 of their coordinates, and cuts have three digits."""

NEIGHBORHOOD_PX = 3  #: width of a neighborhood in pixels: one to each side
Done = Callable[[int], object]  #: function that is called with the number of hogels that are done


@dataclass(frozen=True, kw_only=True)
class Errors:
    """What settings get wrong at a hogel, or at the worst of some: measured, or predicted at most."""

    displacement_p99_px: float  # 0 where nothing is displaced, infinite where it is undefined
    surface_fraction: float  #: share of judged pixels that show the wrong surface
    depth_wrong: (
        float  #: share whose wrong surface is charged to depth; predicted for the unluckiest order
    )

    def beyond(self, tolerance_px: float) -> bool:
        """Return whether a hogel is beyond a tolerance; see `compare.beyond`."""
        return is_beyond(self.displacement_p99_px, self.surface_fraction, tolerance_px)


@dataclass(frozen=True, kw_only=True)
class Quality(Errors):
    """How well some settings do, at the worst of some apertures: predicted, or measured.

    `misordered` is the share of pixels in which the wrong one of two parallel sheets shows, as far
    apart as is asked for, at the farthest visible surface of the worst camera and slab.
    `separation` is the smallest distance of sheets there, scene units, at which no more than
    `MAX_MISORDERED_FRACTION` are wrong; 0 where no two surfaces can be misordered.
    """

    misordered: float
    separation: float


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """What a picture must keep; InputError where a number is not positive, or the share not below one."""

    SEEN_BY_EYES: ClassVar[bool] = False
    """Whether eyes judge near, and not pixels: then the largest near that they cannot see is planned."""

    tolerance_px: float = TOLERANCE_PX  #: largest 99th percentile of displacement
    #: distance of ordered sheets, scene units; None: `SEPARATION_PER_REACH` of the reach
    separation: float | None = None
    max_wrong: float = MAX_DEPTH_WRONG  #: largest share of judged pixels that are wrong by depth
    device: DeviceModel | None = None  #: that draws; None for what is known of the one at hand

    def __post_init__(self) -> None:
        tolerance, share = real(self.tolerance_px), real(self.max_wrong)
        separation = None if self.separation is None else real(self.separation)
        if not ((math.isfinite(tolerance) or self.SEEN_BY_EYES) and tolerance > 0):
            raise InputError(
                f"tolerance must be a positive number of pixels, not {self.tolerance_px!r}"
            )
        if separation is not None and not (math.isfinite(separation) and separation > 0):
            raise InputError(f"separation must be a positive length, not {self.separation!r}")
        if not 0 < share < 1:
            raise InputError(
                f"the largest share of wrong pixels must lie between 0 and 1, not {self.max_wrong!r}"
            )
        settle(self, tolerance_px=tolerance, separation=separation, max_wrong=share)

    def separation_in(self, frustum: Frustum) -> float:
        """Return the separation in scene units."""
        return (
            SEPARATION_PER_REACH * frustum.longest_reach
            if self.separation is None
            else self.separation
        )

    @property
    def beyond_px(self) -> float:
        """Displacement from which on a hogel is beyond: the tolerance, or the usual where eyes judge."""
        return self.tolerance_px if math.isfinite(self.tolerance_px) else TOLERANCE_PX

    def worst_measure(self, found: Errors) -> str:
        """Return the name of the error that is nearest to what is allowed, or farthest beyond it."""
        ratios = {
            "displacement_p99_px": 0.0
            if self.SEEN_BY_EYES
            else found.displacement_p99_px / self.tolerance_px,
            "surface_fraction": 0.0 if self.SEEN_BY_EYES else found.surface_fraction / MAX_WRONG,
            "depth_wrong": found.depth_wrong / self.max_wrong,
        }
        # Where nothing is limited, wrong surfaces decide (`PlatePlanner`).
        return max(ratios, key=ratios.__getitem__) if any(ratios.values()) else "surface_fraction"

    def by_pixels(self, found: Errors) -> float:
        """Return the ratio of what near does to pixels to what is allowed."""
        return max(
            found.displacement_p99_px / self.tolerance_px, found.surface_fraction / MAX_WRONG
        )

    def by_eyes(self, settings: DoubleFrustum) -> float:
        """Return the ratio of what near does to what eyes see to what they notice; 0 where pixels judge."""
        return 0.0

    def excess(self, found: Errors) -> float:
        """Return the largest ratio of errors to what is allowed; infinite where displacement is undefined."""
        return max(self.by_pixels(found), found.depth_wrong / self.max_wrong)

    def missed_by(self, found: Errors) -> bool:
        """Return whether a hogel has more errors than are allowed."""
        return self.excess(found) > 1

    def met_by(self, found: Quality) -> bool:
        """Return whether what was measured is what is required."""
        return not self.missed_by(found) and found.misordered <= depth.MAX_MISORDERED_FRACTION

    def limit_of_near(self, larger: DoubleFrustum, units: str) -> str:
        """Say what a larger near than the largest would do."""
        moved = (
            f"more than one pixel in a hundred might be displaced by over {self.tolerance_px:g} px"
        )
        return f"{moved}, or show the wrong surface"

    def separation_reason(self, units: str) -> str:
        """Say why sheets must be ordered that are so far apart; empty where it was asked for."""
        return ""


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
    """What one aperture truly shows; see `Reference.trace` and `Reference.gaps`."""

    aperture: Aperture
    truth: HogelImage
    gaps: Floats

    @cached_property
    def seen(self) -> dict[Camera, Floats]:
        """Heights |z| of all visible surfaces by the camera that sees them, ascending."""
        height = np.sort(self.truth.height[self.truth.covered].astype(np.float64))
        return {Camera.C: -height[height <= 0][::-1], Camera.C_STAR: height[height > 0]}

    @cached_property
    def stacks(self) -> depth.DepthLayers:
        """What depth buffers have to tell apart."""
        return depth.DepthLayers.from_truth(self.truth, self.gaps)

    def farthest(self, camera: Camera, low: float = 0.0, high: float = math.inf) -> float | None:
        """Return the largest |z| that a camera sees between two heights; None where it sees nothing."""
        seen = self.seen[camera]
        count = int(np.searchsorted(seen, high * (1 + HEIGHT_TOLERANCE_RATIO), side="right"))
        if not count or seen[count - 1] < low * (1 - HEIGHT_TOLERANCE_RATIO):
            return None
        return min(float(seen[count - 1]), high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """What some apertures of a scene truly show, and what any settings are predicted to make of it."""

    reference: Reference
    views: tuple[View, ...]
    device: DeviceModel | None = None  #: that draws; None for one that stores the nearest step

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
        for one in apertures:
            views.append(View(aperture=one, truth=reference.trace(one), gaps=reference.gaps(one)))
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
        """Return what `displacement_bound` is at the worst aperture, or at the first one beyond a limit."""
        worst = 0.0
        for view in self.views:
            worst = max(worst, displacement_bound(view.truth, self.scene.frustum, settings))
            if worst > limit:
                break
        return worst

    def traced_errors(self, settings: DoubleFrustum) -> tuple[float, float]:
        """Return what cameras that round nothing get wrong at the worst: px displaced, share of surfaces."""
        moved, wrong = [0.0], [0.0]
        for view in self.views:
            model = self.reference.trace_model(view.aperture, settings)
            found = compare_images(view.truth, model, self.reference, radiance=False)
            assert found.surface is not None, "the reference has the scene at hand"
            moved.append(displacement_p99(found))
            wrong.append(found.surface.fraction)
        return max(moved), max(wrong)

    def depth_wrong(self, settings: DoubleFrustum) -> float:
        """Return the predicted share of pixels shown wrongly by depth, for the most unlucky draw order."""
        asked = self.scene.frustum, [settings], self.device or depth.ANY
        shares = (
            depth.depth_wrong_shares(view.stacks, *asked, unlucky=True)[0] for view in self.views
        )
        return max(shares, default=0.0)

    def separation(self, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at the farthest surface of the worst camera and slab."""
        every = depth.slabs(self.scene.frustum, settings)
        return max((self.separation_in(slab, settings) for slab in every), default=0.0)

    def separation_in(self, slab: depth.DepthRange, settings: DoubleFrustum) -> float:
        """Return the predicted smallest separation at the farthest surface seen in a slab; 0 without any."""
        ends = [view.farthest(slab.camera, slab.low, slab.high) for view in self.views]
        seen = np.array([end for end in ends if end is not None])
        if not len(seen):
            return 0.0
        w = np.clip(seen + slab.step, slab.near, slab.far)
        asked = slab.near, slab.far, settings.depth, settings.mapping, self.device
        return float(depth.smallest_separation(w, *asked).max())

    def predicted(self, settings: DoubleFrustum, separation: float) -> Quality:
        """Return what closed forms predict of settings, with sheets as far apart as is asked for."""
        smallest, depth_wrong = self.separation(settings), self.depth_wrong(settings)
        certain = NormalDist().inv_cdf(1 - depth.MAX_MISORDERED_FRACTION)
        return Quality(
            displacement_p99_px=self.displaced(settings),
            surface_fraction=depth_wrong,
            depth_wrong=depth_wrong,
            misordered=NormalDist().cdf(-certain * separation / smallest) if smallest else 0.0,
            separation=smallest,
        )
