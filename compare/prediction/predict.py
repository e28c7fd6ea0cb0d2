"""Closed forms of every error, from the scene's geometry alone (docs/method.md)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.error_maps import (
    Spread,
    judged_pixels,
    lengths,
    root_mean_square,
    turned_away,
)
from xfrustum.compare.prediction.chain import traced_settings, with_exact_depth
from xfrustum.compare.prediction.creases import crease_pixels
from xfrustum.compare.prediction.depth import (
    MAX_MISORDERED_FRACTION,
    DepthLayers,
    depth_wrong_shares,
    float32_spacing,
    slabs,
    smallest_separation,
)
from xfrustum.compare.prediction.displacement import TruePoints, displacement_lengths, displacements
from xfrustum.compare.prediction.reasons import (
    LARGE_SIDE,
    MAX_LARGE,
    MAX_OUTSIDE,
    MAX_THIN,
    NO_REASONS,
    Reason,
    Reasons,
    chance,
)
from xfrustum.compare.prediction.silhouettes import Pair, Silhouettes
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import (
    Camera,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Offset,
    Pivot,
)
from xfrustum.scenes.plate.plate import Aperture, Frustum


@dataclass(frozen=True, kw_only=True)
class Separations:
    """Smallest separation at each camera's farthest visible surface, scene units."""

    c: float | None
    c_star: float | None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Expected errors of one choice of settings; shares refer to the judged pixels."""

    #: None where no surface off the plate is drawn, and where it is not predicted
    displacement_px: Spread | None
    silhouettes: float  #: wrong surface along silhouettes because of displacement
    snapped: float  #: wrong surface along silhouettes because edges snap to subpixels
    depth: float  #: wrong surface because of the depth buffer
    outside: float  #: shown is what belongs outside the film
    separation: Separations
    culled: float = 0.0  #: culling leaves the true surface out
    reasons: Reasons = NO_REASONS

    @property
    def surface_fraction(self) -> float:
        """Share of the judged pixels with a wrong surface, its five causes taken as independent."""
        parts = (self.silhouettes, self.snapped, self.depth, self.outside, self.culled)
        return 1 - math.prod(1 - part for part in parts)


@dataclass(frozen=True, kw_only=True)
class LinkPrediction:
    """Expected errors of one link of the chain; None without a closed form."""

    displacement_rms_px: float | None
    surface_pixels: float  #: judged pixels with a wrong surface that are charged to the link
    #: standard deviations of those beside edges along rows, and along columns: they go wrong
    #: together
    flip_deviations: Pair = (0.0, 0.0)
    reasons: Reasons = NO_REASONS


LinkedPrediction = tuple[Prediction, tuple[LinkPrediction, ...]]


class Predictor:
    """All closed forms for the true image of one aperture."""

    def __init__(self, truth: HogelImage, reference: Reference, device: DeviceModel) -> None:
        frustum, aperture = reference.scene.frustum, truth.camera.aperture
        self._truth, self._frustum = truth, frustum
        self._device = device
        self._all_points = TruePoints.from_image(truth)
        self._points = self._all_points.shown()
        self._stacks = DepthLayers.from_truth(
            truth, reference.gaps(aperture), reference.gaps(aperture, truth)
        )
        self._silhouettes = Silhouettes(truth, frustum, self._all_points)
        self._creases = crease_pixels(truth, reference.scene, device.subpixel_bits)
        self._in_plate = plate_segments(reference.scene, aperture)
        sides = np.ptp(reference.scene.triangles[truth.triangle[truth.covered]], axis=1).max(axis=1)
        large = sides > LARGE_SIDE * math.hypot(*reference.scene.plate.size)
        self._large = bool(large.sum() > MAX_LARGE * truth.triangle.size)
        self._parallel = truth.normal is not None and bool(
            (truth.normal[truth.covered][:, :2] == 0).all(axis=1).sum() > truth.covered.sum() / 2
        )
        # Pixel width at each point, and float spacing of the largest visible coordinate.
        spacing = float32_spacing(np.abs(truth.position[truth.covered]).max(initial=1.0))
        pixel = 2 * max(truth.camera.half_extent) / max(frustum.resolution)
        self._rounding_px = (
            float(spacing / (pixel * np.median(self._points.depth)))
            if self._points.depth.size
            else 0.0
        )

    def predict_each(self, settings: Sequence[DoubleFrustum]) -> list[LinkedPrediction]:
        """Return expected errors in total and for each link, in the order of `links_of`.

        The settings differ in their depth buffers alone: they share most.
        """
        (prediction, rounded), predictions = self._predicted(with_exact_depth(settings[0])), []
        shares = depth_wrong_shares(self._stacks, self._frustum, settings, self._device)
        for choice, share in zip(settings, shares, strict=True):
            depth = LinkPrediction(
                displacement_rms_px=None, surface_pixels=share * self._stacks.judged
            )
            links = (*rounded, depth)
            whole = replace(prediction, depth=share, separation=self._separations(choice))
            whole = replace(whole, reasons=self._reasons(choice, whole, links))
            predictions.append((whole, self._with_reasons(choice, whole, links)))
        return predictions

    def _predicted(self, settings: DoubleFrustum) -> LinkedPrediction:
        """Return the same without errors of depth."""
        judged, chain = max(self._stacks.judged, 1), traced_settings(settings, self._frustum)
        swept = self._silhouettes.charged_pixels(chain)
        outside = outside_shares(self._all_points, self._frustum, chain)
        snapped = (
            self._silhouettes.snapped_pixels(settings, self._device.subpixel_bits) + self._creases
        )
        moved = self._moved_by(chain)
        wrong = [
            pixels + share * self._stacks.judged
            for pixels, share in zip(swept, outside, strict=True)
        ]
        turned = 0
        if settings.cull is not Cull.NONE:
            turned = int((turned_away(self._truth) & judged_pixels(self._truth)).sum())
            # Culling shows nothing or a surface behind, which has no displacement in the truth.
            moved[-1] = None
            wrong[-1] = turned * (1 - min(sum(wrong) / judged, 1.0))
        crosses = self._crosses(settings)
        if crosses:
            moved = [None if length else length for length in moved]
        prediction = Prediction(
            displacement_px=None
            if crosses
            else displacement(self._points, self._frustum, settings),
            reasons=Reasons(displacement=Reason.CROSSES if crosses else None),
            silhouettes=sum(swept) / judged,
            snapped=snapped / judged,
            depth=0.0,
            outside=sum(outside),
            separation=Separations(c=None, c_star=None),
            culled=turned / judged,
        )
        together = self._silhouettes.flip_deviations(chain, self._device.subpixel_bits)
        links = zip([*moved, None], [*wrong, snapped], together, strict=True)
        made = (
            LinkPrediction(
                displacement_rms_px=rms, surface_pixels=pixels, flip_deviations=deviations
            )
            for rms, pixels, deviations in links
        )
        return prediction, tuple(made)

    def _crosses(self, settings: DoubleFrustum) -> bool:
        """Return whether a surface crosses the plate within the near windows of both cameras."""
        if settings.offset is not Offset.PLATE:
            return False
        camera = self._truth.camera
        window = np.array(camera.half_extent)
        if settings.pivot is Pivot.CAMERA:
            window = window + np.abs(camera.shear)
        half = settings.near * window
        # A segment meets a rectangle unless an axis, or the segment's own normal, separates them.
        middle, ends = self._in_plate
        (mx, my), (ex, ey) = middle.T, ends.T
        meets = (np.abs(middle) <= half + np.abs(ends)).all(axis=1)
        across = np.abs(mx * ey - my * ex) <= half[0] * np.abs(ey) + half[1] * np.abs(ex)
        return bool((meets & across).any())

    def _within_steps(self, settings: DoubleFrustum) -> bool:
        """Return whether half of the visible depths are stored within 2^-24 of one."""
        near_one = settings.mapping in (DepthMapping.STANDARD, DepthMapping.GL)
        fine = near_one and settings.depth is not DepthFormat.D16 and self._points.depth.size > 0
        return fine and settings.near < 2 * 2.0**-24 * float(np.median(self._points.depth))

    def _reasons(
        self, settings: DoubleFrustum, prediction: Prediction, links: Sequence[LinkPrediction]
    ) -> Reasons:
        """Return the reasons for which a prediction with its depth does not hold."""
        displacement, moved = prediction.reasons.displacement, prediction.displacement_px
        if moved is not None:
            cases = (
                (prediction.depth > MAX_MISORDERED_FRACTION, Reason.STARVED),
                (self._large, Reason.LARGE),
                (prediction.outside > MAX_OUTSIDE, Reason.OUTSIDE),
                (moved.rms < self._rounding_px, Reason.ROUNDED),
            )
            displacement = next((reason for holds, reason in cases if holds), None)
        pixels = prediction.surface_fraction * self._stacks.judged
        by_depth = prediction.depth > prediction.surface_fraction / 100
        together = sum(math.hypot(*link.flip_deviations) ** 2 for link in links)
        by_chance = chance(pixels, together)
        kinds = (
            (self._is_thin(settings), Reason.THIN),
            (self._large, Reason.LARGE),
            (self._parallel and by_depth, Reason.PARALLEL),
            (by_chance, by_chance),
            (by_depth and self._within_steps(settings), Reason.STEPS),
        )
        surface = next((reason for holds, reason in kinds if holds), None)
        return Reasons(displacement=displacement, surface=surface)

    def _with_reasons(
        self, settings: DoubleFrustum, prediction: Prediction, links: Sequence[LinkPrediction]
    ) -> tuple[LinkPrediction, ...]:
        """Return links with the reasons for which their own predictions do not hold.

        Traced links round nothing, so that neither the size of triangles nor the steps of depth
        matter.
        """
        *traced, rasterized, depth = range(len(links))
        thin, moves = self._is_thin(settings), prediction.reasons.displacement
        kinds = {
            **dict.fromkeys(traced, ((thin, Reason.THIN),)),
            rasterized: ((thin, Reason.THIN), (self._large, Reason.LARGE)),
            depth: (
                (self._large, Reason.LARGE),
                (self._parallel, Reason.PARALLEL),
                (self._within_steps(settings), Reason.STEPS),
            ),
        }
        explained = []
        for place, link in enumerate(links):
            by_chance = chance(link.surface_pixels, math.hypot(*link.flip_deviations) ** 2)
            surface = next((reason for holds, reason in kinds[place] if holds), by_chance)
            moved = moves if place in traced and moves != Reason.LARGE else None
            none = not link.surface_pixels
            reasons = Reasons(displacement=moved, surface=None if none else surface)
            explained.append(replace(link, reasons=reasons))
        return tuple(explained)

    def _is_thin(self, settings: DoubleFrustum) -> bool:
        """Return whether too many contours belong to surfaces thinner than a pixel."""
        return self._silhouettes.thin_share(settings) > MAX_THIN

    def _moved_by(self, chain: Sequence[DoubleFrustum]) -> list[float | None]:
        def rms(moved: Floats) -> float | None:
            known = lengths(moved)
            known = known[np.isfinite(known)]
            return root_mean_square(known) if known.size else None

        fields = {
            link: displacements(self._points, self._frustum, link) for link in dict.fromkeys(chain)
        }
        spreads = [rms(fields[chain[0]])]
        # Where nothing moves, all links draw the same surfaces.
        still = None if spreads[0] is None else 0.0
        pairs = pairwise(chain)
        return spreads + [
            still if link == two else rms(fields[two] - fields[link]) for link, two in pairs
        ]

    def _separations(self, settings: DoubleFrustum) -> Separations:
        height = self._points.height
        farthest = {
            Camera.C: -float(height.min(initial=0)),
            Camera.C_STAR: float(height.max(initial=0)),
        }
        separations: dict[Camera, float] = {}
        for slab in slabs(self._frustum, settings):
            if slab.low <= farthest[slab.camera] <= slab.high and farthest[slab.camera] > 0:
                w = np.array([farthest[slab.camera] + slab.step])
                there = smallest_separation(
                    w, slab.near, slab.far, settings.depth, settings.mapping
                )
                # Both slabs draw a surface at their common cut; for one of them it is the nearest
                # surface.
                separations[slab.camera] = min(
                    separations.get(slab.camera, np.inf), float(there[0])
                )
        return Separations(c=separations.get(Camera.C), c_star=separations.get(Camera.C_STAR))


def plate_segments(scene: Scene, aperture: Aperture) -> tuple[Floats, Floats]:
    """Return the segments of triangles that cross or touch the plate without lying in it.

    A segment is the vector from an aperture to its middle and from there to an end, (N, 2).
    """
    lowest, highest = scene.height_ranges
    corners = scene.triangles[(lowest <= 0) & (highest >= 0) & (lowest < highest)]
    following = np.roll(corners, -1, axis=1)
    z, other = corners[..., 2], following[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        places = corners + (following - corners) * (z / (z - other))[..., None]
    places = places[..., :2] - [aperture.x, aperture.y]
    places[(z * other > 0) | (z == other)] = np.nan
    first = np.take_along_axis(places, np.isfinite(places[..., :1]).argmax(axis=1)[:, None], axis=1)
    apart = np.nan_to_num(np.abs(places - first).sum(axis=-1), nan=-1.0).argmax(axis=1)
    last = np.take_along_axis(places, apart[:, None, None], axis=1)
    return (first + last)[:, 0] / 2, (last - first)[:, 0] / 2


def displacement(points: TruePoints, frustum: Frustum, settings: DoubleFrustum) -> Spread | None:
    """Return the spread of displacement over the visible surfaces; None without any."""
    moved = displacement_lengths(points, frustum, settings)
    return Spread.from_values(moved[np.isfinite(moved)])


def outside_shares(
    points: TruePoints, frustum: Frustum, chain: Sequence[DoubleFrustum]
) -> tuple[float, ...]:
    """Return the share of pixels from outside the film that each link of a chain adds.

    Pixels are charged to the first link that shows points from outside to the end. A point on
    the border of the film that is drawn further in by d pixels leaves the d pixels between to
    points from beyond the border. A pixel counts from its center on: of d pixels, floor(d +
    1/2) count. `points` are the points of all pixels (H, W).
    """
    height, width = points.height.shape
    columns, rows = np.arange(width), np.arange(height) * width
    # Left and right, top and bottom: pixels, the axis of displacement, and its outward sign.
    sides = ((rows, 0, -1), (rows + width - 1, 0, 1), (columns, 1, -1), (columns + rows[-1], 1, 1))
    borders = [(points.at(pixels), axis, sign) for pixels, axis, sign in sides]

    def shown(settings: DoubleFrustum) -> list[Floats]:
        """Return the width in pixels of the strip from beyond the border, for each side."""
        moved = (
            sign * displacements(some, frustum, settings)[:, axis] for some, axis, sign in borders
        )
        # Undefined displacement, of points that no camera draws, counts as nothing.
        return [np.floor(np.fmax(depth, 0.0) + 0.5) for depth in moved]

    by_settings = {link: shown(link) for link in dict.fromkeys(chain)}
    together, to_the_end = [], by_settings[chain[-1]]
    for settings in reversed(chain):
        pairs = zip(to_the_end, by_settings[settings], strict=True)
        left, right, top, bottom = to_the_end = [np.minimum(depth, other) for depth, other in pairs]
        across = np.minimum(left + right, width).sum() / (height * width)
        down = np.minimum(top + bottom, height).sum() / (height * width)
        # Both at once only in corners: taken as independent.
        together.append(1 - (1 - across) * (1 - down))
    return tuple(np.diff(together[::-1], prepend=0.0).tolist())
