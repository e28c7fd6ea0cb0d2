"""Writers of small mesh files of shapes in closed form, for the tests of both readers."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.second_reader.gltf_data import COMPONENTS, WIDTHS
from tests.second_reader.model import Floats

FLOAT, BYTE, UBYTE, SHORT, USHORT, UINT = 5126, 5120, 5121, 5122, 5123, 5125

#: Corners without any symmetry, exact in float32, and four triangles of them.
CORNERS: Floats = np.array([[0, 0, 0], [4, 0, 0], [1, 3, 0], [1, 1, 5]], dtype=np.float64)
FACES: NDArray[np.int64] = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
SOUP: Floats = CORNERS[FACES]


@dataclass(frozen=True)
class Case:
    """File to read, others beside it, and its polygons; None where it has no right reading."""

    name: str
    data: bytes
    polygons: list[Floats] | None
    others: tuple[tuple[str, bytes], ...] = ()
    may_refuse: bool = False  #: a refusal is right, too: rare, or left open by the specification

    def write(self, folder: Path) -> Path:
        """Write the files into a folder; return the path of the first."""
        for name, data in self.others:
            (folder / name).write_bytes(data)
        path = folder / self.name.split(": ")[-1]
        path.write_bytes(self.data)
        return path


def case(
    name: str,
    data: bytes | str,
    polygons: Iterable[ArrayLike] | None = SOUP,
    may_refuse: bool = False,
) -> Case:
    """Return a case; text is encoded as UTF-8, lines as they are."""
    shapes = None if polygons is None else [np.asarray(one, dtype=np.float64) for one in polygons]
    encoded = data.encode() if isinstance(data, str) else data
    return Case(name, encoded, shapes, may_refuse=may_refuse)


def moved(matrix: ArrayLike, soup: Floats = SOUP) -> Floats:
    """Place a soup by a 4 x 4 matrix; turn a mirrored one, so that its outside stays outside."""
    placement = np.asarray(matrix, dtype=np.float64)
    placed = soup @ placement[:3, :3].T + placement[:3, 3]
    return placed[:, [0, 2, 1]] if np.linalg.det(placement[:3, :3]) < 0 else placed


def shift(x: float, y: float, z: float) -> Floats:
    """Return the matrix of a translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def scale(x: float, y: float, z: float) -> Floats:
    """Return the matrix of a scale."""
    return np.diag([x, y, z, 1.0])


def quarter_turn() -> Floats:
    """Return the matrix of 90 degrees about z: x to y."""
    return np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64)


class Gltf:
    """Builder of a glTF file."""

    def __init__(self, **top: Any) -> None:
        self.blob = bytearray()
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, **top}

    def add(self, kind: str, **entry: Any) -> int:
        """Append an entry to a list at the top; return its index."""
        entries: list[Any] = self.json.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes, **more: Any) -> int:
        """Append bytes as a buffer view."""
        self.blob += bytes(-len(self.blob) % 4)
        start = len(self.blob)
        self.blob += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **more)

    def accessor(
        self, values: ArrayLike, form: tuple[int, str] = (FLOAT, "VEC3"), **more: Any
    ) -> int:
        """Append values as an accessor of a component type and a type."""
        kind, shape = form
        rows = packed(values, form)
        step = -(-len(rows[0]) // 4) * 4 if shape != "SCALAR" else len(rows[0])
        stride = {"byteStride": step} if step != len(rows[0]) else {}
        view = self.view(b"".join(row.ljust(step, b"\0") for row in rows), **stride)
        return self.add(
            "accessors", bufferView=view, componentType=kind, type=shape, count=len(rows), **more
        )

    def positions(self, values: ArrayLike = CORNERS, kind: int = FLOAT, **more: Any) -> int:
        """Append positions with the min and max that the specification asks for."""
        rows = np.asarray(values, dtype=np.float64)
        bounds = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.accessor(rows, (kind, "VEC3"), **{**bounds, **more})

    def indices(self, values: ArrayLike = FACES, kind: int = USHORT) -> int:
        """Append indices."""
        return self.accessor(np.ravel(values), (kind, "SCALAR"))

    def mesh(
        self, positions: int | None = None, indices: int | None = None, **primitive: Any
    ) -> int:
        """Append a mesh of one primitive, by default the four triangles."""
        attributes = {"POSITION": self.positions() if positions is None else positions}
        attributes |= primitive.pop("attributes", {})
        weights = {"weights": primitive.pop("weights")} if "weights" in primitive else {}
        if indices is None:
            indices = self.indices()
        if indices >= 0:
            primitive["indices"] = indices
        return self.add("meshes", primitives=[{"attributes": attributes, **primitive}], **weights)

    def node(self, **entry: Any) -> int:
        """Append a node."""
        return self.add("nodes", **entry)

    def glb(self, roots: Sequence[int] | None = None) -> bytes:
        """Return the file as GLB."""
        self.finish(roots)
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        blob = bytes(self.blob) + bytes(-len(self.blob) % 4)
        chunks = (
            struct.pack("<II", len(text), 0x4E4F534A)
            + text
            + struct.pack("<II", len(blob), 0x004E4942)
            + blob
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri: str | None = None) -> bytes:
        """Return the file as JSON, its buffer in it or at an address."""
        self.finish(None)
        data = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.blob)).decode()
        self.json["buffers"][0]["uri"] = uri or data
        return json.dumps(self.json).encode()

    def finish(self, roots: Sequence[int] | None) -> None:
        """Add the scene and the buffer."""
        below = {child for node in self.json.get("nodes", []) for child in node.get("children", [])}
        own = [k for k in range(len(self.json.get("nodes", []))) if k not in below]
        self.json.setdefault("scenes", [{"nodes": own if roots is None else list(roots)}])
        self.json.setdefault("buffers", [{"byteLength": len(self.blob)}])


def packed(values: ArrayLike, form: tuple[int, str]) -> list[bytes]:
    """Pack rows of numbers of a component type and a type."""
    letter, _ = COMPONENTS[form[0]]
    rows = np.asarray(values).reshape(-1, WIDTHS[form[1]]).tolist()
    return [
        struct.pack(f"<{len(row)}{letter}", *(row if letter == "f" else map(int, row)))
        for row in rows
    ]


CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


def archive(parts: dict[str, str]) -> bytes:
    """Return a ZIP archive of texts."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, text in parts.items():
            file.writestr(name, text)
    return stream.getvalue()


def model_3mf(objects: str, build: str = "", head: str = "") -> str:
    """Return a model part."""
    return (
        f'<?xml version="1.0"?><model unit="inch" xmlns="{CORE}" xmlns:p="{PRODUCTION}" {head}>'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )


def package_3mf(parts: dict[str, str], root: str = "3D/3dmodel.model") -> bytes:
    """Return a 3MF package of model parts."""
    kind = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
    relation = "application/vnd.openxmlformats-package.relationships+xml"
    types = (
        '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        f'<Default Extension="rels" ContentType="{relation}"/>'
        f'<Default Extension="model" ContentType="{kind}"/></Types>'
    )
    space = "http://schemas.openxmlformats.org/package/2006/relationships"
    top = f'<Relationship Target="/{root}" Id="rel0" Type="{MODEL}"/>'
    others = "".join(
        f'<Relationship Target="/{name}" Id="r{k}" Type="{MODEL}"/>'
        for k, name in enumerate(parts)
        if name != root
    )
    folder, _, name = root.rpartition("/")
    extra = (
        {f"{folder}/_rels/{name}.rels": f'<Relationships xmlns="{space}">{others}</Relationships>'}
        if others
        else {}
    )
    start = {
        "[Content_Types].xml": types,
        "_rels/.rels": f'<Relationships xmlns="{space}">{top}</Relationships>',
    }
    return archive({**start, **parts, **extra})


def object_3mf(name: int, corners: Floats = CORNERS, faces: NDArray[np.int64] = FACES) -> str:
    """Return an object of a mesh."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in corners.tolist())
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
    return (
        f'<object id="{name}" type="model"><mesh><vertices>{vertices}</vertices>'
        f"<triangles>{triangles}</triangles></mesh></object>"
    )


def transform_3mf(matrix: Floats) -> str:
    """Return a matrix that multiplies columns as the attribute, whose points are rows."""
    return " ".join(f"{value:g}" for value in matrix[:3].T.ravel())


def stl(triangles: Floats, header: bytes = b"", order: str = "<") -> bytes:
    """Return a binary STL file."""
    body = [struct.pack(f"{order}12fH", 0, 0, 0, *one.ravel(), 0) for one in triangles]
    return header.ljust(80, b" ") + struct.pack(f"{order}I", len(body)) + b"".join(body)


def stl_text(triangles: Floats, name: str = "") -> str:
    """Return one solid of a text STL file."""
    facets = []
    for one in triangles:
        corners = "\n".join(f"    vertex {x!r} {y!r} {z!r}" for x, y, z in one.tolist())
        facets.append(f"facet normal 0 0 1\n  outer loop\n{corners}\n  endloop\nendfacet\n")
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n"


def ply(
    order: str, types: tuple[str, str, str], polygons: Sequence[Sequence[int]], corners: Floats
) -> bytes:
    """Return a PLY file; types of coordinates, counts and indices."""
    codes = {
        "char": "b",
        "uchar": "B",
        "short": "h",
        "ushort": "H",
        "int": "i",
        "uint": "I",
        "float": "f",
    }
    codes |= {
        "double": "d",
        "int8": "b",
        "uint8": "B",
        "int32": "i",
        "float32": "f",
        "float64": "d",
    }
    name = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    number, count, index = types
    header = (
        f"ply\nformat {name} 1.0\ncomment made by hand\nelement vertex {len(corners)}\nproperty uchar flag\n"
        f"property {number} x\nproperty {number} y\nproperty {number} z\nproperty list uchar short links\n"
        f"element edge 1\nproperty int vertex1\nproperty int vertex2\n"
        f"element face {len(polygons)}\nproperty list {count} {index} vertex_indices\nproperty uchar red\n"
        "end_header\n"
    )
    rows: list[list[tuple[str, float]]] = [
        [("B", 7), *((codes[number], value) for value in corner), ("B", 2), ("h", 1), ("h", -2)]
        for corner in corners.tolist()
    ]
    rows.append([("i", 0), ("i", 1)])
    rows += [
        [(codes[count], len(one)), *((codes[index], k) for k in one), ("B", 9)] for one in polygons
    ]
    rows = [[(code, value if code in "fd" else int(value)) for code, value in row] for row in rows]
    if order == "":
        return (
            header + "".join(" ".join(f"{value!r}" for _, value in row) + "\n" for row in rows)
        ).encode()
    return header.encode() + b"".join(
        struct.pack(order + code, value) for row in rows for code, value in row
    )
