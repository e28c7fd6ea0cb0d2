"""Content of a mesh file: parts in the file's own coordinates, and features that are not honoured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import UnreadFeature


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshPart:
    """Placed triangles of one mesh of a file; parts of one picture share a texture."""

    name: str
    vertices: Floats  #: (V, 3) double precision
    faces: Indices  #: (F, 3) int64 indices into `vertices`
    uv: Floats | None = None  #: (V, 2), v up
    color: Floats | None = None  #: (V, 3) or (3,) linear RGB
    normals: Floats | None = (
        None  #: (V, 3) unit normals on the winding's side, NaN where there is none
    )
    picture: Any = None  #: Pillow image of the texture, opened and not yet decoded
    texture: str | None = None  #: name of the texture in the file


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshContent:
    """Parts of a mesh file in the order of their triangle numbers, and the features left out."""

    parts: tuple[MeshPart, ...]
    unread: tuple[UnreadFeature, ...] = ()


def unit_normals(normals: Floats) -> Floats:
    """Return (V, 3) unit normals, NaN where one is zero or not finite."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.asarray(np.divide(normals, length, out=np.full(normals.shape, np.nan), where=usable))
