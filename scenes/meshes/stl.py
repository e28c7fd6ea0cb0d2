"""STL in text and in binary: whole files alone."""

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
_FACET_LINES = np.array(
    [b"facet", b"outer", b"vertex", b"vertex", b"vertex", b"endloop", b"endfacet"]
)
_COSINE = (
    0.5  # of stored normals and those of the winding: rounded ones differ by less than 60 degrees
)


def read_stl(path: Path) -> MeshContent:
    """Read an STL file; InputError where its length is not what it says, or its text is damaged."""
    data = read_input(path, "mesh file")
    count = int.from_bytes(data[80:_HEADER_BYTES], "little")
    whole = _HEADER_BYTES + count * _FACET.itemsize
    if len(data) >= _HEADER_BYTES and len(data) == whole:
        facets = np.frombuffer(data, _FACET, offset=_HEADER_BYTES)
        colored = bool(facets["attribute"].any())
        return _content(
            path, facets["corners"].astype(np.float64), facets["normal"].astype(np.float64), colored
        )
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _read_text(path, data)
    told = f"header says {counted(count, 'triangle')} = {whole:,} bytes, file has {len(data):,}"
    if len(data) < _HEADER_BYTES:
        told = (
            f"the file has {len(data):,} bytes, fewer than the header of a binary STL and no text"
        )
    raise InputError(f"{path}: {told}; export the mesh again")


def _read_text(path: Path, data: bytes) -> MeshContent:
    lines = TextLines(path, plain_text(data))
    words = lines.keywords(9)
    inside = np.flatnonzero((words != b"solid") & (words != b"endsolid"))
    pattern = np.resize(_FACET_LINES, len(inside))
    for place in np.flatnonzero(words[inside] != pattern)[:1].tolist():
        line = int(inside[place])
        wanted = pattern[place].decode()
        raise lines.error(
            line, f"'{lines.text(line)[:40]}' where '{wanted}' must be; export the mesh again"
        )
    ends, begins = np.flatnonzero(words == b"endsolid"), np.flatnonzero(words == b"solid")
    if len(inside) % len(_FACET_LINES) or len(ends) != len(begins) or words[-1] != b"endsolid":
        facet = len(inside) // len(_FACET_LINES)
        raise lines.error(
            len(lines) - 1, f"the file is cut off after {facet:,} facets; export the mesh again"
        )
    corners, per_line = lines.numbers(words == b"vertex", skip=len("vertex"))
    for place in np.flatnonzero(per_line != 3)[:1].tolist():
        raise lines.error(
            int(np.flatnonzero(words == b"vertex")[place]), "a vertex needs three coordinates"
        )
    return _content(path, corners.reshape(-1, 3, 3), None, False)


def _content(path: Path, corners: Floats, normals: Floats | None, colored: bool) -> MeshContent:
    if not len(corners):
        raise InputError(
            f"{path}: the mesh has no triangles: it says so itself; export the mesh again"
        )
    unread = []
    if colored:
        told = "are not shown: some programs store colors there"
        unread.append(UnreadFeature(feature="attributes of facets", consequence=told))
    if normals is not None and (turned := _turned(corners, normals)):
        told = f"are not read: {turned:,} oppose the order of the corners, which decides"
        unread.append(UnreadFeature(feature="normals of facets", consequence=told))
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    part = MeshPart(name="", vertices=corners.reshape(-1, 3), faces=faces)
    return MeshContent(parts=(part,), unread=tuple(unread))


def _turned(corners: Floats, normals: Floats) -> int:
    """Return how many normals point to the back of the winding."""
    with np.errstate(over="ignore", invalid="ignore"):
        winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        along = np.einsum("fx,fx->f", winding, normals)
        size = np.linalg.norm(winding, axis=1) * np.linalg.norm(normals, axis=1)
        return int(np.count_nonzero(along < -_COSINE * size))
