"""Entrance of the second reader: format by suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.second_reader import archives, gltf, obj, off, ply, stl
from tests.second_reader.model import Floats, Reading, Refused
from tests.second_reader.polygons import cut

READERS: dict[str, Callable[[Path], Reading]] = {
    ".obj": obj.read,
    ".off": off.read,
    ".ply": ply.read,
    ".stl": stl.read,
    ".glb": gltf.read,
    ".gltf": gltf.read,
    ".3mf": archives.read_3mf,
    ".3dxml": archives.read_3dxml,
}


def read(path: Path) -> Reading:
    """Read a mesh file; raise Refused where it has no right reading."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise Refused(f"format {path.suffix}")
    return reader(path).checked()


def read_polygons(path: Path) -> list[Floats]:
    """Read the polygons of a file, (n, 3) each, in the order of the file."""
    return read(path).polygons


def read_triangles(path: Path) -> Floats:
    """Read the triangles of a file, (F, 3, 3), polygons cut."""
    return np.array([triangle for polygon in read_polygons(path) for triangle in cut(polygon)])
