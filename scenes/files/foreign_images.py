"""Hogel images as other renderers write them: numbers packed in RGB, plain pictures, OpenEXR."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path

import numpy as np

from xfrustum.scenes.appearance.display import decoding_curve
from xfrustum.scenes.arrays import Bytes, Numbers, Singles
from xfrustum.scenes.disk.input_files import regular_size
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import MAGIC, read_image
from xfrustum.scenes.files.pictures import read_rgb
from xfrustum.scenes.model.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.notebook.shown import Brief


class Encoding(StrEnum):
    """The meaning of a picture's RGB values; an OpenEXR file names its own channels."""

    RGB = "rgb"
    """Linear radiance."""
    SRGB = "srgb"
    """Radiance encoded as sRGB."""
    TRIANGLE_ID = "triangle-id"
    """Red * 65536 + green * 256 + blue is the triangle's number + 1, 0 for nothing."""
    OBJECT_ID = "object-id"
    """The same with the object's number."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StoredPixels(Brief):
    """A picture's pixels as its file stores them, before they are read as numbers or colors.

    Attributes
    ----------
    rgb
        (H, W, 3) uint8.
    lossy
        Whether the file's format changes pixels when it stores them, as JPEG does.
    """

    rgb: Bytes
    lossy: bool = False


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ForeignImage(HogelImage):
    """A hogel image that was read from a picture, with that picture.

    Attributes
    ----------
    stored
        The picture's own pixels; None where the image comes from OpenEXR or from a function.
    """

    stored: StoredPixels | None = None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A way to read stored pixels.

    Attributes
    ----------
    encoding
        Meaning of the RGB values.
    channels
        The stored channel (0 red, 1 green, 2 blue) that holds the high, the middle and the low byte of a
        number.
    offset
        Number that was added to triangle or object numbers before they were stored.
    background
        Integer that is stored where there is no surface.
    """

    encoding: Encoding
    channels: tuple[int, int, int] = (0, 1, 2)
    offset: int = 1
    background: int = 0

    @property
    def first_is_lost(self) -> bool:
        """Whether number 0 and no surface are stored as the same integer."""
        return self.encoding in (Encoding.TRIANGLE_ID, Encoding.OBJECT_ID) and self.offset == self.background

    def packed(self, rgb: Bytes) -> Numbers:
        """Return the stored integers (H, W) of pixels (H, W, 3), the offset still in them."""
        return np.asarray(
            rgb[..., list(self.channels)].astype(np.int32) @ np.array([65536, 256, 1], dtype=np.int32)
        )

    def numbers(self, packed: Numbers) -> Numbers:
        """Return the numbers (H, W) that stored integers stand for, `NOTHING` for no surface."""
        numbers = np.maximum(packed - self.offset, NOTHING)
        return np.where(packed == self.background, NOTHING, numbers).astype(np.int32)

    def stored(self, numbers: Numbers) -> Numbers:
        """Return the integers that numbers are stored as: the inverse of `numbers`."""
        return np.where(numbers == NOTHING, self.background, numbers + self.offset).astype(np.int32)


def read_foreign(path: Path, camera: HogelCamera, encoding: Encoding) -> HogelImage:
    """Read a hogel image by any renderer.

    Parameters
    ----------
    path
        Path of an OpenEXR file with any of the channels in CONVENTIONS.md, or of a picture.
    camera
        Camera of the image; a camera that the file names is not used.
    encoding
        Meaning of a picture's RGB values.

    Raises
    ------
    InputError
        The file is missing, unreadable, or of another size.
    """
    regular_size(path, "file")
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if magic == MAGIC:
        return read_image(path, camera, partial=True)
    rgb, lossy = read_rgb(path, (camera.resolution[0], camera.resolution[1]))
    return of_stored(StoredPixels(rgb=rgb, lossy=lossy), camera, encoding)


def of_stored(stored: StoredPixels, camera: HogelCamera, encoding: Encoding) -> HogelImage:
    """Return the image that stored pixels mean."""
    return read_again(_of_picture(stored, camera), Reading(encoding=encoding))


def _of_picture(stored: StoredPixels, camera: HogelCamera) -> ForeignImage:
    """Return an image with the stored pixels alone, before they are read as numbers or colors."""
    shape = stored.rgb.shape[:2]
    nothing = np.full(shape, NOTHING, dtype=np.int32)
    position = np.full((*shape, 3), np.nan, dtype=np.float32)
    return ForeignImage(camera=camera, triangle=nothing, object=nothing, position=position, stored=stored)


def read_again(image: HogelImage, reading: Reading) -> HogelImage:
    """Return an image as it is when its stored pixels are read in another way.

    Images that come from OpenEXR or from a function hold numbers already: of these only the offset is read
    anew, and whether they count triangles or objects.
    """
    mine = {item.name: getattr(image, item.name) for item in fields(image)}
    nothing = np.full_like(image.triangle, NOTHING)
    if reading.encoding in (Encoding.RGB, Encoding.SRGB):
        mine |= {"triangle": nothing, "object": nothing}
        mine["color"] = radiance(stored_rgb(image), reading.encoding)
        return type(image)(**mine)
    numbers = reading.numbers(stored_integers(image, reading))
    if isinstance(image, ForeignImage):
        mine["color"] = None
    mine["triangle"] = numbers if reading.encoding is Encoding.TRIANGLE_ID else nothing
    mine["object"] = numbers if reading.encoding is Encoding.OBJECT_ID else nothing
    return type(image)(**mine)


def stored_integers(image: HogelImage, reading: Reading) -> Numbers:
    """Return the integers (H, W) that a picture stores; for other images, their numbers plus one."""
    if isinstance(image, ForeignImage) and image.stored is not None:
        return reading.packed(image.stored.rgb)
    told = image.triangle if (image.triangle != NOTHING).any() else image.object
    return np.asarray(told + np.int32(1))


def stored_rgb(image: HogelImage) -> Bytes:
    """Return the bytes (H, W, 3) that a picture stores; for other images, those of their numbers plus one."""
    if isinstance(image, ForeignImage) and image.stored is not None:
        return image.stored.rgb
    packed = stored_integers(image, Reading(encoding=Encoding.TRIANGLE_ID))
    return np.stack((packed >> 16 & 255, packed >> 8 & 255, packed & 255), axis=-1).astype(np.uint8)


def radiance(rgb: Bytes, encoding: Encoding) -> Singles:
    """Return the linear radiance (.., 3) of stored pixels, `Encoding.RGB` or `Encoding.SRGB`."""
    color: Singles = (rgb / 255).astype(np.float32)
    return decoding_curve(color) if encoding is Encoding.SRGB else color
