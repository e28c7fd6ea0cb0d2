"""glTF 2.0: scene, nodes, skins and morph targets at rest, topologies (sections 3.5 and 3.7)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.second_reader.gltf_data import Document, Rows
from tests.second_reader.model import UNIT, Reading, Refused
from tests.second_reader.placement import Placement, composed, identity, stated

#: Extensions that may be required: read here, or without any effect on geometry.
READ = ("KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility")
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
Vertex = tuple[list[float], list[float]]  #: position and the bound on its rounding
Placed = tuple[list[float], list[float], float]  #: position, sizes of its terms, relative error


def read(path: Path, unit: bool = True) -> Reading:
    """Read the triangles of a glTF file; `unit`: divide quaternions by their length."""
    try:
        document = Document(path)
        refuse(document.json)
        return Walk(document, unit).reading
    except (LookupError, TypeError, AttributeError, ValueError, struct.error) as error:
        raise Refused(f"an entry that is missing or of another type: {error}") from error


def refuse(json: dict[str, Any]) -> None:
    """Refuse versions and extensions without a right reading here."""
    if not str(json.get("asset", {}).get("version", "")).startswith("2."):
        raise Refused("not glTF 2")
    if json["asset"].get("minVersion", "2.0") != "2.0":
        raise Refused(f"needs glTF {json['asset']['minVersion']}")
    for name in json.get("extensionsRequired", []):
        if name not in READ and not name.startswith(LOOKS):
            raise Refused(f"required extension {name}")
    if "CESIUM_RTC" in {
        **json.get("extensions", {}),
        **dict.fromkeys(json.get("extensionsUsed", [])),
    }:
        raise Refused("CESIUM_RTC moves the whole scene")


class Walk:
    """Nodes of the scene, in depth, children in their order."""

    def __init__(self, document: Document, unit: bool) -> None:
        self.document, self.unit, self.reading = document, unit, Reading()
        nodes = document.json.get("nodes", [])
        self.parents: dict[int, int] = {}
        for parent, node in enumerate(nodes):
            for child in node.get("children", []):
                document.item("nodes", child)
                if child in self.parents:
                    raise Refused(f"node {child} has two parents")
                self.parents[child] = parent
        for node in range(len(nodes)):
            self.above(node)
        for root in self.roots():
            if root in self.parents:
                raise Refused(f"node {root} of the scene is not a root")
            self.enter(root)

    def roots(self) -> list[int]:
        """Return the roots of the scene; of all nodes where the file has no scene."""
        scenes = self.document.json.get("scenes", [])
        if not scenes:
            return [
                k for k in range(len(self.document.json.get("nodes", []))) if k not in self.parents
            ]
        nodes: list[int] = self.document.item("scenes", self.document.json.get("scene", 0)).get(
            "nodes", []
        )
        return nodes

    def above(self, node: int) -> list[int]:
        """Return a node and its ancestors, the root last."""
        chain = [node]
        while chain[-1] in self.parents:
            chain.append(self.parents[chain[-1]])
            if chain[-1] == node:
                raise Refused(f"node {node} is below itself")
            if len(chain) > len(self.parents) + 1:
                raise Refused("nodes in a circle")
        return chain

    def placement(self, node: int) -> Placement:
        """Return the global transform of a node."""
        placed = stated(identity())
        for one in self.above(node):
            placed = local(self.document.item("nodes", one), self.unit) @ placed
        return placed

    def enter(self, index: int) -> None:
        """Draw a node and those below it; an invisible node hides them (KHR_node_visibility)."""
        node = self.document.item("nodes", index)
        if not node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True):
            return
        if "mesh" in node:
            self.draw(node, self.placement(index))
        for child in node.get("children", []):
            self.enter(child)

    def draw(self, node: dict[str, Any], placed: Placement) -> None:
        """Draw the mesh of a node, once for each instance."""
        mesh = self.document.item("meshes", node["mesh"])
        instancing = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        if instancing and "skin" in node:
            raise Refused("instances of a skinned mesh")
        copies = [stated(identity())]
        if instancing:
            copies = instances(self.document, instancing["attributes"], self.unit)
        weights = node.get("weights", mesh.get("weights", []))
        for copy in copies:
            for primitive in mesh["primitives"]:
                self.primitive(primitive, weights, node.get("skin"), placed @ copy)

    def primitive(
        self,
        primitive: dict[str, Any],
        weights: Sequence[float],
        skin: int | None,
        placed: Placement,
    ) -> None:
        """Add the triangles of one primitive; one without positions is skipped (3.7.2.1)."""
        attributes, mode = primitive.get("attributes", {}), primitive.get("mode", 4)
        if "POSITION" not in attributes or mode in (0, 1, 2, 3):
            return
        points = morphed(self.document, primitive, weights)
        if skin is None:
            vertices = [placed.of(*point) for point in points]
        else:
            vertices = self.skinned(points, attributes, skin)
        indices = list(range(len(points)))
        if "indices" in primitive:
            indices = [int(row[0]) for row in self.document.accessor(primitive["indices"])]
        if any(index >= len(points) for index in indices):
            raise Refused(f"index {max(indices)} of {len(points)} vertices")
        texture = None
        if "TEXCOORD_0" in attributes:
            texture = [(u, 1 - v) for u, v in self.document.accessor(attributes["TEXCOORD_0"])]
        for a, b, c in topology(mode, indices):
            corners = (a, c, b) if placed.mirrors() and skin is None else (a, b, c)
            self.reading.add(
                [vertices[k][0] for k in corners],
                max(bound for k in corners for bound in vertices[k][1]),
                None if texture is None else [texture[k] for k in corners],
            )

    def skinned(self, points: list[Placed], attributes: dict[str, int], index: int) -> list[Vertex]:
        """Apply the joints alone: the transform of the skinned node is ignored (3.7.3.3)."""
        skin = self.document.item("skins", index)
        inverse = [stated(identity())] * len(skin["joints"])
        if "inverseBindMatrices" in skin:
            rows = self.document.accessor(skin["inverseBindMatrices"])
            inverse = [stated([list(row[k::4]) for k in range(4)]) for row in rows]
        joints = [
            self.placement(joint) @ back
            for joint, back in zip(skin["joints"], inverse, strict=False)
        ]
        influences: list[list[tuple[int, float]]] = [[] for _ in points]
        number = 0
        while f"JOINTS_{number}" in attributes:
            names = self.document.accessor(attributes[f"JOINTS_{number}"])
            shares = self.document.accessor(attributes[f"WEIGHTS_{number}"])
            for one, name, share in zip(influences, names, shares, strict=True):
                one += [
                    (int(joint), weight)
                    for joint, weight in zip(name, share, strict=True)
                    if weight
                ]
            number += 1
        if any(blended(joints, influence).mirrors() for influence in influences):
            # The node's transform gives the winding (3.7.4), and is ignored for a skin (3.7.3.3).
            self.reading.oriented = False
        return [weighed(joints, *pair) for pair in zip(influences, points, strict=True)]


def blended(joints: list[Placement], influence: list[tuple[int, float]]) -> Placement:
    """Return the weighted mean of the joints of a vertex."""
    if not all(joint < len(joints) for joint, _ in influence):
        raise Refused(f"joint {max(joint for joint, _ in influence)} of {len(joints)}")
    rows = [[0.0] * 4 for _ in range(4)]
    for joint, weight in influence:
        for i in range(4):
            for j in range(4):
                rows[i][j] += weight * joints[joint].matrix[i][j]
    return stated(rows)


def weighed(joints: list[Placement], influence: list[tuple[int, float]], point: Placed) -> Vertex:
    """Return the weighted mean of a vertex as each joint places it.

    Weights add up to one but for the rounding of their storage; whether that rest is divided out
    is open, so that it is part of the bound.
    """
    total = sum(weight for _, weight in influence)
    if not influence or abs(total - 1) > 0.02:
        raise Refused(f"weights of a vertex add up to {total}")
    position, bounds = [0.0] * 3, [0.0] * 3
    for joint, weight in influence:
        placed, errors = joints[joint].of(*point)
        for k in range(3):
            position[k] += weight * placed[k]
            rest = (abs(total - 1) + (len(influence) + 1) * UNIT * (weight != 1)) * abs(placed[k])
            bounds[k] += weight * (errors[k] + rest)
    return position, bounds


def local(node: dict[str, Any], unit: bool) -> Placement:
    """Return the transform of a node: its matrix, stored by columns, or T R S (3.5.3)."""
    if "matrix" in node:
        values = [float(value) for value in node["matrix"]]
        return stated([values[k::4] for k in range(4)])
    return composed(
        node.get("translation", (0.0, 0.0, 0.0)),
        node.get("rotation", (0.0, 0.0, 0.0, 1.0)),
        node.get("scale", (1.0, 1.0, 1.0)),
        unit,
    )


def instances(document: Document, attributes: dict[str, int], unit: bool) -> list[Placement]:
    """Return the transform of each instance within its node."""
    rows = {name: document.accessor(index) for name, index in attributes.items()}
    counts = {len(values) for values in rows.values()}
    if len(counts) != 1:
        raise Refused(f"attributes of instances of counts {sorted(counts)}")
    count = counts.pop()
    moved = rows.get("TRANSLATION", [(0.0, 0.0, 0.0)] * count)
    turned = rows.get("ROTATION", [(0.0, 0.0, 0.0, 1.0)] * count)
    scaled = rows.get("SCALE", [(1.0, 1.0, 1.0)] * count)
    return [composed(*three, unit) for three in zip(moved, turned, scaled, strict=True)]


def morphed(
    document: Document, primitive: dict[str, Any], weights: Sequence[float]
) -> list[Placed]:
    """Return positions, targets added by their weights (3.7.2.2), with sizes and relative error."""

    def values(index: int) -> tuple[Rows, float]:
        normalized = document.item("accessors", index).get("normalized")
        return document.accessor(index), 2 * UNIT if normalized else 0.0

    base, relative = values(primitive["attributes"]["POSITION"])
    points = [list(map(float, row)) for row in base]
    sizes = [[abs(value) for value in row] for row in points]
    targets = primitive.get("targets", [])
    if len(weights) > len(targets):
        raise Refused(f"{len(weights)} weights of {len(targets)} morph targets")
    for target, weight in zip(targets, weights, strict=False):
        if not weight or "POSITION" not in target:
            continue
        rows, own = values(target["POSITION"])
        if len(rows) != len(points):
            raise Refused(f"a morph target of {len(rows)} positions for {len(points)}")
        relative = max(relative, own) + 2 * UNIT
        for point, size, row in zip(points, sizes, rows, strict=True):
            for k in range(3):
                point[k] += weight * row[k]
                size[k] += abs(weight * row[k])
    return [(point, size, relative) for point, size in zip(points, sizes, strict=True)]


def topology(mode: int, indices: list[int]) -> list[tuple[int, int, int]]:
    """Return triangles by the formulas of section 3.7.2.1."""
    p = indices
    if mode == 4:
        if len(p) % 3:
            raise Refused(f"{len(p)} indices of triangles")
        return [(p[i], p[i + 1], p[i + 2]) for i in range(0, len(p), 3)]
    if mode == 5:
        return [(p[i], p[i + 1 + i % 2], p[i + 2 - i % 2]) for i in range(len(p) - 2)]
    if mode == 6:
        return [(p[i + 1], p[i + 2], p[0]) for i in range(len(p) - 2)]
    raise Refused(f"primitive mode {mode}")
