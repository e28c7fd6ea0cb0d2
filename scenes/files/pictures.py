"""Pictures as arrays, read and written without a change of any bit."""

from __future__ import annotations

import io
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.disk.input_files import bounded_memory, check_picture_size, head_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import MAGIC, image_size, read_rgb_channels, write_planes
from xfrustum.scenes.files.layouts import Pixels

PLENO_LEVELS = 1023  # largest level of the 10-bit pictures that JPEG Pleno's test conditions ask for
BYTE_LEVELS = 255  # largest level of 8-bit pictures
#: Keyword of the text in a PNG file that says how a single picture is divided, as a JSON object.
TEXT_KEY = "xfrustum:layout"
#: Pillow's names of formats that change pixels; WebP and others may, but need not.
LOSSY_FORMATS = ("JPEG", "MPO", "JPEG2000")
#: Pillow's names of kinds of pixels that are red, green and blue of 8 bits, or become these unchanged.
RGB_MODES = ("RGB", "RGBA", "P", "L", "1")
#: Header of a binary PPM file: width, height, largest level.
_P6_HEADER = re.compile(rb"P6\s+(?:#[^\n]*\n\s*)*(\d+)\s+(\d+)\s+(\d+)\s")
#: Exceptions by which Pillow says that a file is no picture, or is damaged.
_DAMAGE = (OSError, SyntaxError, ValueError, Image.DecompressionBombError)


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A picture as its file stores it, row 0 at the top, and whether the file's format changes pixels."""

    pixels: Pixels  #: (H, W, 3); (frames, H, W, 3) of a video
    levels: int | None = BYTE_LEVELS  #: the largest level of integers; None of floating-point numbers
    lossy: bool = False


def picture_size(path: Path) -> tuple[int, int]:
    """Return the width and height of a picture file in pixels; InputError where it is missing or none."""
    head = head_of(path, "file")
    if head.startswith(MAGIC):
        return image_size(path)
    if ppm := _P6_HEADER.match(head):
        return int(ppm[1]), int(ppm[2])
    try:
        with Image.open(path) as picture:
            return picture.size
    except _DAMAGE as error:
        raise InputError(f"{path}: is not a picture that can be read") from error


def picture_text(path: Path) -> dict[str, object]:
    """Return what a PNG file says of its own division; empty where it says nothing."""
    try:
        with Image.open(path) as picture:
            told = json.loads(getattr(picture, "text", {}).get(TEXT_KEY, "{}"))
    except (*_DAMAGE, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


def read_picture(path: Path) -> Picture:
    """Read a picture file: PNG and the like with 8 bits, PPM with up to 16, OpenEXR.

    Raises InputError where the file is missing, damaged or of another kind.
    """
    head = head_of(path, "file")
    if head.startswith(MAGIC):
        pixels, _ = read_rgb_channels(path, "only pictures in R, G and B are re-arranged")
        half = pixels.dtype == np.float16
        return Picture(pixels=pixels if half else pixels.astype(np.float32), levels=None)
    if _P6_HEADER.match(head):
        return _read_ppm(path)
    rgb, lossy = read_rgb(path)
    return Picture(pixels=rgb, lossy=lossy)


def write_picture(path: Path, picture: Picture, text: dict[str, object] | None = None) -> None:
    """Write a picture into a folder that is being made, in the format that the suffix names.

    That is .png (8 bits), .ppm (8 to 16 bits) or .exr (floating point). PNG files state the text, the
    division of the picture, beside their pixels.

    Raises
    ------
    InputError
        The format cannot hold the picture.
    OSError
        The file cannot be written.
    """
    suffix, pixels = path.suffix.lower(), np.array(picture.pixels, order="C")
    if suffix == ".png" and pixels.dtype == np.uint8:
        info, buffer = PngInfo(), io.BytesIO()
        if text:
            info.add_text(TEXT_KEY, json.dumps(text))
        Image.fromarray(pixels).save(buffer, "PNG", pnginfo=info)
        path.write_bytes(buffer.getvalue())
    elif suffix == ".ppm" and picture.levels is not None:
        height, width = pixels.shape[:2]
        stored = pixels.astype(">u2" if picture.levels > BYTE_LEVELS else np.uint8)
        path.write_bytes(f"P6\n{width} {height}\n{picture.levels}\n".encode() + stored.tobytes())
    elif suffix == ".exr" and picture.levels is None:
        write_planes(path, {name: pixels[..., channel] for channel, name in enumerate("RGB")})
    else:
        raise InputError(
            f"{path}: cannot hold {pixels.dtype.name}; .png holds 8 bits, .ppm integers, .exr floating point"
        )


def _read_ppm(path: Path) -> Picture:
    with bounded_memory(path):
        content = path.read_bytes()
    found = _P6_HEADER.match(content)
    assert found is not None
    width, height, levels = (int(number) for number in found.groups())
    if not 0 < levels < 1 << 16:
        raise InputError(f"{path}: the image is damaged (largest level {levels})")
    dtype = np.dtype(">u2" if levels > BYTE_LEVELS else np.uint8)
    if len(content) - found.end() < 3 * width * height * dtype.itemsize:
        raise InputError(f"{path}: the image is damaged (it ends too early)")
    stored = np.frombuffer(content, dtype, count=3 * width * height, offset=found.end())
    native = stored.astype(dtype.newbyteorder("="))
    if native.max(initial=0) > levels:
        raise InputError(f"{path}: the image is damaged (a level lies above {levels})")
    return Picture(pixels=native.reshape(height, width, 3), levels=levels)


def read_rgb(path: Path, resolution: tuple[int, int] | None = None) -> tuple[Bytes, bool]:
    """Return the pixels (H, W, 3) of a picture, and whether its format changes pixels when it stores them.

    Where the scene says a resolution, pictures of other sizes are refused before their pixels are read.

    Raises InputError where the file is damaged, no picture, of another size, or has other pixels than those
    of `RGB_MODES`.
    """
    try:
        with bounded_memory(path), Image.open(path) as picture:
            if resolution is not None and picture.size != resolution:
                found, said = (" x ".join(map(str, size)) for size in (picture.size, resolution))
                raise InputError(f"{path}: is {found}, but the scene says {said}")
            check_picture_size(path, *picture.size)
            if picture.mode not in RGB_MODES:
                raise InputError(f"{path}: has mode {picture.mode}; write 8 bits each of red, green and blue")
            return np.asarray(picture.convert("RGB")), picture.format in LOSSY_FORMATS
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except _DAMAGE as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error
