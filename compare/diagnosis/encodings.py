"""What do the pixels of a picture mean? Found by reading them in other ways, and comparing with the scene.

As `xfrustum.compare.diagnosis.geometry_fit` finds orientations: by trying. Numbers of triangles are
compared by what
their pixels claim (`xfrustum.compare.diagnosis.containment`), which holds whatever lies in front; all else
is compared
with the truth in `xfrustum.compare.diagnosis.stored_truth`. Another reading is found only where the one
that was stated
fails and it holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from xfrustum.compare.diagnosis.claims import claims_of
from xfrustum.compare.diagnosis.containment import outside_px
from xfrustum.compare.diagnosis.faults import CONVENTIONS, Fault
from xfrustum.compare.diagnosis.geometry_fit import fit_geometry
from xfrustum.compare.diagnosis.stored_truth import (
    LOSSY,
    OVERFLOW,
    RESAMPLED,
    Restoring,
    StoredTruth,
    repeated_pixels,
    restored_first,
    spoiled_numbers,
)
from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.compare.renderer_model.orientations import UPRIGHT, orientations
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

CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID, WRONG_ENCODING = (
    "channel-order",
    "id-offset",
    "background-id",
    "wrong-encoding",
)
ENCODING_FAULTS = (CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID, WRONG_ENCODING, OVERFLOW, RESAMPLED, LOSSY)

ENCODING = "encoding"
"""What `accept` calls all of them; numbers that are lost cannot be accepted."""

ACCEPTABLE = (*CONVENTIONS, ENCODING)
"""What a renderer's author may declare, so that images are judged by what was found."""

NUMBER_ENCODINGS = (Encoding.TRIANGLE_ID, Encoding.OBJECT_ID)

MAX_HELD_MISFIT_PX = 0.05
"""Mean distance by which claims of a reading that is right may fail: 20 times what rasterizers snap edges
by."""

MIN_FAILED_MISFIT_PX = 1.0
"""Mean distance beyond which claims fail altogether: then even those at a triangle's other side do not
hold."""

MISFIT_CAP_PX = 8.0
"""How much one claim counts at most; so much counts a claim of what does not exist."""

MIN_IMPROVEMENT = 4.0
"""How many times less another reading must leave than the stated one. A wrong number is most often that of a
triangle within a pixel or two, so that even the wrong one of two readings leaves little on a fine mesh; but
the right one leaves what rounding leaves."""

MIN_VALID_FRACTION = 0.99
"""Share of stored integers that must exist under a reading that is right; the others are damage."""

MAX_SEARCHED_CLAIMS = 600
"""Claims that are looked at under every orientation and order; more do not change which reading is best."""

CHANNEL_ORDERS = ((0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1), (1, 2, 0), (2, 0, 1))
"""The right one first, then OpenCV's: of those that cannot be told apart, the first is named first."""

MIN_CLAIMS = 100
"""Claims that it takes to tell readings apart."""

NEAR_FRACTIONS = (0.0, 1e-3, 1e-2, 1e-1)
"""Near offsets that claims are tried with, as parts of the reach."""

MIN_AGREEING_FRACTION, MIN_AGREEING_OBJECTS_FRACTION = 0.9, 0.6
"""Share of pixels that must agree with the truth to within a pixel, under a reading that is right: of
triangles, and of objects, which near offsets and moved scenes change."""


@dataclass(frozen=True, kw_only=True)
class FoundEncoding:
    """How images are to be read.

    Attributes
    ----------
    faults
        What is otherwise than stated.
    reading
        How to read the stored pixels; None where they are as stated.
    restoring
        Where numbers were lost, all or only the first one, which looks like nothing: how to tell which were
        meant, for the figures after correction.
    """

    faults: tuple[Fault, ...] = ()
    reading: Reading | None = None
    restoring: Restoring | None = None

    @property
    def as_colors(self) -> bool:
        """Whether pixels that should be numbers are colors."""
        return self.reading is not None and self.reading.encoding not in NUMBER_ENCODINGS

    def read(self, image: HogelImage) -> HogelImage:
        """Return an image as it is read now; the image itself where nothing was found."""
        return self.plainly(image) if self.restoring is None else self.restoring.read(image)

    def plainly(self, image: HogelImage) -> HogelImage:
        """Return an image as it is read now, without telling which numbers were meant that are lost."""
        return image if self.reading is None else read_again(image, self.reading)


def find_encoding(reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel) -> FoundEncoding:
    """Find out what the pixels of a renderer's images mean, where they do not mean what was stated.

    Parameters
    ----------
    reference
        Of the scene.
    images
        Some of the renderer's hogels as found.
    nominal
        What its author says of it.
    """
    stated = _stated(images)
    if stated is None:
        return FoundEncoding()
    told = [image for image in images if (stored_integers(image, stated) != 0).any()]
    if not told:
        return FoundEncoding()
    if stated.encoding in NUMBER_ENCODINGS:
        found = _numbers(reference, told, nominal, stated)
    else:
        found = _numbers_as_colors(reference, told, nominal)
    if found is not None and found.reading is not None and found.reading.first_is_lost:
        restoring = restored_first(StoredTruth(reference, told), found.reading)
        return replace(found, restoring=restoring)
    return found or FoundEncoding()


def _stated(images: Sequence[HogelImage]) -> Reading | None:
    """Return how images are read as stated; None where there is nothing to be read in another way."""
    if any((image.triangle != NOTHING).any() for image in images):
        return Reading(encoding=Encoding.TRIANGLE_ID)
    if any((image.object != NOTHING).any() for image in images):
        return Reading(encoding=Encoding.OBJECT_ID)
    if images and all(_is_picture(image) and image.color is not None for image in images):
        return Reading(encoding=Encoding.RGB)
    return None


def _is_picture(image: HogelImage) -> bool:
    return isinstance(image, ForeignImage) and image.stored is not None


def _numbers(
    reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel, stated: Reading
) -> FoundEncoding | None:
    """Find how numbers are to be read that are stated to be numbers."""
    scene = reference.scene
    truth = StoredTruth(reference, images)
    if stated.encoding is Encoding.TRIANGLE_ID:
        left = _misfit(scene, images, stated, nominal)
        if left <= MAX_HELD_MISFIT_PX:
            return None
        found = _by_claims(scene, images, nominal, stated, left)
        if found is None and left <= MIN_FAILED_MISFIT_PX:
            # Enlarged pictures claim triangles beside the right ones.
            repeated = repeated_pixels(truth, stated)
            return None if repeated is None else FoundEncoding(faults=repeated[:1], restoring=repeated[1])
        if found is not None:
            return found
    else:
        agreeing = truth.agreement(stated)
        if agreeing.share >= MIN_AGREEING_FRACTION:
            return None
        found = _by_objects(scene, images, truth, stated, agreeing.share)
        if found is None and any(_is_picture(image) for image in images):
            triangles = replace(stated, encoding=Encoding.TRIANGLE_ID)
            found = _by_claims(scene, images, nominal, triangles, np.inf, stated)
        if found is not None:
            return found
    return _by_truth(scene, images, truth, stated)


def _by_truth(
    scene: Scene, images: Sequence[HogelImage], truth: StoredTruth, stated: Reading
) -> FoundEncoding | None:
    """Find what else the pixels hold that should be numbers."""
    if stated.encoding is Encoding.TRIANGLE_ID:
        objects = replace(stated, encoding=Encoding.OBJECT_ID)
        found = _by_objects(scene, images, truth, objects, 0.0, stated)
        if found is not None:
            return found
    spoiled = spoiled_numbers(truth, stated)
    if spoiled is not None:
        fault, restoring = spoiled
        return FoundEncoding(faults=(fault,), restoring=restoring)
    # Numbers that exist are numbers, though they be the wrong ones.
    if (
        any(_is_picture(image) for image in images)
        and _valid_share(scene, images, stated) < MIN_VALID_FRACTION
    ):
        colors = truth.colors()
        if colors is not None:
            return FoundEncoding(faults=_faults(stated, colors, ()), reading=colors)
    return None


def _by_claims(
    scene: Scene,
    images: Sequence[HogelImage],
    nominal: DrawnModel,
    start: Reading,
    left: float,
    stated: Reading | None = None,
) -> FoundEncoding | None:
    """Find the reading under which pixels claim triangles that they lie in.

    Parameters
    ----------
    scene, images, nominal
        As for `find_encoding`.
    start
        A reading as triangles; others are made from it.
    left
        What claims leave under it.
    stated
        What the author says, where that is something else.
    """
    readings = [
        reading
        for reading in _others(scene, images, start, include=stated is not None)
        if len(claims_of(scene, [read_again(image, reading) for image in images])) >= MIN_CLAIMS
    ]
    if not readings:
        return None
    ranked = [(_misfit(scene, images, reading, nominal), reading) for reading in readings]
    least = min(misfit for misfit, _ in ranked)
    if least > min(MIN_FAILED_MISFIT_PX * MIN_IMPROVEMENT, left):
        return None
    best = next(reading for misfit, reading in ranked if misfit == least)
    claims = claims_of(scene, [read_again(image, best) for image in images])
    fit = fit_geometry(claims, scene, nominal)
    valid = _valid_share(scene, images, start)
    if not fit.holds:
        return None
    if stated is None and valid > 0.5:
        before = claims_of(scene, [read_again(image, start) for image in images])
        noise = fit_geometry(before, scene, nominal).noise_px
        if max(fit.noise_px, MAX_HELD_MISFIT_PX) * MIN_IMPROVEMENT > noise and least * MIN_IMPROVEMENT > left:
            return None
    same = _indistinct(images, best, readings)
    return FoundEncoding(faults=_faults(stated or start, best, same), reading=best)


def _by_objects(
    scene: Scene,
    images: Sequence[HogelImage],
    truth: StoredTruth,
    start: Reading,
    agreeing: float,
    stated: Reading | None = None,
) -> FoundEncoding | None:
    """Find the reading under which pixels name the objects that the truth shows."""
    readings = list(_others(scene, images, start, include=stated is not None))
    if not readings:
        return None
    shares = [truth.agreement(reading).share for reading in readings]
    best = readings[int(np.argmax(shares))]
    least = MIN_AGREEING_OBJECTS_FRACTION if stated is None else MIN_AGREEING_FRACTION
    if max(shares) < least or (1 - max(shares)) * MIN_IMPROVEMENT > 1 - agreeing:
        return None
    same = _indistinct(images, best, readings)
    return FoundEncoding(faults=_faults(stated or start, best, same), reading=best)


def _numbers_as_colors(
    reference: Reference, images: Sequence[HogelImage], nominal: DrawnModel
) -> FoundEncoding | None:
    """Find numbers in pictures that are stated to hold colors."""
    scene, stated = reference.scene, Reading(encoding=Encoding.RGB)
    triangles = replace(stated, encoding=Encoding.TRIANGLE_ID)
    found = _by_claims(scene, images, nominal, triangles, MAX_HELD_MISFIT_PX * MIN_IMPROVEMENT, stated)
    if found is not None:
        return found
    objects = replace(stated, encoding=Encoding.OBJECT_ID)
    if not any(True for _ in _others(scene, images, objects, include=True)):
        return None
    return _by_objects(scene, images, StoredTruth(reference, images), objects, 0.0, stated)


def _others(
    scene: Scene, images: Sequence[HogelImage], start: Reading, *, include: bool
) -> Iterator[Reading]:
    """Yield readings under which nearly all that is stored exists: `start` only if asked, and first."""
    pictures = all(_is_picture(image) for image in images)
    for channels in CHANNEL_ORDERS if pictures else CHANNEL_ORDERS[:1]:
        for offset in (1, 0, 2):
            plain = replace(start, channels=channels, offset=offset)
            for background in dict.fromkeys((0, _common_strange(scene, images, plain))):
                reading = replace(plain, background=background)
                if reading == start and not include:
                    continue
                if _valid_share(scene, images, reading) >= MIN_VALID_FRACTION:
                    yield reading


def _common_strange(scene: Scene, images: Sequence[HogelImage], reading: Reading) -> int:
    """Return the stored integer that most pixels have of those that do not exist; 0 where all exist."""
    strange = []
    for image in images:
        packed = stored_integers(image, reading)
        strange.append(packed[reading.numbers(packed) >= _count(scene, reading)])
    values, counts = np.unique(np.concatenate(strange), return_counts=True)
    return int(values[np.argmax(counts)]) if len(values) else 0


def _count(scene: Scene, reading: Reading) -> int:
    return len(scene.objects) if reading.encoding is Encoding.OBJECT_ID else len(scene.faces)


def _valid_share(scene: Scene, images: Sequence[HogelImage], reading: Reading) -> float:
    """Return the share of pixels that name something which exists, of those that name something."""
    named, valid = 0, 0
    for image in images:
        numbers = reading.numbers(stored_integers(image, reading))
        named += int((numbers != NOTHING).sum())
        valid += int(((numbers >= 0) & (numbers < _count(scene, reading))).sum())
    return valid / named if named else 0.0


def _misfit(scene: Scene, images: Sequence[HogelImage], reading: Reading, nominal: DrawnModel) -> float:
    """Return by how much claims fail on the average, px, under the best conventions and near offset."""
    valid = _valid_share(scene, images, reading)
    read = [read_again(image, reading) for image in images]
    claims = claims_of(scene, read).thinned(MAX_SEARCHED_CLAIMS) if valid else None
    if claims is None or not len(claims):
        return MISFIT_CAP_PX
    held = float(outside_px(claims, scene, nominal, MISFIT_CAP_PX).mean())
    if held > MAX_HELD_MISFIT_PX:
        several = len(np.unique(claims.hogel, axis=0)) > 1
        orders = list(orientations(claims.hogels)) if several else [UPRIGHT]
        reach = scene.frustum.longest_reach
        nears = sorted({nominal.near, *(part * reach for part in NEAR_FRACTIONS)})
        for orientation, order in itertools.product(orientations(claims.size), orders):
            for near in nears:
                model = replace(nominal, orientation=orientation, order=order, near=near)
                held = min(held, float(outside_px(claims, scene, model, MISFIT_CAP_PX).mean()))
    return valid * held + (1 - valid) * MISFIT_CAP_PX


def _indistinct(
    images: Sequence[HogelImage], best: Reading, readings: Sequence[Reading]
) -> tuple[Reading, ...]:
    """Return the other readings that read every pixel alike."""
    return tuple(
        reading
        for reading in readings
        if reading.channels != best.channels
        and (reading.offset, reading.background) == (best.offset, best.background)
        and all(
            np.array_equal(reading.packed(stored_rgb(image)), best.packed(stored_rgb(image)))
            for image in images
        )
    )


def _faults(stated: Reading, found: Reading, same: Sequence[Reading]) -> tuple[Fault, ...]:
    """Name what a reading has that the stated one has not."""
    faults = []
    if found.encoding is not stated.encoding:
        words = (
            f"pixels hold {_ENCODING_WORDS[found.encoding]}, not {_ENCODING_WORDS[stated.encoding]}: "
            f"--encoding {found.encoding}"
        )
        faults.append(Fault(fault=WRONG_ENCODING, value=str(found.encoding), words=words))
    if found.channels != stated.channels:
        words = f"channels are in another order: numbers are stored as {_letters(found)}, not as RGB"
        if same:
            others = " or ".join(_letters(reading) for reading in same)
            words += f" (or as {others}: with so few numbers images cannot tell)"
        faults.append(Fault(fault=CHANNEL_ORDER, value=_letters(found), words=words))
    if found.offset != stated.offset:
        kept = f"number + {found.offset}" if found.offset else "the number itself"
        words = f"{kept} is stored, not number + {stated.offset}: all are off by one"
        value = float(found.offset - stated.offset)
        faults.append(Fault(fault=ID_OFFSET, value=value, unit="number", words=words))
    if found.background != stated.background:
        words = f"nothing is stored as {found.background}, not as {stated.background}"
        faults.append(Fault(fault=BACKGROUND_ID, value=float(found.background), unit="number", words=words))
    return tuple(faults)


def _letters(reading: Reading) -> str:
    return "".join("RGB"[channel] for channel in reading.channels)


_ENCODING_WORDS = {
    Encoding.TRIANGLE_ID: "numbers of triangles",
    Encoding.OBJECT_ID: "numbers of objects",
    Encoding.RGB: "colors",
    Encoding.SRGB: "colors",
}
