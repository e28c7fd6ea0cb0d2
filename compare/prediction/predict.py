"""Closed forms of every error, from the scene's geometry alone (docs/method.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.displacement import Spread, lengths, root_mean_square
from xfrustum.compare.metrics.error_maps import judged_pixels
from xfrustum.compare.metrics.surface import turned_away
from xfrustum.compare.prediction.chain import traced_settings, with_exact_depth
from xfrustum.compare.prediction.depth import smallest_separation
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, displacements
from xfrustum.compare.prediction.outside import Border
from xfrustum.compare.prediction.share import Stacks, depth_wrong_share, slabs
from xfrustum.compare.prediction.silhouettes import Silhouettes
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
    surface_pixels
        Number of judged pixels with a wrong surface that are charged to the link.
    """

    displacement_rms_px: float | None
    surface_pixels: float | None


class Predictor:
    """All closed forms for the true image of one aperture.

    Parameters
    ----------
    gaps
        (H, W) distances to the next surfaces, see `Reference.gaps`.
    subpixel_bits
        Subpixel bits of the device that draws.
    """

    def __init__(self, truth: HogelImage, gaps: Floats, frustum: Frustum, subpixel_bits: int) -> None:
        self._truth, self._frustum = truth, frustum
        self._subpixel_bits = subpixel_bits
        points = TruePoints.of(truth)
        self._points = points.shown()
        self._stacks = Stacks.of(truth, gaps)
        self._silhouettes = Silhouettes(truth, frustum, points)
        self._border = Border(truth, frustum, points)
        self._without_depth: dict[DoubleFrustum, tuple[Prediction, tuple[LinkPrediction, ...]]] = {}

    def predict(self, settings: DoubleFrustum) -> Prediction:
        """Return the errors to be expected with some settings."""
        return self.predict_links(settings)[0]

    def predict_links(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        """Return the errors to be expected, and those of each link of the chain, in the order of `links_of`.

        Rasterization and depth displace nothing except by the rounding of positions.
        """
        prediction, links = self.without_depth(settings)
        share = depth_wrong_share(self._stacks, self._frustum, settings)
        depth = LinkPrediction(displacement_rms_px=None, surface_pixels=share * self._stacks.judged)
        return replace(prediction, depth=share, separation=self.separations(settings)), (*links, depth)

    def without_depth(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        """Return what the depth buffers of the same cameras share, found once for all of them."""
        exact = with_exact_depth(settings)
        if exact not in self._without_depth:
            self._without_depth[exact] = self._predicted(exact)
        return self._without_depth[exact]

    def _predicted(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        """Return the prediction without errors of depth, and those of all links but depth."""
        judged, chain = max(self._stacks.judged, 1), traced_settings(settings, self._frustum)
        swept, outside = self._silhouettes.charged_pixels(chain), self._border.charged_fractions(chain)
        snapped = self._silhouettes.snapped_pixels(settings, self._subpixel_bits)
        moved = self._moved_by(chain)
        wrong = [pixels + share * self._stacks.judged for pixels, share in zip(swept, outside, strict=True)]
        turned = 0
        if settings.cull is not Cull.NONE:
            turned = int((turned_away(self._truth) & judged_pixels(self._truth)).sum())
            # Culling shows nothing or what lies behind, of which the truth knows no displacement.
            moved[-1] = None
            wrong[-1] = turned * (1 - min(sum(wrong) / judged, 1.0))
        prediction = Prediction(
            displacement_px=_spread(displacement_lengths(self._points, self._frustum, settings)),
            silhouettes=sum(swept) / judged,
            snapped=snapped / judged,
            depth=0.0,
            outside=sum(outside),
            separation=Separations(c=None, c_star=None),
            culled=turned / judged,
        )
        links = zip([*moved, None], [*wrong, snapped], strict=True)
        return prediction, tuple(
            LinkPrediction(displacement_rms_px=rms, surface_pixels=pixels) for rms, pixels in links
        )

    def _moved_by(self, chain: Sequence[DoubleFrustum]) -> list[float | None]:
        """Return the root mean square of the displacement that each link of a chain adds."""
        fields = {one: displacements(self._points, self._frustum, one) for one in dict.fromkeys(chain)}
        found = [_rms_of_known(lengths(fields[chain[0]]))]
        for before, after in pairwise(chain):
            # Where nothing moves, what is drawn at all is the same for all links.
            still = None if found[0] is None else 0.0
            found.append(still if before == after else _rms_of_known(lengths(fields[after] - fields[before])))
        return found

    def separations(self, settings: DoubleFrustum) -> Separations:
        """Return the smallest separation that is ordered at the farthest visible surface of each side."""
        height = self._points.height
        farthest = {Camera.C: -float(height.min(initial=0)), Camera.C_STAR: float(height.max(initial=0))}
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
    known = moved[np.isfinite(moved)]
    return root_mean_square(known) if known.size else None


def _spread(moved: Floats) -> Spread | None:
    """Return the spread of those lengths (N,) that are known; None where none is."""
    return Spread.of(moved[np.isfinite(moved)])
