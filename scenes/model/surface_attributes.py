"""Normals, colors and textures of all objects together, numbered as the scene's triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from xfrustum.scenes.arrays import Bytes, Floats, Numbers
from xfrustum.scenes.notebook.shown import Brief

if TYPE_CHECKING:
    from xfrustum.scenes.model.scene import SceneObject

UNTEXTURED = -1
"""Number in `texture_of_triangle` of a triangle without a texture."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SurfaceAttributes(Brief):
    """Attributes of the vertices and triangles of all objects; None where no object has any.

    Attributes
    ----------
    vertex_normals
        (V, 3) normals of any length, NaN where a vertex has none.
    vertex_colors
        (V, 3) linear RGB, one where an object has none.
    uv
        (V, 2) texture coordinates, v up; NaN where a vertex has none.
    textures
        (H, W, 4) uint8 sRGB each, row 0 at the top.
    texture_of_triangle
        (F,) index into `textures`, or `UNTEXTURED`.
    """

    vertex_normals: Floats | None
    vertex_colors: Floats | None
    uv: Floats | None
    textures: tuple[Bytes, ...]
    texture_of_triangle: Numbers | None

    @classmethod
    def of(cls, objects: Sequence[SceneObject]) -> SurfaceAttributes:
        """Return the attributes of all objects, joined."""
        textures: list[Bytes] = []
        numbers = []
        for part in objects:
            own = part.texture_of_triangle
            if own is None or part.uv is None:
                numbers.append(np.full(len(part.faces), UNTEXTURED, dtype=np.int32))
                continue
            # A triangle with a corner that has no coordinates shows no texture.
            placed = np.isfinite(part.uv[part.faces]).all(axis=(1, 2))
            numbers.append(np.where((own >= 0) & placed, own + len(textures), UNTEXTURED).astype(np.int32))
            textures += part.textures
        textured = bool(textures) and any((part >= 0).any() for part in numbers)
        return cls(
            vertex_normals=_joined(objects, "vertex_normals", 3, np.nan),
            vertex_colors=_joined(objects, "vertex_colors", 3, 1.0),
            uv=_joined(objects, "uv", 2, np.nan),
            textures=tuple(textures) if textured else (),
            texture_of_triangle=np.concatenate(numbers) if textured else None,
        )


def _joined(objects: Sequence[SceneObject], name: str, width: int, missing: float) -> Floats | None:
    """Concatenate an attribute of all objects; None where no object has it."""
    if all(getattr(part, name) is None for part in objects):
        return None
    parts = [
        np.full((len(part.vertices), width), missing) if getattr(part, name) is None else getattr(part, name)
        for part in objects
    ]
    return np.concatenate(parts)
