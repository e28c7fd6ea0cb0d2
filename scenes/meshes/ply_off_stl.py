"""Formats that are lists of vertices and polygons: PLY, OFF and STL, in text and in binary.

* PLY (Greg Turk, 1994), with elements and properties of its header
* OFF of Geomview: a header such as `STCN4OFF`, counts, vertices, polygons with optional colors
* STL; incomplete files are refused
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.grouping import unique_rows
from trimesh.visual.texture import unmerge_faces

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.disk import read_input
from xfrustum.scenes.meshes.content import (
    MeshContent,
    MeshPart,
    linear_colors,
    open_picture,
    unit_normals,
)
from xfrustum.scenes.meshes.tessellation import cut_polygons, sizes_together
from xfrustum.scenes.meshes.text_lines import TextLines, plain_text, ranges, starts_of
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.representation import counted

_TYPES: Final = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float16": "f2", "float32": "f4", "float64": "f8"},
}
_ORDERS: Final = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": "="}
_CORNERS: Final = ("vertex_indices", "vertex_index")
_POINT: Final = ("x", "y", "z")
_NORMAL: Final = ("nx", "ny", "nz")
_COORDINATES: Final = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_COUNT_DIGITS: Final = 18  # maximum of digits of a count; Python converts at most 4,300 digits
_OTHER_COUNT: Final = "has another number of values than the header declares"
_COLORS: Final = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"))


@dataclass(kw_only=True)
class _Element:
    name: str
    count: int
    #: types of a list's length (None for a single value) and of its values, by property
    types: dict[str, tuple[str | None, str]] = field(default_factory=dict)
    values: dict[str, NDArray[Any]] = field(default_factory=dict)  #: by property, row after row
    lengths: dict[str, Indices] = field(default_factory=dict)  #: lengths of lists, by property


@dataclass(frozen=True, kw_only=True)
class _Header:
    order: str
    elements: tuple[_Element, ...]
    textures: tuple[str, ...]
    size: int  #: bytes


def read_ply(path: Path) -> MeshContent:
    """Read a PLY file; InputError if it is damaged, cut off, or has no polygons."""
    data = read_input(path, "mesh file").removeprefix(codecs.BOM_UTF8)
    header = _header(path, data)
    # Text has no byte order, and is cast to the byte order of the machine.
    if header.order == "=":
        _read_text(path, data, header)
    else:
        _read_binary(path, data, header)
    elements = {element.name: element for element in header.elements}
    _check_kind(path, elements)
    return _ply_content(path, elements, header.textures)


def _header(path: Path, data: bytes) -> _Header:
    first = re.match(rb"(?i:ply)[ \t]*(\r\n|\n|\r)", data)
    # The header's last line has the line end of the first line. Bytes of any value follow it.
    line_end = b"\n" if first is None else first[1]
    end = re.search(line_end + rb"end_header[ \t]*" + line_end, data)
    if first is None or end is None:
        raise InputError(
            f"{path}: is damaged: a PLY file begins with 'ply' and has an 'end_header'"
        )
    # A property belongs to the last element declared before it.
    order, elements, textures = None, list[_Element](), list[str]()
    for number, line in enumerate(
        plain_text(data[: end.start()]).decode("utf-8", "replace").split("\n")
    ):
        words = line.split()
        if words[:1] == ["property"] and elements and words[-1] in elements[-1].types:
            raise InputError(f"{path}, line {number + 1}: property {words[-1]} is declared twice")
        match [word.lower() for word in words[:1]] + words[1:]:
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isdecimal() and len(count) <= _COUNT_DIGITS:
                elements.append(_Element(name=name, count=int(count)))
            case ["property", "list", length, kind, name] if (
                elements and {length, kind} <= _TYPES.keys()
            ):
                elements[-1].types[name] = (_TYPES[length], _TYPES[kind])
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].types[name] = (None, _TYPES[kind])
            case ["comment", word, _, *_] if word.lower() == "texturefile":
                textures.append(line.split(None, 2)[2].strip())
            case [] | ["comment" | "obj_info" | "ply", *_]:
                pass
            case _:
                raise InputError(
                    f"{path}, line {number + 1}: '{line.strip()[:60]}' is damaged, or not a line "
                    "of PLY"
                )
    if order is None:
        raise InputError(
            f"{path}: is damaged: its header names no format, such as 'format ascii 1.0'"
        )
    return _Header(order=order, elements=tuple(elements), textures=tuple(textures), size=end.end())


def _read_text(path: Path, data: bytes, header: _Header) -> None:
    lines = TextLines(path, plain_text(data), len(plain_text(data[: header.size])))
    declared, line = sum(element.count for element in header.elements), 0
    if len(lines) != declared:
        reason = (
            f"the header declares {declared:,} lines of elements, and the file has {len(lines):,}"
        )
        raise InputError(f"{path}: {reason}; export the mesh again")
    for element in header.elements:
        rows = slice(line, line + element.count)
        check = partial(lines.check, rows, reason=_OTHER_COUNT)
        numbers, counts = lines.numbers(rows)
        place, after = starts_of(counts), np.cumsum(counts)
        for name, (length_type, kind) in element.types.items():
            lengths = np.ones(element.count, np.int64)
            if length_type is not None:
                check(place + 1 <= after)
                stored, place = numbers[place], place + 1
                check((stored >= 0) & (stored <= after - place) & (stored == np.floor(stored)))
                element.lengths[name] = lengths = stored.astype(np.int64)
            check(place + lengths <= after)
            element.values[name] = _cast(path, numbers[ranges(place, lengths)], kind, name)
            place = place + lengths
        check(place == after)
        line += element.count


def _cast(path: Path, numbers: Floats, kind: str, name: str) -> NDArray[Any]:
    # A text may have more digits than the type in its header. Round to this type.
    with np.errstate(invalid="ignore", over="ignore"):
        cast = numbers.astype(kind)
    if cast.dtype.kind != "f" and (cast != numbers).any():
        raise InputError(
            f"{path}: a value of '{name}' does not fit its type; export the mesh again"
        )
    return cast


def _read_binary(path: Path, data: bytes, header: _Header) -> None:
    place = header.size
    for element in header.elements:
        place = _read_alike(path, data, element, header.order, place) or _read_rows(
            path, data, element, header.order, place
        )
    if place != len(data):
        declared, size = place - header.size, len(data) - header.size
        reason = f"the header declares {declared:,} bytes of elements, file has {size:,}"
        raise InputError(f"{path}: {reason}; export the mesh again")


def _read_alike(path: Path, data: bytes, element: _Element, order: str, place: int) -> int | None:
    """Read an element with lists of equal lengths; return its end, None if lengths differ."""
    row, fixed = list[tuple[str, str] | tuple[str, str, int]](), place
    for name, (length_type, kind) in element.types.items():
        if length_type is None:
            row.append((name, order + kind))
        else:
            length = _number(path, data, fixed, order + length_type) if element.count else 0
            # Names in a header cannot end with a blank, so that this name is unique.
            row += [(f"{name} ", order + length_type), (name, order + kind, length)]
        fixed = place + np.dtype(row).itemsize
    end = place + np.dtype(row).itemsize * element.count
    if end > len(data):
        return None
    table = np.frombuffer(data, np.dtype(row), element.count, place)
    lists = [name for name, (length_type, _) in element.types.items() if length_type is not None]
    if not all((table[f"{name} "] == table[f"{name} "][:1]).all() for name in lists):
        return None
    element.values |= {name: table[name].ravel() for name in element.types}
    element.lengths |= {name: table[f"{name} "].astype(np.int64) for name in lists}
    return end


def _read_rows(path: Path, data: bytes, element: _Element, order: str, place: int) -> int:
    """Read an element whose lists have different lengths, row by row; return its end."""
    values: dict[str, list[NDArray[Any]]] = {name: [] for name in element.types}
    kinds = [
        (name, None if length is None else np.dtype(order + length), np.dtype(order + kind))
        for name, (length, kind) in element.types.items()
    ]
    for row in range(element.count):
        for name, length_kind, kind in kinds:
            length = 1
            if length_kind is not None:
                length = _number(path, data, place, length_kind)
                place += length_kind.itemsize
            end = place + length * kind.itemsize
            if end > len(data) or length < 0:
                reason = f"ends within {element.name} {row:,} of {element.count:,}"
                raise InputError(f"{path}: {reason}: the file is cut off; export the mesh again")
            values[name].append(np.frombuffer(data, kind, length, place))
            place = end
    for name, parts in values.items():
        element.values[name] = np.concatenate(parts) if parts else np.zeros(0)
        element.lengths[name] = np.array([len(part) for part in parts], np.int64)
    return place


def _number(path: Path, data: bytes, place: int, kind: str | np.dtype[Any]) -> int:
    size = np.dtype(kind).itemsize
    if place + size > len(data):
        raise InputError(
            f"{path}: ends before the length of a list: the file is cut off; export the mesh again"
        )
    value = float(np.frombuffer(data, kind, 1, place)[0])
    if not 0 <= value <= len(data) or value != int(value):
        raise InputError(
            f"{path}: a list has {value:g} values: the file is damaged; export the mesh again"
        )
    return int(value)


def _check_kind(path: Path, elements: Mapping[str, _Element]) -> None:
    """Raise InputError for files without polygons, naming their content."""
    vertex, face = elements.get("vertex"), elements.get("face")
    if vertex is None or not vertex.types.keys() >= {*_POINT}:
        raise InputError(
            f"{path}: vertices need three coordinates: the header has no element vertex with "
            "x, y, z"
        )
    for name in chain(_POINT, _NORMAL, *_COORDINATES, *_COLORS):
        if vertex.types.get(name, (None,))[0] is not None:
            raise InputError(
                f"{path}: {name} of vertices is a list, and must be one number; export it again"
            )
    if (strips := elements.get("tristrips")) is not None and strips.count:
        raise InputError(
            f"{path}: triangle strips (element tristrips) are not read; export triangles"
        )
    if face is None or not face.count:
        splats = {"f_dc_0", "opacity", "rot_0", "scale_0"} <= vertex.types.keys()
        kind = "Gaussian splats" if splats else "a point cloud"
        other = [name for name in elements if name not in ("vertex", "face")]
        content = f"{kind}: {counted(vertex.count, 'point')}, no faces"
        content += f", beside {', '.join(other)}" if other else ""
        raise InputError(f"{path}: the mesh has no triangles: {content}; give it a mesh with faces")
    if not any(name in face.lengths for name in _CORNERS):
        raise InputError(f"{path}: faces have no list vertex_indices; export the mesh again")


def _ply_content(
    path: Path, elements: Mapping[str, _Element], textures: tuple[str, ...]
) -> MeshContent:
    vertex, face = elements["vertex"], elements["face"]
    points = _columns(vertex, _POINT).astype(np.float64)
    name = next(name for name in _CORNERS if name in face.lengths)
    counts = face.lengths[name]
    corners = _corners(path, face.values[name], counts, len(points))
    cut = cut_polygons(
        points, corners, counts, lambda number, why: InputError(f"{path}: face {number} {why}")
    )[sizes_together(counts)]
    faces, chosen, uv = _textured(vertex, face, corners[cut], cut, counts)
    colors = _complete(vertex, _COLORS)
    normals = _complete(vertex, (_NORMAL,))
    # Faces may select one of several textures by a number, whose property name is not standardized.
    single = textures[0] if len(textures) == 1 else None
    part = MeshPart(
        vertices=points[chosen],
        faces=faces,
        uv=uv,
        color=None if colors is None else linear_colors(colors)[chosen],
        normals=None if normals is None else unit_normals(normals.astype(np.float64))[chosen],
        picture=None if single is None else open_picture(path, single),
        texture=single,
    )
    return MeshContent(parts=(part,), unread=tuple(_ply_unread(elements, textures, counts)))


def _complete(element: _Element, choices: Iterable[tuple[str, ...]]) -> NDArray[Any] | None:
    """Return the columns of the first complete group of properties, else None."""
    for names in choices:
        if element.values.keys() >= {*names}:
            return _columns(element, names)
    return None


def _columns(element: _Element, names: tuple[str, ...]) -> NDArray[Any]:
    columns = np.column_stack([element.values[name] for name in names])
    return columns.astype(columns.dtype.newbyteorder("="))


def _corners(path: Path, values: NDArray[Any], counts: Indices, vertices: int) -> Indices:
    """Return the corners of faces as indices; InputError for other numbers."""
    for face in np.flatnonzero(counts < 3)[:1].tolist():
        few = counted(int(counts[face]), "corner")
        raise InputError(f"{path}: face {face} has {few}, and needs three; repair the mesh")
    corners = values.astype(np.int64)
    if (corners != values).any():
        raise InputError(
            f"{path}: faces have corners that are no whole numbers; export the mesh again"
        )
    if corners.min() < 0 or corners.max() >= vertices:
        worst = corners.min() if corners.min() < 0 else corners.max()
        reason = f"faces point past the vertices (index {worst}, {vertices} vertices)"
        raise InputError(f"{path}: {reason}; export the mesh again")
    return corners


def _textured(
    vertex: _Element, face: _Element, faces: Indices, cut: Indices, counts: Indices
) -> tuple[Indices, Indices | slice, Floats | None]:
    """Return faces, the vertices to which they refer, and texture coordinates of these vertices."""
    of_faces = face.lengths.get("texcoord")
    if of_faces is not None and (of_faces == 2 * counts).all():
        uv = face.values["texcoord"].astype(np.float64).reshape(-1, 2)[cut].reshape(-1, 2)
        with np.errstate(invalid="ignore", over="ignore"):  # huge coordinates overflow
            unique, inverse = unique_rows(uv)
        faces, chosen, places = unmerge_faces(faces, inverse.reshape(faces.shape))
        return faces, chosen, uv[unique][places]
    placed = _complete(vertex, _COORDINATES)
    if placed is None:
        return faces, slice(None), None
    chosen, numbered = np.unique(faces, return_inverse=True)
    return numbered.reshape(faces.shape), chosen, placed.astype(np.float64)[chosen]


def _ply_unread(
    elements: Mapping[str, _Element], textures: tuple[str, ...], counts: Indices
) -> list[UnreadFeature]:
    face, features = elements["face"], dict[str, str]()
    if len(textures) > 1:
        features[f"textures {', '.join(textures)}"] = "are not shown: faces choose among several"
    if not face.types.keys().isdisjoint(chain(*_COLORS)):
        features["colors of faces"] = "are not shown"
    if "texcoord" in face.lengths and (face.lengths["texcoord"] != 2 * counts).any():
        features["texture coordinates of faces (texcoord)"] = (
            "are not read: not all faces have them"
        )
    for name, element in elements.items():
        if element.count and name not in ("vertex", "face"):
            features[f"element {name}"] = "is not drawn: it has no faces"
    return [UnreadFeature(name, text) for name, text in features.items()]


_HEADER = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(ST)?(C)?(N)?(4)?(n)?OFF\b([ \t]*BINARY)?")


def read_off(path: Path) -> MeshContent:
    """Read an OFF file; InputError names the line of damage or of an unsupported feature."""
    # Letters precede OFF in the header in this order; a file without a header is plain OFF.
    data = plain_text(read_input(path, "mesh file"))
    header = _HEADER.match(data)
    if header is not None and (header[5] or header[6]):
        kind = "binary OFF" if header[6] else "nOFF, of any number of dimensions,"
        raise InputError(
            f"{path}: {kind} is not read; export OFF in text with three coordinates, or PLY"
        )
    kinds = [bool(header and header[group]) for group in (1, 2, 3, 4)]
    textured, colored, normals, weighted = kinds
    lines = TextLines(path, data, 0 if header is None else header.end())
    numbers, per_line = lines.numbers(slice(None))
    # The number of edges is often left out.
    stated = 2 if len(per_line) and per_line[0] == 2 else 3
    counts = _whole(path, numbers[:stated], "its counts")
    if len(counts) < stated or counts.min() < 0:
        raise InputError(
            f"{path}: has no counts of vertices, faces and edges; export the mesh again"
        )
    after = 3 + weighted  # first column of normals; colors and texture coordinates follow
    sizes = [after + 3 * normals + channels * colored + 2 * textured for channels in (3, 4)]
    vertices = _vertices(lines, numbers[stated:], per_line, sizes, int(counts[0]))
    start = stated + vertices.size
    corners, of_face, spare = _faces(lines, start, numbers, per_line, int(counts[1]))
    drawn = of_face >= 3
    reasons = {
        ("colors of faces", "are not shown"): spare,
        ("texture coordinates", "place nothing: OFF has no textures"): textured,
        ("faces of one or two corners", "are not drawn"): not drawn.all(),
    }
    if not drawn.any():
        what = f"{len(vertices):,} vertices, and no faces of three corners"
        raise InputError(f"{path}: the mesh has no triangles: {what}; give it a mesh with faces")
    points = vertices[:, :3]
    # Homogeneous coordinates: a weight of zero gives infinity, which the check of all vertices
    # refuses.
    if weighted:
        with np.errstate(divide="ignore", invalid="ignore"):
            points = points / vertices[:, 3:4]
    corners = corners[np.repeat(drawn, of_face)]
    if corners.min() < 0 or corners.max() >= len(points):
        raise InputError(
            f"{path}: faces point past the vertices, of which there are {len(points):,}"
        )

    def refuse(face: int, reason: str) -> InputError:
        return InputError(f"{path}: face {np.flatnonzero(drawn)[face]} {reason}")

    cut = cut_polygons(points, corners, of_face[drawn], refuse)
    colors = vertices[:, after + 3 * normals :]
    part = MeshPart(
        vertices=points,
        faces=corners[cut][sizes_together(of_face[drawn])],
        normals=unit_normals(vertices[:, after : after + 3]) if normals else None,
        color=linear_colors(colors) if colored else None,
    )
    unread = [UnreadFeature(f, c) for (f, c), there in reasons.items() if there]
    return MeshContent(parts=(part,), unread=tuple(unread))


def _vertices(
    lines: TextLines, numbers: Floats, per_line: Indices, sizes: list[int], count: int
) -> Floats:
    """Return the numbers (V, n) of vertices; `sizes` are n for colors of 3 and of 4 channels."""
    own = np.unique(per_line[1 : 1 + count])
    alike = len(own) == 1  # else vertices may span several lines, and colors have 4 channels
    if alike and len(per_line) > count and int(own[0]) not in (1, *sizes):
        raise lines.error(1, f"a vertex has {own[0]} numbers, and the header says {sizes[1]}")
    size = int(own[0]) if alike and int(own[0]) in sizes else sizes[1]
    if len(numbers) < size * count:
        raise InputError(
            f"{lines.path}: ends within vertex {len(numbers) // size} of {count:,}: "
            "the file is cut off"
        )
    return numbers[: size * count].reshape(count, size)


def _faces(
    lines: TextLines, start: int, numbers: Floats, per_line: Indices, count: int
) -> tuple[Indices, Indices, bool]:
    """Return the corners of all faces, the size of each face, and whether colors follow."""
    line_starts, after = starts_of(per_line), np.cumsum(per_line)
    first_line = int(np.searchsorted(line_starts, start))

    def error(place: int, reason: str) -> InputError:
        line = int(np.searchsorted(line_starts, place, side="right")) - 1
        return lines.error(line, f"{reason}; export the mesh again")

    if len(per_line) - first_line == count and count and line_starts[first_line] == start:
        starts, limits = line_starts[first_line:], after[first_line:]
    else:  # lines have any length, so that colors cannot be distinguished from faces
        places = [start]
        while len(places) <= count and places[-1] < len(numbers) > numbers[places[-1]] >= 0:
            places.append(places[-1] + 1 + int(numbers[places[-1]]))
        if len(places) <= count or places[-1] > len(numbers):
            reason = f"face {min(len(places), count) - 1} of {count:,} is cut off or damaged"
            raise error(min(places[-1], len(numbers)) - 1, reason)
        starts, limits = np.array(places[:-1], np.int64), np.array(places[1:], np.int64)
    end = int(limits[-1]) if len(limits) else start
    if end != len(numbers):
        raise error(end, f"the file goes on after {count:,} faces")
    counts = _whole(lines.path, numbers[starts], "numbers of corners")
    spare = limits - starts - 1 - counts  # numbers of a color: up to four
    for face in np.flatnonzero((counts < 1) | (spare < 0) | (spare > 4))[:1].tolist():
        raise error(int(starts[face]), f"face {face} of {count:,} is cut off or damaged")
    corners = numbers[ranges(starts + 1, counts)]
    return _whole(lines.path, corners, "corners of faces"), counts, bool(spare.any())


def _whole(path: Path, numbers: Floats, what: str) -> Indices:
    """Return whole numbers; InputError for other numbers."""
    with np.errstate(invalid="ignore"):
        whole = numbers.astype(np.int64)
    if (whole != numbers).any():
        raise InputError(f"{path}: {what} are not whole numbers; export the mesh again")
    return whole


_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES = 84  # 80 bytes of any content, and the number of triangles
_FACET_LINES = np.array(b"facet outer vertex vertex vertex endloop endfacet".split())
#: Cosine between a stored normal and the reversed winding normal above which the winding is
#: reversed. Exporters round normals to a few digits, which turns them by far less than 60 degrees.
_COSINE = 0.5


def read_stl(path: Path) -> MeshContent:
    """Read an STL file; InputError if its length or its text is damaged."""
    data = read_input(path, "mesh file")
    count = int.from_bytes(data[80:_HEADER_BYTES], "little")
    whole = _HEADER_BYTES + count * _FACET.itemsize
    # Binary files may begin with `solid`, too: only the length distinguishes them.
    if len(data) >= _HEADER_BYTES and len(data) == whole:
        facets = np.frombuffer(data, _FACET, offset=_HEADER_BYTES)
        corners = facets["corners"].astype(np.float64)
        normals = facets["normal"].astype(np.float64)
        colored = bool(facets["attribute"].any())
        return _stl_content(path, corners, _stl_unread(corners, normals, colored))
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _stl_content(path, _text_corners(path, data), ())
    reason = f"header says {counted(count, 'triangle')} = {whole:,} bytes, file has {len(data):,}"
    if len(data) < _HEADER_BYTES:
        reason = f"the file has {len(data):,} bytes, fewer than the header of a binary STL, and is "
        reason += "not text"
    raise InputError(f"{path}: {reason}; export the mesh again")


def _text_corners(path: Path, data: bytes) -> Floats:
    """Return the corners (F, 3, 3) of all solids of a text."""
    lines = TextLines(path, plain_text(data))
    words = lines.keywords(9)
    inside = (words != b"solid") & (words != b"endsolid")
    pattern = np.resize(_FACET_LINES, np.count_nonzero(inside))
    for place in np.flatnonzero(words[inside] != pattern)[:1].tolist():
        line = int(np.flatnonzero(inside)[place])
        reason = f"'{lines.text(line)[:40]}' where '{pattern[place].decode()}' must be"
        raise lines.error(line, f"{reason}; export the mesh again")
    facets, rest = divmod(len(pattern), len(_FACET_LINES))
    solids = [np.count_nonzero(words == word) for word in (b"solid", b"endsolid")]
    if rest or solids[0] != solids[1] or words[-1] != b"endsolid":
        reason = f"the file is cut off after {facets:,} facets; export the mesh again"
        raise lines.error(len(lines) - 1, reason)
    vertices = words == b"vertex"
    corners, per_line = lines.numbers(vertices, skip=len("vertex"))
    lines.check(vertices, per_line == 3, "a vertex needs three coordinates")
    return np.asarray(corners.reshape(-1, 3, 3))


def _stl_content(path: Path, corners: Floats, unread: tuple[UnreadFeature, ...]) -> MeshContent:
    if not len(corners):
        raise InputError(
            f"{path}: the mesh has no triangles: the file lists none; export the mesh again"
        )
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    part = MeshPart(vertices=corners.reshape(-1, 3), faces=faces)
    return MeshContent(parts=(part,), unread=unread)


def _stl_unread(corners: Floats, normals: Floats, colored: bool) -> tuple[UnreadFeature, ...]:
    """Return unread attributes of facets, and stored normals that contradict the winding."""
    unread = []
    if colored:
        consequence = "are not shown: some programs store colors there"
        unread.append(UnreadFeature("attributes of facets", consequence))
    with np.errstate(over="ignore", invalid="ignore"):
        winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        along = np.einsum("fx,fx->f", winding, normals)
        size = np.linalg.norm(winding, axis=1) * np.linalg.norm(normals, axis=1)
        turned = np.count_nonzero(along < -_COSINE * size)
    if turned:
        consequence = f"are not read: {turned:,} oppose the order of the corners, which decides"
        unread.append(UnreadFeature("normals of facets", consequence))
    return tuple(unread)
