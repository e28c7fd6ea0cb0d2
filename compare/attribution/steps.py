"""How far each link of a chain displaces what is shown, where every image shows a surface off the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.compare.metrics.displacement import percentiles, root_mean_square
from xfrustum.compare.metrics.film import true_lines
from xfrustum.reference.film_shifts import Vectors, film_shifts, film_steps, some_film_steps
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import HogelCamera, HogelImage


@dataclass(frozen=True, kw_only=True)
class StepSize:
    """Root mean square and 99th percentile of the lengths of some displacements, in pixels."""

    rms: float
    p99: float

    @classmethod
    def of(cls, values: Floats, count: int | None = None) -> StepSize | None:
        """Return the size of some lengths (N,); None where there is none. `Spread` has the same numbers.

        Where `count` is given, it is the number of lengths that are meant: those of `values` that are not
        zero, and zeros.
        """
        count = len(values) if count is None else count
        if count == 0:
            return None
        if count > len(values):
            # One zero stands for all that are left out.
            values = np.append(values, 0.0)
        largest = float(values.max())
        if largest == 0 and float(values.min()) == 0:
            return cls(rms=0.0, p99=0.0)
        # Most pixels may not be displaced at all: then the percentile is zero, and nothing is selected.
        zeros = count - int(np.count_nonzero(values > 0))
        none = zeros > 0.99 * (count - 1) + 1
        p99 = 0.0 if none else percentiles(values, (99,), largest, count)[0]
        return cls(rms=root_mean_square(values, largest, count), p99=p99)


def shifts(image: HogelImage, camera: HogelCamera) -> Vectors:
    """Return the displacement (H W,) of an image, the numbers of `displacement`; see `film_shifts`.

    `camera` is that of the true frustum.
    """
    return film_shifts(image.position, true_lines(camera))


def step_lengths(before: HogelImage, after: HogelImage, camera: HogelCamera, pixels: Indices) -> Floats:
    """Return how far an image displaces what it shows beyond another image, at some pixels (N,).

    Lengths are in pixels, and not finite where either image shows no surface off the plate. `camera` is that
    of the true frustum.
    """
    return some_film_steps((before.position, after.position), true_lines(camera), pixels)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """What links add to displacement, where each image before and after them shows a surface off the plate.

    Attributes
    ----------
    known
        (H W,) whether a pixel is one of these.
    count
        Number of these pixels.
    lengths
        Lengths in pixels for each link: (H W,), zero at all other pixels, or those (N,) that are not zero;
        None for a link that changes no image.
    """

    known: Mask
    count: int
    lengths: tuple[Floats | None, ...]

    @classmethod
    def between(cls, images: Sequence[HogelImage], first: Vectors) -> Steps:
        """Return the steps from image to image, given the displacement (H W,) of the first; see `shifts`.

        An image that is the one before it adds nothing.
        """
        distinct = [images[0], *(after for before, after in pairwise(images) if after is not before)]
        pencil = true_lines(images[0].camera)
        # Points very near the plate may be displaced beyond all numbers.
        known, found = film_steps([image.position for image in distinct], pencil, first)
        each = iter(found)
        return cls(
            known=known,
            count=int(np.count_nonzero(known)),
            lengths=tuple(None if after is before else next(each) for before, after in pairwise(images)),
        )

    def sizes(self) -> tuple[StepSize | None, ...]:
        """Return the size of the steps of each link."""
        return tuple(StepSize.of(np.zeros(0) if one is None else one, self.count) for one in self.lengths)

    def with_last(self, pixels: Indices, step: Floats) -> Steps:
        """Return the steps with one more link, which displaces nothing but some pixels.

        Parameters
        ----------
        pixels
            (M,) flat numbers of pixels that this link may displace, ascending.
        step
            (M,) lengths; not finite where the image before or after the link shows no surface off the plate.
        """
        inside = self.known[pixels]
        pixels, step = pixels[inside], step[inside]
        finite = np.isfinite(step)
        if finite.all():
            return Steps(known=self.known, count=self.count, lengths=(*self.lengths, step))
        lost = pixels[~finite]
        known = self.known.copy()
        known[lost] = False
        lengths = [None if one is None else np.where(known, one, 0.0) for one in self.lengths]
        return Steps(known=known, count=self.count - len(lost), lengths=(*lengths, step[finite]))
