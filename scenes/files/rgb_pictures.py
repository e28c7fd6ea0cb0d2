"""Pictures of 8 bits, PNG and the like: their red, green and blue as the file stores them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.disk.input_files import bounded_memory, check_picture_size
from xfrustum.scenes.errors import InputError

LOSSY_FORMATS = ("JPEG", "MPO", "JPEG2000")
"""Pillow's names of formats that change pixels; WebP and others may, but need not."""

RGB_MODES = ("RGB", "RGBA", "P", "L", "1")
"""Pillow's names of kinds of pixels that are red, green and blue of 8 bits, or become these unchanged."""


def read_rgb(path: Path, resolution: tuple[int, int] | None = None) -> tuple[Bytes, bool]:
    """Return the pixels (H, W, 3) of a picture, and whether its format changes pixels when it stores them.

    Parameters
    ----------
    path
        Path of the file.
    resolution
        Width and height that the scene says, if it says any; other sizes are refused before pixels are read.

    Raises
    ------
    InputError
        The file is damaged, no picture, of another size, or has other pixels than those of `RGB_MODES`.
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
    except InputError:
        raise
    except UnidentifiedImageError as error:
        raise InputError(f"{path}: is not an image that can be read") from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: the image is damaged ({error})") from error
