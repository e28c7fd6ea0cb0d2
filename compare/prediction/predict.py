"""Closed forms of every error, from the scene's geometry alone (docs/method.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import pairwise
from threading import Lock

import numpy as np

from xfrustum.compare.metrics.displacement import Spread, lengths, root_mean_square
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.surface import turned_away
from xfrustum.compare.prediction.chain import traced_settings, with_exact_depth, with_named_fit
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, displacements
from xfrustum.compare.prediction.outside import Border
from xfrustum.compare.prediction.share import depth_wrong_share, slabs
from xfrustum.compare.prediction.silhouettes import Silhouettes
from xfrustum.compare.prediction.stacks import Stacks
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, Cull, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum


@dataclass(frozen=True, kw_only=True)
class Separations:
    """The smallest separation that each camera's depth buffer orders at its farthest visible surface.

    Attributes
    ----------
    c, c_star
        Separation for C and for C*, scene units; None where the camera shows no surface.
    """

    c: float | None
    c_star: float | None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """The errors that one choice of settings is expected to have.

    Attributes
    ----------
    displacement_px
        Spread of the displacement, px; None where no surface off the plate is drawn.
    silhouettes, snapped, depth, outside
        Shares of the judged pixels that show a wrong surface: along silhouettes because of
        displacement, along silhouettes because edges snap to subpixels, because of the depth buffer, and
        because they show what belongs outside the film.
    separation
        The smallest separations that the depth buffers still order.
    culled
        Share of the judged pixels whose true surface culling leaves out; 0 without culling.
    """

    displacement_px: Spread | None
    silhouettes: float
    snapped: float
    depth: float
    outside: float
    separation: Separations
    culled: float = 0.0

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels with a wrong surface, its five causes taken as independent."""
        parts = (self.silhouettes, self.snapped, self.depth, self.outside, self.culled)
        return 1 - math.prod(1 - part for part in parts)


@dataclass(frozen=True, kw_only=True)
class LinkPrediction:
    """The errors that one link of the chain is expected to add; None where no closed form is known.

    Attributes
    ----------
    displacement_rms_px
        Root mean square length of the displacement that the link adds.
    surface_pixels
        Number of judged pixels with a wrong surface that are charged to the link.
    """

    displacement_rms_px: float | None
    surface_pixels: float | None


class Predictor:
    """All closed forms for the true image of one aperture.

    Parameters
    ----------
    truth
        The true image.
    gaps
        (H, W) distances to the next surfaces, see `Reference.gaps`.
    frustum
        Frustum of the scene.
    subpixel_bits
        Subpixel bits of the device that draws.
    """

    def __init__(self, truth: HogelImage, gaps: Floats, frustum: Frustum, subpixel_bits: int) -> None:
        self._truth, self._frustum = truth, frustum
        self._subpixel_bits = subpixel_bits
        points = TruePoints.of(truth)
        self._points = points.shown()
        height = self._points.height
        self._farthest = {
            Camera.C: -float(height.min(initial=0)),
            Camera.C_STAR: float(height.max(initial=0)),
        }
        self._stacks = Stacks.of(truth, gaps)
        self._silhouettes = Silhouettes(truth, frustum, points)
        self._border = Border(truth, frustum, points)
        # Threads that ask for the same cameras wait for the one that was first.
        self._predicting, self._linking = Lock(), Lock()
        self._without_depth: dict[DoubleFrustum, Prediction] = {}
        self._depth_shares: dict[DoubleFrustum, float] = {}
        self._links_without_depth: dict[DoubleFrustum, tuple[LinkPrediction, ...]] = {}

    @cached_property
    def _turned_away(self) -> int:
        """Number of judged pixels whose true surface culling leaves out."""
        return int((turned_away(self._truth) & judged_pixels(self._truth)).sum())

    def predict(self, settings: DoubleFrustum) -> Prediction:
        """Return the errors to be expected with some settings."""
        # The depth buffer displaces nothing: settings that differ only in depth share the other errors.
        cameras = with_exact_depth(settings)
        with self._predicting:
            if cameras not in self._without_depth:
                self._without_depth[cameras] = self._predict_without_depth(cameras)
        return replace(
            self._without_depth[cameras],
            depth=self._depth_share(settings),
            separation=self.separations(settings),
        )

    def _predict_without_depth(self, cameras: DoubleFrustum) -> Prediction:
        judged = max(self._stacks.judged, 1)
        return Prediction(
            displacement_px=_spread(displacement_lengths(self._points, self._frustum, cameras)),
            silhouettes=self._silhouettes.wrong_pixels(cameras) / judged,
            snapped=self._silhouettes.snapped_pixels(cameras, self._subpixel_bits) / judged,
            depth=0.0,
            outside=self._border.fraction(cameras),
            separation=Separations(c=None, c_star=None),
            culled=0.0 if cameras.cull is Cull.NONE else self._turned_away / judged,
        )

    def links(self, settings: DoubleFrustum) -> tuple[LinkPrediction, ...]:
        """Return the errors to be expected of each link of the chain, in the order of `links_of`.

        Rasterization and depth displace nothing except by the rounding of positions.
        """
        cameras = with_exact_depth(settings)
        with self._linking:
            if cameras not in self._links_without_depth:
                self._links_without_depth[cameras] = self._undrawn_links(cameras)
        share = self._depth_share(settings)
        depth = LinkPrediction(displacement_rms_px=None, surface_pixels=share * self._stacks.judged)
        return (*self._links_without_depth[cameras], depth)

    def _depth_share(self, settings: DoubleFrustum) -> float:
        """Return the share of pixels that depth makes wrong, found once for the same settings."""
        if settings not in self._depth_shares:
            self._depth_shares[settings] = depth_wrong_share(self._stacks, self._frustum, settings)
        return self._depth_shares[settings]

    def _undrawn_links(self, cameras: DoubleFrustum) -> tuple[LinkPrediction, ...]:
        """Return the errors to be expected of all links but depth."""
        traced = traced_settings(cameras, self._frustum)
        moved = self._moved_by(cameras, traced)
        from_outside = [share * self._stacks.judged for share in self._border.charged_fractions(traced)]
        wrong = [
            sum(both) for both in zip(self._silhouettes.charged_pixels(traced), from_outside, strict=True)
        ]
        if cameras.cull is not Cull.NONE:
            # Culling shows nothing or what lies behind, of which the truth knows no displacement.
            moved[-1] = None
            right_before = 1 - min(sum(wrong) / max(self._stacks.judged, 1), 1.0)
            wrong[-1] = self._turned_away * right_before
        snapped = self._silhouettes.snapped_pixels(cameras, self._subpixel_bits)
        return tuple(
            LinkPrediction(displacement_rms_px=rms, surface_pixels=pixels)
            for rms, pixels in zip([*moved, None], [*wrong, snapped], strict=True)
        )

    def _moved_by(self, cameras: DoubleFrustum, chain: Sequence[DoubleFrustum]) -> list[float | None]:
        """Return the root mean square of the displacement that each link of the cameras' chain adds."""
        field = cache(partial(displacements, self._points, self._frustum))
        found = [self._moved_by_offset(cameras, chain[0])]
        for before, after in pairwise(chain):
            if before != after:
                found.append(_rms_of_known(lengths(field(after) - field(before))))
            else:
                # Nothing moves, where anything is known: what is drawn at all is the same for all links.
                found.append(None if found[0] is None else 0.0)
        return found

    def _moved_by_offset(self, cameras: DoubleFrustum, offset: DoubleFrustum) -> float | None:
        """Return the root mean square of the displacement by a chain's first link, the offset of its cameras.

        Without pivot, fit and slabs that is all displacement, which may have been predicted already.
        """
        known = self._without_depth.get(cameras)
        if known is not None and with_named_fit(cameras, self._frustum) == offset:
            return known.displacement_px.rms if known.displacement_px else None
        return _rms_of_known(displacement_lengths(self._points, self._frustum, offset))

    def separations(self, settings: DoubleFrustum) -> Separations:
        """Return the smallest separation that is ordered at the farthest visible surface of each side."""
        farthest = self._farthest
        found: dict[Camera, float] = {}
        for slab in slabs(self._frustum, settings):
            if slab.low <= farthest[slab.camera] <= slab.high and farthest[slab.camera] > 0:
                w = np.array([farthest[slab.camera] + slab.step])
                there = smallest_separation(w, slab.near, slab.far, settings.depth, settings.mapping)
                # Both slabs draw a surface at their common cut; for one of them it is the nearest surface.
                found[slab.camera] = min(found.get(slab.camera, np.inf), float(there[0]))
        return Separations(c=found.get(Camera.C), c_star=found.get(Camera.C_STAR))


def displacement(truth: HogelImage, frustum: Frustum, settings: DoubleFrustum) -> Spread | None:
    """Return the spread of displacement over the surfaces that the truth shows; None where it shows none."""
    return _spread(displacement_lengths(TruePoints.of(truth).shown(), frustum, settings))


def _rms_of_known(moved: Floats) -> float | None:
    """Return the root mean square of those lengths (N,) that are known; None where none is."""
    known = np.isfinite(moved)
    if not known.all():
        moved = moved[known]
    return root_mean_square(moved) if moved.size else None


def _spread(moved: Floats) -> Spread | None:
    """Return the spread of those lengths (N,) that are known; None where none is."""
    known = np.isfinite(moved)
    return Spread.of(moved if known.all() else moved[known])
