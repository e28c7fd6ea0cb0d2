"""glTF 2.0 without animation: container, accessors, nodes, skins, morph targets and topologies.

Comments name sections of the specification.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from scipy.spatial.transform import Rotation

from tests.second_reader.model import ROUNDING, Floats, Placement, Reading, Refused

#: Extensions that may be required: supported, or without effect on geometry
READ = ("KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility")
LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
COMPONENTS = {5120: "b", 5121: "B", 5122: "h", 5123: "H", 5125: "I", 5126: "f"}
LARGEST = {5120: 127, 5121: 255, 5122: 32767, 5123: 65535}  #: of normalized integers, section 3.11
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read_gltf(path: Path) -> Reading:
    """Read the triangles of a glTF file."""
    try:
        return _Walk(path).reading
    except (LookupError, TypeError, AttributeError, ValueError, struct.error, OSError) as error:
        raise Refused(f"an entry that is missing or of another type: {error}") from error


class _Document:
    """JSON of a file and the bytes of its buffers."""

    def __init__(self, path: Path) -> None:
        self.folder, text, self.binary = path.parent, path.read_bytes(), b""
        if text[:4] == b"glTF":  # binary container, section 4.4
            version, length = struct.unpack_from("<II", text, 4)
            if version != 2 or length > len(text):
                raise Refused(f"GLB version {version} of {length} bytes")
            chunks, place = [], 12
            while place + 8 <= length:
                size, kind = struct.unpack_from("<I4s", text, place)
                if place + 8 + size > length:
                    raise Refused("a chunk is cut off")
                chunks.append((kind, text[place + 8 : place + 8 + size]))
                place += 8 + size
            text, self.binary = chunks[0][1], dict(chunks[1:2]).get(b"BIN\0", b"")
        self.json: dict[str, Any] = json.loads(text.removeprefix(b"\xef\xbb\xbf"))

    def buffer(self, index: int) -> bytes:
        entry = self.json["buffers"][index]
        uri, data = entry.get("uri"), self.binary
        if uri is not None and uri.startswith("data:"):
            kind, _, text = uri.partition(",")
            data = base64.b64decode(text) if kind.endswith("base64") else unquote_to_bytes(text)
        elif uri is not None:
            data = (self.folder / unquote(uri)).read_bytes()
        if len(data) < entry["byteLength"]:
            raise Refused(f"buffer {index} is {len(data)} bytes, not {entry['byteLength']}")
        return bytes(data[: entry["byteLength"]])

    def accessor(self, index: int) -> Floats:
        """Return (count, width): sparse replacements made, normalized integers divided (3.6.2)."""
        entry = self.json["accessors"][index]
        form = (entry["componentType"], WIDTHS[entry["type"]])
        rows = [(0,) * form[1]] * entry["count"]
        if "bufferView" in entry:
            rows = self._rows(entry, form, entry["count"])
        if (sparse := entry.get("sparse")) is not None:
            kind = sparse["indices"]["componentType"]
            places = self._rows(sparse["indices"], (kind, 1), sparse["count"])
            replaced = self._rows(sparse["values"], form, sparse["count"])
            for (place,), row in zip(places, replaced, strict=True):
                rows[place] = row
        values: Floats = np.array(rows, np.float64).reshape(-1, form[1])
        if entry.get("normalized"):
            return np.asarray(np.maximum(values / LARGEST[form[0]], -1.0))
        return values

    def _rows(self, source: dict[str, Any], form: tuple[int, int], count: int) -> list[Any]:
        """Read elements of some component type and width from a buffer view."""
        view = self.json["bufferViews"][source["bufferView"]]
        start = view.get("byteOffset", 0)
        data = self.buffer(view["buffer"])[start : start + view["byteLength"]]
        code = f"<{form[1]}{COMPONENTS[form[0]]}"
        step, place = view.get("byteStride") or struct.calcsize(code), source.get("byteOffset", 0)
        if len(data) < view["byteLength"]:
            raise Refused("a buffer view ends beyond its buffer")
        return [struct.unpack_from(code, data, place + step * k) for k in range(count)]


class _Walk:
    """Nodes of the scene, depth first, children in order."""

    def __init__(self, path: Path) -> None:
        self.document, self.reading = _Document(path), Reading()
        tree = self.document.json
        asset = tree["asset"]
        if asset["version"][:2] != "2." or asset.get("minVersion", "2.0") != "2.0":
            raise Refused("not glTF 2.0")
        used = [*tree.get("extensionsUsed", []), *tree.get("extensions", {})]
        required = tree.get("extensionsRequired", [])
        unknown = [name for name in required if name not in READ and not name.startswith(LOOKS)]
        if unknown or "CESIUM_RTC" in used:
            raise Refused(f"extensions {unknown}")
        self.nodes: list[dict[str, Any]] = tree.get("nodes", [])
        children = [child for node in self.nodes for child in node.get("children", [])]
        if len(set(children)) < len(children) or max(children, default=0) >= len(self.nodes):
            raise Refused("a node has two parents, or does not exist")
        roots = [k for k in range(len(self.nodes)) if k not in children]
        self.places: dict[int, Placement] = {}
        for root in roots:
            self._place(root, Placement())
        if len(self.places) < len(self.nodes):
            raise Refused("nodes in a circle")
        scenes = tree.get("scenes", [])
        for root in scenes[tree.get("scene", 0)].get("nodes", []) if scenes else roots:
            if root in children:
                raise Refused(f"node {root} of the scene is not a root")
            self._enter(root)

    def _place(self, number: int, above: Placement) -> None:
        """Store the global transforms of a node and its descendants (3.5.2)."""
        node = self.nodes[number]
        if "matrix" in node:
            own = Placement(np.reshape(node["matrix"], (4, 4)).T)
        else:
            own = _composed(*(node.get(name) for name in ("translation", "rotation", "scale")))
        self.places[number] = above @ own
        for child in node.get("children", []):
            self._place(child, self.places[number])

    def _enter(self, number: int) -> None:
        """Add the meshes of a node and its descendants, if visible."""
        node = self.nodes[number]
        extensions = node.get("extensions", {})
        if not extensions.get("KHR_node_visibility", {}).get("visible", True):
            return
        if "mesh" in node:
            mesh = self.document.json["meshes"][node["mesh"]]
            weights = node.get("weights", mesh.get("weights", []))
            copies = [Placement()]
            if (instancing := extensions.get("EXT_mesh_gpu_instancing")) is not None:
                copies = self._instances(instancing["attributes"])
                if "skin" in node:
                    raise Refused("instances of a skinned mesh")
            for copy in copies:
                for primitive in mesh["primitives"]:
                    place = self.places[number] @ copy
                    self._primitive(primitive, weights, node.get("skin"), place)
        for child in node.get("children", []):
            self._enter(child)

    def _instances(self, attributes: dict[str, int]) -> list[Placement]:
        rows = {name: self.document.accessor(index) for name, index in attributes.items()}
        [count] = {len(values) for values in rows.values()}
        names = ("TRANSLATION", "ROTATION", "SCALE")
        parts = [rows[name].tolist() if name in rows else [None] * count for name in names]
        return [_composed(*three) for three in zip(*parts, strict=True)]

    def _primitive(
        self, primitive: dict[str, Any], weights: list[float], skin: int | None, place: Placement
    ) -> None:
        """Add the triangles of a primitive; skip a primitive without positions (3.7.2.1)."""
        attributes, mode = primitive["attributes"], primitive.get("mode", 4)
        if "POSITION" not in attributes or mode < 4:
            return
        points, sizes, exact = self._morphed(primitive, weights)
        if skin is None:
            points, sizes = place.of(points, sizes)
            exact &= place.exact
        else:
            points, sizes = self._skinned(points, sizes, attributes, skin)
        if not exact or skin is not None:
            rounding = ROUNDING * float(sizes.max(initial=0.0))
            self.reading.rounding = max(self.reading.rounding, rounding)
        order = list(range(len(points)))
        if "indices" in primitive:
            order = [int(row[0]) for row in self.document.accessor(primitive["indices"])]
        for a, b, c in _triangles(mode, order):
            mirrored = place.mirrors and skin is None  # section 3.7.4
            self.reading.add(points, [a, c, b] if mirrored else [a, b, c])

    def _morphed(
        self, primitive: dict[str, Any], weights: list[float]
    ) -> tuple[Floats, Floats, bool]:
        """Return positions with targets (3.7.2.2), their terms' sizes, and if they are exact."""
        accessors = self.document.json["accessors"]
        targets = primitive.get("targets", [])
        if len(weights) > len(targets):
            raise Refused(f"{len(weights)} weights of {len(targets)} morph targets")
        index = primitive["attributes"]["POSITION"]
        points, exact = self.document.accessor(index), not accessors[index].get("normalized")
        sizes = np.abs(points)
        for target, weight in zip(targets, weights, strict=False):
            if weight and "POSITION" in target:
                added = weight * self.document.accessor(target["POSITION"])
                points, sizes, exact = points + added, sizes + np.abs(added), False
        return points, sizes, exact

    def _skinned(
        self, points: Floats, sizes: Floats, attributes: dict[str, int], index: int
    ) -> tuple[Floats, Floats]:
        """Apply only the joints: the transform of the skinned node is ignored (3.7.3.3)."""
        skin = self.document.json["skins"][index]
        joints = [self.places[joint] for joint in skin["joints"]]
        if "inverseBindMatrices" in skin:
            back = self.document.accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            joints = [joint @ Placement(m.T) for joint, m in zip(joints, back, strict=False)]
        moved, terms = np.zeros_like(points), np.zeros_like(points)
        for vertex, influences in enumerate(self._influences(attributes)):
            matrix = np.zeros((4, 4))
            for name, share in influences:
                placed, size = joints[name].of(points[vertex, None], sizes[vertex, None])
                moved[vertex] += share * placed[0]
                terms[vertex] += share * size[0]
                matrix += share * joints[name].matrix
            if abs(sum(share for _, share in influences) - 1) > 0.02:
                raise Refused("weights of a vertex do not add up to one")
            self.reading.oriented &= not Placement(matrix).mirrors  # unspecified winding
        return moved, terms

    def _influences(self, attributes: dict[str, int]) -> list[list[tuple[int, float]]]:
        """Return the joints of each vertex and their weights."""
        sets = range(sum(name.startswith("JOINTS_") for name in attributes))
        names, shares = (
            np.hstack([self.document.accessor(attributes[f"{kind}_{k}"]) for k in sets])
            for kind in ("JOINTS", "WEIGHTS")
        )
        return [
            [(int(n), share) for n, share in zip(*pair, strict=True) if share]
            for pair in zip(names.tolist(), shares.tolist(), strict=True)
        ]


def _composed(translation: Any, rotation: Any, scale: Any) -> Placement:
    """Return the map T R S; the rotation is a quaternion x, y, z, w (3.5.3)."""
    placement = Placement(np.diag([*(scale or (1.0, 1.0, 1.0)), 1.0]))
    if rotation is not None:
        turn, sizes = np.eye(4), np.eye(4)
        turn[:3, :3] = Rotation.from_quat(rotation).as_matrix()
        sizes[:3, :3] = (
            3.0  # absolute terms of an entry sum to at most 3, even where the terms cancel
        )
        placement = Placement(turn, sizes) @ placement
    if translation is not None:
        matrix = np.eye(4)
        matrix[:3, 3] = translation
        placement = Placement(matrix) @ placement
    return placement


def _triangles(mode: int, p: list[int]) -> list[tuple[int, int, int]]:
    """Return triangles by the formulas of section 3.7.2.1."""
    if mode == 4:
        if len(p) % 3:
            raise Refused(f"{len(p)} indices of triangles")
        return [(p[i], p[i + 1], p[i + 2]) for i in range(0, len(p), 3)]
    if mode == 5:
        return [(p[i], p[i + 1 + i % 2], p[i + 2 - i % 2]) for i in range(len(p) - 2)]
    return [(p[i + 1], p[i + 2], p[0]) for i in range(len(p) - 2)]
