"""Closed forms of every error, from the scene's geometry alone (docs/method.md)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.error_maps import Spread, judged_pixels, lengths, root_mean_square, turned_away
from xfrustum.compare.prediction.chain import traced_settings, with_exact_depth
from xfrustum.compare.prediction.depth import Stacks, depth_wrong_share, slabs, smallest_separation
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, displacements
from xfrustum.compare.prediction.silhouettes import Silhouettes
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.double_frustum import Camera, Cull, DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum


@dataclass(frozen=True, kw_only=True)
class Separations:
    """The smallest separation that each camera orders at its farthest visible surface, scene units."""

    c: float | None
    c_star: float | None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """The errors that one choice of settings is expected to have; shares are of the judged pixels."""

    displacement_px: Spread | None  #: None where no surface off the plate is drawn
    silhouettes: float  #: wrong surface along silhouettes because of displacement
    snapped: float  #: wrong surface along silhouettes because edges snap to subpixels
    depth: float  #: wrong surface because of the depth buffer
    outside: float  #: shown is what belongs outside the film
    separation: Separations
    culled: float = 0.0  #: culling leaves the true surface out

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels with a wrong surface, its five causes taken as independent."""
        parts = (self.silhouettes, self.snapped, self.depth, self.outside, self.culled)
        return 1 - math.prod(1 - part for part in parts)


@dataclass(frozen=True, kw_only=True)
class LinkPrediction:
    """The errors that one link of the chain is expected to add; None where no closed form is known."""

    displacement_rms_px: float | None
    surface_pixels: float | None  #: judged pixels with a wrong surface that are charged to the link


class Predictor:
    """All closed forms for the true image of one aperture; `gaps` (H, W) are those of `Reference.gaps`."""

    def __init__(self, truth: HogelImage, gaps: Floats, frustum: Frustum, subpixel_bits: int) -> None:
        self._truth, self._frustum = truth, frustum
        self._subpixel_bits = subpixel_bits
        self._all_points = TruePoints.of(truth)
        self._points = self._all_points.shown()
        self._stacks = Stacks.of(truth, gaps)
        self._silhouettes = Silhouettes(truth, frustum, self._all_points)
        self._without_depth: dict[DoubleFrustum, tuple[Prediction, tuple[LinkPrediction, ...]]] = {}

    def predict_links(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        """Return the errors to be expected, and those of each link of the chain in order of `links_of`."""
        prediction, links = self.without_depth(settings)
        share = depth_wrong_share(self._stacks, self._frustum, settings)
        depth = LinkPrediction(displacement_rms_px=None, surface_pixels=share * self._stacks.judged)
        return replace(prediction, depth=share, separation=self._separations(settings)), (*links, depth)

    def without_depth(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        """Return the same without errors of depth: found once for the depth buffers of the same cameras."""
        exact = with_exact_depth(settings)
        if exact not in self._without_depth:
            self._without_depth[exact] = self._predicted(exact)
        return self._without_depth[exact]

    def _predicted(self, settings: DoubleFrustum) -> tuple[Prediction, tuple[LinkPrediction, ...]]:
        judged, chain = max(self._stacks.judged, 1), traced_settings(settings, self._frustum)
        swept = self._silhouettes.charged_pixels(chain)
        outside = outside_shares(self._all_points, self._frustum, chain)
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
            displacement_px=_spread(self._points, self._frustum, settings),
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
        def rms(moved: Floats) -> float | None:
            known = lengths(moved)
            known = known[np.isfinite(known)]
            return root_mean_square(known) if known.size else None

        fields = {one: displacements(self._points, self._frustum, one) for one in dict.fromkeys(chain)}
        found = [rms(fields[chain[0]])]
        # Where nothing moves, what is drawn at all is the same for all links.
        still = None if found[0] is None else 0.0
        pairs = pairwise(chain)
        return found + [still if one == two else rms(fields[two] - fields[one]) for one, two in pairs]

    def _separations(self, settings: DoubleFrustum) -> Separations:
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
    return _spread(TruePoints.of(truth).shown(), frustum, settings)


def _spread(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Spread | None:
    moved = displacement_lengths(points, frustum, settings)
    return Spread.of(moved[np.isfinite(moved)])


def outside_shares(points: TruePoints, frustum: Frustum, chain: Sequence[DoubleFrustum]) -> tuple[float, ...]:
    """Return the share of all pixels from outside the film that each link of a chain is charged with.

    Pixels are charged to the link from which on they show points from outside. A point on the border of the
    film that is drawn further in by d pixels leaves the d pixels between to points from beyond the border. A
    pixel counts from its center on: of d pixels, those are floor(d + 1/2). `points` are those of all pixels
    (H, W).
    """
    height, width = points.height.shape
    columns, rows = np.arange(width), np.arange(height) * width
    # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
    sides = ((rows, 0, -1), (rows + width - 1, 0, 1), (columns, 1, -1), (columns + rows[-1], 1, 1))
    borders = [(points.at(pixels), axis, sign) for pixels, axis, sign in sides]

    def shown(settings: DoubleFrustum) -> list[Floats]:
        """Return how many pixels in from the border show what lies beyond it, for each side's points."""
        moved = (sign * displacements(some, frustum, settings)[:, axis] for some, axis, sign in borders)
        # What is not known, as no camera draws it, shows nothing.
        return [np.floor(np.fmax(one, 0.0) + 0.5) for one in moved]

    by_settings = {one: shown(one) for one in dict.fromkeys(chain)}
    together, to_the_end = [], by_settings[chain[-1]]
    for settings in reversed(chain):
        pairs = zip(to_the_end, by_settings[settings], strict=True)
        left, right, top, bottom = to_the_end = [np.minimum(one, other) for one, other in pairs]
        across = np.minimum(left + right, width).sum() / (height * width)
        down = np.minimum(top + bottom, height).sum() / (height * width)
        # Both at once only in corners: taken as independent.
        together.append(1 - (1 - across) * (1 - down))
    return tuple(np.diff(together[::-1], prepend=0.0).tolist())
