"""Packages of XML parts (3MF, 3DXML): zip archives of bounded size, and placed meshes."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk import input_files
from xfrustum.scenes.disk.archives import read_member
from xfrustum.scenes.disk.input_files import damage_refused, read_input
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.meshes.content import MeshPart, carried, unit_normals

#: Bytes of memory that a byte of an unpacked part takes: elements with their attributes, arrays,
#: copies.
_MEMORY_PER_UNPACKED_BYTE = 16
#: Bytes of memory that one placed triangle takes: corners and indices in double precision, and
#: copies.
_MEMORY_PER_TRIANGLE = 512
_DEEPEST = 100  # levels of instances within instances


@dataclass(kw_only=True)
class Node:
    """Object of a package, which may be placed many times."""

    parts: list[MeshPart] = field(default_factory=list)
    children: list[tuple[Node, Floats]] = field(
        default_factory=list
    )  #: with (4, 4) transforms to this node


class Package:
    """Parts of a zip archive by their names, in any case and with or without a slash first."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with damage_refused(path, "package", "pack it again"):
            self._archive = zipfile.ZipFile(io.BytesIO(read_input(path, "mesh file")))
            total = sum(info.file_size for info in self._archive.infolist())
        input_files.check_declared(path, total * _MEMORY_PER_UNPACKED_BYTE, "unpacking")
        self._read: list[bytes] = []
        # Names of parts ignore case (OPC 6.2.2.3), and relationships write them from the root.
        self._names = {name.lower().lstrip("/"): name for name in self._archive.namelist()}

    def error(self, reason: str) -> InputError:
        """Return the error of the package, to be raised."""
        return InputError(f"{self.path}: {reason}")

    def read(self, name: str) -> tuple[ElementTree.Element, dict[str, str]]:
        """Return the root element of an XML part, and its namespaces by their prefixes."""
        stored = self._names.get(name.lower().lstrip("/"))
        if stored is None:
            raise self.error(f"has no part {name}; export the mesh again")
        namespaces: dict[str, str] = {}
        root = None
        with damage_refused(self.path, f"package with a part {name}", "export the mesh again"):
            data = read_member(self._archive, stored, self.path)
            self._read.append(data)
            # ElementTree drops prefixes, which name the required extensions of 3MF.
            for event, value in ElementTree.iterparse(io.BytesIO(data), ("start-ns", "start")):
                if event == "start-ns" and root is None:
                    namespaces[value[0]] = value[1]
                elif root is None:
                    root = value
        assert root is not None
        return root, namespaces

    def mentions(self, word: bytes) -> bool:
        """Return whether any part that was read holds a word."""
        return any(word in data for data in self._read)

    def numbers(self, text: str | None, columns: int) -> Floats:
        """Return (N, columns) numbers between spaces and commas."""
        text = (text or "").replace(",", " ")
        try:
            values = np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
            return values.reshape(-1, columns)
        except ValueError as error:
            raise self.error("has numbers that are damaged; export the mesh again") from error

    def placed(self, root: Node) -> tuple[MeshPart, ...]:
        """Return the parts of all nodes from a root on, placed; refuse too many."""
        sizes: dict[int, int] = {}
        self._count(root, sizes, 0)
        input_files.check_declared(
            self.path, sizes[id(root)] * _MEMORY_PER_TRIANGLE, "placing its objects"
        )
        return tuple(_placed(root, np.eye(4)))

    def _count(self, node: Node, sizes: dict[int, int], depth: int) -> int:
        """Return how many triangles and nodes are placed from a node on."""
        if depth > _DEEPEST:
            raise self.error(
                f"objects lie within each other more than {_DEEPEST} levels deep, or in a circle"
            )
        # Each node is counted once: ten levels of ten instances are ten thousand million triangles.
        if id(node) not in sizes:
            own = 1 + sum(len(part.faces) for part in node.parts)
            sizes[id(node)] = own + sum(
                self._count(child, sizes, depth + 1) for child, _ in node.children
            )
        return sizes[id(node)]


def _placed(node: Node, matrix: Floats) -> Iterator[MeshPart]:
    for part in node.parts:
        yield place_part(part, matrix)
    for child, local in node.children:
        yield from _placed(child, matrix @ local)


def place_part(part: MeshPart, matrix: Floats) -> MeshPart:
    """Return a part placed by a (4, 4) matrix."""
    linear, vertices = matrix[:3, :3], part.vertices
    with np.errstate(over="ignore", invalid="ignore"):
        if not np.array_equal(matrix, np.eye(4)):
            vertices = vertices @ linear.T + matrix[:3, 3]
        faces, normals = carried(linear[None], part.faces, part.normals)
    unit = None if normals is None else unit_normals(normals[0])
    return MeshPart(name=part.name, vertices=vertices, faces=faces[0], normals=unit)
