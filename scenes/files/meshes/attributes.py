"""Normals and colors at the vertices of mesh files: what the file has, and nothing that is made up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual.color import srgb_to_linear

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.meshes.parts import MeshPart

_BYTE, _WORD = 255.0, 65535.0
"""Full scale of whole numbers of 8 and of 16 bits."""


def vertex_normals(parts: Sequence[MeshPart]) -> Floats | None:
    """Return (V, 3) unit normals on the side that the winding faces; None where no part has any.

    NaN on parts whose file has none, and where a normal in it is zero or not finite.
    """
    found = [_normals_of_file(part.mesh) for part in parts]
    if all(normals is None for normals in found):
        return None
    return np.concatenate(
        [
            np.full(part.mesh.vertices.shape, np.nan) if normals is None else normals
            for part, normals in zip(parts, found, strict=True)
        ]
    )


def _normals_of_file(part: trimesh.Trimesh) -> Floats | None:
    # The property `vertex_normals` makes up missing normals. Those of the file are in the cache, where
    # trimesh's own exporters look too.
    if "vertex_normals" not in part._cache:
        return None
    normals = np.array(part.vertex_normals, dtype=np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.asarray(np.divide(normals, length, out=np.full(normals.shape, np.nan), where=usable))


def vertex_colors(parts: Sequence[MeshPart], *, linear: bool) -> Floats | None:
    """Return (V, 3) linear RGB, 1 on parts without; None where no part has any.

    Parameters
    ----------
    parts
        Placed meshes of one file. A glTF material's base color factor multiplies its vertex colors, or
        is in their place.
    linear
        Whether the file holds linear light, as glTF does; else it is decoded from sRGB.
    """
    found = [_color_of(part, linear=linear) for part in parts]
    if all(color is None for color in found):
        return None
    ones = [np.ones(part.mesh.vertices.shape) for part in parts]
    return np.concatenate(
        [one if color is None else one * color for one, color in zip(ones, found, strict=True)]
    )


def _color_of(part: MeshPart, *, linear: bool) -> Floats | None:
    """Return (V, 3) or (3,) linear RGB of a part that has a color, its alpha ignored."""
    color = None
    if part.colors is not None:
        shares = _shares_of_full_scale(part.colors[:, :3], counted_to_one=linear)
        color = shares if linear else np.asarray(srgb_to_linear(shares), dtype=np.float64)
    if part.base_color is None or part.base_color == (1.0, 1.0, 1.0):
        return color
    base = np.array(part.base_color)
    return base if color is None else color * base


def _shares_of_full_scale(stored: NDArray[np.generic], *, counted_to_one: bool) -> Floats:
    """Return colors as a file stores them as numbers from 0 to 1.

    Whole numbers of 8 and 16 bits are shares of the largest. Other numbers are such shares already, as
    glTF says; in other files they are shares of 255 if one of them is above 1, as some exporters of
    OBJ and PLY do. NaN and negative numbers become 0; numbers above full scale become 1.
    """
    colors = np.asarray(stored).astype(np.float64)
    if stored.dtype == np.uint8:
        return colors / _BYTE
    if stored.dtype == np.uint16:
        return colors / _WORD
    colors = np.where(np.isfinite(colors), colors, 0.0)
    full_scale = 1.0 if counted_to_one or not (colors > 1).any() else _BYTE
    return np.clip(colors / full_scale, 0.0, 1.0)
