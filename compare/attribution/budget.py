"""Error budget: each wrong pixel is charged to a link of the chain, and rounding is explained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics import error_maps
from xfrustum.compare.prediction.chain import Chain, links_of
from xfrustum.compare.prediction.predict import LinkPrediction, Prediction, Predictor
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.reference import Reference
from xfrustum.reference.lines import model_cameras
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.images import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import ShortRepr

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
    """Return the size of steps (H, W) at known pixels; None represents steps that are all 0."""
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
