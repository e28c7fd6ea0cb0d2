"""How far each link of a chain displaces what is shown, where every image shows a surface off the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.displacement import percentiles, root_mean_square
from xfrustum.compare.metrics.film import true_lines
from xfrustum.reference.film_shifts import Vectors, film_shifts, film_steps
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage


@dataclass(frozen=True, kw_only=True)
class StepSize:
    """Root mean square and 99th percentile of the lengths of some displacements, in pixels."""

    rms: float
    p99: float

    @classmethod
    def of(cls, values: Floats) -> StepSize | None:
        """Return the size of some lengths (N,); None where there is none. `Spread` has the same numbers."""
        if values.size == 0:
            return None
        largest = float(values.max())
        if largest == 0 and float(values.min()) == 0:
            return cls(rms=0.0, p99=0.0)
        # Most pixels may not be displaced at all: then the percentile is zero, and nothing is selected.
        zeros = len(values) - int(np.count_nonzero(values > 0))
        p99 = 0.0 if zeros > 0.99 * (len(values) - 1) + 1 else percentiles(values, (99,), largest)[0]
        return cls(rms=root_mean_square(values, largest), p99=p99)


def shifts(image: HogelImage, camera: HogelCamera) -> Vectors:
    """Return the displacement (H W,) of an image, the numbers of `displacement`; see `film_shifts`.

    `camera` is that of the true frustum.
    """
    return film_shifts(image.position, true_lines(camera))


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownShifts:
    """Displacement of the first image of a chain, the truth, which is rounding.

    Attributes
    ----------
    vectors
        (H W,) displacement.
    pixels
        (N,) flat numbers of the pixels at which it is finite, ascending.
    """

    vectors: Vectors
    pixels: Indices

    @classmethod
    def of(cls, truth: HogelImage) -> KnownShifts:
        """Return the displacement of a true image."""
        vectors = shifts(truth, truth.camera)
        return cls(vectors=vectors, pixels=np.flatnonzero(np.isfinite(vectors)))


def step_lengths(before: HogelImage, after: HogelImage, camera: HogelCamera, pixels: Indices) -> Floats:
    """Return how far an image displaces what it shows beyond another image, at some pixels (N,).

    Lengths are in pixels, and not finite where either image shows no surface off the plate. `camera` is that
    of the true frustum.
    """
    return film_steps((before.position, after.position), true_lines(camera), pixels)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """What links add to displacement, where each image before and after them shows a surface off the plate.

    Attributes
    ----------
    pixels
        (N,) flat numbers of these pixels, ascending.
    lengths
        (N,) lengths in pixels for each link; None stands for the zeros of a link that changes no image.
    """

    pixels: Indices
    lengths: tuple[Floats | None, ...]

    @classmethod
    def between(cls, images: Sequence[HogelImage], first: KnownShifts) -> Steps:
        """Return the steps from image to image, given the displacement of the first.

        An image that is the one before it adds nothing.
        """
        distinct = [images[0], *(after for before, after in pairwise(images) if after is not before)]
        pencil = true_lines(images[0].camera)
        found = film_steps([image.position for image in distinct], pencil, first.pixels, first.vectors)
        pixels = first.pixels
        # Points very near the plate may be displaced beyond all numbers.
        known = np.isfinite(found[0]) if found else np.ones(len(pixels), dtype=np.bool_)
        for one in found[1:]:
            known &= np.isfinite(one)
        if not known.all():
            places = np.flatnonzero(known)
            pixels, found = pixels.take(places), [one.take(places) for one in found]
        each = iter(found)
        return cls(
            pixels=pixels,
            lengths=tuple(None if after is before else next(each) for before, after in pairwise(images)),
        )

    def some(self, kept: Mask) -> Steps:
        """Return the steps of those pixels that are marked, (N,)."""
        return Steps(
            pixels=self.pixels[kept],
            lengths=tuple(None if one is None else one[kept] for one in self.lengths),
        )

    def sizes(self) -> tuple[StepSize | None, ...]:
        """Return the size of the steps of each link."""
        nothing = StepSize.of(np.zeros(min(len(self.pixels), 1)))
        return tuple(nothing if one is None else StepSize.of(one) for one in self.lengths)

    def with_last(self, pixels: Indices, step: Floats) -> Steps:
        """Return the steps with one more link, which displaces nothing but some pixels.

        Parameters
        ----------
        pixels
            (M,) flat numbers of pixels that this link may displace, ascending.
        step
            (M,) lengths; not finite where the image before or after the link shows no surface off the plate.
        """
        if not len(pixels) or not len(self.pixels):
            nothing = None if len(self.pixels) else np.zeros(0)
            return Steps(pixels=self.pixels, lengths=(*self.lengths, nothing))
        whole = np.zeros(max(self.pixels[-1], pixels[-1]) + 1)
        whole[pixels] = step
        last = whole.take(self.pixels)
        steps = Steps(pixels=self.pixels, lengths=(*self.lengths, last))
        known = np.isfinite(last)
        return steps if known.all() else steps.some(known)
