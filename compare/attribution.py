"""Error budget: wrong pixels and radiance errors charged to the links of the chain.

**Pixels.** Each wrong pixel is charged to one link, and every rounding is explained.

**Radiance.** The error of an image is a sum of signed differences, link by link (docs/method.md).
In the chain's own links, from near offset to depth, the surface points of every image are shaded as
the true frustum shows them. Each link then contains only the error of *showing another point*. The
error of the eye vector belongs to a point, not to a pixel, and is counted once, in its own link:

    [light transport] -> [band limiting] -> near offset -> pivot -> fit -> slabs -> [culling]
    -> rasterization -> depth -> eye vector -> shading -> [averaging] -> clipping -> 8-bit output
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare import error_maps
from xfrustum.compare.comparison import Done, measure_left_out
from xfrustum.compare.error_maps import judged_pixels
from xfrustum.compare.prediction.displacement import drawn_lines, true_lines
from xfrustum.compare.prediction.predict import (
    Chain,
    LinkPrediction,
    Prediction,
    Predictor,
    links_of,
    make_chain,
)
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reference.lines import crossed_frustum, model_cameras
from xfrustum.reference.pictures import points_per_side
from xfrustum.reference.shading import Shader
from xfrustum.scenes.appearance import Sampling, sub_apertures
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum
from xfrustum.scenes.representation import ShortRepr, through_8_bits

#: value in a map of charges for pixels that are right in the last image, or not judged
RIGHT = -1


@dataclass(frozen=True, kw_only=True)
class CauseNumbers:
    """Effect of one link of the chain, measured and predicted; None for an undefined number."""

    #: number of judged pixels with a wrong surface, charged to the link
    surface: int
    #: number of judged pixels with another triangle, charged to the link
    triangle: int
    displacement_rms_px: (
        float | None
    )  #: displacement added where all images of the chain show a surface off the plate
    displacement_p99_px: float | None
    predicted_displacement_rms_px: float | None
    predicted_surface: float | None


@dataclass(frozen=True, kw_only=True)
class Named:
    """Name of a link, one of `links_of`, as the first field of a record."""

    name: str


@dataclass(frozen=True, kw_only=True)
class Cause(CauseNumbers, Named):
    """Effect of a link, with its name."""

    @property
    def numbers(self) -> CauseNumbers:
        """The numbers without the name."""
        return CauseNumbers(
            **{part.name: getattr(self, part.name) for part in fields(CauseNumbers)}
        )


@dataclass(frozen=True, kw_only=True)
class LinkNumbers(Cause):
    """A cause, and the reasons against its predictions; `pixels` is an older name of `triangle`."""

    pixels: int
    prediction_reasons: Reasons


@dataclass(frozen=True, kw_only=True)
class BudgetNumbers:
    """Numbers of a `Budget`, without its images: the record that `budget --json` prints."""

    judged: int
    wrong: int
    links: tuple[LinkNumbers, ...]
    explained: dict[str, int]
    cancelled: int
    unexplained: int
    prediction_reasons: Reasons
    #: name of the device model that explains rounding
    device_model: str


Size = tuple[float | None, float | None]
"""Root mean square and 99th percentile of some lengths; None without lengths."""


def _size(steps: Floats | None, known: Mask) -> Size:
    """Return the `Size` of steps (H, W) at known pixels; `steps` None means that all are 0."""
    if not known.any():
        return None, None
    # A link without effect has length zero wherever the other links are defined.
    if steps is None:
        return 0.0, 0.0
    with np.errstate(invalid="ignore"):
        return error_maps.root_mean_square(steps[known]), float(np.percentile(steps[known], 99))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChainStart(ShortRepr):
    """Images T0 to R0 of a chain, and the results that depend only on these images.

    Settings that differ only in their depth buffers share one start.
    """

    reference: Reference
    images: tuple[HogelImage, ...]
    #: model of the device that drew R0
    device: DeviceModel
    #: (H, W) pixels whose truth is not a tie
    judged: Mask
    #: errors of R0, the frame with exact depth
    exact: error_maps.PixelErrors
    #: (H, W) judged pixels at which R0 shows the wrong surface
    exact_wrong: Mask
    #: (H, W) last link up to R0 that changes the triangle of a pixel, else `RIGHT`
    charge: NDArray[np.int8]
    #: (H, W) last link that makes the surface wrong, for pixels that are wrong in R0, else `RIGHT`
    surface_charge: NDArray[np.int8]
    #: displacement of each image in pixels, (2, H, W); equal images share one array
    shifts: tuple[Floats, ...]
    #: (H, W) lengths of the displacement that each link adds, pixels; None for links without effect
    steps: tuple[Floats | None, ...]
    #: (H, W) pixels at which all images T0 to R0 show a surface off the plate
    known: Mask
    #: size of each of `steps` over the `known` pixels
    sizes: tuple[Size, ...]
    #: causes of the changes by rasterization with exact depth
    rounding: Causes

    @classmethod
    def from_images(
        cls, reference: Reference, images: tuple[HogelImage, ...], device: DeviceModel
    ) -> ChainStart:
        """Judge R0, the last of the images, and charge its wrong pixels to the links before it."""
        truth, drawn = images[0], images[-1]
        exact = error_maps.pixel_errors(truth, drawn, reference)
        assert exact.surface is not None, "the reference has the scene at hand"
        # Links without effect repeat their image.
        changing = [
            link for link, (before, after) in enumerate(pairwise(images)) if after is not before
        ]
        # Later links overwrite earlier ones: the last change counts.
        charge = np.full(truth.triangle.shape, RIGHT, dtype=np.int8)
        for link in changing:
            charge[images[link].triangle != images[link + 1].triangle] = link

        # Images hash by identity: repeated images share one array of shifts, and the step between
        # them is None.
        shift_of: dict[HogelImage, Floats] = {drawn: exact.shift}
        for image in images[:-1]:
            if image not in shift_of:
                shift_of[image] = error_maps.film_shifts(image, truth.camera)
        shifts = tuple(shift_of[image] for image in images)
        steps = tuple(
            None if after is before else np.hypot(*(after - before))
            for before, after in pairwise(shifts)
        )
        known: Mask = np.asarray(np.isfinite(shifts[0]).all(axis=0))
        for step in steps:
            if step is not None:
                known &= np.isfinite(step)
        return cls(
            reference=reference,
            images=images,
            device=device,
            judged=error_maps.judged_pixels(truth),
            exact=exact,
            exact_wrong=exact.surface,
            charge=charge,
            surface_charge=_surface_charge(reference, images, exact.surface, changing),
            shifts=shifts,
            steps=steps,
            known=known,
            sizes=tuple(_size(step, known) for step in steps),
            # The last traced model and R0 differ only by rounding.
            rounding=explain(reference.scene, images[-2], drawn, device),
        )

    @property
    def truth(self) -> HogelImage:
        """The true image, T0."""
        return self.images[0]

    @property
    def depth(self) -> int:
        """Index of the depth link, from R0 to R1; the link before it is rasterization."""
        return len(self.images) - 1


def _surface_charge(
    reference: Reference, images: Sequence[HogelImage], wrong: Mask, changing: Sequence[int]
) -> NDArray[np.int8]:
    """Return the last link that makes the surface of each wrong pixel (H, W) of R0 wrong."""
    # In the traced images, only pixels that are wrong in R0 are judged. The truth is right
    # everywhere: the first link is charged unless a later image shows the right surface again.
    pixels = np.flatnonzero(wrong)
    truth = images[0].at(pixels)
    first, *later = changing
    charged_to = np.full(pixels.size, first, dtype=np.int8)
    for link in later:
        errors = error_maps.surface_errors(truth, images[link].at(pixels), reference)
        charged_to[~errors.wrong[0]] = link
    charge = np.full(wrong.shape, RIGHT, dtype=np.int8)
    charge.reshape(-1)[pixels] = charged_to
    return charge


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(ShortRepr):
    """The error of one image, link by link."""

    start: ChainStart
    #: errors of the last image
    errors: error_maps.PixelErrors
    #: (H, W) link to which each wrong pixel is charged, else `RIGHT`
    charge: NDArray[np.int8]
    #: (H, W) link to which each pixel with a wrong surface is charged, else `RIGHT`
    surface_charge: NDArray[np.int8]
    #: causes of the pixels charged to rasterization and depth
    explanation: Causes
    #: effect of each link, in the order of `links`
    causes: tuple[Cause, ...]
    predicted: tuple[LinkPrediction, ...]
    #: reasons why predictions are invalid
    reasons: Reasons

    @property
    def drawn(self) -> HogelImage:
        """The last image of the chain, R1."""
        return self.errors.raster

    @property
    def judged(self) -> int:
        """Number of pixels whose truth is not a tie."""
        return int(self.start.judged.sum())

    @property
    def wrong(self) -> int:
        """Number of judged pixels that show another triangle in the last image."""
        return int((self.charge != RIGHT).sum())

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        return tuple(cause.name for cause in self.causes)

    @property
    def numbers(self) -> BudgetNumbers:
        """Only the numbers, without the images."""
        counts = self.explanation.counts()
        # Pixels that are right in the last image although some link changed them.
        cancelled = self.start.judged & (self.charge == RIGHT) & (self.start.charge != RIGHT)
        links = tuple(
            LinkNumbers(**vars(cause), pixels=cause.triangle, prediction_reasons=link.reasons)
            for cause, link in zip(self.causes, self.predicted, strict=True)
        )
        return BudgetNumbers(
            judged=self.judged,
            wrong=self.wrong,
            links=links,
            unexplained=counts.pop("unexplained"),
            explained=counts,
            cancelled=int(cancelled.sum()),
            prediction_reasons=self.reasons,
            device_model=self.start.device.name,
        )


def make_budget(reference: Reference, chain: Chain) -> Budget:
    """Charge every wrong pixel of a chain's last image to one link; see `charged`."""
    start = ChainStart.from_images(reference, chain.images[:-1], chain.device)
    predictor = Predictor(start.truth, reference, chain.device)
    errors = error_maps.pixel_errors(start.truth, chain.images[-1], reference, start.exact)
    return charged(start, errors, predictor.predict_each([chain.settings])[0])


def charged(
    start: ChainStart,
    errors: error_maps.PixelErrors,
    predicted: tuple[Prediction, tuple[LinkPrediction, ...]],
) -> Budget:
    """Charge each wrong pixel to the last link that changed its triangle or its surface."""
    exact, drawn, depth = start.images[-1], errors.raster, start.depth
    settings = drawn.camera.settings
    assert errors.surface is not None, "the reference has the scene at hand"
    assert settings is not None, "images of the rasterizer have its settings"
    wrong = (drawn.triangle != start.truth.triangle) & start.judged
    by_depth = wrong & (drawn.triangle != exact.triangle)
    charge = np.where(wrong, np.where(by_depth, np.int8(depth), start.charge), np.int8(RIGHT))
    # A wrong pixel that is right in R0 is charged to depth, whatever the images before R0 show.
    by_surface = np.where(start.exact_wrong, start.surface_charge, np.int8(depth))
    surface_charge = np.where(errors.surface, by_surface, np.int8(RIGHT))
    # Pixels that depth changed again after R0 are charged to depth, and explained there.
    rounding = start.rounding
    rounded = rounding.some(charge.reshape(-1).take(rounding.pixels) == start.depth - 1)
    # R0 and R1 share cameras and edges: only depth can exchange their triangles.
    swapped = explain(start.reference.scene, exact, drawn, start.device, np.flatnonzero(by_depth))

    last, known, sizes = None, start.known, start.sizes
    # R0 and R1 share their arrays if they are equal: then the depth link has no effect.
    if errors.shift is not start.exact.shift:
        last = np.hypot(*(errors.shift - start.exact.shift))
        known = start.known & np.isfinite(last)
        # A depth buffer that loses surfaces leaves fewer pixels at which all links are defined.
        if not np.array_equal(known, start.known):
            sizes = tuple(_size(step, known) for step in start.steps)
    links = zip(links_of(settings), (*sizes, _size(last, known)), predicted[1], strict=True)
    return Budget(
        start=start,
        errors=errors,
        charge=charge,
        surface_charge=surface_charge,
        explanation=rounded.joined(swapped),
        causes=tuple(
            Cause(
                name=name,
                surface=int(np.count_nonzero(surface_charge == link)),
                triangle=int(np.count_nonzero(charge == link)),
                displacement_rms_px=rms,
                displacement_p99_px=p99,
                predicted_displacement_rms_px=expected.displacement_rms_px,
                predicted_surface=expected.surface_pixels,
            )
            for link, (name, (rms, p99), expected) in enumerate(links)
        ),
        predicted=predicted[1],
        reasons=predicted[0].reasons,
    )


def explain(
    scene: Scene,
    model: HogelImage,
    raster: HogelImage,
    device: DeviceModel,
    pixels: Indices | None = None,
) -> Causes:
    """Find the causes of changes by rounding, at pixels (N,) or at all pixels that differ."""
    if pixels is None:
        pixels = np.flatnonzero(model.triangle != raster.triangle)
    cameras = drawing_cameras(scene, raster, device) if len(pixels) else []
    return find_causes(scene.triangles, cameras, model, raster, pixels)


def drawing_cameras(scene: Scene, raster: HogelImage, device: DeviceModel) -> list[RoundingCamera]:
    """Return the cameras of all slabs that drew an image of our rasterizer."""
    settings = raster.camera.settings
    assert settings is not None
    precision = Precision(device=device, depth=settings.depth, mapping=settings.mapping)
    return [
        RoundingCamera(bundle=camera.bundle, precision=precision, heights=camera.heights)
        for camera in model_cameras(scene.frustum, raster.camera.aperture, settings)
    ]


EYE_VECTOR, SHADING = "eye vector", "shading"
CLIPPING, OUTPUT = "clipping", "8-bit output"
TRANSPORT, BAND_LIMITING, AVERAGING = "light transport", "band limiting", "averaging"
"""Names of links.

`EYE_VECTOR` turns the eye vector of each drawn point toward the camera that drew the point.
`SHADING` replaces shading in double precision by the device's: the device interpolates normals,
colors and texture coordinates, and evaluates the light model."""

MAX_CHAIN_PIXELS = 1 << 22
"""Largest number of pixels of each image of a chain: memory is some 500 bytes a pixel."""


@dataclass(frozen=True, kw_only=True)
class RadianceChange:
    """Change of linear radiance over a link or the whole chain; fields without pixels are None."""

    #: mean, rms and max: over all judged pixels
    mean: float | None
    rms: float | None
    max: float | None
    rms_same_triangle: (
        float | None
    )  #: over judged pixels at which all images of the chain show the same triangle
    max_same_triangle: float | None


@dataclass(frozen=True, kw_only=True)
class RadianceLink(RadianceChange, Named):
    """Radiance error added by one link, with its standard error where light is sampled."""

    standard_error: float | None


@dataclass(frozen=True, kw_only=True)
class RadianceNumbers:
    """Numbers of a `RadianceBudget`, without its images."""

    judged: int
    same_triangle: int
    links: tuple[RadianceLink, ...]
    total: RadianceChange


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RadianceBudget(ShortRepr):
    """The radiance error of one image, link by link."""

    links: tuple[str, ...]
    #: (links, H, W, 3) changes of linear RGB; a pixel without a surface is black
    steps: Floats
    #: (H, W, 3) last color minus first
    total: Floats
    #: (H, W) pixels whose truth is not a tie
    judged: Mask
    #: (H, W) judged pixels that show the same triangle in all images of the chain
    same: Mask
    #: rms standard error of links that compare with sampled light, by name of the link
    errors: dict[str, float]

    @property
    def numbers(self) -> RadianceNumbers:
        """The numbers without the images."""

        def sizes(change: Floats) -> tuple[float | None, float | None]:
            if not len(change):
                return None, None
            return float(np.sqrt(np.mean(change**2))), float(np.abs(change).max())

        def changed(change: Floats) -> RadianceChange:
            judged, same = sizes(change[self.judged]), sizes(change[self.same])
            return RadianceChange(
                mean=float(change[self.judged].mean()) if self.judged.any() else None,
                rms=judged[0],
                max=judged[1],
                rms_same_triangle=same[0],
                max_same_triangle=same[1],
            )

        return RadianceNumbers(
            judged=int(self.judged.sum()),
            same_triangle=int(self.same.sum()),
            links=tuple(
                RadianceLink(name=name, **vars(changed(step)), standard_error=self.errors.get(name))
                for name, step in zip(self.links, self.steps, strict=True)
            ),
            total=changed(self.total),
        )


def local_colors(scene: Scene, chain: Chain, side: int = 1) -> Floats:
    """Return the colors before and after each local link, (1 + links, H, W, 3) linear RGB.

    The chain's images are sampled once per pixel: T0 to R1 shaded along true lines, R1 shaded with
    the eye vector of the camera that drew each point, and R1 as the device shaded it. Each
    pixel of the result is the mean of `side` x `side` pixels of these images.
    """
    shader, drawn = Shader(scene), chain.images[-1]
    if drawn.color is None:
        raise ValueError("the chain's last image has no color")
    aperture = drawn.camera.aperture
    pixel_lines = crossed_frustum(scene.frustum, aperture).directions()

    def averaged(color: Floats) -> Floats:
        height, width, _ = color.shape
        boxes = color.reshape(height // side, side, width // side, side, 3)
        return np.asarray(boxes.mean(axis=(1, 3))) if side > 1 else color

    def shaded(image: HogelImage, lines: Floats) -> Floats:
        # The line through the aperture and a point in the aperture is undefined: use the line of
        # the pixel, which also meets the point.
        lines = np.where(np.isfinite(lines), lines, pixel_lines)
        return averaged(shader.picture(image.triangle, image.position.astype(np.float64), lines))

    truly = [shaded(image, true_lines(image.position, aperture)) for image in chain.images]
    bent = shaded(drawn, drawn_lines(drawn.position, scene.frustum, aperture, chain.settings))
    return np.stack([*truly, bent, averaged(drawn.color.astype(np.float64))])


def make_radiance_budget(scene: Scene, chain: Chain, done: Done = lambda: None) -> RadianceBudget:
    """Attribute the radiance error of the last image of a chain; `done` is called `steps` times."""
    truth, settings = chain.images[0], chain.settings
    aperture = truth.camera.aperture
    links, errors = [*links_of(settings), EYE_VECTOR, SHADING], dict[str, float]()
    if scene.sampling == Sampling():
        colors = local_colors(scene, chain)
    else:
        averaged = averaged_colors(scene, aperture, settings, done)
        with Rasterizer(scene) as rasterizer:
            drawn = rasterizer.render(aperture, settings, normals=False)
        assert drawn.color is not None
        colors = np.concatenate((averaged, drawn.color[None].astype(np.float64)))
        links.append(AVERAGING)
    if scene.sampling.aperture > 1:
        # Band limiting comes before the geometry, because it changes the definition of the truth
        # and not the cameras.
        links.insert(0, BAND_LIMITING)
        converged = Reference(scene).converged(aperture)
        done()
        errors[BAND_LIMITING] = converged.error
        colors = np.concatenate((converged.color[None], colors))
    if scene.transport.simulated:
        left_out = measure_left_out(scene, aperture, done).difference
        # Light paths are sampled: the link has the noise of the difference of two truths.
        errors[TRANSPORT] = float(np.sqrt(np.mean(left_out.variance_of_mean)))
        links.insert(0, TRANSPORT)
        colors = np.concatenate((colors[:1] + left_out.mean, colors))
    # Output first clips and then rounds, as the display does.
    clipped = np.clip(colors[-1:], 0.0, 1.0)
    colors = np.concatenate((colors, clipped, through_8_bits(clipped)))
    judged, numbers = judged_pixels(truth), np.stack([image.triangle for image in chain.images])
    return RadianceBudget(
        links=(*links, CLIPPING, OUTPUT),
        steps=np.diff(colors, axis=0),
        total=colors[-1] - colors[0],
        judged=judged,
        same=judged & truth.covered & (numbers == numbers[0]).all(axis=0),
        errors=errors,
    )


def steps(scene: Scene) -> int:
    """Return the number of calls of `done` by `make_radiance_budget`."""
    points, transport = scene.sampling.aperture, scene.transport
    averages = scene.sampling != Sampling()
    return points * averages + (points > 1) + 2 * points * transport.simulated


def averaged_colors(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, done: Done
) -> Floats:
    """Return `local_colors`, each the mean over the samples of pixels and aperture of a scene.

    The device's own samples (multisample) belong to the link from these colors to the device's
    image. Raises InputError if a chain would have more than `MAX_CHAIN_PIXELS`.
    """
    side = points_per_side(scene.sampling)
    width, height = scene.frustum.resolution
    if side * side * width * height > MAX_CHAIN_PIXELS:
        raise InputError(
            f"{width} x {height} pixels with {side} x {side} points each are too many; "
            f"lower frustum.resolution or sampling, to {MAX_CHAIN_PIXELS:,} points at most"
        )
    frustum = replace(scene.frustum, resolution=(side * width, side * height))
    # A finer film represents supersampling: its pixels are the samples, at the same positions.
    fine = replace(scene, frustum=frustum, sampling=Sampling())
    reference, total = Reference(fine), np.zeros(())
    points = sub_apertures(scene.plate, aperture, scene.sampling.aperture)
    with Rasterizer(fine) as rasterizer:
        for point in points:
            total = total + local_colors(
                fine, make_chain(reference, rasterizer, point, settings), side
            )
            done()
    return total / len(points)
