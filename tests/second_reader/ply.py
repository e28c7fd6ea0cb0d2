"""PLY, after "The PLY Polygon File Format" (Greg Turk, 1994), text and both binary orders."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from tests.second_reader import texts
from tests.second_reader.model import Reading, Refused

CODES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B",
    "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I",
    "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
CORNERS = ("vertex_indices", "vertex_index")


@dataclass
class Property:
    """Property of an element: a value, or a list with its count before it."""

    name: str
    code: str
    count_code: str | None = None


@dataclass
class Element:
    """Element of the header."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


class Source(Protocol):
    """Stream of values after the header."""

    def take(self, code: str) -> float: ...

    def end_row(self) -> None: ...

    def end(self) -> None: ...


class Text:
    """Values of a text file, one element a line."""

    def __init__(self, data: bytes) -> None:
        self.lines = [
            texts.words(line) for line in data.decode("latin-1").replace("\r", "\n").split("\n")
        ]
        self.lines = [line for line in self.lines if line]
        self.line, self.column = 0, 0

    def take(self, code: str) -> float:
        if self.line >= len(self.lines) or self.column >= len(self.lines[self.line]):
            raise Refused("the file is cut off")
        word = self.lines[self.line][self.column]
        self.column += 1
        return texts.number(word) if code in "fd" else texts.integer(word)

    def end_row(self) -> None:
        if self.line < len(self.lines) and self.column != len(self.lines[self.line]):
            raise Refused("a line holds more than its properties")
        self.line, self.column = self.line + 1, 0

    def end(self) -> None:
        if self.line != len(self.lines):
            raise Refused("lines beyond the header's counts")


class Binary:
    """Values of a binary file."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data, self.order, self.place = data, order, 0

    def take(self, code: str) -> float:
        size = struct.calcsize(self.order + code)
        if self.place + size > len(self.data):
            raise Refused("the file is cut off")
        value: float = struct.unpack_from(self.order + code, self.data, self.place)[0]
        self.place += size
        return value

    def end_row(self) -> None:
        pass

    def end(self) -> None:
        if self.data[self.place :].strip():
            raise Refused("bytes beyond the header's counts")


def read(path: Path) -> Reading:
    """Read the faces of a PLY file."""
    order, elements, data = _header(path.read_bytes())
    for element in elements:
        if len({one.name for one in element.properties}) < len(element.properties):
            raise Refused(f"element {element.name} declares a property twice")
    source: Source = Text(data) if order == "" else Binary(data, order)
    rows = {element.name: _rows(element, source) for element in elements}
    source.end()
    if "tristrips" in rows:
        raise Refused("triangle strips, an element outside the specification")
    if not rows.get("face"):
        raise Refused("a point cloud: no faces")
    if "vertex" not in rows or not all({"x", "y", "z"} <= set(row) for row in rows["vertex"]):
        raise Refused("no vertices with x, y and z")
    vertices = [[row["x"][0], row["y"][0], row["z"][0]] for row in rows["vertex"]]
    reading = Reading()
    for row in rows["face"]:
        corners = next((row[name] for name in CORNERS if name in row), None)
        if corners is None:
            raise Refused("faces without vertex_indices")
        if len(corners) < 3:
            raise Refused(f"a face of {len(corners)} corners")
        if not all(0 <= corner < len(vertices) for corner in corners):
            raise Refused(f"a face names vertex {max(corners)} of {len(vertices)}")
        polygon = [vertices[int(corner)] for corner in corners]
        reading.add(polygon, _single(polygon, elements))
    return reading


def _single(polygon: list[list[float]], elements: list[Element]) -> float:
    """Return the rounding to the type that the header states.

    A text may say more digits of a `float` than the type holds: the digits and the type are both
    right.
    """
    kinds = {one.name: one.code for element in elements for one in element.properties}
    if kinds["x"] != "f":
        return 0.0
    values = np.array(polygon)
    return float(np.abs(values - values.astype(np.float32)).max())


def _rows(element: Element, source: Source) -> list[dict[str, list[float]]]:
    rows = []
    for _ in range(element.count):
        row = {}
        for one in element.properties:
            count = 1 if one.count_code is None else int(source.take(one.count_code))
            row[one.name] = [source.take(one.code) for _ in range(count)]
        source.end_row()
        rows.append(row)
    return rows


def _header(data: bytes) -> tuple[str, list[Element], bytes]:
    """Return the byte order ("" of text), the elements and the bytes after the header."""
    orders = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    order, elements, place = None, list[Element](), 0
    end = b"\n" if b"\n" in data[:1000] else b"\r"
    while True:
        stop = data.find(end, place)
        if stop < 0:
            raise Refused("the header does not end")
        words = texts.words(data[place:stop].decode("latin-1"))
        first, place = place == 0, stop + 1
        if first and words != ["ply"]:
            raise Refused("not a PLY file")
        if not words or words[0] in ("ply", "comment", "obj_info"):
            continue
        if words == ["end_header"]:
            break
        try:
            if words[0] == "format":
                order = orders[words[1]]
            elif words[0] == "element":
                elements.append(Element(words[1], int(words[2])))
            elif words[0] == "property" and words[1] == "list":
                elements[-1].properties.append(Property(words[4], CODES[words[3]], CODES[words[2]]))
            elif words[0] == "property":
                elements[-1].properties.append(Property(words[2], CODES[words[1]]))
            else:
                raise Refused(f"header line {' '.join(words)}")
        except (IndexError, KeyError, ValueError):
            raise Refused(f"header line {' '.join(words)}") from None
    if order is None:
        raise Refused("no format line")
    return order, elements, data[place:]
