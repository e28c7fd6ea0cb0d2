"""Wavefront OBJ (Advanced Visualizer Manual, B1): polygons with textures, normals and colors.

Triangles are numbered in trimesh's order: materials from the last to the first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.visual.texture import unmerge_faces

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.disk import read_input
from xfrustum.scenes.meshes.content import (
    MeshContent,
    MeshPart,
    file_beside,
    linear_colors,
    open_picture,
    unit_normals,
)
from xfrustum.scenes.meshes.tessellation import cut_polygons, sizes_together
from xfrustum.scenes.meshes.text_lines import (
    TextLines,
    join_continued,
    parse,
    plain_text,
    starts_of,
    word_starts,
)
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.representation import counted

#: Statements of surfaces other than polygons, of other files, and of commands, with reasons.
_REFUSED: Final = {
    **dict.fromkeys(("surf", "bzp", "bsp", "cdp"), "a free-form surface; export polygons"),
    **dict.fromkeys(("call", "csh"), "another file or a command; write its content into this file"),
    "fo": "a face of an old version of OBJ; write f instead",
}
_NO_OBJ: Final = {
    plain_text(b"PK\3\4"): "an archive, and no OBJ; unpack it first",
    b"<": "XML or HTML, and no OBJ; export the mesh as OBJ, or save the file itself, "
    "not its web page",
}
_CURVES: Final = {
    "curv", "curv2", "vp", "cstype", "deg", "bmat", "step", "parm", "trim", "hole", "scrv", "sp",
    "end", "con", "ctech", "stech", "res", "cdc",
}  # fmt: skip
#: Names, groups and hints for other renderers, without effect on geometry.
_NAMES: Final = {
    "o", "g", "mg", "lod", "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj", "maplib",
    "usemap", "mtllib", "usemtl", "s",
}  # fmt: skip
#: Statements of objects without a surface; they are listed as unread.
_FLAT: Final = {"lines (l)": {"l"}, "points (p)": {"p"}, "free-form curves": _CURVES}
_DRAWN: Final = ("v", "vt", "vn", "f")
_POINT, _TEXTURE, _NORMAL = 0, 1, 2  # columns of a corner's indices, in the order of the file
_ABSENT: Final = -1
_BLANK: Final = ord(" ")
_INDEXED: Final = {"v": "vertices", "vt": "texture coordinates", "vn": "normals"}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Polygons:
    #: (K, 3) indices of vertex, texture coordinates and normal, from 0; -1 if absent
    corners: Indices
    counts: Indices  #: (P,) corners of each polygon
    lines: Indices  #: (P,) line of each polygon


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tables:
    vertices: Floats
    colors: Floats | None  #: at vertices, linear RGB
    coordinates: Floats  #: (N, 2) texture coordinates; the last row, index -1, is NaN
    normals: Floats  #: (N, 3); the last row, index -1, is NaN


def read_obj(path: Path) -> MeshContent:
    """Read an OBJ file; InputError names the line of damage or of a surface of another type."""
    text = plain_text(read_input(path, "mesh file"))
    for start, kind in _NO_OBJ.items():
        if text.lstrip().startswith(start):
            raise InputError(f"{path}: is {kind}")
    # Comments are recognized before continued lines are joined, because a comment may end with a
    # backslash.
    lines = TextLines(path, join_continued(text))
    words = lines.keywords(3)
    kinds = {name: words == name.encode() for name in _DRAWN}
    others = np.flatnonzero(~np.logical_or.reduce(list(kinds.values()))).tolist()
    named: dict[str, list[int]] = {}  # line numbers of other statements by keyword
    for line in others:
        named.setdefault(lines.text(line).split(" ")[0].lower(), []).append(line)
    unread = _other_statements(lines, named)
    tables, uncolored = _tables(lines, kinds)
    polygons = _polygons(lines, kinds)
    if "s" in named and (polygons.corners[:, _NORMAL] == _ABSENT).any():
        unread += _smoothing(lines, named["s"])
    changes = named.get("usemtl", [])
    # Material names: none at first, then the name of each `usemtl` statement.
    in_use = ["", *(_value(lines, line) for line in changes)]
    names = list(dict.fromkeys(in_use))
    # The material of a polygon is the last material named before its line.
    used = np.searchsorted(changes, polygons.lines, side="right")
    material_of_polygon = np.array([names.index(name) for name in in_use])[used]
    looks, not_read = _read_libraries(
        path,
        [_value(lines, line) for line in named.get("mtllib", [])],
        {names[number] for number in np.unique(material_of_polygon).tolist()},
    )
    triangles = cut_polygons(
        tables.vertices,
        polygons.corners[:, _POINT],
        polygons.counts,
        lambda polygon, reason: lines.error(int(polygons.lines[polygon]), f"the face {reason}"),
    )
    triangles_of = _places(np.repeat(material_of_polygon, polygons.counts - 2))
    parts = []
    for number, places in _places(material_of_polygon).items():
        own, counts = triangles[triangles_of[number]], polygons.counts[places]
        # trimesh numbers triangles by polygon size only if all polygons have the same size.
        if (counts == counts[0]).all():
            own = own[sizes_together(counts)]
        parts.append(_part(names[number], polygons.corners[own], tables, looks.get(names[number])))
    return MeshContent(parts=tuple(reversed(parts)), unread=(*unread, *uncolored, *not_read))


def _places(numbers: Indices) -> dict[int, Indices]:
    """Return the indices of each number, ascending; numbers in order of first occurrence."""
    unique, first, counts = np.unique(numbers, return_index=True, return_counts=True)
    groups = np.split(np.argsort(numbers, kind="stable"), np.cumsum(counts)[:-1])
    return {int(unique[group]): groups[group] for group in np.argsort(first).tolist()}


def _value(lines: TextLines, line: int) -> str:
    """Return the rest of a line after its keyword; names may contain `#`."""
    _, _, value = lines.text(line, comment=True).replace("\t", " ").partition(" ")
    return value.strip()


def _other_statements(lines: TextLines, named: dict[str, list[int]]) -> list[UnreadFeature]:
    """Return unread statements; InputError for other surfaces and unknown words."""
    for word, (first, *_) in named.items():
        if word in _REFUSED:
            raise lines.error(first, f"'{word}' is {_REFUSED[word]}")
        if word not in _CURVES | _NAMES | {"l", "p"}:
            reason = f"{word[:20]!r} is no statement of OBJ; delete the line, or begin it with #"
            raise lines.error(first, reason)
    consequence = "are not drawn: they have no surface"
    return [
        UnreadFeature(feature, consequence)
        for feature, words in _FLAT.items()
        if not words.isdisjoint(named)
    ]


def _smoothing(lines: TextLines, statements: list[int]) -> list[UnreadFeature]:
    if all(_value(lines, line).lower() in ("off", "0") for line in statements):
        return []
    flat = "are not applied: faces without normals are flat; set smooth = true in the scene file"
    return [UnreadFeature("smoothing groups (s)", flat)]


def _rows(values: Floats, counts: Indices, width: int) -> Floats:
    """Return (N, width) rows with `counts` numbers each; the rest of a short row is undefined."""
    # A short row at the end would read beyond the values, so the values are padded.
    padded = np.append(values, np.full(width, np.nan))
    return np.asarray(padded[starts_of(counts)[:, None] + np.arange(width)])


def _tables(lines: TextLines, kinds: dict[str, Mask]) -> tuple[_Tables, list[UnreadFeature]]:
    """Return the values to which corners refer, and notes about vertices without a color."""
    values, counts = lines.numbers(kinds["v"], skip=1)
    three = "a vertex needs three coordinates, or three and a color of three numbers, not {}"
    lines.check(kinds["v"], np.isin(counts, (3, 4, 6)), three, counts)
    rows = _rows(values, counts, 6)
    weight = "the fourth coordinate is a weight of rational surfaces, and is {:g}; export polygons"
    lines.check(kinds["v"], (counts != 4) | (rows[:, 3] == 1), weight, rows[:, 3])
    colored, colors, uncolored = counts == 6, None, []
    if colored.any():
        colors = np.ones((len(counts), 3))
        colors[colored] = linear_colors(rows[colored, 3:])
        if not colored.all():
            few = f"have none and are white: {np.count_nonzero(~colored):,} of {len(colored):,}"
            uncolored = [UnreadFeature("colors at vertices", few)]
    values, counts = lines.numbers(kinds["vt"], skip=2)
    right = (counts >= 1) & (counts <= 3)
    lines.check(kinds["vt"], right, "texture coordinates (vt) are one to three numbers")
    coordinates = _rows(values, counts, 2)
    # A single number is u; v is then 0.
    coordinates[counts == 1, 1] = 0.0
    normals, counts = lines.numbers(kinds["vn"], skip=2)
    lines.check(kinds["vn"], counts == 3, "a normal (vn) has three numbers")
    return _Tables(
        vertices=rows[:, :3],
        colors=colors,
        coordinates=np.vstack([coordinates, np.full((1, 2), np.nan)]),
        normals=np.vstack([unit_normals(normals.reshape(-1, 3)), np.full((1, 3), np.nan)]),
    ), uncolored


def _polygons(lines: TextLines, kinds: dict[str, Mask]) -> _Polygons:
    """Return the polygons of a file; InputError for damaged or dangling corners."""
    statements = np.flatnonzero(kinds["f"])
    text, line_ends = lines.bytes_of(kinds["f"], skip=1)
    begins = word_starts(text)
    counts = np.diff(np.searchsorted(begins, line_ends), prepend=0)
    face_of_corner = np.repeat(np.arange(len(statements)), counts)

    def error(corner: int, reason: str) -> InputError:
        return lines.error(int(statements[face_of_corner[corner]]), reason)

    for place in np.flatnonzero(counts < 3)[:1].tolist():
        few = counted(int(counts[place]), "corner")
        reason = f"a face has {few}, and needs three; repair the mesh"
        raise lines.error(int(statements[place]), reason)
    table = _corner_indices(text, begins, error)
    firsts = starts_of(counts)
    for column, (kind, things) in enumerate(_INDEXED.items()):
        stated, total = table[:, column] != 0, int(np.count_nonzero(kinds[kind]))
        if not stated.any():
            continue
        some = np.add.reduceat(stated, firsts, dtype=np.int64)
        mixed = f"some corners of a face have {things}, some have none"
        lines.check(kinds["f"], (some == 0) | (some == counts), mixed)
        indices = table[:, column].copy()
        back = np.flatnonzero(indices < 0)
        if len(back):  # negative indices count back from the face's line
            table[back, column] += 1 + np.cumsum(kinds[kind])[statements[face_of_corner[back]]]
        outside = stated & ((table[:, column] < 1) | (table[:, column] > total))
        for place in np.flatnonzero(outside)[:1].tolist():
            past = f"faces point past the {things}, of which the file has {total:,}"
            raise error(place, f"{past}: index {indices[place]}; export the mesh again")
    # Indices count from 1 in the file; absent indices, 0, become -1.
    table -= 1
    return _Polygons(corners=table, counts=counts, lines=statements)


def _corner_indices(
    text: NDArray[np.uint8], begins: Indices, error: Callable[[int, str], InputError]
) -> Indices:
    """Return (K, 3) corner indices as in the file, 0 for none; replace slashes in the text."""
    slashes = text == ord("/")
    before = np.cumsum(slashes, dtype=np.int32) - slashes  # slashes before each byte
    text[slashes] = _BLANK
    numbers = word_starts(text)
    # A number belongs to the last corner that begins before it. The count of slashes between them
    # selects the column.
    marks = np.zeros(len(text), np.bool_)
    marks[begins] = True
    corner = np.cumsum(marks, dtype=np.int32)[numbers] - 1
    field = before[numbers] - before[begins][corner]
    no_number = "a corner is no number, or numbers between slashes"
    values = parse(text, np.int64, len(numbers), lambda word: error(int(corner[word]), no_number))
    for word in np.flatnonzero((field > _NORMAL) | (values == 0))[:1].tolist():
        reason = "more than three indices"
        if values[word] == 0:
            reason = "an index of 0, and indices begin at 1; export the mesh again"
        raise error(int(corner[word]), f"a corner has {reason}")
    table = np.zeros((len(begins), 3), np.int64)
    table[corner, field] = values
    for place in np.flatnonzero(table[:, _POINT] == 0)[:1].tolist():
        raise error(place, "a corner has no vertex")
    return table


def _part(name: str, corners: Indices, tables: _Tables, look: _Material | None) -> MeshPart:
    """Return the triangles of a material by corners (T, 3, 3): vertex, coordinates, normal."""
    # A vertex of the file is split if its corners have different texture coordinates or normals.
    used = [column for column in (_TEXTURE, _NORMAL) if (corners[..., column] != _ABSENT).any()]
    if used:
        faces, points, *rest = unmerge_faces(
            corners[..., _POINT], *(corners[..., column] for column in used)
        )
        chosen = dict(zip(used, rest, strict=True))
    else:
        points, places = np.unique(corners[..., _POINT], return_inverse=True)
        faces, chosen = places.reshape(-1, 3), {}
    return MeshPart(
        name=name,
        vertices=tables.vertices[points],
        faces=faces,
        uv=tables.coordinates[chosen[_TEXTURE]] if _TEXTURE in chosen else None,
        normals=tables.normals[chosen[_NORMAL]] if _NORMAL in chosen else None,
        color=None if tables.colors is None else tables.colors[points],
        picture=None if look is None else look.picture,
        texture=None if look is None else look.texture,
    )


# Material libraries
# -------------------------------------------------------------------------------------------------

#: Statements that change a surface's color or visibility, and their neutral values.
_NEUTRAL: Final = {"kd": 1.0, "d": 1.0, "tr": 0.0}
# Map statements, in addition to all names that begin with map_
_MAPS: Final = ("bump", "disp", "decal", "refl", "norm")
_MOST_NUMBERS: Final = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2}  # maximum of arguments of a map option


@dataclass(kw_only=True)
class _Material:
    """Base color texture of one material; the scene file has colors and lights."""

    texture: str | None = None  #: name of the texture
    picture: Any = None  #: Pillow image, opened and not yet decoded
    not_honoured: list[str] = field(default_factory=list)  #: unsupported statements


def _read_libraries(
    path: Path, statements: Sequence[str], used: set[str]
) -> tuple[dict[str, _Material], list[UnreadFeature]]:
    """Return used materials by name, and unsupported features.

    Parameters
    ----------
    path
        OBJ file.
    statements
        Names of libraries, as each `mtllib` statement lists them.
    used
        Names of the materials of polygons.
    """
    looks: dict[str, _Material] = {}
    unread: dict[str, str] = {}  # consequences by feature
    for statement in dict.fromkeys(statements):
        whole = _library(path, statement)
        for name in [statement] if whole is not None else statement.partition("#")[0].split():
            library = _library(path, name)
            if library is None:
                lost = "is missing or cannot be read; textures that it may name are not shown"
                unread[f"material library {name}"] = lost
            # If materials have the same name, the first is used.
            looks = (library or {}) | looks
    for name in sorted(used - looks.keys() - {""}):
        plain = name.partition("#")[0].strip()  # # begins a comment, or is part of a name
        if plain in looks:
            looks[name] = looks[plain]
        elif looks:
            lost = "is not in a library; its surfaces are drawn without it"
            unread[f"material {name}"] = lost
    own = {name: looks[name] for name in used if name in looks}
    if others := {word for look in own.values() for word in look.not_honoured}:
        lost = "are not applied: colors and lights are those of the scene file"
        unread[f"statements {', '.join(sorted(others))} of materials"] = lost
    return own, [UnreadFeature(name, lost) for name, lost in unread.items()]


def _library(path: Path, name: str) -> dict[str, _Material] | None:
    """Return the materials of a library beside an OBJ file; None if it cannot be read."""
    library = file_beside(path, name)
    try:
        content = None if library is None else read_input(library, "material library")
    except InputError:
        content = None
    if content is None:
        return None
    looks, look = dict[str, _Material](), _Material()
    for line in join_continued(plain_text(content)).decode("utf-8", "replace").split("\n"):
        word, *values = line.split() or [""]
        key = word.lower()
        if key == "newmtl":
            look = looks.setdefault(" ".join(values), _Material())
        elif key == "map_kd" and values:
            options, skipped = _options(values)
            look.texture = line.split(None, 1 + skipped)[-1].strip()
            look.picture = open_picture(path, look.texture)
            look.not_honoured += [f"map_Kd {option}" for option in options]
        elif key.startswith("map_") or key in _MAPS or not _is_neutral(key, values):
            look.not_honoured.append(word)
    return looks


def _is_neutral(key: str, values: Sequence[str]) -> bool:
    """Return whether a statement has no effect: an unlisted statement, or a neutral value."""
    return key not in _NEUTRAL or all(_number(value) == _NEUTRAL[key] for value in values)


def _options(values: Sequence[str]) -> tuple[list[str], int]:
    """Return the options before a texture's name, and the number of their words."""
    options, place, last = list[str](), 0, len(values) - 1
    while place < last and values[place].startswith("-") and values[place][1:2].isalpha():
        options.append(values[place].lower())
        most = _MOST_NUMBERS.get(options[-1], 1)
        numbers = [_number(value) is not None for value in values[place + 1 : place + 1 + most]]
        place += 1 + (max(1, (*numbers, False).index(False)) if most > 1 else 1)
    return options, min(place, last)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
