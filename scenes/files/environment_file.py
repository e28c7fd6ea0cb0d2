"""Environment maps from OpenEXR and Radiance HDR files, through OpenImageIO."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from xfrustum.scenes.appearance.light import Environment
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.disk.input_files import (
    bounded_memory,
    check_environment_file,
    check_picture_size,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.openexr.header import MAGIC, check_header

_FORMATS = ("openexr", "hdr")
"""Formats whose pixels are linear radiance."""


def read_environment(path: Path, *, strength: float = 1.0) -> Environment:
    """Read a latitude-longitude map as it is stored, in linear RGB.

    Parameters
    ----------
    path
        Path of an OpenEXR or Radiance HDR file, whose first row is the top of the surroundings.
    strength
        Factor of the radiance, at least 0.

    Raises
    ------
    InputError
        The file is missing, damaged, of another format, not RGB, or has radiance that is negative or not
        finite.
    """
    check_environment_file(path)
    with path.open("rb") as file:
        if file.read(len(MAGIC)) == MAGIC:
            check_header(path)
    try:
        with bounded_memory(path):
            return Environment(radiance=_read_rgb(path), strength=strength, name=str(path))
    except (UnicodeDecodeError, RuntimeError) as error:  # from the library's own reading of headers
        raise InputError(f"{path}: the environment map is damaged ({error}); write it again") from error


def _read_rgb(path: Path) -> Singles:
    """Return the (H, W, 3) pixels of a file."""
    picture = oiio.ImageInput.open(str(path))
    if picture is None or picture.format_name() not in _FORMATS:
        oiio.geterror()  # otherwise the library prints it at the end of the process
        raise InputError(f"{path}: is not an OpenEXR or Radiance HDR picture; convert it to one")
    spec = picture.spec()
    missing = [name for name in "RGB" if name not in spec.channelnames]
    if missing:
        raise InputError(f"{path}: has no channel {missing[0]}; an environment map is an RGB picture")
    if spec.roi != spec.roi_full or spec.depth != 1:
        raise InputError(f"{path}: is a part of a picture only; an environment map has all directions")
    if spec.get_int_attribute("Orientation", 1) != 1:
        raise InputError(f"{path}: is not stored row by row from the top left; write it so")
    check_picture_size(path, spec.width, spec.height)
    pixels = picture.read_image(oiio.FLOAT)
    if pixels is None:
        reason = " ".join(picture.geterror().split())
        raise InputError(f"{path}: the environment map is damaged ({reason}); write it again")
    return np.asarray(pixels[..., [spec.channelindex(name) for name in "RGB"]], dtype=np.float32)
