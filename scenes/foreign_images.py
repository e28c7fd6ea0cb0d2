"""Hogel images as other renderers write them: numbers packed in RGB, plain pictures, OpenEXR."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.exr_header import MAGIC
from xfrustum.scenes.exr_reader import read_image
from xfrustum.scenes.hogel_image import NOTHING, HogelCamera, HogelImage
from xfrustum.scenes.input_files import bounded_memory, regular_size


class Encoding(StrEnum):
    """What the RGB values of a picture mean; an OpenEXR file says so itself."""

    RGB = "rgb"
    """Linear radiance."""
    SRGB = "srgb"
    TRIANGLE_ID = "triangle-id"
    """Red * 65536 + green * 256 + blue is the triangle's number + 1, 0 for nothing."""
    OBJECT_ID = "object-id"
    """The same with the object's number."""


def read_foreign(path: Path, camera: HogelCamera, encoding: Encoding) -> HogelImage:
    """Read a hogel image by any renderer.

    Parameters
    ----------
    path
        An OpenEXR file with any of the channels of the contract, or a picture.
    camera
        What it answers for; what a file says of itself is not believed.
    encoding
        What the RGB values of a picture mean.

    Raises
    ------
    InputError
        Missing, unreadable, or of another size.
    """
    regular_size(path, "file")
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if magic == MAGIC:
        return read_image(path, camera, partial=True)
    return _of_picture(_pixels(path, camera), camera, encoding)


def _pixels(path: Path, camera: HogelCamera) -> NDArray[np.uint8]:
    """Return RGB (H, W, 3) of a picture."""
    try:
        with bounded_memory(path), Image.open(path) as picture:
            _check_size(path, picture.size, camera)
            if picture.mode not in ("RGB", "RGBA", "P", "L", "1"):
                raise InputError(f"{path}: has mode {picture.mode}; write 8 bits each of red, green and blue")
            return np.asarray(picture.convert("RGB"))
    except InputError:
        raise
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error


def _check_size(path: Path, size: tuple[int, int], camera: HogelCamera) -> None:
    if size != tuple(camera.resolution):
        width, height = camera.resolution
        raise InputError(f"{path}: is {size[0]} x {size[1]}, but the scene says {width} x {height}")


def _of_picture(pixels: NDArray[np.uint8], camera: HogelCamera, encoding: Encoding) -> HogelImage:
    shape = pixels.shape[:2]
    nothing = np.full(shape, NOTHING, dtype=np.int32)
    packed = pixels.astype(np.int32) @ np.array([65536, 256, 1], dtype=np.int32) - 1
    color = None
    if encoding in (Encoding.RGB, Encoding.SRGB):
        color = (pixels / 255).astype(np.float32)
        if encoding is Encoding.SRGB:
            # IEC 61966-2-1, decoding.
            color = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
            color = color.astype(np.float32)
    return HogelImage(
        camera=camera,
        triangle=packed if encoding is Encoding.TRIANGLE_ID else nothing,
        object=packed if encoding is Encoding.OBJECT_ID else nothing,
        position=np.full((*shape, 3), np.nan, dtype=np.float32),
        color=color,
    )
