"""The meaning of stored pixels, found by reading them in other ways and comparing with the scene.

Readings are found by trying, as `xfrustum.compare.diagnosis.geometry_fit` finds orientations. Numbers of
triangles are judged by the claims that they make (`xfrustum.compare.diagnosis.claims`), which hold
whatever lies in front. Everything else is compared with the truth in
`xfrustum.compare.diagnosis.stored_truth`. Another reading is a finding only where it holds and the stated
reading fails.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.diagnosis.claims import Claims, claims_of, outside_px
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.diagnosis.geometry_fit import fit_geometry
from xfrustum.compare.diagnosis.stored_truth import (
    FIRST_NUMBER,
    LOSSY,
    OVERFLOW,
    RESAMPLED,
    Restoring,
    StoredTruth,
    repeated_pixels,
    spoiled_numbers,
)
from xfrustum.compare.renderer_model.conventions import UPRIGHT, orientations
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference import Reference
from xfrustum.scenes.files.foreign_images import (
    Encoding,
    ForeignImage,
    Reading,
    read_again,
    stored_integers,
    stored_rgb,
)
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene

CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID = "channel-order", "id-offset", "background-id"
WRONG_ENCODING = "wrong-encoding"
ENCODING_FAULTS = (CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID, WRONG_ENCODING, OVERFLOW, RESAMPLED, LOSSY)

NUMBER_ENCODINGS = (Encoding.TRIANGLE_ID, Encoding.OBJECT_ID)
"""Encodings whose pixels hold numbers and not colors."""

# Largest mean distance by which the claims of a right reading fail: about 20 times the distance by which
# rasterizers snap edges (`geometry_fit.SNAP_PX`). Beyond a pixel off, claims fail altogether: even those at
# the other side of a triangle do not hold. One claim counts with the cap at most; that of a triangle that
# does not exist counts with it.
MAX_HELD_MISFIT_PX, MIN_FAILED_MISFIT_PX, MISFIT_CAP_PX = 0.05, 1.0, 8.0

# Smallest ratio of the misfit of the stated reading to the misfit of a better one. Most wrong numbers belong
# to a triangle within a pixel or two, so that even a wrong reading has a small misfit on a fine mesh; but the
# misfit of the right reading is that of rounding alone.
MIN_IMPROVEMENT = 4.0

# Smallest share of the stored integers that name something in the scene under a right reading; one in a
# hundred may be damaged.
MIN_VALID_FRACTION = 0.99

# Smallest number of claims by which readings are told apart, and largest number that are tried under every
# orientation and order; more do not change which reading is best.
MIN_CLAIMS, MAX_SEARCHED_CLAIMS = 100, 600

# Orders of the channels, RGB first, then OpenCV's BGR. Of orders that images cannot tell apart, the one that
# comes first here is named first.
CHANNEL_ORDERS = ((0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1), (1, 2, 0), (2, 0, 1))

# Near offsets that are tried, as parts of the reach.
NEAR_FRACTIONS = (0.0, 1e-3, 1e-2, 1e-1)

# Smallest shares of pixels that agree with the truth to within a pixel under a right reading. The second one
# applies to objects of a renderer that may draw with another near offset or a moved scene, which change them.
MIN_AGREEING_FRACTION, MIN_AGREEING_OBJECTS_FRACTION = 0.9, 0.6

_ENCODING_WORDS = {
    Encoding.TRIANGLE_ID: "numbers of triangles",
    Encoding.OBJECT_ID: "numbers of objects",
    Encoding.RGB: "colors",
    Encoding.SRGB: "colors",
}


@dataclass(frozen=True, kw_only=True)
class FoundEncoding:
    """The way to read a renderer's images; without a reading the stated one holds.

    `faults` are its differences from the stated one. Where all numbers are lost, or number 0 alone, which is
    stored like nothing, `restoring` puts them back for the figures after correction.
    """

    faults: tuple[Fault, ...] = ()
    reading: Reading | None = None
    restoring: Restoring | None = None

    @property
    def as_colors(self) -> bool:
        """Whether pixels that should be numbers are colors."""
        return self.reading is not None and self.reading.encoding not in NUMBER_ENCODINGS

    def read(self, reference: Reference, image: HogelImage) -> HogelImage:
        """Return an image read in this way, with lost numbers restored."""
        return self.plainly(image) if self.restoring is None else self.restoring.read(reference, image)

    def plainly(self, image: HogelImage) -> HogelImage:
        """Return an image read in this way, without restoring lost numbers."""
        return image if self.reading is None else read_again(image, self.reading)


def find_encoding(reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel) -> FoundEncoding:
    """Find the way to read a renderer's images, where the stated way does not hold.

    `nominal` is the model of the renderer by its author's statements.
    """
    # Of images without numbers or stored colors, no other reading is possible.
    if any((image.triangle != NOTHING).any() for image in images):
        stated = Reading(encoding=Encoding.TRIANGLE_ID)
    elif any((image.object != NOTHING).any() for image in images):
        stated = Reading(encoding=Encoding.OBJECT_ID)
    elif all(_is_picture(image) and image.color is not None for image in images):
        stated = Reading(encoding=Encoding.RGB)
    else:
        return FoundEncoding()
    told = [one for one in images if (stored_integers(one, stated) != 0).any()]
    if not told:
        return FoundEncoding()
    truth = StoredTruth(reference, told)
    found = _Search(scene=reference.scene, images=told, nominal=nominal, stated=stated, truth=truth).found()
    if found is not None and found.reading is not None and found.reading.first_is_lost:
        agreement = truth.agreement(found.reading)
        lost = Restoring(kind=FIRST_NUMBER, reading=found.reading, agreement=agreement)
        return replace(found, restoring=lost)
    return found or FoundEncoding()


def _is_picture(image: HogelImage) -> bool:
    return isinstance(image, ForeignImage) and image.stored is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """The search for another reading of images that are stated to hold something."""

    scene: Scene
    images: Sequence[HogelImage]
    nominal: DrawnModel
    stated: Reading
    truth: StoredTruth

    def found(self) -> FoundEncoding | None:  # noqa: PLR0911 - one for each way to fail
        """Find another reading that holds where the stated one fails."""
        stated, pictures = self.stated, any(map(_is_picture, self.images))
        triangles, objects = (replace(stated, encoding=one) for one in NUMBER_ENCODINGS)
        if stated.encoding is Encoding.RGB:
            found = self._by_claims(triangles, MAX_HELD_MISFIT_PX * MIN_IMPROVEMENT)
            return found or self._by_objects(objects, 0.0)
        if stated.encoding is Encoding.OBJECT_ID:
            agreeing = self.truth.agreement(stated).share
            if agreeing >= MIN_AGREEING_FRACTION:
                return None
            found = self._by_objects(stated, agreeing)
            if found is None and pictures:
                found = self._by_claims(triangles, np.inf)
        else:
            left = self._misfit(stated)
            if left <= MAX_HELD_MISFIT_PX:
                return None
            found = self._by_claims(stated, left)
            if found is None and left <= MIN_FAILED_MISFIT_PX:
                # Enlarged pictures claim triangles beside the right ones: they fail by less than a pixel.
                repeated = repeated_pixels(self.truth, stated)
                return repeated and FoundEncoding(faults=repeated[:1], restoring=repeated[1])
            found = found or self._by_objects(objects, 0.0)
        # What is left is compared with the truth.
        spoiled = None if found else spoiled_numbers(self.truth, stated)
        if spoiled is not None:
            return FoundEncoding(faults=spoiled[:1], restoring=spoiled[1])
        # Pixels that name things in the scene are numbers, right or wrong, and not colors.
        if found is None and pictures and self._valid_share(stated) < MIN_VALID_FRACTION:
            colors = self.truth.colors()
            if colors is not None:
                return FoundEncoding(faults=_faults(stated, colors, ()), reading=colors)
        return found

    def _read(self, reading: Reading) -> Claims:
        """Return what the images claim in some reading."""
        return claims_of(self.scene, [read_again(image, reading) for image in self.images])

    def _by_claims(self, start: Reading, left: float) -> FoundEncoding | None:
        """Find the reading, derived from one whose claims have the misfit `left`, under which claims hold."""
        readings = [one for one in self._others(start) if len(self._read(one)) >= MIN_CLAIMS]
        misfits = [self._misfit(reading) for reading in readings]
        least = min(misfits, default=np.inf)
        if least > min(MIN_FAILED_MISFIT_PX * MIN_IMPROVEMENT, left):
            return None
        best = readings[misfits.index(least)]
        fit = fit_geometry(self._read(best), self.scene, self.nominal)
        if not fit.holds:
            return None
        if start.encoding is self.stated.encoding and self._valid_share(start) > 0.5:
            noise = fit_geometry(self._read(start), self.scene, self.nominal).noise_px
            better = max(fit.noise_px, MAX_HELD_MISFIT_PX) * MIN_IMPROVEMENT <= noise
            if not better and least * MIN_IMPROVEMENT > left:
                return None
        return self._as_found(best, readings)

    def _by_objects(self, start: Reading, agreeing: float) -> FoundEncoding | None:
        """Find the reading under which pixels name the objects that the truth shows."""
        readings = list(self._others(start))
        shares = [self.truth.agreement(reading).share for reading in readings]
        most, same = max(shares, default=0.0), start.encoding is self.stated.encoding
        enough = MIN_AGREEING_OBJECTS_FRACTION if same else MIN_AGREEING_FRACTION
        if most < enough or (1 - most) * MIN_IMPROVEMENT > 1 - agreeing:
            return None
        return self._as_found(readings[shares.index(most)], readings)

    def _as_found(self, best: Reading, readings: Sequence[Reading]) -> FoundEncoding:
        """Return a reading with its faults, and with those that give the same numbers from other channels."""
        stored = [stored_rgb(image) for image in self.images]
        same = [
            reading
            for reading in readings
            if reading.channels != best.channels
            and (reading.offset, reading.background) == (best.offset, best.background)
            and all(np.array_equal(reading.packed(rgb), best.packed(rgb)) for rgb in stored)
        ]
        return FoundEncoding(faults=_faults(self.stated, best, same), reading=best)

    def _others(self, start: Reading) -> Iterator[Reading]:
        """Yield readings under which nearly all stored numbers exist, without the stated one."""
        pictures = all(map(_is_picture, self.images))
        for channels in CHANNEL_ORDERS if pictures else CHANNEL_ORDERS[:1]:
            for offset in (1, 0, 2):
                plain = replace(start, channels=channels, offset=offset)
                # Nothing may be stored as the most frequent integer that names nothing in the scene.
                packed = np.concatenate([stored_integers(one, plain).ravel() for one in self.images])
                strange = packed[plain.numbers(packed) >= self._count(plain)]
                values, counts = np.unique(strange, return_counts=True)
                common = [int(values[np.argmax(counts)])] if len(values) else []
                for background in dict.fromkeys((0, *common)):
                    reading = replace(plain, background=background)
                    if reading != self.stated and self._valid_share(reading) >= MIN_VALID_FRACTION:
                        yield reading

    def _count(self, reading: Reading) -> int:
        return len(self.scene.objects) if reading.encoding is Encoding.OBJECT_ID else len(self.scene.faces)

    def _valid_share(self, reading: Reading) -> float:
        """Return the share of pixels whose number exists in the scene, among all pixels with a number."""
        parts = [reading.numbers(stored_integers(image, reading)).ravel() for image in self.images]
        numbers = np.concatenate(parts)
        named = int((numbers != NOTHING).sum())
        valid = int(((numbers >= 0) & (numbers < self._count(reading))).sum())
        return valid / named if named else 0.0

    def _misfit(self, reading: Reading) -> float:
        """Return the mean distance by which claims fail under the best conventions and near offset, px."""
        scene, nominal, valid = self.scene, self.nominal, self._valid_share(reading)
        claims = self._read(reading).thinned(MAX_SEARCHED_CLAIMS) if valid else None
        if claims is None or not len(claims):
            return MISFIT_CAP_PX

        def failing(model: DrawnModel) -> float:
            return float(outside_px(claims, scene, model, MISFIT_CAP_PX).mean())

        held = failing(nominal)
        if held > MAX_HELD_MISFIT_PX:
            several = len(np.unique(claims.hogel, axis=0)) > 1
            orders = list(orientations(claims.hogels)) if several else [UPRIGHT]
            nears = {nominal.near, *(part * scene.frustum.longest_reach for part in NEAR_FRACTIONS)}
            tried = itertools.product(orientations(claims.size), orders, sorted(nears))
            models = (replace(nominal, orientation=one, order=two, near=near) for one, two, near in tried)
            held = min(held, *map(failing, models))
        return valid * held + (1 - valid) * MISFIT_CAP_PX


def _faults(stated: Reading, found: Reading, same: Sequence[Reading]) -> tuple[Fault, ...]:
    """Return the differences between a reading and the stated one as faults."""
    faults, (letters, *others) = [], ["".join("RGB"[one] for one in way.channels) for way in (found, *same)]
    if found.encoding is not stated.encoding:
        words = f"pixels hold {_ENCODING_WORDS[found.encoding]}, not {_ENCODING_WORDS[stated.encoding]}: "
        words += f"--encoding {found.encoding}"
        faults.append(Fault(fault=WRONG_ENCODING, value=str(found.encoding), words=words))
    if found.channels != stated.channels:
        words = f"channels are in another order: numbers are stored as {letters}, not as RGB"
        words += f" (or as {' or '.join(others)}: with so few numbers images cannot tell)" if others else ""
        faults.append(Fault(fault=CHANNEL_ORDER, value=letters, words=words))
    if found.offset != stated.offset:
        kept = f"number + {found.offset}" if found.offset else "the number itself"
        words = f"{kept} is stored, not number + {stated.offset}: all are off by one"
        value = float(found.offset - stated.offset)
        faults.append(Fault(fault=ID_OFFSET, value=value, unit="number", words=words))
    if found.background != stated.background:
        words = f"nothing is stored as {found.background}, not as {stated.background}"
        faults.append(Fault(fault=BACKGROUND_ID, value=float(found.background), unit="number", words=words))
    return tuple(faults)
