"""Wavefront OBJ: polygons, their texture coordinates, normals and colors (Wavefront Advanced Visualizer, B1).

Triangles are numbered as trimesh numbers them: materials from the last one to the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from trimesh.visual.texture import unmerge_faces

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, unit_normals
from xfrustum.scenes.meshes.obj_materials import CoarseView, read_libraries
from xfrustum.scenes.meshes.polygons import cut_polygons, sizes_together
from xfrustum.scenes.meshes.text_lines import (
    TextLines,
    join_continued,
    parse,
    plain_text,
    word_starts,
)
from xfrustum.scenes.meshes.textures import linear_colors
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.representation import counted

#: Statements of surfaces that are no polygons, and of files and commands.
_REFUSED: Final = {
    **dict.fromkeys(("surf", "bzp", "bsp", "cdp"), "a free-form surface; export polygons"),
    **dict.fromkeys(("call", "csh"), "another file or a command; write its content into this file"),
    "fo": "a face of an old version of OBJ; write f instead",
}
_NO_OBJ: Final = {
    plain_text(b"PK\3\4"): "an archive, and no OBJ; unpack it first",
    b"<": "XML or HTML, and no OBJ; export the mesh as OBJ, or save the file itself, not its web page",
}
_CURVES: Final = (
    *(
        "curv",
        "curv2",
        "vp",
        "cstype",
        "deg",
        "bmat",
        "step",
        "parm",
        "trim",
        "hole",
        "scrv",
        "sp",
        "end",
    ),
    *("con", "ctech", "stech", "res", "cdc"),
)
#: Names, groups and hints for other renderers, which place nothing.
_NAMES: Final = (
    *(
        "o",
        "g",
        "mg",
        "lod",
        "bevel",
        "c_interp",
        "d_interp",
        "shadow_obj",
        "trace_obj",
        "maplib",
        "usemap",
    ),
    *("mtllib", "usemtl", "s"),
)
_DRAWN: Final = ("v", "vt", "vn", "f")
_POINT, _TEXTURE, _NORMAL = 0, 1, 2  # indices of a corner, in the order of a file
_ABSENT: Final = -1
_INDEXED: Final = {"v": "vertices", "vt": "texture coordinates", "vn": "normals"}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Polygons:
    corners: (
        Indices  #: (K, 3) indices from 0 of vertex, texture coordinates and normal; -1 for none
    )
    counts: Indices  #: (P,) corners of each polygon
    lines: Indices  #: (P,) line of each polygon


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tables:
    vertices: Floats
    colors: Floats | None  #: at vertices, linear RGB
    coordinates: Floats  #: the last row, at -1, is NaN
    normals: Floats  #: the last row, at -1, is NaN


def read_obj(path: Path) -> MeshContent:
    """Read an OBJ file; InputError with the line where it is damaged or has surfaces that are not read."""
    text = plain_text(read_input(path, "mesh file"))
    for start, told in _NO_OBJ.items():
        if text.lstrip().startswith(start):
            raise InputError(f"{path}: is {told}")
    lines = TextLines(path, join_continued(text))
    words = lines.keywords(3)
    kinds = {name: words == name.encode() for name in _DRAWN}
    others = np.flatnonzero(~np.logical_or.reduce(list(kinds.values()))).tolist()
    named: dict[str, list[int]] = {}  # lines of each other statement
    for line in others:
        named.setdefault(lines.text(line).split(" ")[0].lower(), []).append(line)
    unread = _other_statements(lines, named)
    tables, white = _tables(lines, kinds)
    polygons = _polygons(lines, kinds)
    if "s" in named and (polygons.corners[:, _NORMAL] == _ABSENT).any():
        unread += _smoothing(lines, named["s"])
    changes = named.get("usemtl", [])
    in_use = ["", *(_value(lines, line) for line in changes)]  # from each change on
    names = list(dict.fromkeys(in_use))
    numbers = {name: number for number, name in enumerate(names)}
    used = np.searchsorted(changes, polygons.lines, side="right")
    material_of_polygon = np.array([numbers[name] for name in in_use])[used]
    libraries = [_value(lines, line) for line in named.get("mtllib", [])]
    looks, not_read = read_libraries(
        path, libraries, {names[number] for number in np.unique(material_of_polygon).tolist()}
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
        mine, counts = triangles[triangles_of[number]], polygons.counts[places]
        if (counts == counts[0]).all():
            mine = mine[sizes_together(counts)]
        parts.append(_part(names[number], polygons.corners[mine], tables, looks.get(names[number])))
    return MeshContent(parts=tuple(reversed(parts)), unread=(*unread, *white, *not_read))


def _places(numbers: Indices) -> dict[int, Indices]:
    """Return the places of each number, in order; numbers in the order in which they first appear."""
    found, first, counts = np.unique(numbers, return_index=True, return_counts=True)
    groups = np.split(np.argsort(numbers, kind="stable"), np.cumsum(counts)[:-1])
    return {int(found[group]): groups[group] for group in np.argsort(first).tolist()}


def _value(lines: TextLines, line: int) -> str:
    """Return what follows a keyword; names may hold `#`."""
    _, _, value = lines.text(line, comment=True).replace("\t", " ").partition(" ")
    return value.strip()


def _other_statements(lines: TextLines, named: dict[str, list[int]]) -> list[UnreadFeature]:
    """Return statements that are not honoured; InputError at those that are surfaces, or unknown."""
    for word, (first, *_) in named.items():
        if word in _REFUSED:
            raise lines.error(first, f"'{word}' is {_REFUSED[word]}")
        if word not in (*_CURVES, *_NAMES, "l", "p"):
            reason = f"{word[:20]!r} is no statement of OBJ; delete the line, or begin it with #"
            raise lines.error(first, reason)
    found = []
    for words, feature in (
        (("l",), "lines (l)"),
        (("p",), "points (p)"),
        (_CURVES, "free-form curves"),
    ):
        if any(word in named for word in words):
            found.append(
                UnreadFeature(feature=feature, consequence="are not drawn: they have no surface")
            )
    return found


def _smoothing(lines: TextLines, statements: list[int]) -> list[UnreadFeature]:
    if all(_value(lines, line).lower() in ("off", "0") for line in statements):
        return []
    flat = "are not applied: faces without normals are flat; set smooth = true in the scene file"
    return [UnreadFeature(feature="smoothing groups (s)", consequence=flat)]


def _tables(lines: TextLines, kinds: dict[str, Mask]) -> tuple[_Tables, list[UnreadFeature]]:
    """Return what corners refer to, and vertices without a color beside vertices that have one."""
    values, counts = lines.numbers(kinds["v"], skip=1)
    for place in np.flatnonzero(~np.isin(counts, (3, 4, 6)))[:1].tolist():
        told = f"a vertex needs three coordinates, or three and a color of three numbers, not {counts[place]}"
        raise lines.error(int(np.flatnonzero(kinds["v"])[place]), told)
    first = np.cumsum(counts) - counts
    weighted = np.flatnonzero(counts == 4)
    for place in weighted[values[first[weighted] + 3] != 1][:1].tolist():
        weight = values[first[place] + 3]
        told = f"the fourth coordinate is a weight of rational surfaces, and is {weight:g}; export polygons"
        raise lines.error(int(np.flatnonzero(kinds["v"])[place]), told)
    colored, colors, white = counts == 6, None, []
    if colored.any():
        stored = values[first[colored, None] + np.arange(3, 6)]
        colors = np.ones((len(counts), 3))
        colors[colored] = linear_colors(stored)
    if colored.any() and not colored.all():
        few = f"have none and are white: {np.count_nonzero(~colored):,} of {len(colored):,}"
        white = [UnreadFeature(feature="colors at vertices", consequence=few)]
    texture, texture_counts = lines.numbers(kinds["vt"], skip=2)
    for place in np.flatnonzero((texture_counts < 1) | (texture_counts > 3))[:1].tolist():
        told = "texture coordinates (vt) are one to three numbers"
        raise lines.error(int(np.flatnonzero(kinds["vt"])[place]), told)
    coordinates = np.full((len(texture_counts) + 1, 2), np.nan)
    first_texture = np.cumsum(texture_counts) - texture_counts
    coordinates[:-1, 0] = texture[first_texture]
    second = np.minimum(first_texture + 1, len(texture) - 1)
    coordinates[:-1, 1] = np.where(texture_counts > 1, texture[second], 0.0)
    normals, normal_counts = lines.numbers(kinds["vn"], skip=2)
    for place in np.flatnonzero(normal_counts != 3)[:1].tolist():
        raise lines.error(
            int(np.flatnonzero(kinds["vn"])[place]), "a normal (vn) has three numbers"
        )
    return _Tables(
        vertices=values[first[:, None] + np.arange(3)],
        colors=colors,
        coordinates=coordinates,
        normals=np.vstack([unit_normals(normals.reshape(-1, 3)), np.full((1, 3), np.nan)]),
    ), white


def _polygons(lines: TextLines, kinds: dict[str, Mask]) -> _Polygons:
    """Return the polygons of a file; InputError where a corner is damaged or refers to nothing."""
    statements = np.flatnonzero(kinds["f"])
    text, line_ends = lines.bytes_of(kinds["f"], skip=1)
    begins = word_starts(text)
    counts = np.diff(np.searchsorted(begins, line_ends), prepend=0)
    face_of_corner = np.repeat(np.arange(len(statements)), counts)

    def error(corner: int, reason: str) -> InputError:
        return lines.error(int(statements[face_of_corner[corner]]), reason)

    for place in np.flatnonzero(counts < 3)[:1].tolist():
        raise lines.error(
            int(statements[place]),
            f"a face has {counted(int(counts[place]), 'corner')}, and needs three; repair the mesh",
        )
    table = _corner_indices(text, begins, error)
    firsts = np.cumsum(counts) - counts
    for column, (kind, things) in enumerate(_INDEXED.items()):
        given, total = table[:, column] != 0, int(np.count_nonzero(kinds[kind]))
        if not given.any():
            continue
        some = np.add.reduceat(given, firsts, dtype=np.int64)
        for place in np.flatnonzero((some > 0) & (some < counts))[:1].tolist():
            raise lines.error(
                int(statements[place]), f"some corners of a face have {things}, some have none"
            )
        stated = table[:, column].copy()
        back = np.flatnonzero(table[:, column] < 0)
        if len(back):  # counted from the face's own line
            table[back, column] += 1 + np.cumsum(kinds[kind])[statements[face_of_corner[back]]]
        outside = given & ((table[:, column] < 1) | (table[:, column] > total))
        for place in np.flatnonzero(outside)[:1].tolist():
            told = f"faces point past the {things}, of which the file has {total:,}: index {stated[place]}"
            raise error(place, f"{told}; export the mesh again")
    table -= 1
    return _Polygons(corners=table, counts=counts, lines=statements)


def _corner_indices(
    text: NDArray[np.uint8], begins: Indices, error: Callable[[int, str], InputError]
) -> Indices:
    """Return (K, 3) indices of corners of the file, 0 for none; erase the slashes of the text."""
    slashes = np.flatnonzero(text == ord("/"))
    text[slashes] = ord(" ")
    runs = word_starts(text)
    per_corner, rest = divmod(len(slashes), max(len(begins), 1))
    if not rest and len(runs) == (per_corner + 1) * len(begins) and per_corner <= _NORMAL:
        each = slashes.reshape(len(begins), per_corner)
        alike = bool((each > begins[:, None]).all() and (each[:-1] < begins[1:, None]).all())
    else:
        alike = False
    if alike:  # as in most files: no corner leaves an index out
        corner = np.repeat(np.arange(len(begins)), per_corner + 1)
        field = np.tile(np.arange(per_corner + 1), len(begins))
    else:
        corner = np.searchsorted(begins, runs, side="right") - 1
        field = np.searchsorted(slashes, runs) - np.searchsorted(slashes, begins)[corner]
    no_number = "a corner is no number, or numbers between slashes"
    values = parse(text, np.int64, len(runs), lambda run: error(int(corner[run]), no_number))
    for run in np.flatnonzero((field > _NORMAL) | (values == 0))[:1].tolist():
        reason = (
            "has an index of 0, and indices begin at 1; export the mesh again"
            if values[run] == 0
            else "has more than three indices"
        )
        raise error(int(corner[run]), f"a corner {reason}")
    table = np.zeros((len(begins), 3), np.int64)
    if alike:
        table[:, : per_corner + 1] = values.reshape(len(begins), per_corner + 1)
    else:
        table[corner, field] = values
    for place in np.flatnonzero(table[:, _POINT] == 0)[:1].tolist():
        raise error(place, "a corner has no vertex")
    return table


def _part(name: str, corners: Indices, tables: _Tables, look: CoarseView | None) -> MeshPart:
    """Return one material's triangles by their corners (T, 3, 3): vertex, texture coordinates, normal."""
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
