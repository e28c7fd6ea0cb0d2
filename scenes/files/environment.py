"""Environment maps from OpenEXR and Radiance HDR files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from xfrustum.scenes.appearance.appearance import Environment
from xfrustum.scenes.arrays import Bytes, Singles
from xfrustum.scenes.disk.input_files import bounded_memory, check_picture_size, head_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import MAGIC, read_rgb_channels

#: Header of a Radiance picture: lines up to an empty one, then its size.
_HDR_HEADER = re.compile(rb"#\?[^\n]*\n(?:[^\n]+\n)*\n([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\n")
#: Widths of rows that may be run-length encoded, which begin with 2, 2 and the width.
_RUN_WIDTHS = range(8, 1 << 15)


def read_environment(path: Path, *, strength: float = 1.0) -> Environment:
    """Read a latitude-longitude map as it is stored, in linear RGB, its radiance multiplied by the strength.

    Raises InputError where the file is missing, damaged, of another format than OpenEXR and Radiance HDR, not
    RGB, or has radiance that is negative or not finite.
    """
    openexr = head_of(path, "environment map", len(MAGIC)) == MAGIC
    with bounded_memory(path):
        radiance = _of_openexr(path) if openexr else _of_radiance(path)
        return Environment(radiance=radiance, strength=strength, name=str(path))


def _of_openexr(path: Path) -> Singles:
    radiance, header = read_rgb_channels(path, "an environment map is an RGB picture")
    if str(header["dataWindow"]) != str(header["displayWindow"]):
        raise InputError(f"{path}: is a part of a picture only; an environment map has all directions")
    return radiance.astype(np.float32)


def _of_radiance(path: Path) -> Singles:
    """Return the pixels of a Radiance picture: three mantissas and an exponent, 8 bits each.

    Greg Ward, "Real Pixels", Graphics Gems II (1991); rows are run-length encoded component by component.
    """
    content = path.read_bytes()
    found = _HDR_HEADER.match(content)
    if found is None:
        raise InputError(f"{path}: is not an OpenEXR or Radiance HDR picture; convert it to one")
    if b"FORMAT=32-bit_rle_xyze" in found[0]:
        raise InputError(f"{path}: is stored in XYZ; an environment map is an RGB picture")
    if (found[1], found[3]) != (b"-Y", b"+X"):
        raise InputError(f"{path}: is not stored row by row from the top left; write it so")
    height, width = int(found[2]), int(found[4])
    check_picture_size(path, width, height)
    stored = np.frombuffer(content, np.uint8)
    pixels, at = np.empty((height, width, 4), np.uint8), found.end()
    for row in pixels:
        at = _read_row(path, stored, at, row)
    exponent = pixels[..., 3:].astype(np.int32)
    scale = np.where(exponent == 0, 0, np.ldexp(np.float32(1), exponent - 136)).astype(np.float32)
    return pixels[..., :3] * scale


def _read_row(path: Path, stored: Bytes, at: int, row: Bytes) -> int:
    """Fill a row (W, 4) from the bytes at a place, and return the place behind it."""
    width = len(row)
    mark = np.array((2, 2, width >> 8, width & 255), np.uint8)
    if width not in _RUN_WIDTHS or not np.array_equal(stored[at : at + 4], mark):
        flat = stored[at : at + 4 * width]
        if flat.size < 4 * width or (flat.reshape(-1, 4)[:, :3] == 1).all(axis=1).any():
            raise InputError(f"{path}: the environment map is damaged, or of before 1991; write it again")
        row[:] = flat.reshape(width, 4)
        return at + 4 * width
    at += 4
    for component in row.T:
        done = 0
        while done < width:
            # A code above 128 repeats the next value; another is the number of values that follow.
            code = int(stored[at]) if at + 1 < stored.size else 0
            count = code - 128 if code > 128 else code
            values = stored[at + 1 : at + 2] if code > 128 else stored[at + 1 : at + 1 + count]
            if not 0 < count <= width - done or values.size not in (1, count):
                raise InputError(f"{path}: the environment map is damaged (a run of a row); write it again")
            component[done : done + count] = values
            done, at = done + count, at + 1 + values.size
    return at
