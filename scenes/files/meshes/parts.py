"""The parts of a mesh file as trimesh reads them, without what trimesh makes up (docs/adr/0007)."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.load import mesh_loaders
from trimesh.visual.material import SimpleMaterial

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.files.meshes.gltf_header import GLTF_SUFFIXES, GltfMaterial, materials_of_primitives

_RAW_COLOR_SUFFIXES = (".obj", ".ply", *GLTF_SUFFIXES)
"""Files whose colors are taken from trimesh's loaders before its meshes round them to 8 bits."""

# trimesh logs files that it cannot read with a traceback; here they are errors or warnings of one line.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


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


def read_parts(path: Path, resolver: Any = None) -> list[MeshPart]:
    """Return the meshes of a file, each where its node places it, those without faces left out.

    Exceptions of trimesh's parser, of any kind, are passed on.

    Parameters
    ----------
    path
        Path of the mesh file.
    resolver
        trimesh's resolver, which opens the files that the mesh names; None for files beside the mesh.
    """
    if resolver is None:
        resolver = trimesh.resolvers.FilePathResolver(str(path.absolute()))
    scene = _loaded(path, resolver)
    gltf = _gltf_materials(path, list(scene.geometry))
    named = _named_textures(path)
    parts = []
    for node in scene.graph.nodes_geometry:
        file_from_part, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            parts.append(_part(name, geometry, file_from_part, gltf.get(name), named))
    return parts


def _loaded(path: Path, resolver: Any) -> Any:
    """Return trimesh's scene, with the file's own numbers for colors if it is of `_RAW_COLOR_SUFFIXES`."""
    suffix = path.suffix.lower()
    if suffix not in _RAW_COLOR_SUFFIXES:
        return trimesh.load_scene(str(path), process=False, resolver=resolver)
    load: Any = mesh_loaders[suffix[1:]]
    with path.open("rb") as file:
        loaded = load(file_obj=file, file_type=suffix[1:], resolver=resolver, process=False)
    loaded.setdefault("process", False)
    for arguments in (loaded, *loaded.get("geometry", {}).values()):
        if "faces" in arguments and arguments.get("vertex_colors") is not None:
            colors = arguments.pop("vertex_colors")
            arguments["vertex_attributes"] = {**arguments.get("vertex_attributes", {}), "color": colors}
    return trimesh.load_scene(loaded)


def _part(
    name: str,
    geometry: trimesh.Trimesh,
    file_from_part: Floats,
    gltf: GltfMaterial | None,
    named: Mapping[str, str],
) -> MeshPart:
    # trimesh keeps the normals that it has read in its cache.
    mesh = geometry.copy(include_cache=True, include_visual=False)
    mesh.apply_transform(file_from_part)
    visual = geometry.visual
    material = getattr(visual, "material", None)
    colors = _stored_colors(geometry)
    not_read = [] if gltf is None else list(gltf.not_read)
    if colors is not None and len(colors) != len(mesh.vertices):
        not_read.append("colors at vertices, which texture coordinates split")
        colors = None
    if "color" in geometry.face_attributes or getattr(visual, "kind", None) == "face":
        not_read.append("colors of faces")
    return MeshPart(
        name=name,
        mesh=mesh,
        uv=_texture_coordinates(geometry),
        colors=colors,
        base_color=None if gltf is None else gltf.base_color,
        picture=_picture_of_file(material),
        named_texture=gltf.texture if gltf is not None else _named(material, named),
        not_read=tuple(not_read),
    )


def _stored_colors(geometry: trimesh.Trimesh) -> NDArray[np.generic] | None:
    """Return the colors of vertices as the file stores them; None where there are none.

    Raises
    ------
    ValueError
        Vertices have different numbers of color channels, as in a damaged text file.
    """
    visual: Any = geometry.visual
    colors = geometry.vertex_attributes.get("color")
    if colors is None:  # textured glTF keeps them here
        colors = getattr(visual, "vertex_attributes", {}).get("color")
    if colors is None and getattr(visual, "kind", None) == "vertex":
        colors = visual.vertex_colors
    if colors is None:
        return None
    stored = np.asarray(colors)
    if stored.dtype == np.object_:
        raise ValueError("vertices have different numbers of color channels")
    return stored


def _texture_coordinates(geometry: trimesh.Trimesh) -> Floats | None:
    uv = getattr(geometry.visual, "uv", None)
    usable = uv is not None and np.shape(uv) == (len(geometry.vertices), 2)
    return np.array(uv, dtype=np.float64) if usable else None


def _picture_of_file(material: Any) -> Any:
    """Return the base color picture of a material; None where it comes from no file.

    Pictures that Pillow has opened have a format. trimesh made those without one in memory: the 2 x 2 gray
    placeholder of meshes with texture coordinates and no texture, or a conversion of another material.
    """
    picture = getattr(material, "baseColorTexture", None)
    if picture is None:
        picture = getattr(material, "image", None)
    return None if getattr(picture, "format", None) is None else picture


def _gltf_materials(path: Path, names: list[str]) -> dict[str, GltfMaterial]:
    """Return the glTF material of each geometry that has one; nothing for other files."""
    if path.suffix.lower() not in GLTF_SUFFIXES:
        return {}
    materials = materials_of_primitives(path)
    pairs = zip(names, materials, strict=False) if len(materials) == len(names) else ()
    return {name: material for name, material in pairs if material is not None}


_ANY_MATERIAL = ""
"""Key of a texture that belongs to all parts of a file."""


def _named(material: Any, named: Mapping[str, str]) -> str | None:
    name = material.name if isinstance(material, SimpleMaterial) else None
    return named.get(str(name), named.get(_ANY_MATERIAL))


def _named_textures(path: Path) -> dict[str, str]:
    """Return the texture that an OBJ file's library names for each material, or a PLY file for all."""
    if path.suffix.lower() == ".ply":
        with path.open("rb") as file:
            header = file.read(1 << 16).partition(b"end_header")[0]
        found = re.search(rb"(?i)^comment\s+texturefile\s+(.+?)\s*$", header, re.MULTILINE)
        return {} if found is None else {_ANY_MATERIAL: found[1].decode("utf-8", "replace")}
    libraries = material_libraries(path)
    if not libraries or not (path.parent / libraries[0]).is_file():
        return {}
    named, current = {}, _ANY_MATERIAL
    text = (path.parent / libraries[0]).read_bytes().decode("utf-8", "replace")
    for line in text.splitlines():
        key, _, value = line.strip().partition(" ")
        if key.lower() == "newmtl":
            current = " ".join(value.split())
        elif key.lower() == "map_kd" and current:
            named[current] = value.strip()
    return named


def material_libraries(path: Path) -> list[str]:
    """Return the names that an OBJ file's `mtllib` lines have; none for other files."""
    if path.suffix.lower() != ".obj":
        return []
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    return [name.decode("utf-8", "replace") for name in dict.fromkeys(lines)]
