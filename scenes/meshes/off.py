"""OFF of Geomview: a header such as `STCN4OFF`, counts, vertices, polygons with optional colors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, linear_colors, unit_normals
from xfrustum.scenes.meshes.polygons import cut_polygons, sizes_together
from xfrustum.scenes.meshes.text_lines import TextLines, plain_text, ranges, starts_of
from xfrustum.scenes.model.scene import UnreadFeature

_HEADER = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(ST)?(C)?(N)?(4)?(n)?OFF\b([ \t]*BINARY)?")


def read_off(path: Path) -> MeshContent:
    """Read an OFF file; InputError, with the line, for damaged or unsupported files."""
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
    after = 3 + weighted  # the place of normals; colors and texture coordinates follow
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
    # Homogeneous coordinates: a weight of zero gives infinity, which is refused with all vertices.
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
    """Return the numbers of each vertex (V, n); `sizes` are n for colors of 3 and 4 channels."""
    own = np.unique(per_line[1 : 1 + count])
    alike = len(own) == 1  # otherwise vertices are spread over lines, and colors have 4 channels
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
    """Return the corners of all faces in a row, the size of each, and the presence of colors."""
    line_starts, after = starts_of(per_line), np.cumsum(per_line)
    first_line = int(np.searchsorted(line_starts, start))

    def error(place: int, reason: str) -> InputError:
        line = int(np.searchsorted(line_starts, place, side="right")) - 1
        return lines.error(line, f"{reason}; export the mesh again")

    if len(per_line) - first_line == count and count and line_starts[first_line] == start:
        starts, limits = line_starts[first_line:], after[first_line:]
    else:  # numbers in lines of any length, where colors cannot be distinguished from faces
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
    """Return whole numbers; InputError at others."""
    with np.errstate(invalid="ignore"):
        whole = numbers.astype(np.int64)
    if (whole != numbers).any():
        raise InputError(f"{path}: {what} are not whole numbers; export the mesh again")
    return whole
