"""Pictures and environment maps as arrays, bit for bit."""

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from xfrustum.scenes.appearance.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Singles
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import MAGIC, image_size, read_rgb_channels, write_planes
from xfrustum.scenes.files.layouts import Pixels

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
            input_files.bounded_memory(path),
            input_files.open_input(path, "file") as file,
            input_files.open_image(file) as picture,
        ):
            yield picture
    # This is a subclass of OSError, so it must come first.
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error


def picture_size(path: Path) -> tuple[int, int]:
    """Return width and height of a picture file in pixels; InputError if it is not a picture."""
    if input_files.head_of(path, "file", len(MAGIC)) == MAGIC:
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
    if input_files.head_of(path, "file", len(MAGIC)) == MAGIC:
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
    """Return the pixels (H, W, 3) of a picture, and the format that changed them, else "".

    Raises InputError if the file is damaged, its mode is not in `RGB_MODES`, or its resolution
    differs from the scene's.
    """
    with _opened(path) as picture:
        if resolution is not None and picture.size != resolution:
            size, expected = (" x ".join(map(str, s)) for s in (picture.size, resolution))
            raise InputError(f"{path}: is {size}, but the scene says {expected}")
        input_files.check_picture_size(path, *picture.size)
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

#: header of a Radiance picture: lines up to an empty one, then the size
_HDR_HEADER = re.compile(rb"#\?[^\n]*\n(?:[^\n]+\n)*\n([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\n")
#: widths of rows that can be run-length encoded, which begin with 2, 2 and the width
_RUN_WIDTHS = range(8, 1 << 15)


def read_environment(path: Path, *, strength: float = 1.0) -> Environment:
    """Read a latitude-longitude map in linear RGB, OpenEXR or Radiance HDR.

    Raises InputError if the file is missing, damaged, not RGB, or has radiance that is negative or
    not finite.
    """
    with input_files.bounded_memory(path):
        if input_files.head_of(path, "environment map", len(MAGIC)) == MAGIC:
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
    content = input_files.read_input(path, "environment map")
    header = _HDR_HEADER.match(content)
    if header is None:
        raise InputError(f"{path}: is not an OpenEXR or Radiance HDR picture; convert it to one")
    if b"FORMAT=32-bit_rle_xyze" in header[0]:
        raise InputError(f"{path}: is stored in XYZ; an environment map is an RGB picture")
    if (header[1], header[3]) != (b"-Y", b"+X"):
        raise InputError(f"{path}: is not stored row by row from the top left; write it so")
    height, width = int(header[2]), int(header[4])
    input_files.check_picture_size(path, width, height)
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
                f"{path}: the environment map is damaged, or of before 1991; write it again"
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
