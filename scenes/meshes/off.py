"""OFF of Geomview: a header such as `STCN4OFF`, counts, vertices, and polygons with optional colors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, unit_normals
from xfrustum.scenes.meshes.polygons import cut_polygons, sizes_together
from xfrustum.scenes.meshes.text_lines import TextLines, plain_text
from xfrustum.scenes.meshes.textures import linear_colors
from xfrustum.scenes.model.scene import UnreadFeature

_HEADER = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(ST)?(C)?(N)?(4)?(n)?OFF\b([ \t]*BINARY)?")


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Numbers of one vertex, in the order of the file."""

    texture: bool
    colored: bool
    normals: bool
    weighted: bool

    def size(self, colors: int) -> int:
        return 3 + self.weighted + 3 * self.normals + colors * self.colored + 2 * self.texture


def read_off(path: Path) -> MeshContent:
    """Read an OFF file; InputError with the line where it is damaged, or its kind is not read."""
    data = plain_text(read_input(path, "mesh file"))
    header = _HEADER.match(data)
    if header is not None and (header[5] or header[6]):
        kind = "binary OFF" if header[6] else "nOFF, of any number of dimensions,"
        raise InputError(
            f"{path}: {kind} is not read; export OFF in text with three coordinates, or PLY"
        )
    texture, colors, normals, weighted = (bool(header and header[place]) for place in (1, 2, 3, 4))
    layout = _Layout(texture=texture, colored=colors, normals=normals, weighted=weighted)
    lines = TextLines(path, data, 0 if header is None else header.end())
    numbers, per_line = lines.numbers(slice(None))
    counted = (
        3 if len(per_line) == 0 or per_line[0] != 2 else 2
    )  # the number of edges is often left out
    counts = _whole(path, numbers[:counted], "its counts")
    if len(counts) < counted or counts.min() < 0:
        raise InputError(
            f"{path}: has no counts of vertices, faces and edges; export the mesh again"
        )
    vertices, size = _vertices(lines, numbers[counted:], per_line, layout, int(counts[0]))
    corners, sizes, colored = _faces(
        lines, counted + len(vertices) * size, numbers, per_line, int(counts[1])
    )
    return _content(path, vertices, layout, (corners, sizes), colored)


def _vertices(
    lines: TextLines, numbers: Floats, per_line: Indices, layout: _Layout, count: int
) -> tuple[Floats, int]:
    """Return the numbers of each vertex (V, n), and n."""
    sizes = {layout.size(colors) for colors in (3, 4)}
    own = np.unique(per_line[1 : 1 + count])
    if len(own) == 1 and len(per_line) > count and int(own[0]) not in {1, *sizes}:
        raise lines.error(1, f"a vertex has {own[0]} numbers, and the header says {layout.size(4)}")
    size = int(own[0]) if len(own) == 1 and int(own[0]) in sizes else layout.size(4)
    if len(numbers) < size * count:
        raise InputError(
            f"{lines.path}: ends within vertex {len(numbers) // size} of {count:,}: the file is cut off"
        )
    return numbers[: size * count].reshape(count, size), size


def _faces(
    lines: TextLines, start: int, numbers: Floats, per_line: Indices, count: int
) -> tuple[Indices, Indices, bool]:
    """Return the corners of all faces in a row, how many each has, and whether any has a color."""
    after = np.cumsum(per_line)
    line_starts = after - per_line
    first_line = int(np.searchsorted(line_starts, start))

    def error(place: int, reason: str) -> InputError:
        line = int(np.searchsorted(line_starts, place, side="right")) - 1
        return lines.error(line, f"{reason}; export the mesh again")

    if len(per_line) - first_line == count and count and line_starts[first_line] == start:
        starts, limits = line_starts[first_line:], after[first_line:]
    else:  # numbers in lines of any length: colors could not be told from faces
        places = [start]
        while (
            len(places) <= count
            and places[-1] < len(numbers)
            and 0 <= numbers[places[-1]] < len(numbers)
        ):
            places.append(places[-1] + 1 + int(numbers[places[-1]]))
        if len(places) <= count or places[-1] > len(numbers):
            told = f"face {min(len(places), count) - 1} of {count:,} is cut off or damaged"
            raise error(min(places[-1], len(numbers)) - 1, told)
        starts, limits = np.array(places[:-1], np.int64), np.array(places[1:], np.int64)
    if (limits[-1] if len(limits) else start) != len(numbers):
        raise error(
            int(limits[-1]) if len(limits) else start, f"the file goes on after {count:,} faces"
        )
    counts = _whole(lines.path, numbers[starts], "numbers of corners")
    spare = limits - starts - 1 - counts
    for face in np.flatnonzero((counts < 1) | (spare < 0) | (spare > 4))[
        :1
    ].tolist():  # a color has up to four
        raise error(int(starts[face]), f"face {face} of {count:,} is cut off or damaged")
    first = np.cumsum(counts) - counts
    within = np.arange(int(counts.sum())) - np.repeat(first, counts)
    corners = numbers[np.repeat(starts + 1, counts) + within]
    return _whole(lines.path, corners, "corners of faces"), counts, bool(spare.any())


def _content(
    path: Path, vertices: Floats, layout: _Layout, faces: tuple[Indices, Indices], colored: bool
) -> MeshContent:
    corners, counts = faces
    drawn = counts >= 3
    unread = []
    if colored:
        unread.append(UnreadFeature(feature="colors of faces", consequence="are not shown"))
    if layout.texture:
        nothing = "place nothing: OFF has no textures"
        unread.append(UnreadFeature(feature="texture coordinates", consequence=nothing))
    if not drawn.all():
        unread.append(
            UnreadFeature(feature="faces of one or two corners", consequence="are not drawn")
        )
    if not drawn.any():
        what = f"{len(vertices):,} vertices, and no faces of three corners"
        raise InputError(f"{path}: the mesh has no triangles: {what}; give it a mesh with faces")
    corners, sizes, numbers = (
        corners[np.repeat(drawn, counts)],
        counts[drawn],
        np.flatnonzero(drawn),
    )
    points = vertices[:, :3]
    if layout.weighted:
        with np.errstate(divide="ignore", invalid="ignore"):
            points = points / vertices[:, 3:4]
    if corners.min() < 0 or corners.max() >= len(points):
        raise InputError(
            f"{path}: faces point past the vertices, of which there are {len(points):,}"
        )
    cut = cut_polygons(
        points,
        corners,
        sizes,
        lambda face, reason: InputError(f"{path}: face {numbers[face]} {reason}"),
    )
    after = 3 + layout.weighted
    color = vertices[:, after + 3 * layout.normals :][:, :3]
    part = MeshPart(
        name="",
        vertices=points,
        faces=corners[cut][sizes_together(sizes)],
        normals=unit_normals(vertices[:, after : after + 3]) if layout.normals else None,
        color=linear_colors(color) if layout.colored else None,
    )
    return MeshContent(parts=(part,), unread=tuple(unread))


def _whole(path: Path, numbers: Floats, what: str) -> Indices:
    """Return whole numbers; InputError at others."""
    with np.errstate(invalid="ignore"):
        whole = numbers.astype(np.int64)
    if (whole != numbers).any():
        raise InputError(f"{path}: {what} are not whole numbers; export the mesh again")
    return whole
