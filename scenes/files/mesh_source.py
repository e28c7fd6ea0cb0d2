"""Checks of a mesh file before trimesh reads it: of its declared size and of files it refers to."""

from __future__ import annotations

import json
import struct
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from PIL import Image
from trimesh.resolvers import FilePathResolver

from xfrustum.scenes.disk.input_files import (
    check_declared,
    check_mesh_file,
    check_picture_size,
    regular_size,
)
from xfrustum.scenes.errors import InputError

MEMORY_PER_UNPACKED_BYTE = 16
"""Bytes of memory that a byte of an unpacked mesh takes: double precision, 64-bit indices, copies."""

_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""glTF 2.0, table 5.1.1.3: bytes of a component by its type's code."""

_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""glTF 2.0, the same table: components of an element."""

_GLB_MAGIC, _GLB_JSON = 0x46546C67, 0x4E4F534A
"""glTF 2.0, section 4.4: the first word of a binary file, and the type of its first chunk."""


class MeshResolver(FilePathResolver):
    """The files that a mesh refers to: trimesh's own rules, regular files only, pictures of bounded size.

    trimesh goes on without a file that cannot be read. Refused files must not be passed over, so that the
    reasons are kept.

    Attributes
    ----------
    refused
        Reasons why files that exist were not read, one line each.
    """

    def __init__(self, source: str, refused: list[str] | None = None) -> None:
        super().__init__(source)
        self.refused: list[str] = [] if refused is None else refused

    def get(self, name: str) -> Any:
        """Return the bytes of a file beside the mesh.

        Raises
        ------
        FileNotFoundError
            There is no such file, or it is refused.
        """
        for candidate in (name.strip(), name.strip().lstrip("/"), Path(name).name):
            try:
                path = self.absolute(candidate)
                if not path.exists():
                    continue
            except (ValueError, OSError):
                continue
            try:
                regular_size(path, "file that a mesh refers to")
                _check_picture(path)
            except InputError as error:
                self.refused.append(str(error))
                raise FileNotFoundError(name) from error
            return super().get(name)
        raise FileNotFoundError(name)

    def namespaced(self, namespace: str) -> MeshResolver:
        """Return a resolver for a folder below."""
        return MeshResolver(str(Path(self.parent) / namespace), self.refused)


def _check_picture(path: Path) -> None:
    """Refuse a picture that declares more pixels than memory allows; other files pass."""
    try:
        with Image.open(path) as picture:
            width, height = picture.size
    except (OSError, SyntaxError, ValueError):
        return
    check_picture_size(path, width, height)


def check_mesh_source(path: Path) -> None:
    """Refuse a mesh file that is no regular file, is empty, or declares much more than it has.

    Raises
    ------
    InputError
        The file is refused, or cannot be unpacked.
    """
    check_mesh_file(path)
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the mesh file is empty; export the mesh again")
    name = path.name.lower()
    try:
        if name.endswith((".zip", ".3mf", ".zae", ".3dxml")):
            with zipfile.ZipFile(path) as archive:
                total = sum(info.file_size for info in archive.infolist())
            check_declared(path, total * MEMORY_PER_UNPACKED_BYTE, "unpacking")
        elif name.endswith((".gz", ".bz2")):
            raise InputError(f"{path}: is packed in a way that does not say how large it is; unpack it first")
        elif name.endswith((".gltf", ".glb")):
            check_declared(path, _declared_by_gltf(_gltf_json(path)), "arrays")
    except (OSError, EOFError, zipfile.BadZipFile, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise InputError(f"{path}: cannot be unpacked ({reason}); pack it again") from error


def _gltf_json(path: Path) -> object:
    """Return the JSON of a glTF file; None where there is none, which trimesh will report."""
    data = path.read_bytes()
    if len(data) >= 20 and struct.unpack_from("<I", data)[0] == _GLB_MAGIC:
        length, kind = struct.unpack_from("<II", data, 12)
        data = data[20 : 20 + length] if kind == _GLB_JSON else b""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def _declared_by_gltf(tree: object) -> int:
    """Return the bytes of memory that all accessors of a glTF file ask for; trimesh refuses what is none."""
    accessors = tree.get("accessors") if isinstance(tree, dict) else None
    total = 0
    for accessor in accessors if isinstance(accessors, list) else ():
        with suppress(AttributeError, TypeError, ValueError, OverflowError):
            count = max(0, int(accessor["count"])) if "count" in accessor else 0
            size = _COMPONENT_BYTES.get(accessor.get("componentType"), 4)
            total += count * size * _COMPONENTS.get(accessor.get("type"), 1)
    return MEMORY_PER_UNPACKED_BYTE * total
