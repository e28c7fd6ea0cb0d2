"""OFF and its family, after the manual of Geomview, section "OFF Files"."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from tests.second_reader import texts
from tests.second_reader.model import UNIT, Reading, Refused

HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\Z")


def read(path: Path) -> Reading:
    """Read the polygons of an OFF file: `[ST][C][N][4][n]OFF`, text or `BINARY`."""
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    first, _, rest = data.partition(b"\n")
    words = texts.words(first.decode("latin-1").split("#")[0])
    if len(words) == 2 and words[1] == "BINARY":
        if "n" in words[0]:
            raise Refused("binary positions of n dimensions")
        return _binary(_kind(words[0]), rest)
    return _text(data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n"))


def _kind(word: str) -> tuple[bool, int]:
    """Return whether positions are homogeneous, and the count of numbers after a position."""
    match = HEADER.match(word)
    if not match:
        raise Refused(f"header {word}")
    texture, color, normal, four, several = match.groups()
    if several and four:
        raise Refused("homogeneous positions of n dimensions")
    return bool(four), 3 * bool(normal) + 4 * bool(color) + 2 * bool(texture)


def _position(values: list[float], homogeneous: bool) -> list[float]:
    if not homogeneous:
        return values
    if values[3] == 0:
        raise Refused("a vertex at infinity")
    return [value / values[3] for value in values[:3]]


def _text(text: str) -> Reading:
    # Line ends matter after the corners of a face alone, where the color may follow.
    tokens = [
        word for line in text.split("\n") for word in [*texts.words(line.split("#", 1)[0]), "\n"]
    ]
    place = 0

    def take() -> str:
        nonlocal place
        while place < len(tokens) and tokens[place] == "\n":
            place += 1
        if place == len(tokens):
            raise Refused("the file is cut off")
        place += 1
        return tokens[place - 1]

    def number() -> float:
        return texts.number(take())

    def integer() -> int:
        return texts.integer(take())

    head = take()
    if head.isdigit():  # "recommended but optional"
        place, head = 0, "OFF"
    homogeneous, extra = _kind(head)
    if "n" in head and (dimensions := integer()) != 3:
        raise Refused(f"positions of {dimensions} dimensions")
    count, faces, _ = integer(), integer(), integer()
    vertices = []
    for _ in range(count):
        vertices.append(_position([number() for _ in range(3 + homogeneous)], homogeneous))
        for _ in range(extra):
            number()
    reading = Reading()
    for _ in range(faces):
        corners = [integer() for _ in range(integer())]
        _add(reading, vertices, corners, homogeneous)
        stop = tokens.index("\n", place)
        color = tokens[place:stop]
        if len(color) > 4 or not all(re.match(r"[+-]?[\d.]", word) for word in color):
            raise Refused(f"color {' '.join(color)}")
        place = stop
    if any(token != "\n" for token in tokens[place:]):
        raise Refused("more than the header's counts")
    return reading


def _binary(kind: tuple[bool, int], data: bytes) -> Reading:
    """Read 32-bit integers and floats, most significant byte first."""
    homogeneous, extra = kind
    place = 0

    def take(code: str, count: int) -> list[float]:
        nonlocal place
        if count < 0 or place + 4 * count > len(data):
            raise Refused("the file is cut off")
        place += 4 * count
        return list(struct.unpack_from(f">{count}{code}", data, place - 4 * count))

    count, faces, _ = (int(value) for value in take("i", 3))
    vertices = []
    for _ in range(count):
        values = take("f", 3 + homogeneous + extra)
        vertices.append(_position(values[: 3 + homogeneous], homogeneous))
    reading = Reading()
    for _ in range(faces):
        corners = [int(value) for value in take("i", int(take("i", 1)[0]))]
        _add(reading, vertices, corners, homogeneous)
        take("f", int(take("i", 1)[0]))
    if data[place:].strip():
        raise Refused("more than the header's counts")
    return reading


def _add(
    reading: Reading, vertices: list[list[float]], corners: list[int], homogeneous: bool
) -> None:
    if len(corners) < 3:
        raise Refused(f"a face of {len(corners)} corners")
    if not all(0 <= corner < len(vertices) for corner in corners):
        raise Refused(f"a face names a vertex of {len(vertices)} that is not there")
    polygon = [vertices[corner] for corner in corners]
    largest = max(abs(value) for corner in polygon for value in corner)
    reading.add(polygon, 4 * UNIT * largest if homogeneous else 0.0)  # x / w, or x times 1 / w
