"""Colors and textures of mesh files: those that the file has, and a warning for each that is not shown.

glTF's base colors and names of textures come from its JSON header, which is read without trimesh.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual.color import srgb_to_linear

from xfrustum.scenes.arrays import Bytes, Floats, Numbers
from xfrustum.scenes.disk.input_files import check_picture_size

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


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshPart:
    """One mesh of a file, where its node places it.

    Attributes
    ----------
    name
        trimesh's name of the geometry; parts of one name share a texture.
    mesh
        Vertices, faces and normals, in the file's own coordinates.
    uv
        (V, 2) float64 texture coordinates, v up; None where the part has none.
    colors
        (V, 3 or 4) colors at the vertices as the file has them; None where the part has none.
    base_color
        Linear RGB that multiplies the colors, in glTF only; None where the material gives none.
    picture
        Pillow image of the texture, not yet decoded; None where the file has none.
    named_texture
        The file's name of that texture; None where it names none.
    not_read
        Parts of the color in the file that this reader leaves out, in words.
    """

    name: str
    mesh: trimesh.Trimesh
    uv: Floats | None
    colors: NDArray[np.generic] | None
    base_color: tuple[float, float, float] | None
    picture: Any
    named_texture: str | None
    not_read: tuple[str, ...]


_BYTE, _WORD = 255.0, 65535.0
"""Full scale of whole numbers of 8 and of 16 bits."""


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


def material_libraries(path: Path) -> list[str]:
    """Return the names that an OBJ file's `mtllib` lines have; none for other files."""
    if path.suffix.lower() != ".obj":
        return []
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    return [name.decode("utf-8", "replace") for name in dict.fromkeys(lines)]


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
