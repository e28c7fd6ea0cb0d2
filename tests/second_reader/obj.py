"""Wavefront OBJ, after "Advanced Visualizer Manual", appendix B1 (object files)."""

from __future__ import annotations

from pathlib import Path

from tests.second_reader import texts
from tests.second_reader.model import Reading, Refused

#: Statements without geometry, and points and lines.
HARMLESS = {
    "vp",
    "p",
    "l",
    "g",
    "s",
    "mg",
    "o",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "usemtl",
    "mtllib",
}
HARMLESS |= {"shadow_obj", "trace_obj", "usemap", "maplib", "ctech", "stech"}
#: Statements that make surfaces from control points or change the file that is read.
OTHER_GEOMETRY = {
    "curv",
    "curv2",
    "surf",
    "cstype",
    "bzp",
    "bsp",
    "cdc",
    "cdp",
    "res",
    "con",
    "call",
    "csh",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "deg",
    "bmat",
    "step",
}


def read(path: Path) -> Reading:
    """Read the polygons of an OBJ file."""
    vertices: list[list[float]] = []
    texture: list[list[float]] = []
    corners: list[tuple[list[int], list[int]]] = []
    counts = {"v": 0, "vt": 0, "vn": 0}
    for number, words in _statements(path):
        word, values = words[0].lower(), words[1:]
        if word == "v":
            vertices.append(_vertex(number, values))
        elif word == "vt":
            texture.append([*_numbers(number, values), 0.0][:2])
        elif word in ("f", "fo"):
            corners.append(_face(number, values, counts))
        elif word in OTHER_GEOMETRY:
            raise Refused(f"line {number}: statement {word}")
        elif word not in HARMLESS and word not in counts:
            raise Refused(f"line {number}: {word} is no statement")
        if word in counts:
            counts[word] += 1
    reading = Reading()
    for places, places_of_texture in corners:
        if max(places) >= len(vertices):
            raise Refused(f"a face names vertex {max(places) + 1} of {len(vertices)}")
        known = places_of_texture and max(places_of_texture) < len(texture)
        reading.add(
            [vertices[k] for k in places],
            texture=[texture[k] for k in places_of_texture] if known else None,
        )
    return reading


def _statements(path: Path) -> list[tuple[int, list[str]]]:
    """Split a file into numbered statements: comments removed, continued lines joined."""
    text = path.read_bytes()
    text = text.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = text.decode("latin-1").split("\n")
    statements, parts, first = [], "", 1
    for number, line in enumerate(lines, 1):
        if not parts:
            first = number
        stripped = line.split("#", 1)[0].rstrip(" \t\v\f")
        if stripped.endswith("\\"):
            parts += stripped[:-1] + " "
            continue
        words = texts.words(parts + stripped)
        parts = ""
        if words:
            statements.append((first, words))
    if texts.words(parts):
        raise Refused("the last line is continued by none")
    return statements


def _numbers(number: int, words: list[str]) -> list[float]:
    if not words:
        raise Refused(f"line {number}: no numbers")
    return [texts.number(word) for word in words]


def _vertex(number: int, words: list[str]) -> list[float]:
    values = _numbers(number, words)
    if len(values) not in (3, 4, 6, 7):  # x y z, or with a weight, a color, a color and alpha
        raise Refused(f"line {number}: a vertex of {len(values)} numbers")
    if len(values) == 4 and values[3] != 1:  # the manual defines it for rational curves alone
        raise Refused(f"line {number}: weight {values[3]}")
    return values[:3]


def _face(number: int, words: list[str], counts: dict[str, int]) -> tuple[list[int], list[int]]:
    """Return the places of vertices and texture coordinates; negative indices count back."""
    if len(words) < 3:
        raise Refused(f"line {number}: a face of {len(words)} corners")
    places: dict[str, list[int]] = {"v": [], "vt": [], "vn": []}
    for word in words:
        parts = word.split("/")
        if len(parts) > 3 or not parts[0]:
            raise Refused(f"line {number}: corner {word}")
        for kind, part in zip(places, parts, strict=False):
            if part:
                places[kind].append(_place(number, part, counts[kind]))
    whole = places["vt"] if len(places["vt"]) == len(words) else []
    return places["v"], whole


def _place(number: int, word: str, count: int) -> int:
    value = texts.integer(word)
    if value == 0 or value < -count:
        raise Refused(f"line {number}: index {value} after {count}")
    return value - 1 if value > 0 else count + value
