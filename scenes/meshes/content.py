"""Content of a mesh file: its parts, in its own coordinates, and features not honoured."""

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
    #: (V, 3) unit normals on the winding's side, NaN where there is none
    normals: Floats | None = None
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


def cofactors(matrices: Floats) -> Floats:
    """Return (N, 3, 3) matrices by which normals, as rows, follow surfaces that matrices place.

    They are the inverse transposes times the determinants, and exist for singular matrices too.
    """
    x, y, z = np.moveaxis(matrices, 2, 0)
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def carried(
    matrices: Floats, faces: Indices, normals: Floats | None
) -> tuple[Indices, Floats | None]:
    """Return faces (N, F, 3) and normals (N, V, 3) at the places of (N, 3, 3) matrices.

    A mirror turns the winding, so that the outside stays outside; normals stay on its side.
    """
    mirrored = np.linalg.det(matrices) < 0
    placed = np.repeat(faces[None], len(matrices), axis=0)
    placed[mirrored] = placed[mirrored][..., ::-1]
    if normals is None:
        return placed, None
    sides = np.where(mirrored, -1.0, 1.0)[:, None, None]
    return placed, normals @ (cofactors(matrices) * sides)
