"""One mesh file as one object: the reader of its format, and the checks that all formats share.

Faces are numbered as CONVENTIONS.md states. Values that a library invents are not used
(docs/adr/0007).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from xfrustum.scenes import InputError, SceneObject, disk
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, decode_textures
from xfrustum.scenes.meshes.gltf import read_gltf
from xfrustum.scenes.meshes.obj import read_obj
from xfrustum.scenes.meshes.packages import read_3dxml, read_3mf
from xfrustum.scenes.meshes.ply_off_stl import read_off, read_ply, read_stl
from xfrustum.scenes.model.scene import UNTEXTURED, UnreadFeature
from xfrustum.scenes.representation import counted
from xfrustum.scenes.shapes import has_area

#: Readers by suffix.
_READERS: dict[str, Callable[[Path], MeshContent]] = {
    ".3dxml": read_3dxml,
    ".3mf": read_3mf,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": read_obj,
    ".off": read_off,
    ".ply": read_ply,
    ".stl": read_stl,
    ".stl_ascii": read_stl,
}

#: Advice for known formats that are not read, by suffix.
_EXPORT = "export the mesh as glTF, OBJ, PLY or STL"
_REFUSED = {
    ".dae .zae": f"COLLADA, which is not read; {_EXPORT}",
    ".xaml .x3d .wrl .amf .ctm .drc": f"of a format that is not read; {_EXPORT}",
    ".fbx .blend .usd .usda .usdc .usdz .abc": f"a scene; {_EXPORT}",
    ".step .stp .iges .igs .brep .dxf .dwg": f"a CAD drawing; {_EXPORT}",
    ".xyz .pts .pcd .las .laz .e57": "a point cloud; give it a mesh with faces",
    ".zip .gz .bz2 .xz .tar .7z": "packed; unpack it first",
}


def load_mesh(path: Path, *, material: str | None = None) -> SceneObject:
    """Read a mesh file as one object, in the mesh's own coordinates.

    Faces are numbered as in trimesh's `load(path, process=False, force="mesh")`; a part that is
    used twice counts twice. Parts are joined here, because trimesh would pack their textures into
    an atlas, in which textures cannot repeat. Raises InputError if the file is missing, of another
    type, damaged, without triangles, or has geometry that the reader does not support.
    """
    disk.check_mesh_file(path)
    with disk.bounded_memory(path):
        content = _reader(path)(path)
        parts = content.parts
        if not parts:
            raise InputError(f"{path}: the mesh has no triangles; give it a mesh with faces")
        _check_geometry(path, parts)
        offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        vertices = np.concatenate([part.vertices for part in parts])
        faces = np.concatenate([part.faces + at for part, at in zip(parts, offsets, strict=True)])
        # Missing attributes of parts are NaN, or white for colors.
        uv = _joined(parts, (part.uv for part in parts), (np.nan, np.nan))
        pictures, texture_of_triangle, not_shown = decode_textures(path, parts)
        if texture_of_triangle is not None and uv is not None:
            # A triangle has no texture if a corner lacks texture coordinates.
            texture_of_triangle[np.isnan(uv[faces]).any(axis=(1, 2))] = UNTEXTURED
        return SceneObject(
            name=str(path),
            vertices=vertices,
            faces=faces,
            material=material,
            uv=uv,
            textures=pictures,
            texture_of_triangle=texture_of_triangle,
            vertex_normals=_joined(parts, (part.normals for part in parts), (np.nan,) * 3),
            vertex_colors=_joined(parts, (part.color for part in parts), (1.0, 1.0, 1.0)),
            unread=tuple(
                dict.fromkeys([*content.unread, *not_shown, *_without_area(vertices[faces])])
            ),
        )


def _without_area(triangles: Floats) -> list[UnreadFeature]:
    flat = np.count_nonzero(~has_area(triangles))
    share = f"{flat:,} of {counted(len(triangles), 'triangle')}"
    return [UnreadFeature(share, "have no area and are not seen")] if flat else []


def _reader(path: Path) -> Callable[[Path], MeshContent]:
    """Return the reader of a file; InputError if its format is not read."""
    suffix = path.suffix.lower()
    if suffix in _READERS:
        return _READERS[suffix]
    for suffixes, kind in _REFUSED.items():
        if suffix in suffixes.split():
            raise InputError(f"{path}: is {kind}")
    kinds = ", ".join(sorted(suffix[1:] for suffix in _READERS))
    raise InputError(f"{path}: not a mesh type that can be read; use one of {kinds}")


def _joined(
    parts: Sequence[MeshPart], values: Iterable[Floats | None], otherwise: tuple[float, ...]
) -> Floats | None:
    """Return (V, n) values at the vertices of all parts; None if no part has any."""
    own = list(values)
    if all(value is None for value in own):
        return None
    filled = [
        np.broadcast_to(otherwise if value is None else value, (len(part.vertices), len(otherwise)))
        for part, value in zip(parts, own, strict=True)
    ]
    return np.concatenate(filled)


def _check_geometry(path: Path, parts: Sequence[MeshPart]) -> None:
    """Raise InputError if faces refer to missing vertices, or if vertices are not finite."""
    for part in parts:
        ends, count = (int(part.faces.min()), int(part.faces.max())), len(part.vertices)
        for index in ends:
            if not 0 <= index < count:
                raise InputError(
                    f"{path}: faces point past the vertices (index {index}, {count} vertices); "
                    "export the mesh again"
                )
    finite = np.concatenate([np.isfinite(part.vertices).all(axis=1) for part in parts])
    if not finite.all():
        raise InputError(
            f"{path}: {np.count_nonzero(~finite)} of {len(finite)} vertices are NaN or infinite, "
            f"the first is number {int(np.argmin(finite))}; repair the mesh"
        )
