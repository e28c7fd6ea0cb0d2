"""The JSON header of glTF files, read without trimesh: base colors and names of textures."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

GLTF_SUFFIXES = (".gltf", ".glb")

_LINES, _POINTS, _TRIANGLES, _STRIP = 1, 0, 4, 5
_PRIMITIVES_READ = (_LINES, _POINTS, _TRIANGLES, _STRIP)
"""Modes of the primitives from which trimesh makes a geometry each; it leaves out those of other modes."""

_GLB_JSON_START = 20
"""Bytes before the JSON text of a binary file: its header of 12, and length and type of the first chunk."""

WHITE = (1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class GltfMaterial:
    """The color of a surface in a glTF material.

    Attributes
    ----------
    base_color
        Linear RGB factor; white where the material gives none, as the standard says.
    texture
        Name of the base color texture; None where the material names none.
    not_read
        Parts of the material's color that this reader leaves out, in words.
    """

    base_color: tuple[float, float, float] = WHITE
    texture: str | None = None
    not_read: tuple[str, ...] = ()


def materials_of_primitives(path: Path) -> list[GltfMaterial | None]:
    """Return the material, or None, of each primitive from which trimesh makes a geometry, in its order.

    The list is empty where the header cannot be understood, which the reader of the mesh reports.
    """
    try:
        header = _header(path)
        materials = [_material(header, entry) for entry in header.get("materials", [])]
        return [
            materials[primitive["material"]] if "material" in primitive else None
            for mesh in header.get("meshes", [])
            for primitive in mesh["primitives"]
            if primitive.get("mode", _TRIANGLES) in _PRIMITIVES_READ
        ]
    except (AttributeError, KeyError, IndexError, TypeError, ValueError, struct.error):
        return []


def _header(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        start = file.read(_GLB_JSON_START)
        if start[:4] == b"glTF":
            text = file.read(struct.unpack("<I", start[12:16])[0])
        else:
            text = start + file.read()
    header: dict[str, Any] = json.loads(text)
    return header


def _material(header: dict[str, Any], entry: dict[str, Any]) -> GltfMaterial:
    rough = entry.get("pbrMetallicRoughness", {})
    red, green, blue = (float(part) for part in rough.get("baseColorFactor", WHITE)[:3])
    reference = rough.get("baseColorTexture")
    not_read = []
    if "KHR_materials_pbrSpecularGlossiness" in entry.get("extensions", {}):
        not_read.append("colors of KHR_materials_pbrSpecularGlossiness")
    if reference is not None:
        if reference.get("texCoord", 0) != 0:
            not_read.append("the texture's own set of coordinates: it is placed by the first set")
        if "KHR_texture_transform" in reference.get("extensions", {}):
            not_read.append("KHR_texture_transform: the texture is placed as if it were not there")
    return GltfMaterial(
        base_color=(red, green, blue),
        texture=None if reference is None else _texture_name(header, reference["index"]),
        not_read=tuple(not_read),
    )


def _texture_name(header: dict[str, Any], index: int) -> str:
    """Return the URI of a texture's image; a description where the image has none that people can read."""
    texture = header["textures"][index]
    source = texture.get("source")
    for extension in texture.get("extensions", {}).values():
        source = extension.get("source", source)
    if source is None:
        return f"number {index} without an image"
    image = header["images"][source]
    uri = str(image.get("uri", "data:"))
    return f"in image {source} of the file itself" if uri.startswith("data:") else uri
