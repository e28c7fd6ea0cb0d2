"""PLY, after "The PLY Polygon File Format" (Greg Turk, 1994), text and both binary orders."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.second_reader.model import Reading, Refused, integer, number, plain_lines

CODES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B",
    "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I",
    "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

#: name and count of an element, and its properties: name, type, type of a list's length
Element = tuple[str, int, list[tuple[str, str, str | None]]]
Row = dict[str, list[float]]


def read_ply(path: Path) -> Reading:
    """Read the faces of a PLY file."""
    order, elements, data = _header(path.read_bytes())
    try:
        rows = _text(data, elements) if order == "" else _binary(data, order, elements)
    except (StopIteration, RuntimeError, struct.error) as error:
        raise Refused(f"the file is cut off, or longer than its header states: {error}") from None
    if "tristrips" in rows or not rows.get("face"):
        raise Refused("triangle strips, or no faces")
    vertices = np.array([[row[axis][0] for axis in "xyz"] for row in rows.get("vertex", [])])
    reading = Reading()
    for row in rows["face"]:
        corners = row.get("vertex_indices", row.get("vertex_index", []))
        reading.add(vertices, [int(corner) for corner in corners])
    return reading


def _header(data: bytes) -> tuple[str, list[Element], bytes]:
    """Return the byte order ("" for text), the elements, and the bytes after the header."""
    end = b"\r" if data[3:4] == b"\r" != data[4:5] != b"\n" else b"\n"
    head, separator, rest = data.partition(
        end + b"end_header" + (b"\r\n" if b"\r\n" in data else end)
    )
    lines = [line.decode("latin-1").split() for line in plain_lines(head)]
    if not separator or lines[0] != ["ply"]:
        raise Refused("no header")
    order, elements = None, list[Element]()
    try:
        for words in lines[1:]:
            match words:
                case ["format", name, "1.0"]:
                    order = _ORDERS[name]
                case ["element", name, count]:
                    elements.append((name, int(count), []))
                case ["property", "list", length, kind, name]:
                    elements[-1][2].append((name, CODES[kind], CODES[length]))
                case ["property", kind, name]:
                    elements[-1][2].append((name, CODES[kind], None))
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case _:
                    raise Refused(f"header line {words}")
    except (LookupError, ValueError) as error:
        raise Refused(f"header: {error}") from None
    names = [{name for name, _, _ in properties} for _, _, properties in elements]
    if order is None or any(len(a) < len(b[2]) for a, b in zip(names, elements, strict=True)):
        raise Refused("no format, or a property is declared twice")
    if not any(
        name == "vertex" and {"x", "y", "z"} <= names[k] for k, (name, *_) in enumerate(elements)
    ):
        raise Refused("no vertices with x, y and z")
    return order, elements, rest


def _rows(
    elements: list[Element], take: Callable[[str], float], end: Callable[[], None]
) -> dict[str, list[Row]]:
    rows: dict[str, list[Row]] = {}
    for name, count, properties in elements:
        rows[name] = []
        for _ in range(count):
            row = {}
            for label, code, length in properties:
                row[label] = [take(code) for _ in range(1 if length is None else int(take(length)))]
            end()
            rows[name].append(row)
    return rows


def _text(data: bytes, elements: list[Element]) -> dict[str, list[Row]]:
    lines = [line.split() for line in plain_lines(data) if line.split()][::-1]
    line = iter(lines.pop()) if lines else iter([])

    def take(code: str) -> float:
        word = next(line)
        # The header states the type, although a text may have more digits.
        return (
            float(np.float32(number(word)))
            if code == "f"
            else (number if code == "d" else integer)(word)
        )

    def end() -> None:
        nonlocal line
        if next(line, None) is not None:
            raise Refused("a line holds more than its properties")
        line = iter(lines.pop()) if lines else iter([])

    rows = _rows(elements, take, end)
    if lines or next(line, None) is not None:
        raise Refused("lines beyond the header's counts")
    return rows


def _binary(data: bytes, order: str, elements: list[Element]) -> dict[str, list[Row]]:
    place = 0

    def take(code: str) -> float:
        nonlocal place
        value: float = struct.unpack_from(order + code, data, place)[0]
        place += struct.calcsize(order + code)
        return value

    rows = _rows(elements, take, lambda: None)
    if data[place:]:
        raise Refused("bytes beyond the header's counts")
    return rows
