"""Every wrong pixel charged to one link of the chain, and every rounding explained.

See docs/method.md, "The error budget".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.attribution.explain import differing_triangles, explain
from xfrustum.compare.attribution.shear import ShearNumbers, shear_numbers
from xfrustum.compare.metrics.displacement import film_shifts, root_mean_square, shifts_at
from xfrustum.compare.metrics.error_maps import (
    PixelErrors,
    differing_pixels,
    judged_pixels,
    pixel_errors,
)
from xfrustum.compare.metrics.surface import wrong_surface
from xfrustum.compare.prediction.chain import PIVOT, Chain, links_of
from xfrustum.compare.prediction.predict import LinkPrediction, Predictor
from xfrustum.compare.rounding.causes import Causes
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.notebook import Brief, Shown


@dataclass(frozen=True, kw_only=True)
class StepSize:
    """Root mean square and 99th percentile of the lengths of some displacements, in pixels."""

    rms: float
    p99: float

    @classmethod
    def of(cls, values: Floats) -> StepSize | None:
        """Return the size of lengths (N,), the numbers of a `Spread`; None where there is none."""
        if not values.size:
            return None
        with np.errstate(invalid="ignore"):
            return cls(rms=root_mean_square(values), p99=float(np.percentile(values, 99)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """What links add to displacement, where each image before and after them shows a surface off the plate.

    Attributes
    ----------
    known
        (H W,) whether a pixel is one of these.
    lengths
        (H W,) lengths in pixels for each link; None for a link that changes no image.
    """

    known: Mask
    lengths: tuple[Floats | None, ...]

    @classmethod
    def between(cls, shifts: Sequence[Floats]) -> Steps:
        """Return the steps from image to image.

        Parameters
        ----------
        shifts
            Displacement (2, H W) of each image, see `film_shifts`; that of the same image is the same array.
        """
        lengths = tuple(
            None if after is before else np.hypot(*(after - before)) for before, after in pairwise(shifts)
        )
        known: Mask = np.asarray(np.isfinite(shifts[0]).all(axis=0))
        for length in lengths:
            if length is not None:
                known &= np.isfinite(length)
        return cls(known=known, lengths=lengths)

    def sizes(self) -> tuple[StepSize | None, ...]:
        """Return the size of the steps of each link."""
        still = StepSize(rms=0.0, p99=0.0) if self.known.any() else None
        return tuple(still if one is None else StepSize.of(one[self.known]) for one in self.lengths)

    def with_last(self, pixels: Indices, step: Floats) -> Steps:
        """Return the steps with one more link, which displaces nothing but some pixels.

        Parameters
        ----------
        pixels
            (M,) flat numbers of pixels that this link may displace.
        step
            (M,) lengths; not finite where the image before or after the link shows no surface off the plate.
        """
        known, last = self.known.copy(), np.zeros(self.known.size)
        known[pixels] &= np.isfinite(step)
        last[pixels] = step
        return Steps(known=known, lengths=(*self.lengths, last))


RIGHT = -1
"""Value in a map of charges of a pixel that is right in the end, or not judged."""


@dataclass(frozen=True, kw_only=True)
class CauseNumbers:
    """What one link of the chain does, measured and predicted; None where nothing is displaced.

    Attributes
    ----------
    surface, triangle
        Numbers of judged pixels charged to it that show the wrong surface, and another triangle.
    displacement_rms_px, displacement_p99_px
        Root mean square and 99th percentile of what it adds to displacement, where every image of the chain
        shows a surface off the plate.
    predicted_displacement_rms_px, predicted_surface
        The same by closed forms, where there are any.
    """

    surface: int
    triangle: int
    displacement_rms_px: float | None
    displacement_p99_px: float | None
    predicted_displacement_rms_px: float | None
    predicted_surface: float | None


@dataclass(frozen=True, kw_only=True)
class _Named:
    """The name of a link, one of `links_of`."""

    name: str


@dataclass(frozen=True, kw_only=True)
class Cause(CauseNumbers, _Named):
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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VectorBudget(Brief):
    """What each link adds to a quantity, where every image of the chain shows a surface.

    Attributes
    ----------
    steps
        (links, H, W, components) differences between neighboring images, NaN elsewhere.
    total
        (H, W, components) last image minus first.
    elsewhere
        Number of pixels left out, because some image shows no surface or one in the plate.
    """

    steps: Floats
    total: Floats
    elsewhere: int

    @classmethod
    def of(cls, values: Floats) -> VectorBudget:
        """Take the differences of a quantity (images, H, W, components), NaN where it is undefined."""
        defined: Mask = np.all(np.isfinite(values), axis=(0, -1))
        values = np.where(defined[..., None], values, np.nan)
        return cls(
            steps=np.diff(values, axis=0), total=values[-1] - values[0], elsewhere=int((~defined).sum())
        )

    def rms(self) -> list[float | None]:
        """Return the root mean square length of each link's steps, None where there is none."""
        squared = np.square(self.steps).sum(axis=-1).reshape(len(self.steps), -1)
        return [float(np.sqrt(np.nanmean(link))) if np.isfinite(link).any() else None for link in squared]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ChainStart(Brief):
    """All images of a chain but the last: what the depth buffers of one pair of cameras share.

    Attributes
    ----------
    subpixel_bits
        Subpixel bits of the device that drew R0.
    """

    reference: Reference
    images: tuple[HogelImage, ...]
    subpixel_bits: int

    @property
    def truth(self) -> HogelImage:
        """The true image."""
        return self.images[0]

    @property
    def rasterization(self) -> int:
        """Number of the link to the last of these images."""
        return len(self.images) - 2

    @property
    def depth(self) -> int:
        """Number of the link from the last of these images to what is drawn."""
        return len(self.images) - 1

    @cached_property
    def judged(self) -> Mask:
        """(H, W) pixels whose truth is no tie."""
        return judged_pixels(self.truth)

    @cached_property
    def charge(self) -> NDArray[np.int8]:
        """(H, W) the last link that changes the triangle of each pixel up to R0, `RIGHT` where none does."""
        charge = np.full(self.truth.triangle.shape, RIGHT, dtype=np.int8)
        for link in self.changing:
            charge[self.images[link].triangle != self.images[link + 1].triangle] = link
        return charge

    @cached_property
    def changing(self) -> tuple[int, ...]:
        """Numbers of the links up to R0 that change anything: the first one, which traces, always does."""
        return tuple(
            link for link, (before, after) in enumerate(pairwise(self.images)) if after is not before
        )

    @cached_property
    def changed(self) -> Mapping[int, Indices]:
        """Flat numbers of the pixels whose triangle each of the links `changing`, but the first, changes."""
        return {
            link: differing_triangles(self.images[link], self.images[link + 1]) for link in self.changing[1:]
        }

    @cached_property
    def exact(self) -> PixelErrors:
        """Errors of the frame with exact depth, R0."""
        return pixel_errors(self.truth, self.images[-1], self.reference)

    @cached_property
    def exact_wrong(self) -> Mask:
        """(H, W) judged pixels at which R0 shows the wrong surface."""
        wrong = self.exact.surface
        assert wrong is not None, "the reference has the scene at hand"
        return wrong

    @cached_property
    def surface_charge(self) -> NDArray[np.int8]:
        """(H, W) the link from which on each pixel of R0 shows a wrong surface, `RIGHT` where it does not.

        Traced images are judged at these pixels alone; images that are one, once.
        """
        wrong = self.exact_wrong
        pixels = np.flatnonzero(wrong)
        truth = self.truth.at(pixels)
        # The truth is right everywhere: until a later image is, the first link is charged.
        first, *later = self.changing
        found = np.full(pixels.size, first, dtype=np.int8)
        for link in later:
            found[~wrong_surface(truth, self.images[link].at(pixels), self.reference)[0]] = link
        charge = np.full(wrong.shape, RIGHT, dtype=np.int8)
        charge.reshape(-1)[pixels] = found
        return charge

    @cached_property
    def shifts(self) -> tuple[Floats, ...]:
        """Displacement of each image in pixels, (2, H W); see `film_shifts`."""
        found = {id(image): film_shifts(image, self.truth.camera) for image in dict.fromkeys(self.images)}
        return tuple(found[id(image)] for image in self.images)

    @cached_property
    def steps(self) -> Steps:
        """What each link but the last adds to displacement, where all images show a surface off the plate."""
        return Steps.between(self.shifts)

    @cached_property
    def step_sizes(self) -> tuple[StepSize | None, ...]:
        """How far each link but the last displaces the pixels of `steps`."""
        return self.steps.sizes()

    @cached_property
    def rounding(self) -> Causes:
        """Causes of what rasterization changed, with exact depth."""
        return self.causes_of(self.rasterization, self.images[-1], self.changed[self.rasterization])

    @cached_property
    def shear(self) -> ShearNumbers | None:
        """What the pivot alone does to the points that T2 shows; None where the pivot does nothing."""
        return shear_numbers(self.images[PIVOT + 1], self.reference.scene.frustum)

    def find_shared(self) -> None:
        """Find what all budgets share, in the thread of the caller: other threads then only read it."""
        for name in ("exact_wrong", "surface_charge", "step_sizes", "rounding", "shear"):
            getattr(self, name)
        self.exact.find_maps()

    def causes_of(self, link: int, after: HogelImage, pixels: Indices) -> Causes:
        """Return the causes of what a link that rounds has changed between two images, at pixels (N,)."""
        return explain(self.reference.scene, self.images[link], after, self.subpixel_bits, pixels)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(Shown):
    """The error of one image, link by link.

    Attributes
    ----------
    changed
        (N,) flat numbers of the pixels at which the last shows other than R0.
    charge
        (H, W) number of the link that each wrong pixel is charged to, else `RIGHT`.
    surface_charge
        (H, W) the same by surfaces: number of the link from which on the pixel shows a wrong surface.
    explanation
        Causes of the pixels charged to rasterization and depth.
    """

    start: ChainStart
    drawn: HogelImage
    changed: Indices
    charge: NDArray[np.int8]
    surface_charge: NDArray[np.int8]
    explanation: Causes
    predicted: tuple[LinkPrediction, ...]

    @property
    def judged(self) -> int:
        """Number of pixels whose truth is no tie."""
        return int(self.start.judged.sum())

    @property
    def wrong(self) -> int:
        """Number of judged pixels that show another triangle in the end."""
        return int((self.charge != RIGHT).sum())

    @property
    def cancelled(self) -> int:
        """Number of judged pixels that are right in the end although some link changed them."""
        return int((self.start.judged & (self.charge == RIGHT) & (self.start.charge != RIGHT)).sum())

    @property
    def moved(self) -> Floats:
        """Lengths (H, W) of the displacement of the last image, NaN where it is undefined."""
        shifts = film_shifts(self.drawn, self.start.truth.camera)
        return np.asarray(np.hypot(*shifts).reshape(self.charge.shape))

    @cached_property
    def displacement(self) -> VectorBudget:
        """Budget of displacement: columns and rows, pixels."""
        shifts = np.stack((*self.start.shifts, film_shifts(self.drawn, self.start.truth.camera)))
        return VectorBudget.of(np.moveaxis(shifts, 1, -1).reshape(len(shifts), *self.charge.shape, 2))

    @cached_property
    def height(self) -> VectorBudget:
        """Budget of height, scene units."""
        images = (*self.start.images, self.drawn)
        heights = [np.where(image.off_plate, image.height.astype(np.float64), np.nan) for image in images]
        return VectorBudget.of(np.stack(heights)[..., None])

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        settings = self.drawn.camera.settings
        assert settings is not None, "the rasterizer says with which settings it drew"
        return links_of(settings)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """What each link does, in the order of `links`."""
        # Links that change no image are charged with nothing, and nothing is counted.
        changing = (*self.start.changing, self.start.depth)
        charges = self.surface_charge, self.charge
        return tuple(
            self._cause(
                link,
                size,
                [int(np.count_nonzero(charge == link)) if link in changing else 0 for charge in charges],
            )
            for link, size in enumerate(self._step_sizes())
        )

    def _step_sizes(self) -> tuple[StepSize | None, ...]:
        """Return how far each link displaces what is shown."""
        start, changed, camera = self.start, self.changed, self.start.truth.camera
        # What depth does not change it does not move: elsewhere R0 is displaced alike, or not at all.
        off_plate = self.drawn.off_plate.reshape(-1)[changed]
        step = np.full(changed.size, np.nan)
        after = shifts_at(self.drawn, camera, changed[off_plate])
        step[off_plate] = np.hypot(*(after - start.shifts[-1][:, changed[off_plate]]))
        steps = start.steps.with_last(changed, step)
        if np.array_equal(steps.known, start.steps.known):
            last = Steps(known=steps.known, lengths=steps.lengths[-1:])
            return (*start.step_sizes, *last.sizes())
        return steps.sizes()

    def _cause(self, link: int, size: StepSize | None, wrong: list[int]) -> Cause:
        return Cause(
            name=self.links[link],
            surface=wrong[0],
            triangle=wrong[1],
            displacement_rms_px=size.rms if size else None,
            displacement_p99_px=size.p99 if size else None,
            predicted_displacement_rms_px=self.predicted[link].displacement_rms_px,
            predicted_surface=self.predicted[link].surface_pixels,
        )

    @property
    def numbers(self) -> BudgetNumbers:
        """The numbers alone, without the images."""
        counts = self.explanation.counts()
        unexplained = counts.pop("unexplained")
        links = (
            LinkNumbers(**vars(cause), pixels=cause.triangle, height_rms=raised)
            for cause, raised in zip(self.causes, self.height.rms(), strict=True)
        )
        return BudgetNumbers(
            judged=self.judged,
            wrong=self.wrong,
            links=tuple(links),
            explained=counts,
            cancelled=self.cancelled,
            unexplained=unexplained,
            not_in_every_link=self.displacement.elsewhere,
        )

    def summary(self) -> dict[str, Any]:
        """Return the numbers as `budget --json` prints them."""
        numbers = self.numbers
        return {**asdict(numbers), "links": [asdict(link) for link in numbers.links]}

    def _said(self) -> str:
        return said_of_budget(self)


def said_of_budget(budget: Budget) -> str:
    """Return in a line how many pixels are wrong, and how many of these nothing explains."""
    unexplained = budget.explanation.counts()["unexplained"]
    wrong = f"{budget.wrong:,} of {budget.judged:,} judged pixels show another triangle"
    return f"{wrong}, {unexplained:,} unexplained"


def make_budget(reference: Reference, chain: Chain) -> Budget:
    """Charge every wrong pixel of a chain's last image to one link; see `charged`."""
    start = ChainStart(reference=reference, images=chain.images[:-1], subpixel_bits=chain.subpixel_bits)
    gaps = reference.gaps(start.truth.camera.aperture)
    predictor = Predictor(start.truth, gaps, reference.scene.frustum, chain.subpixel_bits)
    return charged(start, chain.images[-1], predictor.predict_links(chain.settings)[1])


def charged(
    start: ChainStart,
    drawn: HogelImage,
    predicted: tuple[LinkPrediction, ...],
    errors: PixelErrors | None = None,
) -> Budget:
    """Charge every wrong pixel of a drawn image to one link of its chain.

    A pixel is charged to the last link that changed its triangle: the smallest for which every
    later link agrees with the final image. By surfaces, it is charged to the link from which on it is wrong.

    Parameters
    ----------
    errors
        Errors of the last image, where it was compared with the truth beside R0 already.
    """
    charge = np.full(drawn.triangle.shape, RIGHT, dtype=np.int8)
    wrong = (drawn.triangle != start.truth.triangle) & start.judged
    # A wrong pixel that no later link changes was made wrong by the first. Later links change few pixels.
    charge[wrong] = start.changing[0]
    exact = start.images[-1]
    changed = errors.changed if errors else None
    changed = differing_pixels(exact, drawn) if changed is None else changed
    depth = differing_triangles(exact, drawn, changed)
    for link, pixels in (*start.changed.items(), (start.depth, depth)):
        charge.reshape(-1)[pixels[wrong.reshape(-1).take(pixels)]] = link
    rounding = start.rounding
    by_rasterizing = rounding.some(charge.reshape(-1).take(rounding.pixels) == start.rasterization)
    by_depth = depth[charge.reshape(-1).take(depth) == start.depth]
    by_rounding_depth = start.causes_of(start.depth, drawn, by_depth)
    return Budget(
        start=start,
        drawn=drawn,
        changed=changed,
        charge=charge,
        surface_charge=_surface_charge(start, drawn, errors),
        explanation=by_rasterizing.joined(by_rounding_depth),
        predicted=predicted,
    )


def _surface_charge(start: ChainStart, drawn: HogelImage, errors: PixelErrors | None) -> NDArray[np.int8]:
    """Return the link (H, W) from which on each pixel shows a wrong surface; parameters as for `charged`."""
    if errors is None or errors.surface is None:
        wrong = wrong_surface(start.truth, drawn, start.reference) & start.judged
    else:
        wrong = errors.surface
    # What R0 shows rightly goes wrong by depth, whatever the images before show. Few pixels differ from R0.
    charge = start.surface_charge.copy()
    pixels = np.flatnonzero(wrong != start.exact_wrong)
    charge.reshape(-1)[pixels] = np.where(wrong.reshape(-1).take(pixels), start.depth, RIGHT)
    return charge
