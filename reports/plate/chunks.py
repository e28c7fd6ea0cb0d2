"""Is a chunk of a plate all there? From the layout of its Zstandard frame, without decompressing it.

A frame says how many bytes it holds when it is decompressed, and is a chain of blocks each of which says
how long it is: RFC 8878, section 3.1.1. A file that is empty, cut off, or something else does not end
where its chain does.
"""

from __future__ import annotations

import os
import stat
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MAGIC = 0xFD2FB528

_HEADER_BYTES = 18
"""Most that a frame's header takes: magic number, descriptor, window, dictionary, size of the content."""

_DICTIONARY_BYTES = (0, 1, 2, 4)
_RAW, _RUN, _COMPRESSED = range(3)


@contextmanager
def opened(path: Path) -> Iterator[tuple[int, int] | None]:
    """Open a regular file; yield its descriptor and its size, or None where there is no such file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        yield None
        return
    try:
        status = os.fstat(descriptor)
        yield (descriptor, status.st_size) if stat.S_ISREG(status.st_mode) else None
    finally:
        os.close(descriptor)


def is_whole(path: Path, content_bytes: int) -> bool:
    """Return whether a file is one complete Zstandard frame of some content's length."""
    with opened(path) as file:
        return file is not None and is_frame(file[0], (0, file[1]), content_bytes)


def is_frame(descriptor: int, place: tuple[int, int], content_bytes: int) -> bool:
    """Return whether a part of a file is one complete Zstandard frame of some content's length.

    Parameters
    ----------
    descriptor
        The open file.
    place
        First byte of the part, and its number of bytes.
    content_bytes
        Number of bytes that the frame has to hold when it is decompressed.
    """
    try:
        return _frame_end(descriptor, place[0], content_bytes) == sum(place)
    except (OSError, struct.error):
        return False


def _frame_end(descriptor: int, start: int, content_bytes: int) -> int | None:
    """Return where the frame that begins at a byte ends; None where there is none of that content."""
    header = os.pread(descriptor, _HEADER_BYTES, start)
    magic: int
    flags: int
    magic, flags = struct.unpack_from("<IB", header)
    single, checksum = flags >> 5 & 1, flags >> 2 & 1
    place = 5 + (1 - single) + _DICTIONARY_BYTES[flags & 3]
    form = ("<B" if single else "", "<H", "<I", "<Q")[flags >> 6]
    if magic != MAGIC or not form:
        return None
    content: int = struct.unpack_from(form, header, place)[0]
    # Two bytes begin where one ends.
    if content + (256 if form == "<H" else 0) != content_bytes:
        return None
    place += start + struct.calcsize(form)
    last = False
    while not last:
        # Nothing more reads as a block of no kind.
        block = int.from_bytes(os.pread(descriptor, 3, place).ljust(3, b"\xff"), "little")
        last, kind, size = bool(block & 1), block >> 1 & 3, block >> 3
        if kind not in (_RAW, _RUN, _COMPRESSED):
            return None
        place += 3 + (1 if kind == _RUN else size)
    return place + 4 * checksum
