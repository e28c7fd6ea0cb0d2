"""Search for the encoding of stored pixels, by testing alternative readings against the scene.

A reading maps stored bytes to numbers or colors. Triangle numbers are tested by their claims
(`xfrustum.compare.diagnosis.geometry_fit`), which do not depend on occlusion. Other readings are
compared with the truth, encoded with and without damage. Another reading is accepted only if it
fits and the stated reading does not.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from xfrustum.compare.diagnosis.defects import Defect
from xfrustum.compare.diagnosis.geometry_fit import fit_geometry
from xfrustum.compare.diagnosis.testset import PixelClaims, claims_of, outside_px, spread
from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation, orientations
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import (
    COLOR_TOLERANCE,
    as_gray,
    as_stored,
    reference_colors,
    trace_drawn,
)
from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Numbers
from xfrustum.scenes.files.pictures import (
    Encoding,
    Reading,
    Transfer,
    bytes_of,
    is_picture,
    radiance,
    read_again,
    stored_integers,
    stored_rgb,
)
from xfrustum.scenes.model.images import NOTHING, HogelImage

CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID = "channel-order", "id-offset", "background-id"
# Defects of colors stored with another curve than stated; the last name is for all other curves.
SRGB_READ_AS_LINEAR, LINEAR_READ_AS_SRGB = "srgb-read-as-linear", "linear-read-as-srgb"
GAMMA, WRONG_TRANSFER = "gamma", "wrong-transfer"
WRONG_ENCODING, RESTARTING = "wrong-encoding", "numbers-restarting"
OVERFLOW, RESAMPLED, LOSSY = "8-bit-overflow", "resampled", "lossy"
TRANSFER_FAULTS = (SRGB_READ_AS_LINEAR, LINEAR_READ_AS_SRGB, GAMMA, WRONG_TRANSFER)
ENCODING_FAULTS = (
    *(CHANNEL_ORDER, ID_OFFSET, BACKGROUND_ID, WRONG_ENCODING),
    *TRANSFER_FAULTS,
    *(OVERFLOW, RESTARTING, RESAMPLED, LOSSY),
)
"""Names of encoding defects; under the last four, numbers are lost."""

TRUE = RendererModel()  #: the renderer that draws the true crossed frustum

# Damage that loses only number 0, stored like the background. It is not a defect by itself.
FIRST_NUMBER = "first"

NUMBER_ENCODINGS = (Encoding.TRIANGLE_ID, Encoding.OBJECT_ID)
# Channel orders, RGB first, then OpenCV's BGR. If several give the same images, the earliest is
# reported first.
CHANNEL_ORDERS = ((0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1), (1, 2, 0), (2, 0, 1))

# Limits of the mean distance, in pixels, by which claims fail. A correct reading has at most
# `MAX_HELD_MISFIT_PX`, about 20 times the distance by which rasterizers snap edges
# (`geometry_fit.SNAP_PX`). A failed reading has at least `MIN_FAILED_MISFIT_PX`. A single claim
# counts at most the cap. A triangle number that does not exist counts the cap.
MAX_HELD_MISFIT_PX, MIN_FAILED_MISFIT_PX, MISFIT_CAP_PX = 0.05, 1.0, 8.0

# Smallest ratio of the misfit of the stated reading to the misfit of a better reading. On a fine
# mesh even a wrong reading has a small misfit, because most wrong numbers belong to a triangle
# within a pixel or two. The misfit of the correct reading is only rounding.
MIN_IMPROVEMENT = 4.0

# Smallest share of stored integers that exist in the scene, for a correct reading: one in a hundred
# may be damaged.
MIN_VALID_FRACTION = 0.99

# Smallest number of claims that distinguishes readings. Largest numbers of claims, of hogels, and
# of rows and columns per hogel in the search; larger numbers do not change the result. Tested near
# offsets, as fractions of the reach.
MIN_CLAIMS, MAX_SEARCHED_CLAIMS, MAX_COMPARED_HOGELS, COMPARED_LINES = 100, 600, 3, 100
NEAR_FRACTIONS = (0.0, 1e-3, 1e-2, 1e-1)

# Smallest shares of pixels that agree with the truth to within a pixel under a correct reading, or
# are explained by damage; the first equals `testset.MIN_EXPLAINED_FRACTION`. The second share
# applies if the author stated object numbers: the renderer may also have another near offset or a
# moved scene, and these change object numbers.
MIN_AGREEING_FRACTION, MIN_AGREEING_OBJECTS_FRACTION = 0.9, 0.6

# Smallest share of pixels of a resampled picture with a number between their neighbors' numbers; a
# smaller share is chance. Smallest ratio of the count of distinct integers in the picture to their
# count in the truth: interpolation makes new values, while a permutation, such as objects in
# another order, keeps the count.
MIN_MIXED_FRACTION, MIN_VALUES_FACTOR = 0.01, 1.2

# Largest change of a byte by lossy compression. JPEG of quality 75 quantizes low frequencies of
# brightness in steps of at most 16, and chroma adds half of its own step.
MAX_LOSSY_STEPS = 24

# Smallest number of gray values in a shaded picture; masks and outlines have fewer. Smallest
# correlation of brightness with the truth; for stored numbers it is random. Smallest share of
# pixels as bright as the truth at which a picture is read as sRGB. Under the correct reading nearly
# all pixels are as bright as the truth, and under another reading few are.
MIN_SHADES, MIN_CORRELATION, MIN_SAME_COLOR_FRACTION = 3, 0.5, 0.5

# Another transfer function is accepted if it reduces the distance between the brightness quantiles
# of image and truth to at most this share of the distance under the stated function. Quantiles
# hardly depend on geometry if the same surfaces are visible. The diagnosis of the decoded pictures
# is the final test.
MAX_TRANSFER_DISTANCE = 0.5

# Transfer functions that `--encoding` can state, and their encodings.
STATED_TRANSFERS = {Transfer.LINEAR: Encoding.RGB, Transfer.SRGB: Encoding.SRGB}

_NAMED_TRANSFERS = {
    Transfer.SRGB: SRGB_READ_AS_LINEAR,
    Transfer.LINEAR: LINEAR_READ_AS_SRGB,
    Transfer.GAMMA: GAMMA,
}


@dataclass(frozen=True, kw_only=True)
class IdRepair:
    """Repair of damaged numbers by the truth, and the share of pixels that the damage explains.

    Repaired numbers are used only for figures after correction; no image passes because of them.
    """

    kind: str  #: `OVERFLOW`, `RESTARTING`, `RESAMPLED`, `LOSSY` or `FIRST_NUMBER`
    reading: Reading
    bits: int = 24  #: number of low bits that remain after `OVERFLOW`
    #: first triangle number of each object, for `RESTARTING`
    first: tuple[int, ...] = ()
    share: float = 0.0
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    nominal: RendererModel = TRUE  #: model of the renderer according to its author

    def read(self, reference: Reference, image: HogelImage) -> HogelImage:
        """Return an image with true numbers at pixels whose stored number the damage explains."""
        plate, as_read = reference.scene.plate, read_again(image, self.reading)
        index = self.order.index(image.camera.aperture.index, plate.hogels)
        truth = _stated(reference, self.nominal, index)
        pair = _TruthPair.from_images(truth, image, self.orientation)
        name = "object" if self.reading.encoding is Encoding.OBJECT_ID else "triangle"
        numbers = np.array(self.orientation.upright(getattr(as_read, name)))
        # The pixel's own number is assigned last, and overwrites its neighbors' numbers.
        meant = list(zip(pair.explained(self), pair.numbers(self.reading), strict=False))
        for mask, number in reversed(meant):
            numbers[mask] = number[mask]
        restored: dict[str, Any] = {name: self.orientation.applied(numbers)}
        return replace(as_read, **restored)


def _stated(reference: Reference, nominal: RendererModel, index: tuple[int, int]) -> HogelImage:
    """Return an aperture's image as expected from the author's statements."""
    aperture = reference.scene.plate.aperture(*index)
    if nominal == TRUE:
        return reference.trace(aperture)
    return reference_colors(reference, nominal, trace_drawn(reference, nominal, aperture))


@dataclass(frozen=True, kw_only=True, eq=False)
class _TruthPair:
    """Stored bytes of an upright image, with the numbers and brightness of the truth."""

    rgb: Bytes  # (h, w, 3)
    triangle: Numbers  # (9, h, w): first the number of the pixel itself, then of its neighbors
    object: Numbers
    gray: Floats  # (h, w)

    @classmethod
    def from_images(
        cls, truth: HogelImage, image: HogelImage, orientation: Orientation, lines: int = 0
    ) -> _TruthPair:
        """Pair an image with the truth; `lines` limits the rows and columns of both."""
        height, width = truth.triangle.shape
        step = max(1, min(height, width) // lines) if lines else 1
        places = sorted(itertools.product(range(3), range(3)), key=lambda place: place != (1, 1))

        def with_neighbors(numbers: Numbers) -> Numbers:
            padded = np.pad(numbers, 1, mode="edge")
            return np.stack(
                [padded[r : r + height : step, c : c + width : step] for r, c in places]
            )

        return cls(
            rgb=orientation.upright(stored_rgb(image))[::step, ::step],
            triangle=with_neighbors(truth.triangle),
            object=with_neighbors(truth.object),
            gray=as_gray(as_stored(truth, image))[::step, ::step],
        )

    @property
    def lit(self) -> Mask:
        """Mask of pixels that do not store 0."""
        return np.asarray((self.rgb != 0).any(axis=-1))

    def numbers(self, reading: Reading) -> Numbers:
        """Return the true numbers (9, h, w) of objects or of triangles, whichever are stored."""
        return self.object if reading.encoding is Encoding.OBJECT_ID else self.triangle

    def stored(self, reading: Reading) -> Numbers:
        """Return the integers that a correct renderer would store, (9, h, w)."""
        return reading.stored(self.numbers(reading))

    def same(self, reading: Reading) -> Mask:
        """Return a mask (9, h, w) of pixels that store their own or a neighbor's true number."""
        return np.asarray(reading.packed(self.rgb) == self.stored(reading))

    def explained(self, damage: IdRepair) -> Mask:
        """Return a mask (n, h, w) of pixels whose bytes are their or a neighbor's damaged number.

        For interpolated or lossy numbers n is 1: the pixel's bytes must be within the range of the
        neighbors' bytes.
        """
        reading = damage.reading
        stored, packed = self.stored(reading), reading.packed(self.rgb)
        if damage.kind == FIRST_NUMBER:
            first = self.numbers(reading)[:1] == 0
            return np.asarray((packed == reading.background) & first)
        if damage.kind == RESTARTING:
            # The appended 0 is for pixels without an object.
            own = self.triangle - np.array([*damage.first, 0])[self.object]
            return np.asarray(packed == reading.stored(own))
        if damage.kind == OVERFLOW:
            # The low eight bits may be stored in blue only, or in all three channels.
            low = stored & (2**damage.bits - 1)
            return np.asarray((packed == low) | ((damage.bits == 8) & (packed == low * 0x010101)))
        margin = MAX_LOSSY_STEPS if damage.kind == LOSSY else 0
        parts = bytes_of(stored).astype(np.int32)[..., np.argsort(reading.channels)]
        low, high = parts.min(axis=0) - margin, parts.max(axis=0) + margin
        return np.asarray(((self.rgb >= low) & (self.rgb <= high)).all(axis=-1)[None])


@dataclass(frozen=True, kw_only=True)
class FoundEncoding:
    """Detected reading of a renderer's images."""

    faults: tuple[Defect, ...] = ()  #: differences from the stated reading
    reading: Reading | None = None  #: None for the stated reading
    #: repair of lost numbers for figures after correction: of all numbers, or only of number 0,
    #: which is stored like the background
    restoring: IdRepair | None = None

    @property
    def as_colors(self) -> bool:
        """True if pixels hold colors in place of numbers."""
        read = self.reading
        return read is not None and read.transfer is None and read.encoding not in NUMBER_ENCODINGS

    def read(self, reference: Reference, image: HogelImage) -> HogelImage:
        """Return an image decoded with this reading, with lost numbers repaired."""
        restoring = self.restoring
        return self.plainly(image) if restoring is None else restoring.read(reference, image)

    def plainly(self, image: HogelImage) -> HogelImage:
        """Return an image decoded with this reading, without repair of lost numbers."""
        return image if self.reading is None else read_again(image, self.reading)


def find_encoding(
    reference: Reference, images: Sequence[HogelImage], nominal: RendererModel
) -> FoundEncoding:
    """Determine the reading of a renderer's images if the stated reading fails.

    `nominal` is the model of the renderer according to its author.
    """
    # Images without numbers or stored colors have no other reading.
    if any((image.triangle != NOTHING).any() for image in images):
        stated = Reading(encoding=Encoding.TRIANGLE_ID)
    elif any((image.object != NOTHING).any() for image in images):
        stated = Reading(encoding=Encoding.OBJECT_ID)
    elif all(is_picture(image) and image.color is not None for image in images):
        stated = Reading(encoding=Encoding.RGB)
    else:
        return FoundEncoding()
    filled = [image for image in images if (stored_integers(image, stated) != 0).any()]
    if not filled:
        return FoundEncoding()
    search = _Search(reference=reference, images=filled, nominal=nominal, stated=stated)
    result = search.reading() or FoundEncoding()
    if result.reading is not None and result.reading.first_is_lost:
        return replace(result, restoring=search.agreement(result.reading, FIRST_NUMBER))
    return result


def find_transfer(reference: Reference, images: Sequence[HogelImage]) -> FoundEncoding:
    """Select the transfer function whose distribution of brightness is closest to the truth.

    The geometry is still unknown, so that only the diagnosis of the decoded pictures tests the
    transfer function.
    """
    if not all(is_picture(image) and image.color is not None for image in images):
        return FoundEncoding()
    # A few pictures suffice: a plate has one transfer function.
    chosen = spread(images, MAX_COMPARED_HOGELS)
    truths = [reference.trace(image.camera.aperture).color for image in chosen]
    expected = np.concatenate([truth.ravel() for truth in truths if truth is not None])
    stored = [radiance(stored_rgb(image), Encoding.RGB).ravel() for image in chosen]
    # Transfer functions are increasing, so that values and radiance have the same order.
    expected, values = np.sort(np.clip(expected, 0.0, 1.0)), np.sort(np.concatenate(stored))
    distances = {
        transfer: float(np.abs(transfer.linear(values) - expected).mean()) for transfer in Transfer
    }
    first, pixels = chosen[0].color, stored_rgb(chosen[0])
    assert first is not None
    ways = STATED_TRANSFERS.items()
    stated = next(way for way, code in ways if np.array_equal(first, radiance(pixels, code)))
    best = min(distances, key=distances.__getitem__)
    if distances[best] > MAX_TRANSFER_DISTANCE * distances[stated]:
        return FoundEncoding()
    reading = Reading(encoding=Encoding.RGB, transfer=best)
    value, name = str(STATED_TRANSFERS.get(best, best)), _NAMED_TRANSFERS.get(best, WRONG_TRANSFER)
    defect = Defect(fault=name, value=value, stated=str(stated), details=(str(best),))
    return FoundEncoding(faults=(defect,), reading=reading)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """Search for a reading of the stored pixels other than `stated`."""

    reference: Reference
    images: Sequence[HogelImage]
    nominal: RendererModel
    stated: Reading

    @cached_property
    def conventions(self) -> list[tuple[Orientation, Orientation]]:
        """All pairs of an aperture order and a picture orientation, beginning with no change."""
        scene = self.reference.scene
        several = len({image.camera.aperture.index for image in self.images}) > 1
        orders = list(orientations(scene.plate.hogels)) if several else [UPRIGHT]
        return list(itertools.product(orders, orientations(scene.frustum.resolution)))

    @cached_property
    def truth(self) -> Callable[[tuple[int, int]], HogelImage]:
        """Function from an aperture to its expected image, with a cache."""
        return lru_cache(None)(lambda index: _stated(self.reference, self.nominal, index))

    def reading(self) -> FoundEncoding | None:
        """Return another reading that holds if the stated reading fails, else None."""
        stated, pictures = self.stated, any(map(is_picture, self.images))
        triangles, objects = (replace(stated, encoding=encoding) for encoding in NUMBER_ENCODINGS)
        if stated.encoding is Encoding.RGB:
            result = self._by_claims(triangles, MAX_HELD_MISFIT_PX * MIN_IMPROVEMENT)
            return result or self._by_objects(objects, 0.0)
        if stated.encoding is Encoding.OBJECT_ID:
            agreeing = self.agreement(stated).share
            if agreeing >= MIN_AGREEING_FRACTION:
                return None
            result = self._by_objects(stated, agreeing)
            if result is None and pictures:
                result = self._by_claims(triangles, np.inf)
        else:
            left = self._misfit(stated)
            if left <= MAX_HELD_MISFIT_PX:
                return None
            result = self._by_claims(stated, left) or self._restarting()
            # Enlarged pictures name neighbors of the true triangles: these claims fail by less than
            # a pixel.
            if result is None and left <= MIN_FAILED_MISFIT_PX:
                return None
            # Numbers are undamaged if a camera can draw their triangles at these pixels. This test
            # comes before the tests of damage, because damage would explain nearly any number in a
            # scene of few triangles.
            result = result or self._by_objects(objects, 0.0) or self._drawn()
        # The remaining readings are compared with the truth.
        result = result or self._overflown() or self._mixed()
        # If nearly all pixels hold numbers that exist in the scene, they do not hold colors.
        if result is None and pictures and self._valid_share(stated) < MIN_VALID_FRACTION:
            return self._colors()
        return result

    def _best(
        self, damage: IdRepair, matching: Callable[[_TruthPair], Mask] | None = None
    ) -> tuple[IdRepair, list[_TruthPair]]:
        """Return the damage with the conventions that match most pixels, and the image pairs."""
        matching = matching or (lambda pair: pair.explained(damage))
        damage, best = replace(damage, nominal=self.nominal), list[_TruthPair]()
        hogels = self.reference.scene.plate.hogels
        for order, orientation in self.conventions:
            pairs, shown, matched = [], 0, 0
            for image in spread(self.images, MAX_COMPARED_HOGELS):
                truth = self.truth(order.index(image.camera.aperture.index, hogels))
                pair = _TruthPair.from_images(truth, image, orientation, COMPARED_LINES)
                some = pair.triangle[0] != NOTHING
                if not damage.reading.background:
                    some |= pair.lit
                shown += some.sum()
                matched += (matching(pair).any(axis=0) & some).sum()
                pairs.append(pair)
            share = float(matched / shown) if shown else 0.0
            # If several conventions agree equally well, the first (no change) wins.
            if not best or share > damage.share + 1e-6:
                damage = replace(damage, share=share, orientation=orientation, order=order)
                best = pairs
        return damage, best

    def agreement(self, reading: Reading, kind: str = RESAMPLED) -> IdRepair:
        """Return the conventions under which most pixels store their own or a neighbor's number."""
        return self._best(IdRepair(kind=kind, reading=reading), lambda pair: pair.same(reading))[0]

    def _colors(self) -> FoundEncoding | None:
        """Return the reading of pixels that are colors of the scene; None for other pixels."""
        colors = Reading(encoding=Encoding.RGB)
        # A pixel matches if it is lit and the truth has a surface there or at a neighbor, or if it
        # is dark and the truth has background there or at a neighbor.
        result, parts = self._best(
            IdRepair(kind=WRONG_ENCODING, reading=colors),
            lambda pair: (pair.triangle != NOTHING) == pair.lit,
        )
        if result.share < MIN_AGREEING_FRACTION:
            return None
        inner = [part.lit & (part.triangle[0] != NOTHING) for part in parts]
        rgb = np.concatenate([part.rgb[some] for part, some in zip(parts, inner, strict=True)])
        gray = np.concatenate([part.gray[some] for part, some in zip(parts, inner, strict=True)])
        shades = rgb.astype(np.float64).mean(axis=1)
        if len(np.unique(shades)) < MIN_SHADES:
            return None
        colorless = float((np.ptp(rgb, axis=1) == 0).mean()) >= MIN_AGREEING_FRACTION
        if not colorless and (
            np.ptp(gray) == 0 or np.corrcoef(shades, gray)[0, 1] < MIN_CORRELATION
        ):
            return None
        # Shares of pixels that are as bright as the truth, in each of the two encodings.
        expected = np.clip(gray, 0.0, 1.0)
        linear, encoded = (
            np.mean(np.abs(radiance(rgb, way).mean(axis=-1) - expected) <= COLOR_TOLERANCE)
            for way in (Encoding.RGB, Encoding.SRGB)
        )
        if encoded >= MIN_SAME_COLOR_FRACTION and encoded > linear:
            colors = replace(colors, encoding=Encoding.SRGB)
        return self._as_found(colors, ())

    def _overflown(self) -> FoundEncoding | None:
        """Detect numbers of which only the low bits are stored."""
        count, stated = len(self.reference.scene.faces), self.stated
        for bits in (8, 16) if stated.encoding is Encoding.TRIANGLE_ID else ():
            if count < 2**bits:
                break
            result, _ = self._best(IdRepair(kind=OVERFLOW, reading=stated, bits=bits))
            if result.share >= MIN_AGREEING_FRACTION:
                defect = Defect(fault=OVERFLOW, value=float(bits), unit="bits")
                return FoundEncoding(faults=(defect,), restoring=result)
        return None

    def _mixed(self) -> FoundEncoding | None:
        """Detect numbers that were interpolated, or stored in a lossy file."""
        stated = self.stated
        storages = (getattr(image, "stored", None) for image in self.images)
        named_lossy = any(storage is not None and storage.lossy for storage in storages)
        for kind in (LOSSY,) if named_lossy else (RESAMPLED, LOSSY):
            result, parts = self._best(IdRepair(kind=kind, reading=stated))
            same = [
                part.same(stated)[:, part.lit | (part.triangle[0] != NOTHING)].any(axis=0)
                for part in parts
            ]
            mixed = 1 - float(np.concatenate(same).mean())
            stored = np.concatenate([stated.packed(part.rgb).ravel() for part in parts])
            should = np.concatenate([part.stored(stated)[0].ravel() for part in parts])
            new = len(np.unique(stored)) >= MIN_VALUES_FACTOR * len(np.unique(should))
            accounted = result.share >= MIN_AGREEING_FRACTION and mixed >= MIN_MIXED_FRACTION
            if named_lossy or (accounted and new):
                defect = Defect(fault=kind, value=mixed, unit="share")
                return FoundEncoding(faults=(defect,), restoring=result)
        return None

    def _drawn(self) -> FoundEncoding | None:
        """Return the stated reading if claims hold with at most one group off nominal."""
        claims = self._read(self.stated)
        if len(claims) < MIN_CLAIMS:
            return None
        fit = fit_geometry(claims, self.nominal, simple=True)
        return FoundEncoding() if fit.noise_px <= MAX_HELD_MISFIT_PX else None

    def _restarting(self) -> FoundEncoding | None:
        """Detect triangle numbers that restart with each object, as `gl_PrimitiveID` does."""
        _, first = np.unique(self.reference.scene.object_of_triangle, return_index=True)
        damage = IdRepair(kind=RESTARTING, reading=self.stated, first=tuple(first.tolist()))
        result, parts = self._best(damage)
        # Numbers of the first object do not change: the numbers of other objects must restart.
        matching = [np.asarray(part.explained(result).any(axis=0)) for part in parts]
        others = np.concatenate(
            [match[part.object[0] > 0] for match, part in zip(matching, parts, strict=True)]
        )
        if not len(others) or min(result.share, others.mean()) < MIN_AGREEING_FRACTION:
            return None
        defect = Defect(fault=RESTARTING, value=float(len(first)), unit="number")
        return FoundEncoding(faults=(defect,), restoring=result)

    def _read(self, reading: Reading) -> PixelClaims:
        """Return the claims of the images decoded with a reading."""
        images = [read_again(image, reading) for image in self.images]
        return claims_of(self.reference.scene, images)

    def _by_claims(self, start: Reading, left: float) -> FoundEncoding | None:
        """Return the reading under which claims hold; the misfit of `start` is `left`."""
        readings = [way for way in self._others(start) if len(self._read(way)) >= MIN_CLAIMS]
        misfits = [self._misfit(reading) for reading in readings]
        least = min(misfits, default=np.inf)
        if least > min(MIN_FAILED_MISFIT_PX * MIN_IMPROVEMENT, left):
            return None
        best = readings[misfits.index(least)]
        fit = fit_geometry(self._read(best), self.nominal)
        if not fit.holds:
            return None
        if start.encoding is self.stated.encoding and self._valid_share(start) > 0.5:
            noise = fit_geometry(self._read(start), self.nominal).noise_px
            better = max(fit.noise_px, MAX_HELD_MISFIT_PX) * MIN_IMPROVEMENT <= noise
            if not better and least * MIN_IMPROVEMENT > left:
                return None
        return self._as_found(best, readings)

    def _by_objects(self, start: Reading, agreeing: float) -> FoundEncoding | None:
        """Return the reading under which pixels hold the object numbers of the truth."""
        readings = list(self._others(start))
        shares = [self.agreement(reading).share for reading in readings]
        most, same = max(shares, default=0.0), start.encoding is self.stated.encoding
        enough = MIN_AGREEING_OBJECTS_FRACTION if same else MIN_AGREEING_FRACTION
        if most < enough or (1 - most) * MIN_IMPROVEMENT > 1 - agreeing:
            return None
        return self._as_found(readings[shares.index(most)], readings)

    def _as_found(self, best: Reading, readings: Sequence[Reading]) -> FoundEncoding:
        """Return a reading with its differences from the stated reading.

        Other `readings` that differ only in channel order and give the same numbers are listed
        too.
        """
        stated, defects = self.stated, list[Defect]()
        if best.encoding is not stated.encoding:
            value, was = str(best.encoding), str(stated.encoding)
            defects.append(Defect(fault=WRONG_ENCODING, value=value, stated=was))
        if best.channels != stated.channels:
            pixels = [stored_rgb(image) for image in self.images]
            own, *others = (
                "".join("RGB"[channel] for channel in way.channels)
                for way in (best, *(replace(best, channels=order) for order in CHANNEL_ORDERS))
                if way is best or (way != best and way in readings)
                if all(np.array_equal(way.packed(rgb), best.packed(rgb)) for rgb in pixels)
            )
            defects.append(Defect(fault=CHANNEL_ORDER, value=own, details=tuple(others)))
        for fault, number, usual in (
            (ID_OFFSET, best.offset - stated.offset, stated.offset),
            (BACKGROUND_ID, best.background, stated.background),
        ):
            if number:
                size, right = float(number), float(usual)
                defects.append(Defect(fault=fault, value=size, unit="number", stated=right))
        return FoundEncoding(faults=tuple(defects), reading=best)

    def _others(self, start: Reading) -> Iterator[Reading]:
        """Yield readings under which nearly all numbers exist, except the stated reading."""
        pictures = all(map(is_picture, self.images))
        orders = CHANNEL_ORDERS if pictures else CHANNEL_ORDERS[:1]
        for channels, offset in itertools.product(orders, (1, 0, 2)):
            plain = replace(start, channels=channels, offset=offset)
            # Pixels without a surface may store the most frequent integer that is not a number of
            # the scene.
            packed = np.concatenate(
                [stored_integers(image, plain).ravel() for image in self.images]
            )
            strange = packed[plain.numbers(packed) >= self._count(plain)]
            values, counts = np.unique(strange, return_counts=True)
            common = [int(values[np.argmax(counts)])] if len(values) else []
            for background in dict.fromkeys((0, *common)):
                reading = replace(plain, background=background)
                if reading != self.stated and self._valid_share(reading) >= MIN_VALID_FRACTION:
                    yield reading

    def _count(self, reading: Reading) -> int:
        scene = self.reference.scene
        return len(scene.objects if reading.encoding is Encoding.OBJECT_ID else scene.faces)

    def _valid_share(self, reading: Reading) -> float:
        """Return the share of numbers that exist in the scene."""
        parts = [reading.numbers(stored_integers(image, reading)).ravel() for image in self.images]
        numbers = np.concatenate(parts)
        named = int((numbers != NOTHING).sum())
        valid = int(((numbers >= 0) & (numbers < self._count(reading))).sum())
        return valid / named if named else 0.0

    def _misfit(self, reading: Reading) -> float:
        """Return the mean distance (px) by which claims fail, for the best conventions and near."""
        nominal, valid = self.nominal, self._valid_share(reading)
        claims = self._read(reading).thinned(MAX_SEARCHED_CLAIMS) if valid else None
        if claims is None or not len(claims):
            return MISFIT_CAP_PX

        def failing(model: RendererModel) -> float:
            return float(outside_px(claims, model, MISFIT_CAP_PX).mean())

        held = failing(nominal)
        if held > MAX_HELD_MISFIT_PX:
            reach = self.reference.scene.frustum.longest_reach
            nears = {nominal.near, *(part * reach for part in NEAR_FRACTIONS)}
            models = (
                replace(nominal, orientation=orientation, order=order, near=near)
                for (order, orientation), near in itertools.product(self.conventions, nears)
            )
            held = min(held, *map(failing, models))
        return valid * held + (1 - valid) * MISFIT_CAP_PX
