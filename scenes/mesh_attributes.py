"""Normals and colors at the vertices of mesh files: what the file has, and nothing that is made up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual.color import ColorVisuals, srgb_to_linear, to_float


def vertex_normals(parts: Sequence[trimesh.Trimesh]) -> NDArray[np.float64] | None:
    """Return (V, 3) unit normals on the side that the winding faces; None where no part has any.

    NaN on parts whose file has none, and where a normal in it is zero or not finite.
    """
    found = [_normals_of_file(part) for part in parts]
    if all(normals is None for normals in found):
        return None
    return np.concatenate(
        [
            np.full(part.vertices.shape, np.nan) if normals is None else normals
            for part, normals in zip(parts, found, strict=True)
        ]
    )


def _normals_of_file(part: trimesh.Trimesh) -> NDArray[np.float64] | None:
    # Asked for, `vertex_normals` makes some up; like trimesh's own exporters, look whether it has them.
    if "vertex_normals" not in part._cache:
        return None
    normals = np.array(part.vertex_normals, dtype=np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.asarray(np.divide(normals, length, out=np.full(normals.shape, np.nan), where=usable))


def vertex_colors(parts: Sequence[trimesh.Trimesh], *, linear: bool) -> NDArray[np.float64] | None:
    """Return (V, 3) linear RGB, one on parts without; None where no part has any.

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
    ones = [np.ones(part.vertices.shape) for part in parts]
    return np.concatenate(
        [one if color is None else one * color for one, color in zip(ones, found, strict=True)]
    )


def _color_of(part: trimesh.Trimesh, *, linear: bool) -> NDArray[np.float64] | None:
    """Return (V, 3) or (3,) linear RGB of a part that has a color, its alpha ignored."""
    stored = _stored_colors(part)
    color = None
    if stored is not None and len(stored) == len(part.vertices):
        decoded = to_float(stored) if linear else srgb_to_linear(stored)
        color = np.asarray(decoded, dtype=np.float64)[:, :3]
    # Only a glTF material has one; it is linear by that standard.
    factor = getattr(getattr(part.visual, "material", None), "baseColorFactor", None)
    if factor is None:
        return color
    base = np.asarray(to_float(factor), dtype=np.float64)[:3]
    return base if color is None else color * base


def _stored_colors(part: trimesh.Trimesh) -> NDArray[np.generic] | None:
    """Return (V, 3 or 4) colors at vertices as the file has them, which trimesh rounds to 8 bits."""
    visual = part.visual
    if isinstance(visual, ColorVisuals):
        return np.asarray(visual.vertex_colors) if visual.kind == "vertex" else None
    colors = part.vertex_attributes.get("color")
    return None if colors is None else np.asarray(colors)
