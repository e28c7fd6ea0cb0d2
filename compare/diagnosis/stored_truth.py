"""Stored pixels beside what the truth would have stored, and the damage that explains the difference."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation, orientations
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

# The damage that loses number 0 alone, where it is stored like nothing; no fault by itself.
FIRST_NUMBER = "first"

# Largest number of hogels that are compared with the truth, and approximate number of rows and columns of
# each, evenly spread; more do not change which damage is found.
MAX_COMPARED_HOGELS, COMPARED_LINES = 3, 100

# Smallest share of the pixels that show something for which a kind of damage must account; equal to
# `evidence.MIN_EXPLAINED_FRACTION`.
MIN_ACCOUNTED_FRACTION = 0.9

# Smallest share of columns and of rows that repeat the ones before in an enlarged picture. Enlarging by a
# factor f repeats 1 - 1 / f of the lines: 15 % at 1.18. In pictures drawn at their own size few lines repeat.
MIN_REPEATED_FRACTION = 0.15

# Smallest share of pixels with a number between those around them in a resampled picture; fewer are
# accidents.
MIN_MIXED_FRACTION = 0.01

# Smallest ratio of the number of different integers in a mixed or compressed picture to that in the truth:
# values between two numbers are new. Merely wrong numbers, such as those of objects in another order, are as
# many as the right ones.
MIN_VALUES_FACTOR = 1.2

# Largest change of a byte by lossy compression. JPEG of quality 75 quantizes the low frequencies of
# brightness in steps of at most 16, and chroma adds half a step of its own.
MAX_LOSSY_STEPS = 24

# Smallest number of different gray values in a shaded picture; masks and outlines have fewer. And the
# smallest correlation of brightness with the truth's at which colored pixels count as a picture of the scene:
# that of numbers is random.
MIN_SHADES, MIN_CORRELATION = 3, 0.5

# Smallest share of pixels as bright as the truth for pictures to be read as sRGB. Under the right reading
# nearly all are, but for those beside outlines that have moved; a picture under another light, which is as
# bright in few, says nothing of its encoding.
MIN_SAME_COLOR_FRACTION = 0.5


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """The share of pixels that agree with the truth, and the conventions under which most do."""

    share: float
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT


@dataclass(frozen=True, kw_only=True)
class Restoring:
    """A way to restore damaged numbers with the help of the truth.

    Restored numbers serve the figures after correction only; no image passes because of them. `bits` are the
    low bits of each number that `OVERFLOW` has kept.
    """

    kind: str
    reading: Reading
    agreement: Agreement = Agreement(share=0.0)
    bits: int = 24

    def read(self, reference: Reference, image: HogelImage) -> HogelImage:
        """Return an image with the truth's number wherever the damage explains what is stored instead."""
        orientation, reading = self.agreement.orientation, self.reading
        truth = StoredTruth(reference, (image,))
        beside = truth.beside(image, orientation, self.agreement.order, thinned=False)
        as_read, name = read_again(image, reading), beside.name(reading)
        numbers = np.array(orientation.upright(getattr(as_read, name)))
        # The pixel's own number is tried last, and wins.
        meant = getattr(beside, name)
        for mask, number in reversed(list(zip(beside.explained(self), meant, strict=False))):
            numbers[mask] = number[mask]
        restored = orientation.applied(numbers)
        return replace(as_read, object=restored) if name == "object" else replace(as_read, triangle=restored)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """The stored bytes (h, w, 3) of an image, upright, beside the truth's numbers (9, h, w) and brightness.

    The first of the nine numbers belongs to the pixel itself, the others to its neighbors.
    """

    rgb: Bytes
    triangle: Numbers
    object: Numbers
    gray: Floats

    def name(self, reading: Reading) -> str:
        """Return the name of the numbers that pixels hold by a reading."""
        return "object" if reading.encoding is Encoding.OBJECT_ID else "triangle"

    def shown(self) -> Mask:
        """Return the pixels where the image or the truth shows something, (h, w)."""
        return np.asarray((self.rgb != 0).any(axis=-1) | (self.triangle[0] != NOTHING))

    def stored(self, reading: Reading) -> Numbers:
        """Return the integers that the truth would have stored, (9, h, w)."""
        return reading.stored(getattr(self, self.name(reading)))

    def same(self, reading: Reading) -> Mask:
        """Return where pixels store the truth's number of the same pixel or of a neighbor, (9, h, w)."""
        return np.asarray(reading.packed(self.rgb) == self.stored(reading))

    def covers(self) -> Mask:
        """Return where pixels are lit as the truth around them shows a surface, black as not, (9, h, w)."""
        return np.asarray((self.triangle != NOTHING) == (self.rgb != 0).any(axis=-1))

    def explained(self, damage: Restoring) -> Mask:
        """Return where damage turns the truth's own and neighbors' numbers into the bytes, (n, h, w).

        Where numbers are mixed, n is 1: bytes lie in the range of those around them.
        """
        reading, stored = damage.reading, self.stored(damage.reading)
        packed = reading.packed(self.rgb)
        if damage.kind == FIRST_NUMBER:
            meant = getattr(self, self.name(reading))
            return np.asarray((packed == reading.background) & (meant[:1] == 0))
        if damage.kind == OVERFLOW:
            # Eight bits may be in blue alone, with red and green black, or in all three channels.
            low = stored & (2**damage.bits - 1)
            return np.asarray((packed == low) | ((damage.bits == 8) & (packed == low * 0x010101)))
        margin = MAX_LOSSY_STEPS if damage.kind == LOSSY else 0
        matching = np.ones((1, *stored.shape[1:]), dtype=np.bool_)
        for channel, shift in zip(reading.channels, (16, 8, 0), strict=True):
            parts, byte = stored >> shift & 255, self.rgb[..., channel].astype(np.int32)
            matching &= (byte >= parts.min(axis=0) - margin) & (byte <= parts.max(axis=0) + margin)
        return matching


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
        return self.best(partial(_Beside.same, reading=reading), background=reading.background)

    def best(self, matching: Callable[[_Beside], Mask], background: int = 0) -> Agreement:
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
                matched += int((matching(beside).any(axis=0) & some).sum())
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
        height, width = truth.triangle.shape
        step = max(1, min(height, width) // COMPARED_LINES) if thinned else 1
        places = sorted(itertools.product(range(3), range(3)), key=lambda place: place != (1, 1))

        def around(numbers: Numbers) -> Numbers:
            padded = np.pad(numbers, 1, mode="edge")
            return np.stack([padded[r : r + height : step, c : c + width : step] for r, c in places])

        return _Beside(
            rgb=orientation.upright(stored_rgb(image))[::step, ::step],
            triangle=around(truth.triangle),
            object=around(truth.object),
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
        # The shares of pixels that are as bright as the truth in either encoding.
        linear, encoded = (
            np.mean(np.abs(radiance(rgb, one).mean(axis=-1) - np.clip(gray, 0.0, 1.0)) <= COLOR_TOLERANCE)
            for one in (Encoding.RGB, Encoding.SRGB)
        )
        is_encoded = encoded >= MIN_SAME_COLOR_FRACTION and encoded > linear
        return Reading(encoding=Encoding.SRGB if is_encoded else Encoding.RGB)


def spoiled_numbers(truth: StoredTruth, stated: Reading) -> tuple[Fault, Restoring] | None:
    """Find damage after which numbers are lost: high bits cut off, neighbors mixed, lossy compression."""
    count = len(truth.reference.scene.faces)
    stored_as = [image.stored for image in truth.images if isinstance(image, ForeignImage)]
    named_lossy = any(one is not None and one.lossy for one in stored_as)
    tried = [Restoring(kind=OVERFLOW, reading=stated, bits=bits) for bits in (8, 16) if count >= 2**bits]
    tried = tried if stated.encoding is Encoding.TRIANGLE_ID else []
    tried += [Restoring(kind=kind, reading=stated) for kind in (RESAMPLED, LOSSY)[named_lossy:]]
    for damage in tried:
        found = truth.best(partial(_Beside.explained, damage=damage))
        accounted, restoring = found.share >= MIN_ACCOUNTED_FRACTION, replace(damage, agreement=found)
        if damage.kind == OVERFLOW:
            if accounted:
                words = f"only the low {damage.bits} bits of each number are stored, of {count:,} triangles"
                words += ": others are lost"
                return Fault(fault=OVERFLOW, value=float(damage.bits), unit="bits", words=words), restoring
            continue
        parts = truth.all_beside(found)
        same = [part.same(stated)[:, part.shown()].any(axis=0) for part in parts]
        mixed = 1 - float(np.concatenate(same).mean())
        stored = np.concatenate([stated.packed(part.rgb).ravel() for part in parts])
        should = np.concatenate([part.stored(stated)[0].ravel() for part in parts])
        new = len(np.unique(stored)) >= MIN_VALUES_FACTOR * len(np.unique(should))
        if (accounted and mixed >= MIN_MIXED_FRACTION and new) or (damage.kind == LOSSY and named_lossy):
            words = f"numbers are mixed with their neighbors' in {mixed:.0%} of the pixels, "
            words += "by filtering, resizing or anti-aliasing: numbers have no averages"
            if damage.kind == LOSSY:
                words = "numbers went through lossy compression, such as JPEG: write PNG"
            return Fault(fault=damage.kind, value=mixed, unit="share", words=words), restoring
    return None


def repeated_pixels(truth: StoredTruth, stated: Reading) -> tuple[Fault, Restoring] | None:
    """Find pictures that were drawn smaller and enlarged by repeating columns and rows."""
    images = [stated.packed(stored_rgb(image)) for image in truth.images]
    expected = [truth.truth(image.camera.aperture.index).triangle for image in truth.images]

    def repeated(images: Sequence[Numbers], axis: int) -> float:
        """Return the share of rows (axis 0) or columns that repeat the ones before, uniform ones left out."""
        same = telling = 0
        for image in images:
            lines = np.moveaxis(image, axis, 0)
            several = (lines[:-1] != lines[:-1, :1]).any(axis=1)
            telling += int(several.sum())
            same += int((several & (lines[1:] == lines[:-1]).all(axis=1)).sum())
        return same / telling if telling else 0.0

    shares = [repeated(images, axis) for axis in (0, 1)]
    usual = [repeated(expected, axis) for axis in (0, 1)]
    if any(mine < MIN_REPEATED_FRACTION or its > mine / 2 for mine, its in zip(shares, usual, strict=True)):
        return None
    share = float(np.mean(shares))
    words = f"{share:.0%} of columns and rows repeat the ones before: images were drawn smaller and enlarged"
    restoring = Restoring(kind=RESAMPLED, reading=stated, agreement=truth.agreement(stated))
    return Fault(fault=RESAMPLED, value=share, unit="share", words=words), restoring
