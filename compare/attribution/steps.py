"""How far each link of a chain displaces what is shown, where every image shows a surface off the plate.

Images are compared point by point: most pixels of an image show no surface at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.metrics.displacement import percentiles, root_mean_square
from xfrustum.compare.metrics.film import DrawnPoints, true_lines
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import read_only

Vectors = NDArray[np.complex128]


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
        if float(values.max()) == 0 and float(values.min()) == 0:
            return cls(rms=0.0, p99=0.0)
        (p99,) = percentiles(values, (99,))
        return cls(rms=root_mean_square(values), p99=p99)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shifts:
    """Displacement of the points that an image shows off the plate.

    Attributes
    ----------
    pixels
        (N,) flat numbers of their pixels, ascending.
    shift
        (N,) columns plus i times rows in pixels, as `displacement` has them: NumPy is several times slower
        along rows of two numbers.
    """

    pixels: Indices
    shift: Vectors

    @classmethod
    def of(cls, image: HogelImage, camera: HogelCamera, pixels: Indices | None = None) -> Shifts:
        """Return the displacement of an image that names triangles.

        Parameters
        ----------
        image, camera
            The image, and the camera of the true frustum.
        pixels
            (M,) flat numbers of the pixels that are asked about, ascending; all where None.
        """
        if pixels is None:
            pixels = np.flatnonzero(image.triangle != NOTHING)
        points = DrawnPoints.of(image, pixels)
        known: Mask = np.isfinite(points.coordinates).all(axis=0) & (points.coordinates[2] != 0)
        if not known.all():
            points = points.at(np.flatnonzero(known))
        pencil = true_lines(camera)
        shift = np.empty(len(points.pixels), dtype=np.complex128)
        shift.real, shift.imag = points.places(pencil)
        shift -= _centers(pencil.resolution).take(points.pixels)
        return cls(pixels=points.pixels, shift=shift)

    def among(self, pixels: Indices) -> Vectors:
        """Return the displacement (M,) at pixels (M,) that hold all of these; NaN elsewhere among them."""
        found = np.full(len(pixels), complex(np.nan, np.nan))
        found[np.searchsorted(pixels, self.pixels)] = self.shift
        return found

    def where(self, chosen: Mask) -> Vectors:
        """Return the displacement (M,) of those pixels that are marked among all (H W,) pixels."""
        kept = chosen.take(self.pixels)
        return self.shift if kept.all() else self.shift[kept]


@lru_cache(maxsize=1)
def _centers(resolution: tuple[int, int]) -> Vectors:
    """Return columns plus i times rows of the centers of all pixels, (H W,), read-only."""
    width, height = resolution
    return np.asarray(read_only(np.add.outer(1j * np.arange(height), np.arange(width)).ravel()))


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
    def of(cls, images: Sequence[Shifts], size: int) -> Steps:
        """Return the steps from image to image; an image that is the one before it adds nothing.

        `size` is the number of pixels of an image.
        """
        common = np.ones(size, dtype=np.bool_)
        different = {id(one): one for one in images}
        for one in different.values():
            if len(one.pixels) < size:
                shown = np.zeros(size, dtype=np.bool_)
                shown[one.pixels] = True
                common &= shown
        there = {number: one.where(common) for number, one in different.items()}
        found = tuple(
            None if after is before else np.abs(there[id(after)] - there[id(before)])
            for before, after in pairwise(images)
        )
        steps = cls(pixels=np.flatnonzero(common), lengths=found)
        # Points very near the plate may be displaced beyond all numbers.
        finite = [np.isfinite(one) for one in found if one is not None]
        known: Mask = np.logical_and.reduce(finite) if finite else np.ones(len(steps.pixels), dtype=np.bool_)
        return steps if known.all() else steps.some(known)

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
            (M,) flat numbers of pixels that this link may displace.
        step
            (M,) lengths; not finite where the image before or after the link shows no surface off the plate.
        """
        last = np.zeros(len(self.pixels))
        place = np.searchsorted(self.pixels, pixels)
        place[place == len(self.pixels)] = 0
        mine = self.pixels[place] == pixels if len(self.pixels) else np.zeros(len(pixels), dtype=np.bool_)
        place, step = place[mine], step[mine]
        last[place] = step
        steps = Steps(pixels=self.pixels, lengths=(*self.lengths, last))
        known = np.ones(len(last), dtype=np.bool_)
        known[place] = np.isfinite(step)
        return steps if known.all() else steps.some(known)
