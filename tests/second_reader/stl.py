"""STL in text and binary, after the "StereoLithography Interface Specification" (3D Systems, 1989)."""

from __future__ import annotations

import struct
from pathlib import Path

from tests.second_reader import texts
from tests.second_reader.model import Reading, Refused


def read(path: Path) -> Reading:
    """Read the triangles of an STL file: binary where the length fits the count, else text."""
    data = path.read_bytes()
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else None
    if count is not None and len(data) == 84 + 50 * count:
        return _binary(data, count)
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _text(data)
    if count is None:
        raise Refused(f"{len(data)} bytes are neither text nor a header")
    raise Refused(f"header says {count} triangles = {84 + 50 * count} bytes, file has {len(data)}")


def _binary(data: bytes, count: int) -> Reading:
    reading = Reading()
    for k in range(count):
        reading.add(struct.unpack_from("<9f", data, 84 + 50 * k + 12))
    return reading


def _text(data: bytes) -> Reading:
    """Read solids of facets: `facet normal`, `outer loop`, three `vertex`, `endloop endfacet`."""
    reading = Reading()
    lines = [texts.words(line) for line in data.decode("latin-1").replace("\r", "\n").split("\n")]
    lines = [line for line in lines if line]
    words = [word for line in lines for word in _without_name(line)]
    place = 0

    def take(*expected: str) -> None:
        nonlocal place
        if tuple(word.lower() for word in words[place : place + len(expected)]) != expected:
            raise Refused(
                f"{' '.join(expected)} expected, not {' '.join(words[place : place + 3])}"
            )
        place += len(expected)

    def numbers() -> list[float]:
        nonlocal place
        three = words[place : place + 3]
        place += 3
        values = [texts.number(word) for word in three]
        if len(values) < 3:
            raise Refused("the file is cut off")
        return values

    while place < len(words):
        take("solid")
        while place < len(words) and words[place].lower() == "facet":
            take("facet", "normal")
            numbers()
            take("outer", "loop")
            corners = []
            for _ in range(3):
                take("vertex")
                corners.append(numbers())
            take("endloop", "endfacet")
            reading.add(corners)
        take("endsolid")
    return reading


def _without_name(line: list[str]) -> list[str]:
    return line[:1] if line[0].lower() in ("solid", "endsolid") else line
