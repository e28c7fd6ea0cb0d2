"""3MF: objects, components and build items (core specification 1.3, and production extension 1.1).

Triangles are numbered as by trimesh: the first component of an object, then the others from the
last one on; components that place the same object come together.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.meshes.content import MeshContent, MeshPart
from xfrustum.scenes.meshes.package import Node, Package
from xfrustum.scenes.model.scene import UnreadFeature

_CORE: Final = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_3D: Final = "http://schemas.microsoft.com/3dmanufacturing/"
#: Extensions that are honoured, or that change looks alone.
_KNOWN: Final = {
    _CORE,
    f"{_3D}production/2015/06",
    f"{_3D}material/2015/02",
    f"{_3D}trianglesets/2021/07",
}
_ROOT_TYPE: Final = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_HARMLESS: Final = ("vertices", "triangles", "trianglesets", "metadatagroup", "mesh", "components")


def read_3mf(path: Path) -> MeshContent:
    """Read a 3MF file; InputError where it is damaged or requires an extension that is not read."""
    package = Package(path)
    relations, _ = package.read("_rels/.rels")
    targets = [
        relation.get("Target", "")
        for relation in relations.iter()
        if relation.get("Type") == _ROOT_TYPE
    ]
    if not targets:
        raise package.error("names no 3D model in _rels/.rels; export the mesh again")
    model = _Model(package)
    root_part = targets[0].lstrip("/")
    root = model.part(root_part)
    items = [
        item
        for build in root.findall(f"{{{_CORE}}}build")
        for item in build.findall(f"{{{_CORE}}}item")
    ]
    try:
        placed = package.placed(model.group(root_part, items))
    except RecursionError as error:
        raise package.error(
            "objects lie within each other too deeply; export the mesh again"
        ) from error
    unread = []
    unit = root.get("unit", "millimeter")
    if unit != "millimeter":
        reason = (
            "is not applied: coordinates are taken in the units of the scene; give the "
            "object a scale"
        )
        unread.append(UnreadFeature(feature=f"unit {unit}", consequence=reason))
    if model.colored:
        unread.append(UnreadFeature(feature="materials and colors", consequence="are not shown"))
    return MeshContent(parts=placed, unread=tuple(unread))


class _Model:
    """Objects of all parts of a package, each read once; their numbers belong to their part."""

    def __init__(self, package: Package) -> None:
        self.package = package
        self.colored = False  #: whether any object has colors or textures
        self._parts: dict[str, Element] = {}
        self._elements: dict[tuple[str, str], Element] = {}
        self._nodes: dict[tuple[str, str], Node] = {}

    def part(self, name: str) -> Element:
        """Return the root element of a part, its extensions checked."""
        if name not in self._parts:
            root, namespaces = self.package.read(name)
            for prefix in root.get("requiredextensions", "").split():
                uri = namespaces.get(prefix, prefix)
                if uri not in _KNOWN:
                    reason = f"requires the extension {uri}, which is not read"
                    raise self.package.error(f"{reason}; export the mesh without it")
            self._parts[name] = root
            for item in root.iterfind(f"{{{_CORE}}}resources/{{{_CORE}}}object"):
                self._elements.setdefault((name, item.get("id", "")), item)
        return self._parts[name]

    def group(self, part: str, references: list[Element]) -> Node:
        """Return the node of build items or components, in the order of trimesh's numbers."""
        children: dict[tuple[str, str], list[tuple[Node, Floats]]] = {}
        for reference in references:
            path = next(
                (
                    value
                    for name, value in reference.attrib.items()
                    if name.rpartition("}")[2] == "path"
                ),
                part,
            )
            key = path.lstrip("/"), reference.get("objectid", "")
            children.setdefault(key, []).append(
                (self._object(*key), self._transform(reference.attrib))
            )
        # trimesh walks the scene graph depth first and puts children on a stack.
        first, *others = [child for group in children.values() for child in group] or [
            (Node(), np.eye(4))
        ]
        return Node(children=[first, *reversed(others)])

    def _object(self, part: str, number: str) -> Node:
        self.part(part)
        key = part, number
        if key not in self._nodes:
            element = self._elements.get(key)
            if element is None:
                raise self.package.error(
                    f"object {number} of {part} is not there; export the mesh again"
                )
            self._nodes[key] = node = (
                Node()
            )  # first, so that a circle ends here; placing refuses it
            self._read(part, element, node)
        return self._nodes[key]

    def _read(self, part: str, element: Element, node: Node) -> None:
        for child in (
            *element,
            *(two for mesh in element.findall(f"{{{_CORE}}}mesh") for two in mesh),
        ):
            name = child.tag.rpartition("}")[2]
            if name not in _HARMLESS:
                reason = (
                    f"object {element.get('id')} of {part} is made of '{name}', which is not read"
                )
                raise self.package.error(f"{reason}; export triangles alone")
        self.colored |= element.get("pid") is not None
        for mesh in element.findall(f"{{{_CORE}}}mesh"):
            vertices = mesh.findall(f"{{{_CORE}}}vertices/{{{_CORE}}}vertex")
            triangles = mesh.findall(f"{{{_CORE}}}triangles/{{{_CORE}}}triangle")
            self.colored |= any("pid" in child.attrib for child in triangles)
            corners = self._table(triangles, ("v1", "v2", "v3"))
            if (corners != np.floor(corners)).any():
                reason = (
                    f"object {element.get('id')} of {part} has corners of triangles that are "
                    "no whole numbers"
                )
                raise self.package.error(f"{reason}; export the mesh again")
            if len(corners):
                points = self._table(vertices, ("x", "y", "z"))
                node.parts.append(
                    MeshPart(
                        name=f"{part} {element.get('id')}",
                        vertices=points,
                        faces=corners.astype(np.int64),
                    )
                )
        components = element.findall(f"{{{_CORE}}}components/{{{_CORE}}}component")
        if components:
            node.children += self.group(part, components).children

    def _table(self, elements: list[Element], names: tuple[str, str, str]) -> Floats:
        # A missing attribute becomes a word that is no number, and is refused.
        text = " ".join(row.get(name, "?") for row in elements for name in names)
        return self.package.numbers(text, len(names))

    def _transform(self, attributes: Mapping[str, str]) -> Floats:
        matrix = np.eye(4)
        if "transform" in attributes:
            rows = self.package.numbers(attributes["transform"], 3)
            if len(rows) != 4:
                raise self.package.error("a transform needs 12 numbers; export the mesh again")
            matrix[:3] = rows.T
        return matrix
