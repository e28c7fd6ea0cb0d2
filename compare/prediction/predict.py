"""The chain from the truth to the raster, and closed forms of the error of every link.

The forms need only the scene's geometry. The chain changes one setting per link (docs/method.md,
"The error budget").
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from xfrustum.compare.error_maps import Spread, judged_pixels, turned_away
from xfrustum.compare.prediction.depth import (
    MAX_MISORDERED_FRACTION,
    DepthLayers,
    depth_wrong_shares,
    float32_spacing,
    slabs,
    smallest_separation,
)
from xfrustum.compare.prediction.displacement import (
    TruePoints,
    link_lengths,
    outside_shares,
    spread_of,
)
from xfrustum.compare.prediction.reasons import (
    LARGE_SIDE,
    MAX_LARGE,
    MAX_OUTSIDE,
    MAX_THIN,
    NO_REASONS,
    Reason,
    Reasons,
    chance,
    first_reason,
)
from xfrustum.compare.prediction.silhouettes import Pair, Silhouettes, crease_pixels
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.visibility import crosses_plate
from xfrustum.scenes.plate import (
    Aperture,
    Camera,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Frustum,
    Offset,
    Pivot,
)
from xfrustum.scenes.representation import ShortRepr

#: Change of each link; link k leads from image k to image k + 1 of the chain.
LINKS = ("near offset", "pivot", "fit", "slabs", "rasterization", "depth")

PIVOT = 1  #: index of the link that moves the center of the shear
RASTERIZATION = (
    #: index in `LINKS` of the first of the two links with rounding; wrong pixels of these links are
    #: classified by cause
    4
)
#: link between slabs and rasterization, in chains whose settings cull faces
CULLING = "culling"

#: Depth buffer practically without errors: pixels that only it gets right are charged to depth.
EXACT_DEPTH = (DepthFormat.D32F, DepthMapping.LINEAR)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Chain(ShortRepr):
    """T0, T1, T2, T3, T4, R0 and R1 of one aperture; with culling T5 between T4 and R0.

    T0 is the true crossed frustum. T1 adds the near offset, T2 the pivot, T3 the fit, T4 the slabs,
    and T5 omits culled faces. All of these are traced and certified. R0 is rasterized with linear
    depth, and R1 is rasterized with the depth buffer of the settings.
    """

    images: tuple[HogelImage, ...]
    settings: DoubleFrustum
    device: DeviceModel  #: model of the device that drew R0 and R1


# All hogels of a plate have the same settings.
@lru_cache
def traced_settings(settings: DoubleFrustum, frustum: Frustum) -> tuple[DoubleFrustum, ...]:
    """Return the settings of T1 to T4, and of T5 with culling; each adds one change."""
    # The default fit is replaced by its explicit equivalent, so that settings without a change
    # compare equal.
    settings = replace(settings, fit=settings.fitted_height(frustum) or Fit.ANGLE)
    drawn = replace(settings, cull=Cull.NONE)
    whole = replace(drawn, slabs=())
    sheared = replace(whole, fit=Fit.ANGLE)
    unculled = replace(sheared, pivot=Pivot.APERTURE), sheared, whole, drawn
    return unculled if settings.cull is Cull.NONE else (*unculled, settings)


def links_of(settings: DoubleFrustum) -> tuple[str, ...]:
    """Return the names of a chain's links: `LINKS`, with `CULLING` where faces are culled."""
    if settings.cull is Cull.NONE:
        return LINKS
    return (*LINKS[:RASTERIZATION], CULLING, *LINKS[RASTERIZATION:])


@lru_cache
def with_exact_depth(settings: DoubleFrustum) -> DoubleFrustum:
    """Return settings with `EXACT_DEPTH` and everything else unchanged."""
    return replace(settings, depth=EXACT_DEPTH[0], mapping=EXACT_DEPTH[1])


def traced_models(
    reference: Reference,
    aperture: Aperture,
    settings: DoubleFrustum,
    traced: dict[DoubleFrustum, HogelImage] | None = None,
    *,
    shaded: bool = True,
) -> tuple[HogelImage, ...]:
    """Return T1 to T4, and T5 with culling; `traced` caches models of this aperture by settings."""
    traced = {} if traced is None else traced
    links = [with_exact_depth(link) for link in traced_settings(settings, reference.scene.frustum)]
    for link in links:
        if link not in traced:
            traced[link] = reference.trace_model(aperture, link, shaded=shaded)
    return tuple(traced[link] for link in links)


def make_chain(
    reference: Reference, rasterizer: Rasterizer, aperture: Aperture, settings: DoubleFrustum
) -> Chain:
    """Trace and draw all images of the chain; invalid settings raise InputError."""
    settings.check_against(reference.scene.frustum)
    traced = traced_models(reference, aperture, settings)
    links = (with_exact_depth(settings), settings)
    drawn = [rasterizer.render(aperture, link, normals=False) for link in links]
    return Chain(
        images=(reference.trace(aperture), *traced, *drawn),
        settings=settings,
        device=rasterizer.model,
    )


@dataclass(frozen=True, kw_only=True)
class Separations:
    """Smallest separation at each camera's farthest visible surface, scene units."""

    c: float | None
    c_star: float | None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Expected errors of one choice of settings; shares refer to the judged pixels."""

    #: None if no surface off the plate is drawn, or if displacement has no prediction
    displacement_px: Spread | None
    silhouettes: float  #: share of pixels wrong along silhouettes because of displacement
    snapped: float  #: share of pixels wrong along silhouettes because edges snap to subpixels
    depth: float  #: share of pixels wrong because of the depth buffer
    outside: float  #: share of pixels wrong because they show a point from outside the film
    separation: Separations
    culled: float = 0.0  #: share of pixels wrong because the true surface is culled
    reasons: Reasons = NO_REASONS

    @property
    def surface_fraction(self) -> float:
        """Share of judged pixels with a wrong surface; the five causes are taken as independent."""
        parts = (self.silhouettes, self.snapped, self.depth, self.outside, self.culled)
        return 1 - math.prod(1 - part for part in parts)


@dataclass(frozen=True, kw_only=True)
class LinkPrediction:
    """Expected errors of one link of the chain; None without a closed form."""

    displacement_rms_px: float | None
    surface_pixels: float  #: judged pixels with a wrong surface that are charged to the link
    #: standard deviations of the number of wrong pixels along edges in rows, and in columns; the
    #: pixels of such an edge become wrong together
    flip_deviations: Pair = (0.0, 0.0)
    reasons: Reasons = NO_REASONS


LinkedPrediction = tuple[Prediction, tuple[LinkPrediction, ...]]


class Predictor:
    """All closed forms for the true image of one aperture."""

    def __init__(self, truth: HogelImage, reference: Reference, device: DeviceModel) -> None:
        scene, aperture = reference.scene, truth.camera.aperture
        self._truth, self._scene, self._device = truth, scene, device
        self._all_points = TruePoints.from_image(truth)
        self._points = self._all_points.shown()
        self._layers = DepthLayers.from_truth(
            truth, reference.gaps(aperture), reference.gaps(aperture, truth)
        )
        self._silhouettes = Silhouettes(truth, scene.frustum, self._all_points)
        self._creases = crease_pixels(truth, scene, device.subpixel_bits)
        covered, depth = truth.covered, self._points.depth
        sides = np.ptp(scene.triangles[truth.triangle[covered]], axis=1).max(axis=1)
        large = sides > LARGE_SIDE * math.hypot(*scene.plate.size)
        self._large = bool(large.sum() > MAX_LARGE * truth.triangle.size)
        self._parallel = truth.normal is not None and bool(
            (truth.normal[covered][:, :2] == 0).all(axis=1).sum() > covered.sum() / 2
        )
        self._median_depth = float(np.median(depth)) if depth.size else None
        # The median pixel width at visible points, and the float32 spacing of the largest
        # coordinate.
        spacing = float32_spacing(np.abs(truth.position[covered]).max(initial=1.0))
        pixel = 2 * max(truth.camera.half_extent) / max(scene.frustum.resolution)
        self._rounding_px = float(spacing / (pixel * np.median(depth))) if depth.size else 0.0

    def predict_each(self, settings: Sequence[DoubleFrustum]) -> list[LinkedPrediction]:
        """Return expected errors in total and for each link, in the order of `links_of`.

        The settings differ only in their depth buffers and share most of the work.
        """
        prediction, rounded = self._without_depth(with_exact_depth(settings[0]))
        thin = self._silhouettes.thin_share(settings[0]) > MAX_THIN
        frustum, predictions = self._scene.frustum, []
        shares = depth_wrong_shares(self._layers, frustum, settings, self._device)
        for choice, share in zip(settings, shares, strict=True):
            depth = LinkPrediction(
                displacement_rms_px=None, surface_pixels=share * self._layers.judged
            )
            whole = replace(prediction, depth=share, separation=self._separations(choice))
            predictions.append(self._with_reasons(choice, whole, (*rounded, depth), thin))
        return predictions

    def _without_depth(self, settings: DoubleFrustum) -> LinkedPrediction:
        """Return the expected errors with exact depth, in total and for each link except depth."""
        frustum, judged = self._scene.frustum, max(self._layers.judged, 1)
        chain, bits = traced_settings(settings, frustum), self._device.subpixel_bits
        swept = self._silhouettes.charged_pixels(chain)
        outside = outside_shares(self._all_points, frustum, chain)
        snapped = self._silhouettes.snapped_pixels(settings, bits) + self._creases
        moved = link_lengths(self._points, frustum, chain)
        wrong = [
            pixels + share * self._layers.judged
            for pixels, share in zip(swept, outside, strict=True)
        ]
        turned = 0
        if settings.cull is not Cull.NONE:
            turned = int((turned_away(self._truth) & judged_pixels(self._truth)).sum())
            # A culled pixel shows no surface or a hidden surface. The true image does not contain
            # hidden surfaces, so that their displacement is unknown.
            moved[-1] = None
            wrong[-1] = turned * (1 - min(sum(wrong) / judged, 1.0))
        spread, crosses = None, self._crosses(settings)
        if crosses:
            moved = [None if length else length for length in moved]
        else:
            spread = spread_of(self._points, frustum, settings)
        prediction = Prediction(
            displacement_px=spread,
            reasons=Reasons(displacement=Reason.CROSSES if crosses else None),
            silhouettes=sum(swept) / judged,
            snapped=snapped / judged,
            depth=0.0,
            outside=sum(outside),
            separation=Separations(c=None, c_star=None),
            culled=turned / judged,
        )
        together = self._silhouettes.flip_deviations(chain, bits)
        links = zip([*moved, None], [*wrong, snapped], together, strict=True)
        return prediction, tuple(
            LinkPrediction(
                displacement_rms_px=rms, surface_pixels=pixels, flip_deviations=deviations
            )
            for rms, pixels, deviations in links
        )

    def _crosses(self, settings: DoubleFrustum) -> bool:
        """Return whether a surface crosses the plate within the near windows of both cameras."""
        if settings.offset is not Offset.PLATE:
            return False
        camera = self._truth.camera
        window = np.array(camera.half_extent)
        if settings.pivot is Pivot.CAMERA:
            window = window + np.abs(camera.shear)
        return crosses_plate(self._scene, camera.aperture, settings.near * window)

    def _within_steps(self, settings: DoubleFrustum) -> bool:
        """Return whether half of the visible depths are stored within 2^-24 of one."""
        near_one = settings.mapping in (DepthMapping.STANDARD, DepthMapping.GL)
        if not near_one or settings.depth is DepthFormat.D16 or self._median_depth is None:
            return False
        return settings.near < 2 * 2.0**-24 * self._median_depth

    def _with_reasons(
        self,
        settings: DoubleFrustum,
        prediction: Prediction,
        links: Sequence[LinkPrediction],
        is_thin: bool,
    ) -> LinkedPrediction:
        """Return a prediction and its links with the reasons why they are not valid.

        Traced links have no rounding, so that large triangles and depth steps do not affect
        them.
        """
        thin, large = (is_thin, Reason.THIN), (self._large, Reason.LARGE)
        within_steps = self._within_steps(settings)
        displacement = prediction.reasons.displacement
        if (spread := prediction.displacement_px) is not None:
            displacement = first_reason(
                (prediction.depth > MAX_MISORDERED_FRACTION, Reason.STARVED),
                large,
                (prediction.outside > MAX_OUTSIDE, Reason.OUTSIDE),
                (spread.rms < self._rounding_px, Reason.ROUNDED),
            )
        variances = [math.hypot(*link.flip_deviations) ** 2 for link in links]
        by_depth = prediction.depth > prediction.surface_fraction / 100
        by_chance = chance(prediction.surface_fraction * self._layers.judged, sum(variances))
        surface = first_reason(
            thin,
            large,
            (self._parallel and by_depth, Reason.PARALLEL),
            (by_chance is not None, by_chance),
            (by_depth and within_steps, Reason.STEPS),
        )
        whole = replace(prediction, reasons=Reasons(displacement=displacement, surface=surface))
        traced = len(links) - 2
        parallel, steps = (self._parallel, Reason.PARALLEL), (within_steps, Reason.STEPS)
        cases = [*[(thin,)] * traced, (thin, large), (large, parallel, steps)]
        explained = []
        for place, (link, variance) in enumerate(zip(links, variances, strict=True)):
            own = first_reason(*cases[place]) or chance(link.surface_pixels, variance)
            moves = displacement if place < traced and displacement != Reason.LARGE else None
            reasons = Reasons(displacement=moves, surface=own if link.surface_pixels else None)
            explained.append(replace(link, reasons=reasons))
        return whole, tuple(explained)

    def _separations(self, settings: DoubleFrustum) -> Separations:
        height = self._points.height
        farthest = {
            Camera.C: -float(height.min(initial=0)),
            Camera.C_STAR: float(height.max(initial=0)),
        }
        separations: dict[Camera, float] = {}
        for slab in slabs(self._scene.frustum, settings):
            far = farthest[slab.camera]
            if far > 0 and slab.low <= far <= slab.high:
                planes, buffer = (slab.near, slab.far), (settings.depth, settings.mapping)
                there = smallest_separation(np.array([far + slab.step]), *planes, *buffer)
                # Both slabs draw a surface at their common cut. The slab that begins there resolves
                # it better.
                least = separations.get(slab.camera, math.inf)
                separations[slab.camera] = min(least, float(there[0]))
        return Separations(c=separations.get(Camera.C), c_star=separations.get(Camera.C_STAR))
