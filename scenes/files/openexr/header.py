"""The header of an OpenEXR file, checked before the library sees it.

The library's Python binding ends the process at a name that is no UTF-8, and allocates whatever a header
declares. Layout: "OpenEXR File Layout", Academy Software Foundation, sections "Header" and "Attribute types".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from xfrustum.scenes.disk.input_files import check_declared, check_image_file
from xfrustum.scenes.errors import InputError

MAGIC = bytes.fromhex("762f3101")
"""First four bytes of every OpenEXR file."""

_VERSION, _LONG_NAMES, _DEEP, _SEVERAL_PARTS = 2, 0x400, 0x800, 0x1000
"""Version number, and flags above it."""

_NAME_LENGTHS = (31, 255)
"""Largest length of a name, without and with the flag for long names."""

_PIXEL_BYTES = (4, 2, 4)
"""Bytes of unsigned numbers, halves and floats, in the order of their codes."""

_KNOWN_TYPES = frozenset(
    (
        *(
            "box2i",
            "box2f",
            "chlist",
            "chromaticities",
            "compression",
            "double",
            "envmap",
            "float",
            "floatvector",
        ),
        *("int", "keycode", "lineOrder", "m33f", "m33d", "m44f", "m44d", "preview", "rational", "string"),
        *("stringvector", "tiledesc", "timecode", "v2i", "v2f", "v2d", "v3i", "v3f", "v3d"),
    )
)
"""Attribute types of the format; the binding raises an obscure error at any other."""

LARGEST_HEADER = 1 << 20
"""Largest size of a header, in bytes: names, a camera, and a preview picture fit."""

LARGEST_SIDE = 1 << 24
"""Largest number of pixels along a side: single precision cannot count more."""


class _Damaged(Exception):
    """A header breaks the rules of the format; the message says how."""


@dataclass
class _Bytes:
    """Bytes of a header, and the place up to which they have been read."""

    data: bytes
    at: int = 0

    def taken(self, count: int) -> bytes:
        if count < 0 or self.at + count > len(self.data):
            raise _Damaged("it ends within the header")
        self.at += count
        return self.data[self.at - count : self.at]

    def text(self, longest: int) -> str:
        """Return a text that ends in a zero byte."""
        end = self.data.find(b"\0", self.at, self.at + longest + 1)
        if end < 0:
            raise _Damaged(f"a name is longer than {longest} bytes, or has no end")
        raw = self.taken(end - self.at)
        self.at += 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise _Damaged(f"the name {raw[:40]!r} is no UTF-8") from error


def check_header(path: Path) -> None:
    """Refuse an OpenEXR file whose header is damaged, or that declares far more pixels than it holds.

    Raises
    ------
    InputError
        The header is damaged or declares too much, or the file is no OpenEXR image of flat pixels.
    """
    check_image_file(path)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if data[: len(MAGIC)] != MAGIC:
        raise InputError(f"{path}: is not an OpenEXR image")
    try:
        declared = _declared(_Bytes(data, len(MAGIC)))
    except _Damaged as error:
        raise InputError(f"{path}: the OpenEXR image is damaged ({error}); write it again") from error
    check_declared(path, declared, "pixels")


def _declared(header: _Bytes) -> int:
    """Return the bytes of pixels that the first part declares."""
    (version,) = struct.unpack("<I", header.taken(4))
    if version & 0xFF != _VERSION:
        raise _Damaged(f"its version is {version & 0xFF}, not {_VERSION}")
    if version & _DEEP:
        raise _Damaged("it has deep pixels; only flat ones are read")
    if version & _SEVERAL_PARTS:
        raise _Damaged("it has several parts; only files of one part are read")
    longest = _NAME_LENGTHS[bool(version & _LONG_NAMES)]
    pixel_bytes, size = None, None
    while name := header.text(longest):
        kind, length = header.text(longest), struct.unpack("<i", header.taken(4))[0]
        value = _Bytes(header.taken(length))
        if kind not in _KNOWN_TYPES:
            raise _Damaged(f"its attribute {name} has the unknown type {kind[:40]}")
        if kind == "string":
            _check_text(name, value.data)
        if name == "channels":
            pixel_bytes = _bytes_of_channels(value, longest)
        elif name == "dataWindow":
            size = _size(value)
    if pixel_bytes is None or size is None:
        raise _Damaged("it declares no channels, or no data window")
    return pixel_bytes * size[0] * size[1]


def _check_text(name: str, value: bytes) -> None:
    try:
        value.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _Damaged(f"its attribute {name} is no UTF-8") from error


def _bytes_of_channels(value: _Bytes, longest: int) -> int:
    """Return the bytes of one pixel in all channels."""
    total = 0
    while value.text(longest):
        (kind,) = struct.unpack("<i", value.taken(4))
        if not 0 <= kind < len(_PIXEL_BYTES):
            raise _Damaged(f"a channel has the unknown pixel type {kind}")
        value.taken(4)  # whether it is perceptually linear, and three reserved bytes
        if min(struct.unpack("<ii", value.taken(8))) < 1:
            raise _Damaged("a channel has no sampling")
        total += _PIXEL_BYTES[kind]
    return total


def _size(value: _Bytes) -> tuple[int, int]:
    """Return width and height of a data window."""
    left, top, right, bottom = struct.unpack("<iiii", value.taken(16))
    width, height = right - left + 1, bottom - top + 1
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise _Damaged(f"its data window is {width} x {height} pixels")
    return width, height
