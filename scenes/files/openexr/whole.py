"""Whether an OpenEXR file is complete, seen from its layout alone, without its pixels.

A file is a header, a table of where each chunk of rows begins, and the chunks one after the other:
https://openexr.com/en/latest/OpenEXRFileLayout.html. The table is written last, so that it shows whether
the writing came to its end; the length of the last chunk shows whether the file has kept all of it.
"""

from __future__ import annotations

import errno
import struct
from pathlib import Path
from typing import BinaryIO

from xfrustum.scenes.files.openexr.header import MAGIC

ROWS_OF_ZIP_CHUNK = 16
"""Rows that ZIP compression puts into one chunk."""


def check_whole(path: Path, height: int) -> None:
    """Raise OSError unless a file with one part, whose rows are compressed by ZIP, has every chunk.

    Parameters
    ----------
    path
        Path of a file by `ImageWriter`, with chunks in the order of the rows and nothing between them.
    height
        Rows of the image.
    """
    with path.open("rb") as file:
        _skip_header(file)
        count = -(-height // ROWS_OF_ZIP_CHUNK)
        begins = struct.unpack(f"<{count}Q", _read(file, 8 * count))
        place = file.tell()
        for number, begin in enumerate(begins):
            file.seek(begin)
            row, size = struct.unpack("<ii", _read(file, 8))
            if begin != place or row != number * ROWS_OF_ZIP_CHUNK or size < 0:
                raise _incomplete()
            place += 8 + size
        if place != path.stat().st_size:
            raise _incomplete()


def _skip_header(file: BinaryIO) -> None:
    if _read(file, 4) != MAGIC:
        raise _incomplete()
    _read(file, 4)  # version and flags
    while _text(file):
        _text(file)  # the attribute's type
        (size,) = struct.unpack("<i", _read(file, 4))
        _read(file, size)


def _text(file: BinaryIO) -> bytes:
    """Read to the next zero."""
    letters = bytearray()
    while letter := _read(file, 1).rstrip(b"\0"):
        letters += letter
    return bytes(letters)


def _read(file: BinaryIO, size: int) -> bytes:
    data = file.read(max(size, 0))
    if len(data) != size:
        raise _incomplete()
    return data


def _incomplete() -> OSError:
    return OSError(errno.EIO, "what was written is not complete")
