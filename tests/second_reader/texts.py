"""OBJ ("Advanced Visualizer Manual", B1), OFF (Geomview's manual), and STL (3D Systems, 1989)."""

from __future__ import annotations

import re
import struct
from collections import Counter
from pathlib import Path

import numpy as np

from tests.second_reader.model import Reading, Refused, integer, number, plain_lines

#: Statements of OBJ without surfaces.
_SILENT = set(
    b"vp p l g s mg o bevel c_interp d_interp lod usemtl mtllib shadow_obj trace_obj usemap"
    b" maplib ctech stech".split()
)


def read_obj(path: Path) -> Reading:
    """Read the polygons of an OBJ file."""
    text = b"\n".join(line.split(b"#")[0].rstrip() for line in plain_lines(path.read_bytes()))
    if text.rstrip(b"\n").endswith(b"\\"):
        raise Refused("the last line is continued by none")
    vertices: list[list[float]] = []
    faces: list[list[int]] = []
    counts = Counter[bytes]()
    for line in text.replace(b"\\\n", b" ").split(b"\n"):
        word, *values = line.split() or [b"o"]
        word = word.lower()
        if word in (b"v", b"vt", b"vn"):
            numbers = [number(value) for value in values]
            if word == b"v":
                # Weights are defined only for rational surfaces.
                if len(numbers) not in (3, 4, 6) or (len(numbers) == 4 and numbers[3] != 1):
                    raise Refused(f"vertex {values}")
                vertices.append(numbers[:3])
        elif word == b"f":
            faces.append([_place(corner, counts) for corner in values])
        elif word not in _SILENT:
            raise Refused(f"statement {word!r}")
        counts[word] += 1
    reading, points = Reading(), np.array(vertices).reshape(-1, 3)
    for corners in faces:
        reading.add(points, corners)
    return reading


def _place(corner: bytes, counts: Counter[bytes]) -> int:
    """Return the index of a corner's vertex; negative indices count back from the face's line."""
    parts = corner.split(b"/")
    if len(parts) > 3:
        raise Refused(f"corner {corner!r}")
    places = []
    for kind, part in zip((b"v", b"vt", b"vn"), parts, strict=False):
        if part or kind == b"v":
            index = integer(part)
            if index == 0 or index < -counts[kind]:
                raise Refused(f"index {index} after {counts[kind]}")
            places.append(index - 1 if index > 0 else counts[kind] + index)
    return places[0]


def read_off(path: Path) -> Reading:
    """Read the polygons of an OFF file in text, with three or homogeneous coordinates."""
    # Line ends matter only after the corners of a face, where its color may follow.
    words = [
        word
        for line in plain_lines(path.read_bytes())
        for word in [*line.split(b"#")[0].split(), b"\n"]
    ][::-1]

    def take() -> bytes:
        while words and words[-1] == b"\n":
            words.pop()
        if not words:
            raise Refused("the file is cut off")
        return words.pop()

    head = take()
    if head.isdigit():  # the word OFF is optional
        words.append(head)
        head = b"OFF"
    match = re.match(rb"(ST)?(C)?(N)?(4)?OFF\Z", head)
    if match is None or words[-1] == b"BINARY":
        raise Refused(f"header {head!r}")
    texture, color, normal, weighted = map(bool, match.groups())
    count, faces, _ = integer(take()), integer(take()), integer(take())
    vertices = []
    for _ in range(count):
        row = [number(take()) for _ in range(3 + weighted + 3 * normal + 4 * color + 2 * texture)]
        if weighted and row[3] == 0:
            raise Refused("a vertex at infinity")
        vertices.append([value / row[3] if weighted else value for value in row[:3]])
    reading, points = Reading(), np.array(vertices).reshape(-1, 3)
    for _ in range(faces):
        reading.add(points, [integer(take()) for _ in range(integer(take()))])
        spare = 0
        while words and words[-1] != b"\n":
            number(words.pop())
            spare += 1
        if spare > 4:
            raise Refused("more numbers than a color has")
    if set(words) - {b"\n"}:
        raise Refused("more than the header's counts")
    return reading


_NUMBERS = rb"([\d.+-]\S*)\s+([\d.+-]\S*)\s+([\d.+-]\S*)\s+"
_VERTEX = rb"vertex\s+" + _NUMBERS
_FACET = (
    rb"facet\s+normal\s+" + _NUMBERS + rb"outer\s+loop\s+" + 3 * _VERTEX + rb"endloop\s+endfacet\s+"
)


def read_stl(path: Path) -> Reading:
    """Read the triangles of an STL file: binary where the length fits the count, else text."""
    data = path.read_bytes()
    reading = Reading()
    if len(data) >= 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        for place in range(84, len(data), 50):
            corners = struct.unpack_from("<9f", data, place + 12)
            reading.polygons.append(np.array(corners).reshape(3, 3))
        return reading
    text = b"\n".join(plain_lines(data)).lower()
    text = re.sub(rb"(?m)^\s*((?:end)?solid)\b.*$", rb"\1", text)  # names are arbitrary
    if not re.fullmatch(rb"\s*(?:solid\s+(?:%b)*endsolid\s*)+" % _FACET, text):
        raise Refused("neither binary nor solids of facets")
    for facet in re.findall(_FACET, text):
        reading.polygons.append(np.array([number(word) for word in facet[3:]]).reshape(3, 3))
    return reading
