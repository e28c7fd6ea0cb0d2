"""Mesh files through trimesh, numbered as the contract says (CONVENTIONS.md, "Triangles and objects")."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import bounded_memory
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.meshes.attributes import vertex_colors, vertex_normals
from xfrustum.scenes.files.meshes.gltf_header import GLTF_SUFFIXES
from xfrustum.scenes.files.meshes.parts import MeshPart, read_parts
from xfrustum.scenes.files.meshes.source import MeshResolver, check_mesh_source
from xfrustum.scenes.files.meshes.textures import missing_libraries, read_textures
from xfrustum.scenes.model.scene import SceneObject


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
