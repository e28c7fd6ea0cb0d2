"""Packages of XML parts in zip archives: 3MF and 3DXML.

3MF is read by its core specification 1.3 and its production extension 1.1: objects, components and
build items. In 3DXML (Dassault Systèmes) the finest level of detail of each tessellated
representation is read and placed by the product structure. Triangles are numbered as by trimesh.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, iterparse

import numpy as np
from trimesh.util import triangle_fans_to_faces, triangle_strips_to_faces

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.disk import check_declared, damage_refused, read_input, read_member
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, carried, unit_normals
from xfrustum.scenes.model.scene import UnreadFeature

#: Bytes of memory for each byte of an unpacked part: elements with attributes, arrays, copies.
_MEMORY_PER_UNPACKED_BYTE = 16
#: Bytes of memory that one placed triangle takes: corners and indices in double precision, and
#: copies.
_MEMORY_PER_TRIANGLE = 512
_DEEPEST = 100  # largest number of levels of instances within instances

_3D: Final = "http://schemas.microsoft.com/3dmanufacturing/"
_CORE: Final = f"{{{_3D}core/2015/02}}"
#: Extensions of 3MF that are read, or that change only the appearance.
_KNOWN: Final = [
    f"{_3D}{name}"
    for name in ("core/2015/02", "production/2015/06", "material/2015/02", "trianglesets/2021/07")
]
#: Elements of an object of 3MF that are read, or that have no effect on geometry.
_READ: Final = ("vertices", "triangles", "trianglesets", "metadatagroup", "mesh", "components")
_AGAIN: Final = "export the mesh again"


@dataclass(kw_only=True)
class _Node:
    """Object of a package; it may be placed many times."""

    parts: list[MeshPart] = field(default_factory=list)
    #: child nodes, with (4, 4) transforms to this node
    children: list[tuple[_Node, Floats]] = field(default_factory=list)

    def placed(self, matrix: Floats) -> Iterator[MeshPart]:
        """Yield the parts of this node and of its descendants, placed by a (4, 4) matrix."""
        linear = matrix[:3, :3]
        for part in self.parts:
            vertices = part.vertices
            with np.errstate(over="ignore", invalid="ignore"):
                if not np.array_equal(matrix, np.eye(4)):
                    vertices = vertices @ linear.T + matrix[:3, 3]
                (faces,), normals = carried(linear[None], part.faces, part.normals)
            unit = None if normals is None else unit_normals(normals[0])
            yield MeshPart(name=part.name, vertices=vertices, faces=faces, normals=unit)
        for child, local in self.children:
            yield from child.placed(matrix @ local)


class _Package:
    """Parts of a zip archive by name, ignoring case and a leading slash."""

    def __init__(self, path: Path) -> None:
        self.path = path
        #: root elements of parts that were read, and namespaces by their prefixes
        self.parts: dict[str, tuple[Element, dict[str, str]]] = {}
        with damage_refused(path, "package", "pack it again"):
            self._archive = zipfile.ZipFile(io.BytesIO(read_input(path, "mesh file")))
            total = sum(info.file_size for info in self._archive.infolist())
        check_declared(path, total * _MEMORY_PER_UNPACKED_BYTE, "unpacking")
        # Part names are case-insensitive (OPC 6.2.2.3), and relationships write them with a leading
        # slash.
        self._names = {name.lower().lstrip("/"): name for name in self._archive.namelist()}

    def error(self, reason: str, advice: str = _AGAIN) -> InputError:
        """Return the error of the package, to be raised."""
        return InputError(f"{self.path}: {reason}; {advice}")

    def read(self, name: str) -> tuple[Element, dict[str, str]]:
        """Return the root element of an XML part, and its namespaces by their prefixes."""
        stored = self._names.get(name.lower().lstrip("/"))
        if stored is None:
            raise self.error(f"has no part {name}")
        if stored not in self.parts:
            namespaces, root = dict[str, str](), None
            with damage_refused(self.path, f"package with a part {name}", _AGAIN):
                data = io.BytesIO(read_member(self._archive, stored, self.path))
                # ElementTree drops prefixes, but required extensions of 3MF are listed by prefix.
                for event, value in iterparse(data, ("start-ns", "start")):
                    if event == "start-ns" and root is None:
                        namespaces[value[0]] = value[1]
                    elif root is None:
                        root = value
            assert root is not None
            self.parts[stored] = root, namespaces
        return self.parts[stored]

    def numbers(self, text: str | None, columns: int) -> Floats:
        """Return (N, columns) numbers separated by spaces and commas."""
        text = (text or "").replace(",", " ")
        try:
            values = np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
            return values.reshape(-1, columns)
        except ValueError as error:
            raise self.error("has numbers that are damaged") from error

    def matrix(self, text: str | None, name: str) -> Floats:
        """Return the (4, 4) matrix of three axes and an origin (12 numbers); identity for None."""
        matrix = np.eye(4)
        if text is not None:
            rows = self.numbers(text, 3)
            if len(rows) != 4:
                raise self.error(f"a {name} needs 12 numbers")
            matrix[:3] = rows.T
        return matrix

    def placed(self, root: _Node) -> tuple[MeshPart, ...]:
        """Return the placed parts of a root and its descendants; refuse too many triangles."""
        size = self._size(root, {}, 0)
        check_declared(self.path, size * _MEMORY_PER_TRIANGLE, "placing its objects")
        return tuple(root.placed(np.eye(4)))

    def _size(self, node: _Node, sizes: dict[int, int], depth: int) -> int:
        """Return the number of triangles and nodes placed by a node and its descendants."""
        if depth > _DEEPEST:
            reason = f"objects lie within each other more than {_DEEPEST} levels deep"
            raise self.error(f"{reason}, or in a circle")
        # The size of each node is computed once: ten levels of ten instances are 10^10 triangles.
        if id(node) not in sizes:
            below = [self._size(child, sizes, depth + 1) for child, _ in node.children]
            sizes[id(node)] = 1 + sum(len(part.faces) for part in node.parts) + sum(below)
        return sizes[id(node)]


def read_3mf(path: Path) -> MeshContent:
    """Read a 3MF file; InputError if it is damaged or requires an extension that is not read."""
    package = _Package(path)
    relations, _ = package.read("_rels/.rels")
    kind = f"{_3D}2013/01/3dmodel"
    targets = [link.get("Target", "") for link in relations.iter() if link.get("Type") == kind]
    if not targets:
        raise package.error("names no 3D model in _rels/.rels")
    model, part = _Model(package), targets[0].lstrip("/")
    model.objects(part)
    root, _ = package.read(part)
    try:
        children = model.children(part, root.findall(f"{_CORE}build/{_CORE}item"))
        placed = package.placed(_Node(children=children))
    except RecursionError as error:
        raise package.error("objects lie within each other too deeply") from error
    unread = []
    unit = root.get("unit", "millimeter")
    if unit != "millimeter":
        reason = "is not applied: coordinates are taken in the units of the scene; give the object "
        unread.append(UnreadFeature(f"unit {unit}", f"{reason}a scale"))
    if model.colored:
        unread.append(UnreadFeature("materials and colors", "are not shown"))
    return MeshContent(parts=placed, unread=tuple(unread))


class _Model:
    """Objects of all parts of a 3MF package, each read once; numbers are unique within a part."""

    def __init__(self, package: _Package) -> None:
        self.package = package
        self.colored = False  #: whether any object has colors or textures
        self._objects: dict[str, dict[str, Element]] = {}
        self._nodes: dict[tuple[str, str], _Node] = {}

    def objects(self, part: str) -> dict[str, Element]:
        """Return the objects of a part by their numbers; refuse unknown required extensions."""
        if part not in self._objects:
            root, namespaces = self.package.read(part)
            for prefix in root.get("requiredextensions", "").split():
                uri = namespaces.get(prefix, prefix)
                if uri not in _KNOWN:
                    reason = f"requires the extension {uri}, which is not read"
                    raise self.package.error(reason, "export the mesh without it")
            # If objects have the same number, the first is used.
            listed = reversed(root.findall(f"{_CORE}resources/{_CORE}object"))
            self._objects[part] = {item.get("id", ""): item for item in listed}
        return self._objects[part]

    def children(self, part: str, references: list[Element]) -> list[tuple[_Node, Floats]]:
        """Return build items or components of a part as nodes, in the order of their triangles."""
        groups: dict[tuple[str, str], list[tuple[_Node, Floats]]] = {}
        for reference in references:
            # Some exporters leave out the namespace of the attribute.
            named = {name.rpartition("}")[2]: path for name, path in reference.attrib.items()}
            key = named.get("path", part).lstrip("/"), named.get("objectid", "")
            child = self._node(*key), self.package.matrix(named.get("transform"), "transform")
            groups.setdefault(key, []).append(child)
        # trimesh traverses the scene graph depth first with a stack of children: the first child,
        # then the other children from the last. Instances of one object are consecutive.
        placed = list(chain.from_iterable(groups.values()))
        return [*placed[:1], *placed[:0:-1]]

    def _node(self, part: str, number: str) -> _Node:
        key, element = (part, number), self.objects(part).get(number)
        if element is None:
            raise self.package.error(f"object {number} of {part} is not there")
        if key not in self._nodes:
            # Store the node first, so that a cycle ends here; `placed` refuses cycles.
            self._nodes[key] = node = _Node()
            self._read(part, element, node)
        return self._nodes[key]

    def _read(self, part: str, element: Element, node: _Node) -> None:
        meshes, what = element.findall(f"{_CORE}mesh"), f"object {element.get('id')} of {part}"
        for child in (*element, *(child for mesh in meshes for child in mesh)):
            name = child.tag.rpartition("}")[2]
            if name not in _READ:
                reason = f"{what} is made of '{name}', which is not read"
                raise self.package.error(reason, "export triangles alone")
        self.colored |= element.get("pid") is not None
        for mesh in meshes:
            triangles = mesh.findall(f"{_CORE}triangles/{_CORE}triangle")
            self.colored |= any("pid" in child.attrib for child in triangles)
            corners = self._table(triangles, ("v1", "v2", "v3"))
            if (corners != np.floor(corners)).any():
                raise self.package.error(
                    f"{what} has corners of triangles that are no whole numbers"
                )
            if len(corners):
                points = mesh.findall(f"{_CORE}vertices/{_CORE}vertex")
                vertices, faces = self._table(points, ("x", "y", "z")), corners.astype(np.int64)
                node.parts.append(MeshPart(name=what, vertices=vertices, faces=faces))
        components = element.findall(f"{_CORE}components/{_CORE}component")
        node.children += self.children(part, components)

    def _table(self, elements: list[Element], names: tuple[str, str, str]) -> Floats:
        # Replace a missing attribute by a word that is not a number, so that it is refused.
        text = " ".join(row.get(name, "?") for row in elements for name in names)
        return self.package.numbers(text, len(names))


def read_3dxml(path: Path) -> MeshContent:
    """Read a 3DXML file; InputError for damage and for geometry other than tessellations."""
    package = _Package(path)
    manifest, _ = package.read("Manifest.xml")
    tree, _ = package.read((manifest.findtext("{*}Root") or "").strip())
    structure = tree.find("{*}ProductStructure")
    if structure is None:
        raise package.error("has no ProductStructure")
    shown = [element.get("visible") for element in tree.iterfind(".//{*}GeneralAttributes")]
    if not {"false", "0"}.isdisjoint(shown):
        reason = "hides some of its objects, which is not read"
        raise package.error(reason, "export only visible objects")
    if tree.find(".//{*}DefaultViewProperty/{*}RelativePosition") is not None:
        reason = "moves objects in a view (RelativePosition), which is not read"
        raise package.error(reason, "export without it")
    # References and representations share one number space.
    nodes = {element.get("id", ""): _Node() for element in tree.iterfind(".//{*}Reference3D")}
    for element in tree.iterfind(".//{*}ReferenceRep"):
        nodes[element.get("id", "")] = _Node(parts=_representation(package, element))

    def named(instance: Element, kind: str) -> _Node:
        """Return the node of an instance, by number or by a name that ends with the number."""
        text = (instance.findtext(f"{{*}}{kind}") or "").strip()
        node = nodes.get(text.rpartition(":")[2])
        if node is None:
            reason = f"'{text[:80]}' ({kind}) is not in the file"
            raise package.error(reason, "export the mesh with all its parts")
        return node

    # Read instances of geometry first, for trimesh's numbering of triangles.
    for kind in ("InstanceRep", "Instance3D"):
        for element in tree.iterfind(f".//{{*}}{kind}"):
            matrix = package.matrix(element.findtext("{*}RelativeMatrix"), "RelativeMatrix")
            child = named(element, "IsInstanceOf")
            named(element, "IsAggregatedBy").children.append((child, matrix))
    root = nodes.get(structure.get("root", ""))
    if root is None:
        raise package.error("has no root of its ProductStructure")
    # Triangles are numbered by representation, each with all its instances.
    names = [part.name for node in nodes.values() for part in node.parts]
    placed = sorted(package.placed(root), key=lambda part: names.index(part.name))
    looks = UnreadFeature("colors, materials and textures", "are not shown")
    colored = any(
        part.find(".//{*}SurfaceAttributes") is not None for part, _ in package.parts.values()
    )
    return MeshContent(parts=tuple(placed), unread=(looks,) if colored else ())


def _representation(package: _Package, reference: Element) -> list[MeshPart]:
    """Return the single part of a tessellated representation; empty if it has no faces."""
    form, name = reference.get("format", ""), reference.get("associatedFile", "").rpartition(":")[2]
    if form != "TESSELLATED":
        reason = f"{name} has the format {form}, which is not read"
        raise package.error(reason, "export tessellated geometry")
    vertices, normals, faces, before = list[Floats](), list[Floats](), list[Indices](), 0
    root, _ = package.read(name)
    for rep in root.iterfind(".//{*}Rep"):
        stored = rep.findtext("{*}VertexBuffer/{*}Positions")
        if stored is None:
            if rep.find("{*}Faces") is not None:
                raise package.error(f"{name} has faces without positions")
            continue
        points = package.numbers(stored, 3)
        own = package.numbers(rep.findtext("{*}VertexBuffer/{*}Normals"), 3)
        normals.append(own if len(own) == len(points) else np.full(points.shape, np.nan))
        vertices.append(points)
        corners = _finest(package, rep)
        if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
            past = f"faces point past the vertices, of which there are {len(points):,}"
            raise package.error(f"{name}: {past}")
        faces.append(before + corners)
        before += len(points)
    if not any(map(len, faces)):
        return []
    part = MeshPart(
        name=reference.get("id", ""),
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        normals=unit_normals(np.concatenate(normals)),
    )
    return [part]


def _finest(package: _Package, rep: Element) -> Indices:
    """Return the faces of a representation, or of its level with the smallest deviation."""
    own, levels = rep.findall("{*}Faces"), rep.findall("{*}PolygonalLOD")
    if not own and levels:
        accuracies = package.numbers(" ".join(level.get("accuracy", "inf") for level in levels), 1)
        if len(accuracies) != len(levels):
            raise package.error("has a PolygonalLOD whose accuracy is no number")
        # The accuracy is the largest deviation of a level, so that the finest level has the
        # smallest accuracy.
        own = levels[int(np.argmin(accuracies))].findall("{*}Faces")

    def rows(text: str) -> Iterator[Sequence[Indices]]:
        for row in text.split(","):
            if len(numbers := package.numbers(row, 1)) > 2:
                yield [numbers[:, 0].astype(np.int64)]

    corners = [np.zeros((0, 3), np.int64)]
    for face in (face for faces in own for face in faces.iterfind(".//{*}Face")):
        corners += map(triangle_strips_to_faces, rows(face.get("strips", "")))
        corners.append(package.numbers(face.get("triangles"), 3).astype(np.int64))
        corners += map(triangle_fans_to_faces, rows(face.get("fans", "")))
    return np.concatenate(corners)
