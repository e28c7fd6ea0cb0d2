"""Hogel images of other renderers: numbers packed in RGB, plain pictures, OpenEXR."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from xfrustum.scenes import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.appearance.display import decoding_curve, encoding_curve
from xfrustum.scenes.arrays import Bytes, Indices, Numbers, Singles
from xfrustum.scenes.disk.input_files import head_of
from xfrustum.scenes.files.channels import OBJECT, TRIANGLE
from xfrustum.scenes.files.exr import MAGIC, read_image
from xfrustum.scenes.files.pictures import read_rgb
from xfrustum.scenes.representation import ShortRepr


class Encoding(StrEnum):
    """Meaning of a picture's RGB values; OpenEXR files have channel names instead."""

    #: linear radiance
    RGB = "rgb"
    #: radiance encoded as sRGB
    SRGB = "srgb"
    #: triangle number + 1 as red * 65536 + green * 256 + blue; 0 for no surface
    TRIANGLE_ID = "triangle-id"
    #: object number + 1, packed likewise
    OBJECT_ID = "object-id"


class Transfer(StrEnum):
    """Transfer function from linear radiance to a picture's stored values."""

    LINEAR = "linear"
    SRGB = "sRGB"
    GAMMA = "gamma 2.2"
    TWICE = "sRGB, encoded twice"
    DECODED = "linear values that were decoded once more, as if they were sRGB"

    def linear(self, stored: Singles) -> Singles:
        """Return the linear radiance of stored values from 0 to 1."""
        match self:
            case Transfer.LINEAR:
                return stored
            case Transfer.SRGB:
                return decoding_curve(stored)
            case Transfer.GAMMA:
                return np.asarray(stored**2.2)
            case Transfer.TWICE:
                return decoding_curve(decoding_curve(stored))
            case Transfer.DECODED:
                return encoding_curve(stored)

    def step(self, stored: Singles) -> Singles:
        """Return the largest change of linear radiance for a change of one stored level."""
        here, level = self.linear(stored), np.float32(1 / 255)
        up = self.linear(np.minimum(stored + level, 1))
        down = self.linear(np.maximum(stored - level, 0))
        return np.asarray(np.maximum(up - here, here - down))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StoredPixels(ShortRepr):
    """Pixels of a picture as stored in its file."""

    #: (H, W, 3)
    rgb: Bytes
    #: name of a lossy file format, such as "JPEG"
    lossy: str = ""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ForeignImage(HogelImage):
    """A hogel image with the stored pixels of its picture; None for OpenEXR."""

    stored: StoredPixels | None = None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Interpretation of stored pixels: channel order, offset, background, transfer."""

    encoding: Encoding
    #: channels (0 red, 1 green, 2 blue) of the high, middle and low byte of a number
    channels: tuple[int, int, int] = (0, 1, 2)
    #: difference of stored and actual numbers
    offset: int = 1
    #: stored integer of no surface
    background: int = 0
    #: transfer function of colors; None selects the encoding's
    transfer: Transfer | None = None

    @property
    def first_is_lost(self) -> bool:
        """True if number 0 and the background are stored as the same integer."""
        return (
            self.encoding in (Encoding.TRIANGLE_ID, Encoding.OBJECT_ID)
            and self.offset == self.background
        )

    def packed(self, rgb: Bytes) -> Numbers:
        """Return the stored integers (H, W) of pixels (H, W, 3), offset included."""
        return np.asarray(
            rgb[..., list(self.channels)].astype(np.int32)
            @ np.array([65536, 256, 1], dtype=np.int32)
        )

    def numbers(self, packed: Numbers) -> Numbers:
        """Return the numbers (H, W) of stored integers, `NOTHING` for no surface."""
        # Integers below the offset are no surface either.
        known = np.maximum(packed - self.offset, NOTHING)
        return np.where(packed == self.background, NOTHING, known).astype(np.int32)

    def stored(self, numbers: Numbers) -> Numbers:
        """Return the stored integers of numbers: the inverse of `numbers`."""
        return np.where(numbers == NOTHING, self.background, numbers + self.offset).astype(np.int32)


def read_foreign(path: Path, camera: HogelCamera, encoding: Encoding) -> HogelImage:
    """Read a hogel image of any renderer: OpenEXR with channels of CONVENTIONS.md, or a picture.

    Raises InputError if the file is missing, unreadable, or not of the film's size.
    """
    if head_of(path, "file", len(MAGIC)) == MAGIC:
        counted = {Encoding.TRIANGLE_ID: TRIANGLE, Encoding.OBJECT_ID: OBJECT}.get(encoding)
        return read_image(path, camera, partial=True, counted=counted)
    rgb, lossy = read_rgb(path, (camera.resolution[0], camera.resolution[1]))
    return of_stored(StoredPixels(rgb=rgb, lossy=lossy), camera, encoding)


def of_stored(stored: StoredPixels, camera: HogelCamera, encoding: Encoding) -> HogelImage:
    """Return the image of stored pixels."""
    shape = stored.rgb.shape[:2]
    nothing = np.full(shape, NOTHING, dtype=np.int32)
    position = np.full((*shape, 3), np.nan, dtype=np.float32)
    unread = ForeignImage(
        camera=camera,
        triangle=nothing,
        object=nothing,
        position=position,
        stored=stored,
        storage=f"{stored.lossy}, lossy" if stored.lossy else None,
    )
    return read_again(unread, Reading(encoding=encoding))


def is_picture(image: HogelImage) -> bool:
    """Return whether an image was read from a picture, which stores integers."""
    return isinstance(image, ForeignImage) and image.stored is not None


def read_again(image: HogelImage, reading: Reading) -> HogelImage:
    """Return an image whose stored pixels are decoded with another reading.

    For images without stored pixels, only the offset and the choice of triangles or objects change.
    """
    nothing = np.full_like(image.triangle, NOTHING)
    if reading.encoding in (Encoding.RGB, Encoding.SRGB):
        color: Singles | None = radiance(stored_rgb(image), reading.encoding)
        if reading.transfer is not None:
            color = reading.transfer.linear(radiance(stored_rgb(image), Encoding.RGB))
        return replace(image, triangle=nothing, object=nothing, color=color)
    # Pictures hold numbers or colors; OpenEXR files can hold both.
    numbers = reading.numbers(stored_integers(image, reading))
    color = None if isinstance(image, ForeignImage) else image.color
    is_object = reading.encoding is Encoding.OBJECT_ID
    triangle, objects = (nothing, numbers) if is_object else (numbers, nothing)
    return replace(image, triangle=triangle, object=objects, color=color)


def stored_integers(image: HogelImage, reading: Reading) -> Numbers:
    """Return the stored integers (H, W) of a picture; for other images, the numbers plus one."""
    if isinstance(image, ForeignImage) and image.stored is not None:
        return reading.packed(image.stored.rgb)
    numbers = image.triangle if (image.triangle != NOTHING).any() else image.object
    return np.asarray(numbers + np.int32(1))


def stored_rgb(image: HogelImage) -> Bytes:
    """Return the stored bytes (H, W, 3) of a picture; for other images, of the numbers plus one."""
    if isinstance(image, ForeignImage) and image.stored is not None:
        return image.stored.rgb
    return bytes_of(stored_integers(image, Reading(encoding=Encoding.TRIANGLE_ID)))


def bytes_of(integers: Numbers | Indices) -> Bytes:
    """Return integers (..) below 2^24 as pixels (.., 3): 65536 red + 256 green + blue."""
    return np.stack((integers >> 16 & 255, integers >> 8 & 255, integers & 255), axis=-1).astype(
        np.uint8
    )


def radiance(rgb: Bytes, encoding: Encoding) -> Singles:
    """Return the linear radiance (.., 3) of stored pixels, `Encoding.RGB` or `Encoding.SRGB`."""
    color: Singles = (rgb / 255).astype(np.float32)
    return decoding_curve(color) if encoding is Encoding.SRGB else color
