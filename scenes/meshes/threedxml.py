"""3DXML of Dassault Systèmes: tessellated representations, placed by the product structure.

The finest tessellation of each representation is read; its coarser levels of detail are left out.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from trimesh.util import triangle_fans_to_faces, triangle_strips_to_faces

from xfrustum.scenes.arrays import Indices
from xfrustum.scenes.meshes.content import MeshContent, MeshPart, unit_normals
from xfrustum.scenes.meshes.package import Node, Package
from xfrustum.scenes.model.scene import UnreadFeature

_LOOKS = b"SurfaceAttributes"  # element of colors and materials


def read_3dxml(path: Path) -> MeshContent:
    """Read a 3DXML file; InputError at damage and at other geometry than tessellations."""
    package = Package(path)
    manifest, _ = package.read("Manifest.xml")
    tree, _ = package.read((manifest.findtext("{*}Root") or "").strip())
    structure = tree.find("{*}ProductStructure")
    if structure is None:
        raise package.error("has no ProductStructure; export the mesh again")
    if any(
        element.get("visible") in ("false", "0")
        for element in tree.iterfind(".//{*}GeneralAttributes")
    ):
        raise package.error(
            "hides some of its objects, which is not read; export what is to be seen"
        )
    if tree.find(".//{*}DefaultViewProperty/{*}RelativePosition") is not None:
        raise package.error(
            "moves objects in a view (RelativePosition), which is not read; export without"
        )
    # References and representations share one space of numbers.
    nodes: dict[str, Node] = {}
    for element in tree.iterfind(".//{*}Reference3D"):
        nodes[element.get("id", "")] = Node()
    for element in tree.iterfind(".//{*}ReferenceRep"):
        nodes[element.get("id", "")] = Node(parts=_representation(package, element))
    # Instances of geometry first, as trimesh numbers triangles.
    for kind in ("InstanceRep", "Instance3D"):
        for element in tree.iterfind(f".//{{*}}{kind}"):
            parent, child = (
                _node(package, nodes, element, name) for name in ("IsAggregatedBy", "IsInstanceOf")
            )
            matrix = np.eye(4)
            if (text := element.findtext("{*}RelativeMatrix")) is not None:
                numbers = package.numbers(text, 3)
                if len(numbers) != 4:
                    raise package.error("a RelativeMatrix needs 12 numbers; export the mesh again")
                matrix[:3] = numbers.T
            parent.children.append((child, matrix))
    root = nodes.get(structure.get("root", ""))
    if root is None:
        raise package.error("has no root of its ProductStructure; export the mesh again")
    # Triangles are numbered representation by representation, each with all its places.
    names = [part.name for node in nodes.values() for part in node.parts]
    placed = sorted(package.placed(root), key=lambda part: names.index(part.name))
    looks = UnreadFeature(feature="colors, materials and textures", consequence="are not shown")
    return MeshContent(parts=tuple(placed), unread=(looks,) if package.mentions(_LOOKS) else ())


def _node(package: Package, nodes: dict[str, Node], instance: Element, name: str) -> Node:
    """Return the node that an instance names: a number, or a name that ends with it."""
    text = (instance.findtext(f"{{*}}{name}") or "").strip()
    node = nodes.get(text.rpartition(":")[2])
    if node is None:
        raise package.error(
            f"'{text[:80]}' ({name}) is not in the file; export the mesh with all its parts"
        )
    return node


def _representation(package: Package, reference: Element) -> list[MeshPart]:
    """Return the single part of a tessellated representation; none without faces."""
    form, name = reference.get("format", ""), reference.get("associatedFile", "").rpartition(":")[2]
    if form != "TESSELLATED":
        raise package.error(
            f"{name} has the format {form}, which is not read; export tessellated geometry"
        )
    vertices, normals, faces, before = [], [], [], 0
    root, _ = package.read(name)
    for rep in root.iterfind(".//{*}Rep"):
        if rep.find("{*}VertexBuffer/{*}Positions") is None:
            if rep.find("{*}Faces") is not None:
                raise package.error(f"{name} has faces without positions; export the mesh again")
            continue
        points = package.numbers(rep.findtext("{*}VertexBuffer/{*}Positions"), 3)
        stored = rep.findtext("{*}VertexBuffer/{*}Normals")
        own_normals = (
            np.full(points.shape, np.nan) if stored is None else package.numbers(stored, 3)
        )
        normals.append(
            own_normals if len(own_normals) == len(points) else np.full(points.shape, np.nan)
        )
        vertices.append(points)
        own = _finest(package, rep)
        if len(own) and (own.min() < 0 or own.max() >= len(points)):
            raise package.error(
                f"{name}: faces point past the vertices, of which there are {len(points):,}"
            )
        faces.append(before + own)
        before += len(points)
    if not sum(len(own_faces) for own_faces in faces):
        return []
    return [
        MeshPart(
            name=reference.get("id", ""),
            vertices=np.concatenate(vertices),
            faces=np.concatenate(faces),
            normals=unit_normals(np.concatenate(normals)),
        )
    ]


def _finest(package: Package, rep: Element) -> Indices:
    """Return the faces of a representation itself; else of its level with the least deviation."""
    own = rep.findall("{*}Faces")
    levels = rep.findall("{*}PolygonalLOD")
    if not own and levels:
        accuracies = package.numbers(" ".join(level.get("accuracy", "inf") for level in levels), 1)
        if len(accuracies) != len(levels):
            raise package.error(
                "has a PolygonalLOD whose accuracy is no number; export the mesh again"
            )
        # The accuracy is the largest deviation, so that the least one is the finest level.
        own = levels[int(np.argmin(accuracies))].findall("{*}Faces")
    corners = [np.zeros((0, 3), np.int64)]
    for face in (face for faces in own for face in faces.iterfind(".//{*}Face")):
        for kind, to_faces in (
            ("strips", triangle_strips_to_faces),
            ("fans", triangle_fans_to_faces),
        ):
            rows = [
                package.numbers(row, 1)[:, 0].astype(np.int64)
                for row in face.get(kind, "").split(",")
            ]
            corners += [to_faces([row]) for row in rows if len(row) > 2]
            if kind == "strips":
                corners.append(package.numbers(face.get("triangles"), 3).astype(np.int64))
    return np.concatenate(corners)
