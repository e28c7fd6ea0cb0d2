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
    """Read a 3DXML file; InputError where it is damaged, or has geometry that is no tessellation."""
    package = Package(path)
    manifest, _ = package.read("Manifest.xml")
    tree, _ = package.read((manifest.findtext("{*}Root") or "").strip())
    structure = tree.find("{*}ProductStructure")
    if structure is None:
        raise package.error("has no ProductStructure; export the mesh again")
    if any(
        one.get("visible") in ("false", "0") for one in tree.iterfind(".//{*}GeneralAttributes")
    ):
        raise package.error(
            "hides some of its objects, which is not read; export what is to be seen"
        )
    if tree.find(".//{*}DefaultViewProperty/{*}RelativePosition") is not None:
        raise package.error(
            "moves objects in a view (RelativePosition), which is not read; export without"
        )
    nodes: dict[str, Node] = {}
    for one in tree.iterfind(".//{*}Reference3D"):
        nodes[one.get("id", "")] = Node()
    for one in tree.iterfind(".//{*}ReferenceRep"):
        nodes[one.get("id", "")] = Node(parts=_representation(package, one))
    # Instances of geometry first, as trimesh numbers triangles.
    for kind in ("InstanceRep", "Instance3D"):
        for one in tree.iterfind(f".//{{*}}{kind}"):
            parent, child = (
                _node(package, nodes, one, name) for name in ("IsAggregatedBy", "IsInstanceOf")
            )
            matrix = np.eye(4)
            if (text := one.findtext("{*}RelativeMatrix")) is not None:
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
    found = nodes.get(text.rpartition(":")[2])
    if found is None:
        raise package.error(
            f"'{text[:80]}' ({name}) is not in the file; export the mesh with all its parts"
        )
    return found


def _representation(package: Package, reference: Element) -> list[MeshPart]:
    """Return the one part of a tessellated representation, or none where it has no faces."""
    form, name = reference.get("format", ""), reference.get("associatedFile", "").rpartition(":")[2]
    if form != "TESSELLATED":
        raise package.error(
            f"{name} has the format {form}, which is not read; export tessellated geometry"
        )
    vertices, normals, faces, before = [], [], [], 0
    root, _ = package.read(name)
    for one in root.iterfind(".//{*}Rep"):
        if one.find("{*}VertexBuffer/{*}Positions") is None:
            if one.find("{*}Faces") is not None:
                raise package.error(f"{name} has faces without positions; export the mesh again")
            continue
        points = package.numbers(one.findtext("{*}VertexBuffer/{*}Positions"), 3)
        stored = one.findtext("{*}VertexBuffer/{*}Normals")
        found = np.full(points.shape, np.nan) if stored is None else package.numbers(stored, 3)
        normals.append(found if len(found) == len(points) else np.full(points.shape, np.nan))
        vertices.append(points)
        own = _finest(package, one)
        if len(own) and (own.min() < 0 or own.max() >= len(points)):
            raise package.error(
                f"{name}: faces point past the vertices, of which there are {len(points):,}"
            )
        faces.append(before + own)
        before += len(points)
    if not sum(len(one) for one in faces):
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
        own = levels[int(np.argmin(accuracies))].findall("{*}Faces")
    found = [np.zeros((0, 3), np.int64)]
    for face in (face for faces in own for face in faces.iterfind(".//{*}Face")):
        for kind, to_faces in (
            ("strips", triangle_strips_to_faces),
            ("fans", triangle_fans_to_faces),
        ):
            rows = [
                package.numbers(row, 1)[:, 0].astype(np.int64)
                for row in face.get(kind, "").split(",")
            ]
            found += [to_faces([row]) for row in rows if len(row) > 2]
            if kind == "strips":
                found.append(package.numbers(face.get("triangles"), 3).astype(np.int64))
    return np.concatenate(found)
