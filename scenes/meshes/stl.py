"""STL, text and binary; incomplete files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.content import MeshContent, MeshPart
from xfrustum.scenes.meshes.text_lines import TextLines, plain_text
from xfrustum.scenes.model.scene import UnreadFeature
from xfrustum.scenes.representation import counted

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES = 84  # 80 of any content, and the number of triangles
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
        return _content(path, corners, _unread(corners, normals, colored))
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _content(path, _text_corners(path, data), ())
    reason = f"header says {counted(count, 'triangle')} = {whole:,} bytes, file has {len(data):,}"
    if len(data) < _HEADER_BYTES:
        reason = (
            f"the file has {len(data):,} bytes, fewer than the header of a binary STL and no text"
        )
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


def _content(path: Path, corners: Floats, unread: tuple[UnreadFeature, ...]) -> MeshContent:
    if not len(corners):
        raise InputError(
            f"{path}: the mesh has no triangles: it says so itself; export the mesh again"
        )
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    part = MeshPart(vertices=corners.reshape(-1, 3), faces=faces)
    return MeshContent(parts=(part,), unread=unread)


def _unread(corners: Floats, normals: Floats, colored: bool) -> tuple[UnreadFeature, ...]:
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
