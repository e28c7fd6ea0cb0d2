"""Mesh files through trimesh, without what it makes up (docs/adr/0007).

Colors are those that its loaders read, before its meshes round them to 8 bits.
"""

from __future__ import annotations

import logging
import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.exchange.load import mesh_loaders
from trimesh.resolvers import FilePathResolver
from trimesh.visual.color import srgb_to_linear
from trimesh.visual.material import SimpleMaterial

from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.meshes.content import MeshContent, MeshPart
from xfrustum.scenes.model.scene import UnreadFeature

#: Files whose colors are taken from trimesh's loaders before its meshes round them to 8 bits.
_RAW_COLOR_SUFFIXES = (".obj", ".ply")
#: Bytes of memory that a byte of an unpacked mesh takes: double precision, 64-bit indices, copies.
MEMORY_PER_UNPACKED_BYTE = 16

# trimesh logs files that it cannot read with a traceback; here they are errors or warnings of one line.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def read_with_trimesh(path: Path) -> MeshContent:
    """Read a mesh file in a format of trimesh's; InputError where it cannot be read."""
    resolver = _Resolver(str(path))
    _check_packed(path)
    with _readable(path):
        named, unread = _named_textures(path)
        parts = _parts(path, resolver, named)
    if resolver.refused:
        raise InputError(f"{path}: {resolver.refused[0]}")
    return MeshContent(
        parts=tuple(part for part, _ in parts),
        unread=(*unread, *(feature for _, features in parts for feature in features)),
    )


class _Resolver(FilePathResolver):  # type: ignore[misc]
    """The files that a mesh refers to: trimesh's own rules, regular files only, pictures of bounded size.

    trimesh goes on without a file that cannot be read; why files were refused that exist, `refused` keeps.
    """

    def __init__(self, source: str, refused: list[str] | None = None) -> None:
        super().__init__(source)
        self.refused: list[str] = [] if refused is None else refused

    def get(self, name: str) -> Any:
        for candidate in (name.strip(), name.strip().lstrip("/"), Path(name).name):
            try:
                path = self.absolute(candidate)
                if not path.exists():
                    continue
            except (ValueError, OSError):
                continue
            try:
                input_files.regular_size(path, "file that a mesh refers to")
                with suppress(OSError, SyntaxError, ValueError), Image.open(path) as picture:
                    input_files.check_picture_size(path, *picture.size)
            except InputError as error:
                self.refused.append(str(error))
                raise FileNotFoundError(name) from error
            return super().get(name)
        raise FileNotFoundError(name)

    def namespaced(self, namespace: str) -> _Resolver:
        return _Resolver(str(Path(self.parent) / namespace), self.refused)


def _check_packed(path: Path) -> None:
    """Raise InputError at a packed file that does not say how large it is, or declares too much."""
    name = path.name.lower()
    try:
        if name.endswith((".gz", ".bz2")):
            raise InputError(f"{path}: is packed in a way that does not say how large it is; unpack it first")
        if name.endswith((".zip", ".3mf", ".zae", ".3dxml")):
            with zipfile.ZipFile(path) as archive:
                total = sum(info.file_size for info in archive.infolist())
            input_files.check_declared(path, total * MEMORY_PER_UNPACKED_BYTE, "unpacking")
    except (OSError, EOFError, zipfile.BadZipFile, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise InputError(f"{path}: cannot be unpacked ({reason}); pack it again") from error


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn whatever trimesh's loaders raise within a block into an InputError with the reason."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot read the mesh ({error.strerror or 'I/O error'})") from error
    except ImportError as error:
        raise InputError(
            f"{path}: reading it needs a package that is not installed; for 3MF: pip install '.[3mf]' in "
            "the checkout of xfrustum"
        ) from error
    except NotImplementedError as error:
        kinds = ", ".join(sorted(trimesh.available_formats()))
        raise InputError(f"{path}: not a mesh type that can be read; use one of {kinds}") from error
    except IndexError as error:
        raise InputError(
            f"{path}: faces point past the vertices, or the file is damaged; export the mesh again"
        ) from error
    except MemoryError:
        raise
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
        raise InputError(f"{path}: cannot be read as a mesh ({reason}); export the mesh again") from error


def _parts(
    path: Path, resolver: _Resolver, named: Mapping[str, str]
) -> list[tuple[MeshPart, list[UnreadFeature]]]:
    """Return the meshes of a file that have faces."""
    suffix = path.suffix.lower()
    if suffix in _RAW_COLOR_SUFFIXES:
        load: Any = mesh_loaders[suffix[1:]]
        with path.open("rb") as file:
            loaded = load(file_obj=file, file_type=suffix[1:], resolver=resolver, process=False)
        loaded.setdefault("process", False)
        for arguments in (loaded, *loaded.get("geometry", {}).values()):
            if "faces" in arguments and arguments.get("vertex_colors") is not None:
                colors = arguments.pop("vertex_colors")
                arguments["vertex_attributes"] = {**arguments.get("vertex_attributes", {}), "color": colors}
        scene: Any = trimesh.load_scene(loaded)
    else:
        scene = trimesh.load_scene(str(path), process=False, resolver=resolver)
    return [
        _part(name, scene.geometry[name], placed, named)
        for placed, name in (scene.graph[node] for node in scene.graph.nodes_geometry)
        if isinstance(scene.geometry[name], trimesh.Trimesh) and len(scene.geometry[name].faces)
    ]


def _part(
    name: str, geometry: trimesh.Trimesh, placed: Floats, named: Mapping[str, str]
) -> tuple[MeshPart, list[UnreadFeature]]:
    # trimesh keeps the normals that it has read in its cache.
    mesh = geometry.copy(include_cache=True, include_visual=False)
    mesh.apply_transform(placed)
    visual: Any = geometry.visual
    kind = getattr(visual, "kind", None)
    unread: list[UnreadFeature] = []
    stored = geometry.vertex_attributes.get("color")
    if stored is None and kind == "vertex":
        stored = visual.vertex_colors
    colors = None if stored is None else np.asarray(stored)
    if colors is not None and colors.dtype == np.object_:
        raise ValueError("vertices have different numbers of color channels")
    if colors is not None and len(colors) != len(mesh.vertices):
        unread.append(
            UnreadFeature(
                feature="colors at vertices", consequence="are left out: texture coordinates split vertices"
            )
        )
        colors = None
    if "color" in geometry.face_attributes or kind == "face":
        unread.append(UnreadFeature(feature="colors of faces", consequence="are not shown"))
    uv, material = getattr(visual, "uv", None), getattr(visual, "material", None)
    picture = getattr(material, "image", None)
    own_name = str(material.name) if isinstance(material, SimpleMaterial) else _ANY_MATERIAL
    part = MeshPart(
        name=name,
        vertices=np.asarray(mesh.vertices, np.float64),
        faces=np.asarray(mesh.faces, np.int64),
        uv=np.array(uv, np.float64) if uv is not None and np.shape(uv) == (len(mesh.vertices), 2) else None,
        color=_color(colors),
        # Pictures that Pillow has opened have a format. trimesh made those without one: the 2 x 2 gray
        # placeholder of meshes with coordinates and no texture, or a conversion of another material.
        picture=None if getattr(picture, "format", None) is None else picture,
        texture=named.get(own_name, named.get(_ANY_MATERIAL)),
        normals=_normals(mesh),
    )
    return part, unread


def _normals(part: trimesh.Trimesh) -> Floats | None:
    """Return (V, 3) unit normals on the side that the winding faces, NaN where one is zero or not finite."""
    # The property `vertex_normals` makes up missing normals. Those of the file are in the cache, where
    # trimesh's own exporters look too.
    if "vertex_normals" not in part._cache:
        return None
    normals = np.array(part.vertex_normals, dtype=np.float64)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 0)
    return np.asarray(np.divide(normals, length, out=np.full(normals.shape, np.nan), where=usable))


def _color(stored: NDArray[np.generic] | None) -> Floats | None:
    """Return (V, 3) linear RGB of stored sRGB, alpha ignored; None where there is no color.

    Numbers of 8 and 16 bits are shares of the largest. Others are shares of 255 if any is above 1, as some
    exporters of OBJ and PLY write, else of one. They are clipped, NaN to 0.
    """
    if stored is None:
        return None
    color = stored[:, :3].astype(np.float64)
    if stored.dtype in (np.uint8, np.uint16):
        color = color / (255.0 if stored.dtype == np.uint8 else 65535.0)
    else:
        color = np.where(np.isfinite(color), color, 0.0)
        color = np.clip(color / (255.0 if (color > 1).any() else 1.0), 0.0, 1.0)
    return np.asarray(srgb_to_linear(color), dtype=np.float64)


_ANY_MATERIAL = ""  # key of a texture that belongs to all parts of a file


def _named_textures(path: Path) -> tuple[dict[str, str], list[UnreadFeature]]:
    """Return an OBJ file's textures by material or a PLY file's for all, and lines for libraries not read."""
    if path.suffix.lower() == ".ply":
        with path.open("rb") as file:
            header = file.read(1 << 16).partition(b"end_header")[0]
        found = re.search(rb"(?i)^comment\s+texturefile\s+(.+?)\s*$", header, re.MULTILINE)
        return {} if found is None else {_ANY_MATERIAL: found[1].decode("utf-8", "replace")}, []
    if path.suffix.lower() != ".obj":
        return {}, []
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    first, *others = [name.decode("utf-8", "replace") for name in dict.fromkeys(lines)] or [""]
    only_first = "is not read: only the first one is"
    unread = [UnreadFeature(feature=f"material library {name}", consequence=only_first) for name in others]
    if first and not (path.parent / first).is_file():
        lost = "is missing; textures that it may name are not shown"
        unread.insert(0, UnreadFeature(feature=f"material library {first}", consequence=lost))
    if not first or not (path.parent / first).is_file():
        return {}, unread
    named, current = {}, _ANY_MATERIAL
    for line in (path.parent / first).read_bytes().decode("utf-8", "replace").splitlines():
        key, _, value = line.strip().partition(" ")
        if key.lower() == "newmtl":
            current = " ".join(value.split())
        elif key.lower() == "map_kd" and current:
            named[current] = value.strip()
    return named, unread
