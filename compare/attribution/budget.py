"""Every wrong pixel charged to one link of the chain, and every rounding explained (docs/method.md)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics import error_maps
from xfrustum.compare.prediction.chain import PIVOT, Chain, links_of
from xfrustum.compare.prediction.predict import LinkPrediction, Prediction, Predictor
from xfrustum.compare.prediction.reasons import Reasons
from xfrustum.compare.rounding.causes import Causes, find_causes
from xfrustum.compare.rounding.triangles import Precision, RoundingCamera
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import film_window, model_cameras, pixel_places
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import NotebookRepr, ShortRepr
from xfrustum.scenes.plate.double_frustum import Offset, Pivot
from xfrustum.scenes.plate.plate import Frustum

RIGHT = -1  #: value in a map of charges of a pixel that is right in the end, or not judged


@dataclass(frozen=True, kw_only=True)
class CauseNumbers:
    """What one link of the chain does, measured and predicted; None where nothing is displaced."""

    surface: int  #: judged pixels charged to it that show the wrong surface
    triangle: int  #: and another triangle
    displacement_rms_px: (
        float | None
    )  #: what it adds, where every image shows a surface off the plate
    displacement_p99_px: float | None
    predicted_displacement_rms_px: float | None
    predicted_surface: float | None


@dataclass(frozen=True, kw_only=True)
class Named:
    """The name of a link, one of `links_of`: the first field of what inherits from it."""

    name: str


@dataclass(frozen=True, kw_only=True)
class Cause(CauseNumbers, Named):
    """A link of the chain by its name, and what it does."""

    @property
    def numbers(self) -> CauseNumbers:
        """The numbers without the name."""
        return CauseNumbers(**{one.name: getattr(self, one.name) for one in fields(CauseNumbers)})


@dataclass(frozen=True, kw_only=True)
class LinkNumbers(Cause):
    """A cause, and what it does to heights; `pixels` is `triangle` by its older name."""

    pixels: int
    height_rms: float | None
    prediction_reasons: Reasons


@dataclass(frozen=True, kw_only=True)
class BudgetNumbers:
    """The numbers of a `Budget`, without its images, as they are written."""

    judged: int
    wrong: int
    links: tuple[LinkNumbers, ...]
    explained: dict[str, int]
    cancelled: int
    unexplained: int
    not_in_every_link: int
    prediction_reasons: Reasons
    device_model: str  #: name of the model by which rounding is explained


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VectorBudget(ShortRepr):
    """What each link adds to a quantity, where every image of the chain shows a surface."""

    steps: (
        Floats  #: (links, H, W, components) differences between neighboring images, NaN elsewhere
    )
    total: Floats  #: (H, W, components) last image minus first
    elsewhere: int  #: pixels left out, because some image shows no surface or one in the plate

    @classmethod
    def from_values(cls, values: Floats) -> VectorBudget:
        """Take the differences of a quantity (images, H, W, components), NaN where it is undefined."""
        defined: Mask = np.all(np.isfinite(values), axis=(0, -1))
        values = np.where(defined[..., None], values, np.nan)
        total = values[-1] - values[0]
        return cls(steps=np.diff(values, axis=0), total=total, elsewhere=int((~defined).sum()))

    def rms(self) -> list[float | None]:
        """Return the root mean square length of each link's steps, None where there is none."""
        squared = np.square(self.steps).sum(axis=-1).reshape(len(self.steps), -1)
        return [
            float(np.sqrt(np.nanmean(link))) if np.isfinite(link).any() else None
            for link in squared
        ]


Size = tuple[float | None, float | None]
"""Root mean square and 99th percentile of some lengths; None where there are none."""


def _size(steps: Floats | None, known: Mask) -> Size:
    """Return the size of steps (H W,) where they are known; None stands for steps that are all 0."""
    if not known.any():
        return None, None
    if steps is None:
        return 0.0, 0.0
    with np.errstate(invalid="ignore"):
        return error_maps.root_mean_square(steps[known]), float(np.percentile(steps[known], 99))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChainStart(ShortRepr):
    """All images of a chain but the last: what the depth buffers of one pair of cameras share."""

    reference: Reference
    images: tuple[HogelImage, ...]
    device: DeviceModel  #: that drew R0

    @property
    def truth(self) -> HogelImage:
        """The true image."""
        return self.images[0]

    @property
    def depth(self) -> int:
        """Number of the link from R0 to what is drawn; the one before it rasterizes."""
        return len(self.images) - 1

    @cached_property
    def judged(self) -> Mask:
        """(H, W) pixels whose truth is no tie."""
        return error_maps.judged_pixels(self.truth)

    @cached_property
    def changing(self) -> tuple[int, ...]:
        """Numbers of the links up to R0 that change anything: the first one, which traces, always does."""
        pairs = enumerate(pairwise(self.images))
        return tuple(link for link, (before, after) in pairs if after is not before)

    @cached_property
    def charge(self) -> NDArray[np.int8]:
        """(H, W) the last link that changes the triangle of each pixel up to R0, `RIGHT` where none does."""
        charge = np.full(self.truth.triangle.shape, RIGHT, dtype=np.int8)
        for link in self.changing:
            charge[self.images[link].triangle != self.images[link + 1].triangle] = link
        return charge

    @cached_property
    def exact(self) -> error_maps.PixelErrors:
        """Errors of the frame with exact depth, R0."""
        return error_maps.pixel_errors(self.truth, self.images[-1], self.reference)

    @cached_property
    def exact_wrong(self) -> Mask:
        """(H, W) judged pixels at which R0 shows the wrong surface."""
        assert self.exact.surface is not None, "the reference has the scene at hand"
        return self.exact.surface

    @cached_property
    def surface_charge(self) -> NDArray[np.int8]:
        """(H, W) the link from which on each pixel of R0 shows a wrong surface, `RIGHT` where it does not."""
        # Traced images are judged at these pixels alone. The truth is right everywhere: until a
        # later image is, the first link is charged.
        pixels = np.flatnonzero(self.exact_wrong)
        truth = self.truth.at(pixels)
        first, *later = self.changing
        found = np.full(pixels.size, first, dtype=np.int8)
        for link in later:
            shown = error_maps.surface_errors(truth, self.images[link].at(pixels), self.reference)
            found[~shown.wrong[0]] = link
        charge = np.full(self.exact_wrong.shape, RIGHT, dtype=np.int8)
        charge.reshape(-1)[pixels] = found
        return charge

    @cached_property
    def shifts(self) -> tuple[Floats, ...]:
        """Displacement of each image in pixels, (2, H W); that of the same image is the same array."""
        camera, images = self.truth.camera, dict.fromkeys(self.images)
        found = {image: error_maps.film_shifts(image, camera) for image in images}
        return tuple(found[image] for image in self.images)

    @cached_property
    def steps(self) -> tuple[Floats | None, ...]:
        """(H W,) lengths in pixels that each link adds to displacement; None for one that changes nothing."""
        pairs = pairwise(self.shifts)
        return tuple(
            None if after is before else np.hypot(*(after - before)) for before, after in pairs
        )

    @cached_property
    def known(self) -> Mask:
        """(H W,) pixels at which all these images show a surface off the plate."""
        known: Mask = np.asarray(np.isfinite(self.shifts[0]).all(axis=0))
        for steps in self.steps:
            if steps is not None:
                known &= np.isfinite(steps)
        return known

    @cached_property
    def sizes(self) -> tuple[Size, ...]:
        """How far each link but the last displaces the pixels that are `known`."""
        return tuple(_size(steps, self.known) for steps in self.steps)

    @cached_property
    def rounding(self) -> Causes:
        """Causes of what rasterization changed, with exact depth."""
        model, drawn = self.images[-2:]
        return explain(self.reference.scene, model, drawn, self.device)

    @cached_property
    def shear(self) -> ShearNumbers | None:
        """What the pivot alone does to the points that T2 shows; None where the pivot does nothing."""
        return shear_numbers(self.images[PIVOT + 1], self.reference.scene.frustum)

    def find_shared(self) -> None:
        """Find what all budgets share, in the thread of the caller: other threads then only read it."""
        for name in ("charge", "exact_wrong", "surface_charge", "sizes", "rounding", "shear"):
            getattr(self, name)
        self.exact.find_maps()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(NotebookRepr):
    """The error of one image, link by link."""

    start: ChainStart
    drawn: HogelImage
    charge: NDArray[np.int8]  #: (H, W) the link that each wrong pixel is charged to, else `RIGHT`
    surface_charge: NDArray[
        np.int8
    ]  #: (H, W) the link from which on each pixel shows a wrong surface
    explanation: Causes  #: of the pixels charged to rasterization and depth
    predicted: tuple[LinkPrediction, ...]
    reasons: Reasons  #: why predictions do not hold

    @property
    def judged(self) -> int:
        """Number of pixels whose truth is no tie."""
        return int(self.start.judged.sum())

    @property
    def wrong(self) -> int:
        """Number of judged pixels that show another triangle in the end."""
        return int((self.charge != RIGHT).sum())

    @property
    def moved(self) -> Floats:
        """Lengths (H, W) of the displacement of the last image, NaN where it is undefined."""
        return error_maps.lengths(error_maps.displacement(self.drawn, self.start.truth.camera))

    @cached_property
    def displacement(self) -> VectorBudget:
        """Budget of displacement: columns and rows, pixels."""
        shifts = np.stack(
            (*self.start.shifts, error_maps.film_shifts(self.drawn, self.start.truth.camera))
        )
        return VectorBudget.from_values(
            np.moveaxis(shifts, 1, -1).reshape(len(shifts), *self.charge.shape, 2)
        )

    @cached_property
    def height(self) -> VectorBudget:
        """Budget of height, scene units."""
        images = (*self.start.images, self.drawn)
        heights = [
            np.where(image.off_plate, image.height.astype(np.float64), np.nan) for image in images
        ]
        return VectorBudget.from_values(np.stack(heights)[..., None])

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        settings = self.drawn.camera.settings
        assert settings is not None, "the rasterizer says with which settings it drew"
        return links_of(settings)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """What each link does, in the order of `links`."""
        start = self.start
        last = np.hypot(
            *(error_maps.film_shifts(self.drawn, start.truth.camera) - start.shifts[-1])
        )
        known = start.known & np.isfinite(last)
        same = np.array_equal(known, start.known)
        sizes = start.sizes if same else [_size(steps, known) for steps in start.steps]
        return tuple(
            Cause(
                name=self.links[link],
                surface=int(np.count_nonzero(self.surface_charge == link)),
                triangle=int(np.count_nonzero(self.charge == link)),
                displacement_rms_px=rms,
                displacement_p99_px=p99,
                predicted_displacement_rms_px=self.predicted[link].displacement_rms_px,
                predicted_surface=self.predicted[link].surface_pixels,
            )
            for link, (rms, p99) in enumerate((*sizes, _size(last, known)))
        )

    @property
    def numbers(self) -> BudgetNumbers:
        """The numbers alone, without the images."""
        counts = self.explanation.counts()
        # Right in the end although some link changed them.
        cancelled = self.start.judged & (self.charge == RIGHT) & (self.start.charge != RIGHT)
        return BudgetNumbers(
            judged=self.judged,
            wrong=self.wrong,
            links=tuple(
                LinkNumbers(
                    **vars(cause),
                    pixels=cause.triangle,
                    height_rms=raised,
                    prediction_reasons=link.reasons,
                )
                for cause, raised, link in zip(
                    self.causes, self.height.rms(), self.predicted, strict=True
                )
            ),
            unexplained=counts.pop("unexplained"),
            explained=counts,
            cancelled=int(cancelled.sum()),
            not_in_every_link=self.displacement.elsewhere,
            prediction_reasons=self.reasons,
            device_model=self.start.device.name,
        )

    def _said(self) -> str:
        unexplained = self.explanation.counts()["unexplained"]
        wrong = f"{self.wrong:,} of {self.judged:,} judged pixels show another triangle"
        return f"{wrong}, {unexplained:,} unexplained"


def make_budget(reference: Reference, chain: Chain) -> Budget:
    """Charge every wrong pixel of a chain's last image to one link; see `charged`."""
    start = ChainStart(reference=reference, images=chain.images[:-1], device=chain.device)
    predictor = Predictor(start.truth, reference, chain.device)
    errors = error_maps.pixel_errors(start.truth, chain.images[-1], reference, start.exact)
    return charged(start, errors, predictor.predict_each([chain.settings])[0])


def charged(
    start: ChainStart,
    errors: error_maps.PixelErrors,
    predicted: tuple[Prediction, tuple[LinkPrediction, ...]],
) -> Budget:
    """Charge each wrong pixel to the last link that changed its triangle, or made its surface wrong."""
    exact, drawn, depth = start.images[-1], errors.raster, start.depth
    assert errors.surface is not None, "the reference has the scene at hand"
    wrong = (drawn.triangle != start.truth.triangle) & start.judged
    by_depth = wrong & (drawn.triangle != exact.triangle)
    charge = np.where(wrong, np.where(by_depth, np.int8(depth), start.charge), np.int8(RIGHT))
    # What R0 shows rightly goes wrong by depth, whatever the images before show.
    by_surface = np.where(start.exact_wrong, start.surface_charge, np.int8(depth))
    rounding = start.rounding
    rounded = rounding.some(charge.reshape(-1).take(rounding.pixels) == start.depth - 1)
    swapped = explain(start.reference.scene, exact, drawn, start.device, np.flatnonzero(by_depth))
    return Budget(
        start=start,
        drawn=drawn,
        charge=charge,
        surface_charge=np.where(errors.surface, by_surface, np.int8(RIGHT)),
        explanation=rounded.joined(swapped),
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
    """Find the causes of a change by rounding, at pixels (N,) or wherever the images differ."""
    if pixels is None:
        pixels = np.flatnonzero(model.triangle != raster.triangle)
    cameras = drawing_cameras(scene, raster, device) if len(pixels) else []
    return find_causes(scene.triangles, cameras, model, raster, pixels)


def drawing_cameras(scene: Scene, raster: HogelImage, device: DeviceModel) -> list[RoundingCamera]:
    """Return the cameras that drew an image of our rasterizer; each draws the heights of its own slab."""
    settings = raster.camera.settings
    assert settings is not None
    precision = Precision(device=device, depth=settings.depth, mapping=settings.mapping)
    return [
        RoundingCamera(bundle=camera.bundle, precision=precision, heights=camera.heights)
        for camera in model_cameras(scene.frustum, raster.camera.aperture, settings)
    ]


@dataclass(frozen=True, kw_only=True)
class ShearNumbers:
    """How far surface points are drawn from where cameras that are sheared about the aperture draw them.

    As traced, and in closed form, -k n/((|z| + n) t) at the same points; means are columns and
    rows.
    """

    pixels: int  #: that show a surface off the plate: all are measured
    rms_px: float
    closed_form_rms_px: float
    mean_px: tuple[float, float]
    closed_form_mean_px: tuple[float, float]
    largest_difference_px: float  #: between a traced shift and its closed form


def shear_numbers(model: HogelImage, frustum: Frustum) -> ShearNumbers | None:
    """Measure the shear of T2, a traced model whose cameras are sheared about their own centers.

    Points are compared with themselves, so that nothing depends on which surfaces come into view.
    None where there is no such shear (another pivot, no offset, a centered frustum), and where no
    surface off the plate is shown.
    """
    settings, shown = model.camera.settings, model.off_plate
    assert settings is not None, "a model says whose cameras it shows"
    sheared = (
        settings.pivot is Pivot.CAMERA and settings.offset is Offset.PLATE and frustum.recentered
    )
    if not sheared or not shown.any():
        return None
    points = model.position[shown].astype(np.float64)
    about_aperture = np.empty((len(points), 2))
    for camera in model_cameras(
        frustum, model.camera.aperture, replace(settings, pivot=Pivot.APERTURE)
    ):
        side: Mask = (points[:, 2] < 0) == camera.orthoscopic
        about_aperture[side] = pixel_places(points[side], camera.bundle)
    moved = error_maps.pixel_centers(model.camera)[shown] - about_aperture
    shear, half_extent = (np.asarray(pair) for pair in film_window(frustum, model.camera.aperture))
    width, height = model.camera.resolution
    share = settings.near / (np.abs(points[:, 2]) + settings.near)
    expected = -share[:, None] * (shear / half_extent * np.array([width / 2, -height / 2]))

    def sizes(shifts: Floats) -> tuple[float, tuple[float, float]]:
        columns, rows = shifts.mean(axis=0).tolist()
        return float(np.sqrt(np.mean(np.square(error_maps.lengths(shifts))))), (columns, rows)

    (rms, mean), (closed_form_rms, closed_form_mean) = sizes(moved), sizes(expected)
    return ShearNumbers(
        pixels=len(points),
        rms_px=rms,
        closed_form_rms_px=closed_form_rms,
        mean_px=mean,
        closed_form_mean_px=closed_form_mean,
        largest_difference_px=float(error_maps.lengths(moved - expected).max()),
    )
