"""Stored pixels beside what the truth would have stored, and the damage that explains the difference."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.orientations import UPRIGHT, Orientation, orientations
from xfrustum.compare.renderer_model.pictures import COLOR_TOLERANCE, as_gray
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers
from xfrustum.scenes.files.foreign_images import (
    Encoding,
    ForeignImage,
    Reading,
    radiance,
    read_again,
    stored_rgb,
)
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage

OVERFLOW, RESAMPLED, LOSSY = "8-bit-overflow", "resampled", "lossy"
"""Names of the kinds of damage that lose numbers, as faults."""

FIRST_NUMBER = "first"
"""Name of the damage that loses number 0 alone, where it is stored like nothing; no fault by itself."""

MAX_COMPARED_HOGELS = 3
"""Largest number of hogels that are compared with the truth; more do not change which damage is found."""

COMPARED_LINES = 100
"""Approximate number of rows and columns of each hogel that are compared with the truth, evenly spread."""

MIN_ACCOUNTED_FRACTION = 0.9
"""Smallest share of the pixels that show something for which a kind of damage must account; equal to
`evidence.MIN_EXPLAINED_FRACTION`."""

MIN_REPEATED_FRACTION = 0.15
"""Smallest share of columns and of rows that repeat the ones before in an enlarged picture. Enlarging by a
factor f repeats 1 - 1 / f of the lines: 15 % at 1.18. In pictures drawn at their own size few lines
repeat."""

MIN_MIXED_FRACTION = 0.01
"""Smallest share of pixels with a number between those around them in a resampled picture; fewer are
accidents."""

MIN_VALUES_FACTOR = 1.2
"""Smallest ratio of the number of different integers in a mixed or compressed picture to that in the truth:
values between two numbers are new. Merely wrong numbers, such as those of objects in another order, are as
many as the right ones."""

MAX_LOSSY_STEPS = 24
"""Largest change of a byte by lossy compression. JPEG of quality 75 quantizes the low frequencies of
brightness in steps of at most 16, and chroma adds half a step of its own."""

MIN_SHADES = 3
"""Smallest number of different gray values in a shaded picture; masks and outlines have fewer."""

MIN_CORRELATION = 0.5
"""Smallest correlation of brightness with the truth's within surfaces at which colored pixels count as a
picture of the scene: that of numbers is random."""


MIN_SAME_COLOR_FRACTION = 0.5
"""Smallest share of pixels as bright as the truth for pictures to be read as sRGB. Under the right reading
nearly all are, but for those beside outlines that have moved; a picture under another light, which is as
bright in few, says nothing of its encoding."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The share of pixels that agree with the truth, and the conventions under which most do."""

    share: float
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """The stored pixels of an image beside the truth of the same pixels and their neighbors.

    Attributes
    ----------
    rgb
        (h, w, 3) stored bytes, upright.
    triangle, object
        (9, h, w) the truth's numbers; the first of the nine belongs to the pixel itself, the others to its
        neighbors.
    gray
        (h, w) the truth's brightness.
    """

    rgb: Bytes
    triangle: Numbers
    object: Numbers
    gray: Floats

    def shown(self) -> Mask:
        """Return the pixels where the image or the truth shows something, (h, w)."""
        return np.asarray((self.rgb != 0).any(axis=-1) | (self.triangle[0] != NOTHING))

    def stored(self, reading: Reading) -> Numbers:
        """Return the integers that the truth would have stored, (9, h, w)."""
        named = self.object if reading.encoding is Encoding.OBJECT_ID else self.triangle
        return reading.stored(named)

    def same(self, reading: Reading) -> Mask:
        """Return the pixels that store the truth's number of the same pixel or a neighbor, (h, w)."""
        return np.asarray((reading.packed(self.rgb) == self.stored(reading)).any(axis=0))

    def covers(self) -> Mask:
        """Return the pixels that are lit where the truth around them shows a surface, and black elsewhere."""
        lit = (self.rgb != 0).any(axis=-1)
        return np.asarray(((self.triangle != NOTHING) == lit).any(axis=0))

    def overflown(self, stated: Reading, bits: int) -> Mask:
        """Return whether pixels hold the low bits of the truth's numbers, own and neighbors', (9, h, w).

        Eight bits may be in blue alone, with red and green black, or in all three channels.
        """
        low, packed = self.stored(stated) & (2**bits - 1), stated.packed(self.rgb)
        matching = packed == low
        return np.asarray(matching | (packed == low * 0x010101) if bits == 8 else matching)

    def between(self, stated: Reading, margin: int) -> Mask:
        """Return the pixels whose bytes lie in the range of the truth's bytes around them, (h, w)."""
        around = self.stored(stated)
        matching = np.ones(around.shape[1:], dtype=np.bool_)
        for channel, shift in zip(stated.channels, (16, 8, 0), strict=True):
            parts, byte = around >> shift & 255, self.rgb[..., channel].astype(np.int32)
            matching &= (byte >= parts.min(axis=0) - margin) & (byte <= parts.max(axis=0) + margin)
        return matching


Matching = Callable[[_Beside], Mask]
"""A function that returns the pixels (h, w) which match the truth in some sense."""


class StoredTruth:
    """Some images of a renderer, as found, beside the truth, under any orientation and order."""

    def __init__(self, reference: Reference, images: Sequence[HogelImage]) -> None:
        self.reference = reference
        count = min(MAX_COMPARED_HOGELS, len(images))
        chosen = np.unique(np.linspace(0, max(len(images) - 1, 0), count).astype(int)).tolist()
        self.images = [images[index] for index in chosen]
        self.several = len({image.camera.aperture.index for image in images}) > 1
        self._truths: dict[tuple[int, int], HogelImage] = {}

    def agreement(self, reading: Reading) -> Agreement:
        """Return the agreement of pixels that store the truth's number of the same pixel or a neighbor."""
        return self.best(lambda beside: beside.same(reading), background=reading.background)

    def best(self, matching: Matching, background: int = 0) -> Agreement:
        """Return the conventions under which most pixels that show something match, and their share."""
        scene = self.reference.scene
        best = Agreement(share=0.0)
        orders = list(orientations(scene.plate.hogels)) if self.several else [UPRIGHT]
        for order, orientation in itertools.product(orders, orientations(scene.frustum.resolution)):
            shown = matched = 0
            for image in self.images:
                beside = self.beside(image, orientation, order)
                some = beside.shown() if not background else beside.triangle[0] != NOTHING
                shown += int(some.sum())
                matched += int((matching(beside) & some).sum())
            share = matched / shown if shown else 0.0
            # Where conventions agree equally well, the first one, no change, wins.
            if share > best.share + 1e-6:
                best = Agreement(share=share, orientation=orientation, order=order)
        return best

    def truth(self, index: tuple[int, int]) -> HogelImage:
        """Return the truth of an aperture."""
        if index not in self._truths:
            self._truths[index] = self.reference.trace(self.reference.scene.plate.aperture(*index))
        return self._truths[index]

    def beside(
        self, image: HogelImage, orientation: Orientation, order: Orientation, *, thinned: bool = True
    ) -> _Beside:
        """Return an image's pixels beside the truth's."""
        truth = self.truth(order.index(image.camera.aperture.index, self.reference.scene.plate.hogels))
        step = max(1, min(truth.triangle.shape) // COMPARED_LINES) if thinned else 1
        return _Beside(
            rgb=orientation.upright(stored_rgb(image))[::step, ::step],
            triangle=_around(truth.triangle, step),
            object=_around(truth.object, step),
            gray=as_gray(truth)[::step, ::step],
        )

    def all_beside(self, found: Agreement) -> list[_Beside]:
        """Return all images beside the truth, under the conventions under which they agree."""
        return [self.beside(image, found.orientation, found.order) for image in self.images]

    def colors(self) -> Reading | None:
        """Return how to read pixels that are colors of the scene; None where they are not."""
        found = self.best(_Beside.covers)
        if found.share < MIN_ACCOUNTED_FRACTION:
            return None
        parts = self.all_beside(found)
        inner = [(part.rgb != 0).any(axis=-1) & (part.triangle[0] != NOTHING) for part in parts]
        rgb = np.concatenate([part.rgb[some] for part, some in zip(parts, inner, strict=True)])
        gray = np.concatenate([part.gray[some] for part, some in zip(parts, inner, strict=True)])
        shades = rgb.astype(np.float64).mean(axis=1)
        if len(np.unique(shades)) < MIN_SHADES:
            return None
        colorless = float((np.ptp(rgb, axis=1) == 0).mean()) >= MIN_ACCOUNTED_FRACTION
        if not colorless and (np.ptp(gray) == 0 or np.corrcoef(shades, gray)[0, 1] < MIN_CORRELATION):
            return None
        linear, encoded = (_same_color(rgb, encoding, gray) for encoding in (Encoding.RGB, Encoding.SRGB))
        is_encoded = encoded >= MIN_SAME_COLOR_FRACTION and encoded > linear
        return Reading(encoding=Encoding.SRGB if is_encoded else Encoding.RGB)


def _same_color(rgb: Bytes, encoding: Encoding, gray: Floats) -> float:
    """Return the share of pixels (N, 3) that are as bright as the truth (N,) when read in some encoding."""
    off = radiance(rgb, encoding).mean(axis=-1) - np.clip(gray, 0.0, 1.0)
    return float((np.abs(off) <= COLOR_TOLERANCE).mean())


def _around(numbers: Numbers, step: int) -> Numbers:
    """Return the numbers of every `step`-th pixel and its neighbors, (9, h, w), the pixel itself first."""
    height, width = numbers.shape
    padded = np.pad(numbers, 1, mode="edge")
    places = sorted(itertools.product(range(3), range(3)), key=lambda place: place != (1, 1))
    return np.stack([padded[r : r + height : step, c : c + width : step] for r, c in places])


@dataclass(frozen=True, kw_only=True)
class Restoring:
    """A way to restore damaged numbers with the help of the truth.

    Restored numbers serve the figures after correction only; no image passes because of them.

    Attributes
    ----------
    bits
        Number of low bits of each number that were kept; only for `OVERFLOW`.
    """

    kind: str
    reading: Reading
    agreement: Agreement
    bits: int = 24

    def read(self, reference: Reference, image: HogelImage) -> HogelImage:
        """Return an image with the truth's number wherever the damage explains what is stored instead."""
        orientation, reading = self.agreement.orientation, self.reading
        truth = StoredTruth(reference, (image,))
        beside = truth.beside(image, orientation, self.agreement.order, thinned=False)
        as_read = read_again(image, reading)
        name = "object" if reading.encoding is Encoding.OBJECT_ID else "triangle"
        numbers = np.array(orientation.upright(getattr(as_read, name)))
        meant = beside.object if name == "object" else beside.triangle
        if self.kind == FIRST_NUMBER:
            explained = (reading.packed(beside.rgb) == reading.background) & (meant[0] == 0)
        elif self.kind == OVERFLOW:
            explained = beside.overflown(reading, self.bits)
        else:
            explained = beside.between(reading, MAX_LOSSY_STEPS if self.kind == LOSSY else 0)
        explained = explained if explained.ndim > 2 else explained[None]
        # The pixel's own number is tried last, and wins.
        for mask, number in reversed(list(zip(explained, meant, strict=False))):
            numbers[mask] = number[mask]
        restored = orientation.applied(numbers)
        return replace(as_read, object=restored) if name == "object" else replace(as_read, triangle=restored)


def restored_first(truth: StoredTruth, reading: Reading) -> Restoring:
    """Return a way to tell number 0 from nothing where both are stored alike."""
    return Restoring(kind=FIRST_NUMBER, reading=reading, agreement=truth.agreement(reading))


def spoiled_numbers(truth: StoredTruth, stated: Reading) -> tuple[Fault, Restoring] | None:
    """Find damage after which numbers are lost: high bits cut off, neighbors mixed, lossy compression."""
    count = len(truth.reference.scene.faces)
    for bits in (8, 16) if stated.encoding is Encoding.TRIANGLE_ID else ():
        if count < 2**bits:
            continue
        found = truth.best(partial(_any_overflown, stated=stated, bits=bits))
        if found.share >= MIN_ACCOUNTED_FRACTION:
            words = f"only the low {bits} bits of each number are stored, of {count:,} triangles"
            fault = Fault(fault=OVERFLOW, value=float(bits), unit="bits", words=f"{words}: others are lost")
            return fault, Restoring(kind=OVERFLOW, reading=stated, agreement=found, bits=bits)
    return _mixed(truth, stated)


def _any_overflown(beside: _Beside, stated: Reading, bits: int) -> Mask:
    return np.asarray(beside.overflown(stated, bits).any(axis=0))


def _mixed(truth: StoredTruth, stated: Reading) -> tuple[Fault, Restoring] | None:
    """Find numbers that were averaged with their neighbors, or compressed with loss."""
    stored_as = [image.stored for image in truth.images if isinstance(image, ForeignImage)]
    named_lossy = any(one is not None and one.lossy for one in stored_as)
    for kind, margin in ((RESAMPLED, 0), (LOSSY, MAX_LOSSY_STEPS)):
        if kind == RESAMPLED and named_lossy:
            continue
        found = truth.best(partial(_Beside.between, stated=stated, margin=margin))
        parts = truth.all_beside(found)
        mixed = 1 - float(np.concatenate([part.same(stated)[part.shown()] for part in parts]).mean())
        stored = np.concatenate([stated.packed(part.rgb).ravel() for part in parts])
        should = np.concatenate([part.stored(stated)[0].ravel() for part in parts])
        new = len(np.unique(stored)) >= MIN_VALUES_FACTOR * len(np.unique(should))
        explained = found.share >= MIN_ACCOUNTED_FRACTION and mixed >= MIN_MIXED_FRACTION and new
        if explained or (kind == LOSSY and named_lossy):
            words = {
                RESAMPLED: f"numbers are mixed with their neighbors' in {mixed:.0%} of the pixels, "
                "by filtering, resizing or anti-aliasing: numbers have no averages",
                LOSSY: "numbers went through lossy compression, such as JPEG: write PNG",
            }[kind]
            fault = Fault(fault=kind, value=mixed, unit="share", words=words)
            return fault, Restoring(kind=kind, reading=stated, agreement=found)
    return None


def repeated_pixels(truth: StoredTruth, stated: Reading) -> tuple[Fault, Restoring] | None:
    """Find pictures that were drawn smaller and enlarged by repeating columns and rows."""
    images = [stated.packed(stored_rgb(image)) for image in truth.images]
    expected = [truth.truth(image.camera.aperture.index).triangle for image in truth.images]
    shares = [(_repeated(images, axis), _repeated(expected, axis)) for axis in (0, 1)]
    if any(mine < MIN_REPEATED_FRACTION or its > mine / 2 for mine, its in shares):
        return None
    share = float(np.mean([mine for mine, _ in shares]))
    words = f"{share:.0%} of columns and rows repeat the ones before: images were drawn smaller and enlarged"
    fault = Fault(fault=RESAMPLED, value=share, unit="share", words=words)
    return fault, Restoring(kind=RESAMPLED, reading=stated, agreement=truth.agreement(stated))


def _repeated(images: Sequence[Numbers], axis: int) -> float:
    """Return the share of rows (axis 0) or columns that repeat the ones before, uniform ones left out."""
    repeated = telling = 0
    for image in images:
        lines = np.moveaxis(image, axis, 0)
        several = (lines[:-1] != lines[:-1, :1]).any(axis=1)
        telling += int(several.sum())
        repeated += int((several & (lines[1:] == lines[:-1]).all(axis=1)).sum())
    return repeated / telling if telling else 0.0
