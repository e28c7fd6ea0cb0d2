"""Mesh files through trimesh, numbered as the contract says (CONVENTIONS.md, "Triangles and objects").

Nothing that trimesh makes up is taken (docs/adr/0007).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.load import mesh_loaders
from trimesh.visual.material import SimpleMaterial

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import bounded_memory
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.mesh_colors import (
    GLTF_SUFFIXES,
    GltfMaterial,
    MeshPart,
    material_libraries,
    materials_of_primitives,
    missing_libraries,
    read_textures,
    vertex_colors,
)
from xfrustum.scenes.files.mesh_source import MeshResolver, check_mesh_source
from xfrustum.scenes.model.scene import SceneObject

_RAW_COLOR_SUFFIXES = (".obj", ".ply", *GLTF_SUFFIXES)
"""Files whose colors are taken from trimesh's loaders before its meshes round them to 8 bits."""

# trimesh logs files that it cannot read with a traceback; here they are errors or warnings of one line.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def load_mesh(path: Path, *, material: str | None = None) -> SceneObject:
    """Read a mesh file as one object, in the mesh's own coordinates.

    Faces are numbered as by trimesh's `load(path, process=False, force="mesh")`: glTF nodes placed
    and joined, a part used twice counted twice. The parts are joined here and not by trimesh, which
    would pack their textures into one atlas and so lose the repetition of texture coordinates. The object
    has the normals and colors of vertices that the file has, and no others (CONVENTIONS.md, "Light").

    Raises
    ------
    InputError
        The file is missing, of a type that trimesh does not read, damaged, without triangles, or
        has vertices that are not finite or faces that point past them.
    """
    check_mesh_source(path)
    with bounded_memory(path):
        return _loaded(path, material)


def _loaded(path: Path, material: str | None) -> SceneObject:
    """Read a mesh file that has been checked, and join its parts."""
    resolver = MeshResolver(str(path))
    parts = _parts(path, resolver)
    if resolver.refused:
        raise InputError(f"{path}: {resolver.refused[0]}")
    if not parts:
        raise InputError(f"{path}: the mesh has no triangles; give it a mesh with faces")
    for part in parts:
        _check_faces(path, part.mesh)
    counts = [len(part.mesh.vertices) for part in parts]
    offsets = np.cumsum([0, *counts[:-1]])
    faces = [part.mesh.faces + offset for part, offset in zip(parts, offsets, strict=True)]
    vertices = np.concatenate([part.mesh.vertices for part in parts])
    _check_finite(path, vertices)
    textures = read_textures(path, parts)
    told = dict.fromkeys([*missing_libraries(path), *textures.warnings, *_left_out(parts)])
    return SceneObject(
        name=str(path),
        vertices=vertices,
        faces=np.concatenate(faces),
        material=material,
        uv=_texture_coordinates(parts),
        textures=textures.pictures,
        texture_of_triangle=textures.of_triangle,
        vertex_normals=vertex_normals(parts),
        vertex_colors=vertex_colors(parts, linear=path.suffix.lower() in GLTF_SUFFIXES),
        warnings=tuple(f"{path}: {line}" for line in told),
    )


def _parts(path: Path, resolver: MeshResolver) -> list[MeshPart]:
    """Return the parts of a file; raise InputError with the reason where it cannot be read."""
    kinds = ", ".join(sorted(trimesh.available_formats()))
    try:
        return read_parts(path, resolver)
    except OSError as error:
        raise InputError(f"{path}: cannot read the mesh ({error.strerror or 'I/O error'})") from error
    except ImportError as error:
        raise InputError(
            f"{path}: reading it needs a package that is not installed; for 3MF: pip install '.[3mf]' in "
            "the checkout of xfrustum"
        ) from error
    except NotImplementedError as error:
        raise InputError(f"{path}: not a mesh type that can be read; use one of {kinds}") from error
    except IndexError as error:
        raise InputError(
            f"{path}: faces point past the vertices, or the file is damaged; export the mesh again"
        ) from error
    except MemoryError:
        raise
    except Exception as error:  # trimesh's loaders raise exceptions of any kind
        reason = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
        raise InputError(f"{path}: cannot be read as a mesh ({reason}); export the mesh again") from error


def _check_faces(path: Path, part: trimesh.Trimesh) -> None:
    """Raise InputError where a part's own faces leave its own vertices, or these are no points in space."""
    if part.vertices.ndim != 2 or part.vertices.shape[1] != 3 or part.faces.shape[1:] != (3,):
        raise InputError(f"{path}: vertices need three coordinates each; export the mesh again")
    lowest, highest = int(part.faces.min()), int(part.faces.max())
    if lowest < 0 or highest >= len(part.vertices):
        raise InputError(
            f"{path}: faces point past the vertices (index {lowest if lowest < 0 else highest}, "
            f"{len(part.vertices)} vertices); export the mesh again"
        )


def _check_finite(path: Path, vertices: Floats) -> None:
    """Raise InputError, with their number, where vertices are not finite."""
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        raise InputError(
            f"{path}: {np.count_nonzero(~finite)} of {len(vertices)} vertices are NaN or infinite, "
            f"the first is number {int(np.argmin(finite))}; repair the mesh"
        )


def _texture_coordinates(parts: list[MeshPart]) -> Floats | None:
    """Return (V, 2) coordinates, NaN on parts without; None where no part has them."""
    if all(part.uv is None for part in parts):
        return None
    return np.concatenate(
        [np.full((len(part.mesh.vertices), 2), np.nan) if part.uv is None else part.uv for part in parts]
    )


def _left_out(parts: list[MeshPart]) -> list[str]:
    """Return one line for each part of a color that this reader leaves out."""
    return [f"not read: {what} (see CONVENTIONS.md, Light)" for part in parts for what in part.not_read]


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
    scene = _trimesh_scene(path, resolver)
    gltf = _gltf_materials(path, list(scene.geometry))
    named = _named_textures(path)
    parts = []
    for node in scene.graph.nodes_geometry:
        file_from_part, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            parts.append(_part(name, geometry, file_from_part, gltf.get(name), named))
    return parts


def _trimesh_scene(path: Path, resolver: Any) -> Any:
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
        uv=_own_coordinates(geometry),
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


def _own_coordinates(geometry: trimesh.Trimesh) -> Floats | None:
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
