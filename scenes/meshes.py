"""Mesh files through trimesh, numbered as the contract says (design, section 7)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.input_files import bounded_memory
from xfrustum.scenes.mesh_attributes import vertex_colors, vertex_normals
from xfrustum.scenes.mesh_source import MeshResolver, check_mesh_source
from xfrustum.scenes.scene import SceneObject

_GLTF = (".gltf", ".glb")
"""Files whose vertex colors are linear; those of others are sRGB."""


def load_mesh(path: Path, *, material: str | None = None) -> SceneObject:
    """Read a mesh file as one object, in the mesh's own coordinates.

    Faces are numbered as by trimesh's `load(path, process=False, force="mesh")`: glTF nodes placed
    and joined, a part used twice counted twice. The parts are joined here and not by trimesh, which
    would pack their textures into one atlas and so lose the repetition of texture coordinates. Of
    normals and colors at vertices it has what the file has (CONVENTIONS.md, "Light").

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
    parts = _read_parts(path, resolver)
    if resolver.refused:
        raise InputError(f"{path}: {resolver.refused[0]}")
    if not parts:
        raise InputError(f"{path}: the mesh has no triangles; give it a mesh with faces")
    for part in parts:
        _check_faces(path, part)
    counts = [len(part.vertices) for part in parts]
    offsets = np.cumsum([0, *counts[:-1]])
    faces = [part.faces + offset for part, offset in zip(parts, offsets, strict=True)]
    vertices = np.concatenate([part.vertices for part in parts])
    _check_finite(path, vertices)
    textures, texture_of_triangle = _textures(parts)
    return SceneObject(
        name=str(path),
        vertices=vertices,
        faces=np.concatenate(faces),
        material=material,
        uv=_texture_coordinates(parts),
        textures=textures,
        texture_of_triangle=texture_of_triangle,
        vertex_normals=vertex_normals(parts),
        vertex_colors=vertex_colors(parts, linear=path.suffix.lower() in _GLTF),
    )


def _read_parts(path: Path, resolver: MeshResolver) -> list[trimesh.Trimesh]:
    """Return the meshes of a file, each where its node places it, those without faces left out."""
    kinds = ", ".join(sorted(trimesh.available_formats()))
    try:
        return _placed(trimesh.load_scene(str(path), process=False, resolver=resolver))
    except OSError as error:
        raise InputError(f"{path}: cannot read the mesh ({error.strerror or 'I/O error'})") from error
    except NotImplementedError as error:
        raise InputError(f"{path}: not a mesh type that can be read; use one of {kinds}") from error
    except IndexError as error:
        raise InputError(
            f"{path}: faces point past the vertices, or the file is damaged; export the mesh again"
        ) from error
    except MemoryError:
        raise
    except Exception as error:  # trimesh's loaders raise whatever their parser stumbled over
        reason = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
        raise InputError(f"{path}: cannot be read as a mesh ({reason}); export the mesh again") from error


def _placed(scene: Any) -> list[trimesh.Trimesh]:
    """Return every mesh of a scene where its nodes place it, as its `dump` does, but with normals."""
    parts = []
    for node in scene.graph.nodes_geometry:
        scene_from_part, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            # The cache is where trimesh keeps the normals that it has read.
            part = geometry.copy(include_cache=True)
            part.apply_transform(scene_from_part)
            colors = getattr(geometry.visual, "vertex_attributes", {}).get("color")
            if colors is not None:  # which a copy of textured visuals leaves out
                part.vertex_attributes["color"] = colors
            part.metadata["name"] = name
            parts.append(part)
    return parts


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


def _check_finite(path: Path, vertices: NDArray[np.float64]) -> None:
    """Raise InputError that counts the vertices that are no points."""
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        raise InputError(
            f"{path}: {np.count_nonzero(~finite)} of {len(vertices)} vertices are NaN or infinite, "
            f"the first is number {int(np.argmin(finite))}; repair the mesh"
        )


def _texture_coordinates(parts: list[trimesh.Trimesh]) -> NDArray[np.float64] | None:
    """Return (V, 2) coordinates, NaN on parts without; None where no part has them."""
    found = []
    for part in parts:
        uv = getattr(part.visual, "uv", None)
        usable = uv is not None and np.shape(uv) == (len(part.vertices), 2)
        found.append(np.asarray(uv, dtype=np.float64) if usable else np.full((len(part.vertices), 2), np.nan))
    joined = np.concatenate(found)
    return None if np.isnan(joined).all() else joined


def _textures(parts: list[trimesh.Trimesh]) -> tuple[tuple[NDArray[np.uint8], ...], NDArray[np.int32] | None]:
    """Return each different base color texture once, and per triangle which one it uses."""
    textures: list[NDArray[np.uint8]] = []
    index_of_geometry: dict[Any, int] = {}
    indices = []
    for part in parts:
        geometry = part.metadata.get("name", id(part))
        if geometry not in index_of_geometry:
            texture = _base_color_texture(part)
            index_of_geometry[geometry] = -1 if texture is None else len(textures)
            textures += [] if texture is None else [texture]
        indices.append(np.full(len(part.faces), index_of_geometry[geometry], dtype=np.int32))
    return tuple(textures), np.concatenate(indices) if textures else None


def _base_color_texture(part: trimesh.Trimesh) -> NDArray[np.uint8] | None:
    """Return a part's (H, W, 4) uint8 picture, or None: a bad picture never fails a mesh."""
    material = getattr(part.visual, "material", None)
    picture = getattr(material, "baseColorTexture", None)
    if picture is None:
        picture = getattr(material, "image", None)
    if picture is None:
        return None
    try:
        return np.array(picture.convert("RGBA"), dtype=np.uint8)
    except OSError:  # Pillow decodes late, and only then finds a truncated file
        return None
