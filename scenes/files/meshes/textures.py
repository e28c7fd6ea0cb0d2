"""Textures of mesh files: those that the file has, and a warning for each that it names in vain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.scenes.arrays import Bytes, Numbers
from xfrustum.scenes.disk.input_files import check_picture_size
from xfrustum.scenes.files.meshes.parts import MeshPart, material_libraries

_GRAY_OF_16_BITS = "I;16"
"""Pillow's name for gray pictures of 16 bits, which its own conversion to 8 bits clips instead of scaling."""

_UNSCALED = ("I", "F")
"""Pillow's modes of 32 bits a pixel, whose numbers have no known full scale."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Textures:
    """Textures of all parts of a mesh file.

    Attributes
    ----------
    pictures
        (H, W, 4) uint8 sRGB pictures, row 0 at the top, each different one once.
    of_triangle
        (F,) int32 index into `pictures`, -1 where a triangle has none; None where there are no pictures.
    warnings
        One line for each texture that is named and not shown.
    """

    pictures: tuple[Bytes, ...]
    of_triangle: Numbers | None
    warnings: tuple[str, ...]


def read_textures(path: Path, parts: Sequence[MeshPart]) -> Textures:
    """Decode the textures of a mesh file's parts; a damaged picture is a warning and no error.

    Parameters
    ----------
    path
        Path of the mesh file, beside which its textures lie.
    parts
        All parts of the file; parts of one name share a texture.
    """
    pictures: list[Bytes] = []
    warnings: list[str] = []
    index_of_name: dict[str, int] = {}
    indices = []
    for part in parts:
        if part.name not in index_of_name:
            if part.picture is not None:
                check_picture_size(path, *part.picture.size)  # pictures within glTF files too
            pixels = None if part.picture is None else _decoded(part.picture)
            index_of_name[part.name] = -1 if pixels is None else len(pictures)
            pictures += [] if pixels is None else [pixels]
            warnings += _faults(path, part, shown=pixels is not None)
        indices.append(np.full(len(part.mesh.faces), index_of_name[part.name], dtype=np.int32))
    return Textures(
        pictures=tuple(pictures),
        of_triangle=np.concatenate(indices) if pictures else None,
        warnings=tuple(warnings),
    )


def missing_libraries(path: Path) -> list[str]:
    """Return a line for each material library that an OBJ file names and that is not read."""
    libraries = material_libraries(path)
    missing = [name for name in libraries[:1] if not (path.parent / name).is_file()]
    return [
        *(
            f"the material library {name} is missing; textures that it may name are not shown"
            for name in missing
        ),
        *(f"the material library {name} is not read: only the first one is" for name in libraries[1:]),
    ]


def _faults(path: Path, part: MeshPart, *, shown: bool) -> list[str]:
    """Return the reason why a texture that the file names is not shown, or nothing."""
    name = part.named_texture
    if shown:
        return (
            []
            if part.uv is not None
            else [f"the texture {name} is not shown: there are no coordinates for it"]
        )
    if name is None:
        return []
    there = name.startswith("in image") or (path.parent / name).is_file()
    return [
        f"the texture {name} {'cannot be read' if there else 'is missing'}; the surface is drawn without it"
    ]


def _decoded(picture: Any) -> Bytes | None:
    """Return a picture's (H, W, 4) pixels; None where it is damaged or its numbers have no full scale."""
    if picture.mode in _UNSCALED:
        return None
    try:
        if picture.mode == _GRAY_OF_16_BITS:
            gray = np.round(np.asarray(picture).astype(np.float64) / 257).astype(np.uint8)
            return np.dstack([gray, gray, gray, np.full_like(gray, 255)])
        return np.array(picture.convert("RGBA"), dtype=np.uint8)
    except (OSError, SyntaxError, ValueError):  # Pillow decodes, and finds damage, only here
        return None
