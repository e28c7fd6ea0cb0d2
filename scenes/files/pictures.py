"""Pictures as arrays, bit for bit: textures, environment maps, hogel images of other renderers.

Hogel images are numbers packed in RGB, plain pictures, or OpenEXR.
"""

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from xfrustum.scenes import NOTHING, HogelCamera, HogelImage, disk
from xfrustum.scenes.appearance import Environment
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Bytes, Indices, Numbers, Singles
from xfrustum.scenes.disk import head_of
from xfrustum.scenes.files.channels import OBJECT, TRIANGLE
from xfrustum.scenes.files.exr import MAGIC, image_size, read_image, read_rgb_channels, write_planes
from xfrustum.scenes.files.layouts import Pixels
from xfrustum.scenes.representation import ShortRepr, decoding_curve, encoding_curve

#: keyword of a PNG text with a plate's layout, a JSON object
TEXT_KEY = "xfrustum:layout"
#: chunk gAMA of a PNG file with linear pixels: the exponent 1 in units of 1 / 100,000
LINEAR_GAMMA = (100_000).to_bytes(4, "big")
#: Pillow's names of formats that are always lossy; WebP, for example, may be lossless
LOSSY_FORMATS = ("JPEG", "MPO", "JPEG2000")
#: Pillow's modes that convert to 8-bit RGB losslessly
RGB_MODES = ("RGB", "RGBA", "P", "L", "1")
#: exceptions of Pillow for files that are not pictures, or are damaged
_DAMAGE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """Picture as stored in its file, row 0 at the top."""

    #: (H, W, 3), levels from 0 to 255 (uint8) or floating point
    pixels: Pixels
    #: name of a lossy file format, such as "JPEG"
    lossy: str = ""
    #: whether a PNG file states that its pixels are linear radiance
    linear: bool = False


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a picture with Pillow, undecoded; InputError if damaged or not a picture."""
    try:
        with (
            disk.bounded_memory(path),
            disk.open_input(path, "file") as file,
            disk.open_image(file) as picture,
        ):
            yield picture
    # UnidentifiedImageError is a subclass of OSError, so it must come first.
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error


def picture_size(path: Path) -> tuple[int, int]:
    """Return width and height of a picture file in pixels; InputError if it is not a picture."""
    if disk.head_of(path, "file", len(MAGIC)) == MAGIC:
        return image_size(path)
    with _opened(path) as picture:
        width, height = picture.size
    return width, height


def picture_text(path: Path) -> dict[str, object]:
    """Return the layout that a PNG file states; empty if it states none."""
    try:
        with _opened(path) as picture:
            stated = json.loads(getattr(picture, "text", {}).get(TEXT_KEY, "{}"))
    except (InputError, ValueError, RecursionError):
        return {}
    return stated if isinstance(stated, dict) else {}


def read_picture(path: Path) -> Picture:
    """Read 8-bit RGB, or R, G and B of an OpenEXR file; InputError for anything else."""
    if disk.head_of(path, "file", len(MAGIC)) == MAGIC:
        pixels, read = read_rgb_channels(path, "only pictures in R, G and B are re-arranged")
        half, lossy = pixels.dtype == np.float16, read.lossy("R")
        floats = pixels if half else pixels.astype(np.float32)
        return Picture(pixels=floats, lossy=f"OpenEXR {lossy}" if lossy else "")
    rgb, lossy = read_rgb(path)
    return Picture(pixels=rgb, lossy=lossy)


def write_picture(path: Path, picture: Picture, text: dict[str, object] | None = None) -> None:
    """Write a picture in the format of the suffix: .png (uint8) or .exr (floating point).

    `text`, the layout of a plate, is stored in PNG files. Raises InputError if the format cannot
    store the pixels, OSError if the file cannot be written.
    """
    suffix, pixels = path.suffix.lower(), np.array(picture.pixels, order="C")
    if suffix == ".png" and pixels.dtype == np.uint8:
        # Encode in memory: Pillow would leave an incomplete file behind when the disk is full.
        info, buffer = PngInfo(), io.BytesIO()
        if text:
            info.add_text(TEXT_KEY, json.dumps(text))
        if picture.linear:
            info.add(b"gAMA", LINEAR_GAMMA)
        Image.fromarray(pixels).save(buffer, "PNG", pnginfo=info)
        path.write_bytes(buffer.getvalue())
    elif suffix == ".exr" and pixels.dtype.kind == "f":
        write_planes(path, {name: pixels[..., channel] for channel, name in enumerate("RGB")})
    else:
        raise InputError(
            f"{path}: cannot hold {pixels.dtype.name}; .png holds 8 bits, .exr floating point"
        )


def read_rgb(path: Path, resolution: tuple[int, int] | None = None) -> tuple[Bytes, str]:
    """Return the pixels (H, W, 3) of a picture, and the name of its lossy format, else "".

    Raises InputError if the file is damaged, its mode is not in `RGB_MODES`, or its resolution
    differs from the scene's.
    """
    with _opened(path) as picture:
        if resolution is not None and picture.size != resolution:
            size, expected = (" x ".join(map(str, s)) for s in (picture.size, resolution))
            raise InputError(f"{path}: is {size}, but the scene has {expected}")
        disk.check_picture_size(path, *picture.size)
        # Pillow reduces PPM files of 16 bits to 8 silently; their largest level is the second
        # argument of the decoder.
        deep = picture.format == "PPM" and picture.tile and picture.tile[0].codec_name == "ppm"
        if deep and picture.tile[0].args[1] > 255:
            raise InputError(
                f"{path}: has levels up to {picture.tile[0].args[1]}; write 8 bits, or OpenEXR"
            )
        if picture.mode not in RGB_MODES:
            raise InputError(
                f"{path}: has mode {picture.mode}; write 8 bits each of red, green and blue"
            )
        lossy = picture.format if picture.format in LOSSY_FORMATS else ""
        # An MPO file holds several JPEG pictures.
        return np.asarray(picture.convert("RGB")), "JPEG" if lossy == "MPO" else lossy


# Environment maps

#: header of a Radiance picture: lines up to an empty line, then the size
_HDR_HEADER = re.compile(rb"#\?[^\n]*\n(?:[^\n]+\n)*\n([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\n")
#: widths of rows that can be run-length encoded; such rows begin with 2, 2 and the width
_RUN_WIDTHS = range(8, 1 << 15)


def read_environment(path: Path, *, strength: float = 1.0) -> Environment:
    """Read a latitude-longitude map in linear RGB, OpenEXR or Radiance HDR.

    Raises InputError if the file is missing, damaged, not RGB, or has radiance that is negative or
    not finite.
    """
    with disk.bounded_memory(path):
        if disk.head_of(path, "environment map", len(MAGIC)) == MAGIC:
            radiance, read = read_rgb_channels(path, "an environment map is an RGB picture")
            attributes = read.header.attributes
            if str(attributes["dataWindow"]) != str(attributes["displayWindow"]):
                raise InputError(
                    f"{path}: is a part of a picture only; an environment map has all directions"
                )
        else:
            radiance = _read_radiance(path)
        return Environment(radiance=radiance.astype(np.float32), strength=strength, name=str(path))


def _read_radiance(path: Path) -> Singles:
    """Return the pixels of a Radiance picture: G. Ward, "Real Pixels", Graphics Gems II (1991)."""
    content = disk.read_input(path, "environment map")
    header = _HDR_HEADER.match(content)
    if header is None:
        raise InputError(f"{path}: is not an OpenEXR or Radiance HDR picture; convert it to one")
    if b"FORMAT=32-bit_rle_xyze" in header[0]:
        raise InputError(f"{path}: is stored in XYZ; an environment map is an RGB picture")
    if (header[1], header[3]) != (b"-Y", b"+X"):
        raise InputError(
            f"{path}: is not stored row by row from the top left; store it in this order"
        )
    height, width = int(header[2]), int(header[4])
    disk.check_picture_size(path, width, height)
    stored = np.frombuffer(content, np.uint8)
    pixels, at = np.empty((height, width, 4), np.uint8), header.end()
    for row in pixels:
        at = _read_row(path, stored, at, row)
    # The unit of the 8-bit mantissa is 1/256, and the exponent has a bias of 128: 128 + 8 = 136.
    exponent = pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent == 0, 0, np.ldexp(np.float32(1), exponent - 136)).astype(np.float32)
    return pixels[..., :3] * scale


def _read_row(path: Path, stored: Bytes, at: int, row: Bytes) -> int:
    """Fill a row (W, 4) from the bytes at an offset, and return the next offset."""
    width = len(row)
    mark = np.array((2, 2, width >> 8, width & 255), np.uint8)
    if width not in _RUN_WIDTHS or not np.array_equal(stored[at : at + 4], mark):
        flat = stored[at : at + 4 * width]
        if flat.size < 4 * width or (flat.reshape(-1, 4)[:, :3] == 1).all(axis=1).any():
            raise InputError(
                f"{path}: the environment map is damaged, or older than 1991; write it again"
            )
        row[:] = flat.reshape(width, 4)
        return at + 4 * width
    at += 4
    for component in row.T:
        done = 0
        while done < width:
            # A code above 128 repeats the next value; other codes are the number of values that
            # follow.
            code = int(stored[at]) if at + 1 < stored.size else 0
            count = code - 128 if code > 128 else code
            values = stored[at + 1 : at + 2] if code > 128 else stored[at + 1 : at + 1 + count]
            if not 0 < count <= width - done or values.size != (1 if code > 128 else count):
                raise InputError(
                    f"{path}: the environment map is damaged (a run of a row); write it again"
                )
            component[done : done + count] = values
            done, at = done + count, at + 1 + values.size
    return at


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
    """Hogel image with the stored pixels of its picture; `stored` is None for OpenEXR."""

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
    #: transfer function of colors; None selects the encoding's transfer
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
    """Return an image whose stored pixels are decoded with another interpretation.

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
