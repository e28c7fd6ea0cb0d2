"""A small writer of glTF documents for tests: arrays become accessors with correct bounds."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

TENT = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [2, 1, 5]], "<f4")
"""A pyramid with a single symmetry, four sides, and a floor of two triangles."""
TENT_FACES = np.array([0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4, 2, 1, 0, 3, 2, 0], "<u2")


class Writer:
    """A document that grows part by part; `tree` may be changed before it is saved."""

    def __init__(self) -> None:
        self.data = b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{name: [] for name in ("nodes", "meshes", "accessors", "bufferViews")},
        }

    def add(self, table: str, **entry: Any) -> int:
        """Add an entry to a table; return its number."""
        entries = self.tree.setdefault(table, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes, **more: Any) -> int:
        """Add a buffer view; return its number."""
        start, self.data = len(self.data), self.data + data + bytes(-len(data) % 4)
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **more)

    def array(self, array: Array, **more: Any) -> int:
        """Add an accessor of an array (count,) or (count, width); return its number."""
        rows = array.reshape(len(array), -1)
        if "bufferView" not in more and "sparse" not in more:
            more["bufferView"] = self.view(np.ascontiguousarray(rows).tobytes())
        if rows.shape[1] == 3:
            more = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist(), **more}
        code, kind = _CODES[array.dtype.str[1:]], _TYPES[rows.shape[1]]
        return self.add("accessors", componentType=code, count=len(rows), type=kind, **more)

    def mesh(self, points: Array | int, faces: Array | None = None, **primitive: Any) -> int:
        """Add a mesh of one primitive; return its number. `points` may be an accessor's number."""
        position = points if isinstance(points, int) else self.array(points)
        attributes = {"POSITION": position, **primitive.pop("attributes", {})}
        if faces is not None:
            primitive["indices"] = self.array(faces)
        return self.add("meshes", primitives=[{"attributes": attributes, **primitive}])

    def tent(self, points: Array | int = TENT, **primitive: Any) -> int:
        """Add a mesh with the faces of `TENT`, by default with its points; return its number."""
        return self.mesh(points, TENT_FACES, **primitive)

    def node(self, *, root: bool = True, **node: Any) -> int:
        """Add a node; return its number."""
        number = self.add("nodes", **node)
        if root:
            self.tree["scenes"][0]["nodes"].append(number)
        return number

    def extend(self, table: str, number: int, name: str, extension: dict[str, Any]) -> None:
        """Add an extension to an entry, and list it as used."""
        self.tree[table][number].setdefault("extensions", {})[name] = extension
        self.tree.setdefault("extensionsUsed", []).append(name)

    def save(self, path: Path) -> Path:
        """Write the document with embedded data; return the path."""
        buffer: dict[str, Any] = {"byteLength": len(self.data)}
        if path.suffix != ".glb":
            text = base64.b64encode(self.data).decode()
            buffer["uri"] = "data:application/octet-stream;base64," + text
        document = json.dumps({"buffers": [buffer], **self.tree}).encode()
        if path.suffix == ".glb":
            document += b" " * (-len(document) % 4)
            chunks = struct.pack("<II", len(document), 0x4E4F534A) + document
            chunks += struct.pack("<II", len(self.data), 0x004E4942) + self.data
            document = struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
        path.write_bytes(document)
        return path
