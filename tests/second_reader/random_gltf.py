"""glTF files of random features, for a comparison of both readers without closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.second_reader.model import Floats
from tests.support.gltf_writer import Writer

EXTENSIONS = ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility"]
INTEGERS = ("<i1", "<u1", "<i2", "<u2")


def random_gltf(seed: int) -> Writer:
    """Return a document of up to three meshes in a random tree of up to seven nodes."""
    random, writer = np.random.default_rng(seed), Writer()
    writer.tree |= {"extensionsUsed": EXTENSIONS, "extensionsRequired": EXTENSIONS}
    nodes: list[dict[str, Any]] = writer.tree["nodes"]
    for number in range(int(random.integers(1, 8))):
        parent = nodes[int(random.integers(number))] if number and random.random() < 0.7 else None
        writer.node(root=parent is None, **_placement(random))
        if parent is not None:
            parent.setdefault("children", []).append(number)
    meshes = [_mesh(writer, random, skinned=False) for _ in range(int(random.integers(1, 4)))]
    skinned = _mesh(writer, random, skinned=True)
    for number, node in enumerate(nodes):
        chance, extensions = random.random(), dict[str, Any]()
        if chance < 0.15:
            node |= {"mesh": skinned, "skin": _skin(writer, random, len(nodes))}
        elif chance < 0.8:
            node["mesh"] = int(random.choice(meshes))
            if random.random() < 0.3:
                extensions["EXT_mesh_gpu_instancing"] = {"attributes": _instances(writer, random)}
        if "mesh" in node and random.random() < 0.2:
            targets = writer.tree["meshes"][node["mesh"]]["primitives"][0].get("targets", [])
            node["weights"] = random.normal(size=len(targets)).tolist()
        if random.random() < 0.1:
            extensions["KHR_node_visibility"] = {"visible": bool(random.random() < 0.3)}
        nodes[number]["extensions"] = extensions
        if random.random() < 0.1:
            node["camera"] = 0  # cameras hide neither a mesh nor the children of a node
    if random.random() < 0.1:
        del writer.tree["scenes"], writer.tree["scene"]  # all roots are drawn
    return writer


def _placement(random: Generator) -> dict[str, Any]:
    """Return a random transform of a node: a matrix, or parts of T R S, mirrored or not."""
    if random.random() < 0.2:
        matrix = np.eye(4)
        matrix[:3] = random.normal(size=(3, 4))
        return {"matrix": matrix.T.ravel().tolist()}
    parts = {
        "translation": random.normal(size=3) * 10.0 ** random.integers(0, 7),
        "rotation": _unit(random, 1)[0],
        "scale": random.choice([-1, 1], 3) * random.uniform(0.2, 3, 3),
    }
    return {name: part.tolist() for name, part in parts.items() if random.random() < 0.6}


def _unit(random: Generator, count: int) -> Floats:
    rows = random.normal(size=(count, 4))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _instances(writer: Writer, random: Generator) -> dict[str, int]:
    """Return attributes of instances, at least one."""
    count = int(random.integers(1, 5))
    kind = str(random.choice(["<f4", "<i1", "<i2"]))
    turns = _unit(random, count) * (1 if kind == "<f4" else np.iinfo(kind).max)
    turns = turns if kind == "<f4" else np.rint(turns)
    sizes = random.choice([-1, 1], (count, 3)) * random.uniform(0.2, 3, (count, 3))
    attributes = {"SCALE": writer.array(sizes.astype("<f4"))}
    if random.random() < 0.7:
        attributes["TRANSLATION"] = writer.array(random.normal(size=(count, 3)).astype("<f4"))
    if random.random() < 0.7:
        more = {} if kind == "<f4" else {"normalized": True}
        attributes["ROTATION"] = writer.array(turns.astype(kind), **more)
    return attributes


def _mesh(writer: Writer, random: Generator, skinned: bool) -> int:
    """Add a mesh of one or two primitives with the same number of morph targets."""
    targets = int(random.integers(0, 3))
    primitives = [
        _primitive(writer, random, targets, skinned) for _ in range(int(random.integers(1, 3)))
    ]
    weights = {"weights": random.normal(size=targets).tolist()} if random.random() < 0.8 else {}
    return writer.add("meshes", primitives=primitives, **weights)


def _primitive(writer: Writer, random: Generator, targets: int, skinned: bool) -> dict[str, Any]:
    count = int(random.integers(3, 12))
    attributes = {"POSITION": _vectors(writer, random, count)}
    if skinned:
        first = random.integers(0, 256, (count, 1))
        weights = np.hstack([first, 255 - first, first * 0, first * 0]).astype("<u1")
        joints = random.integers(0, 2, (count, 4)).astype("<u1")
        attributes["JOINTS_0"] = writer.array(joints)
        attributes["WEIGHTS_0"] = writer.array(weights, normalized=True)
    mode = int(random.choice([4, 4, 5, 6]))
    primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
    if mode == 4 or random.random() < 0.7:
        length = 3 * int(random.integers(1, 6)) if mode == 4 else int(random.integers(3, 12))
        kind = str(random.choice(["<u1", "<u2", "<u4"]))
        indices = random.integers(0, count, length).astype(kind)
        primitive["indices"] = writer.array(indices, **_sparse(writer, random, indices[:, None]))
    if targets:
        primitive["targets"] = [
            {"POSITION": _vectors(writer, random, count)} for _ in range(targets)
        ]
    return primitive


def _vectors(writer: Writer, random: Generator, count: int) -> int:
    """Add an accessor of vectors of a random component type, sparse or not."""
    kind = str(random.choice(["<f4", "<f4", *INTEGERS]))
    rows = random.uniform(-1, 1, (count, 3)).astype("<f4")
    more: dict[str, Any] = {}
    if kind != "<f4":
        bounds = np.iinfo(kind)
        rows = random.integers(bounds.min, bounds.max + 1, (count, 3)).astype(kind)
        more = {"normalized": bool(random.random() < 0.7)}
    if random.random() < 0.2:
        stored = np.pad(rows, ((0, 0), (1, 1)), constant_values=77)  # rows between other data
        width = stored.itemsize
        stride = -(-5 * width // 4) * 4
        data = b"".join(row.tobytes().ljust(stride, b"\0") for row in stored)
        view = writer.view(data, byteStride=stride)
        return writer.array(rows, bufferView=view, byteOffset=width, **more)
    return writer.array(rows, **more, **_sparse(writer, random, rows))


def _sparse(writer: Writer, random: Generator, rows: NDArray[Any]) -> dict[str, Any]:
    """Return the parts of an accessor that replaces some rows; it may set other rows to zero."""
    if random.random() < 0.7:
        return {}
    count = int(random.integers(1, len(rows)))
    chosen = np.sort(random.choice(len(rows), count, replace=False))
    places = {"bufferView": writer.view(chosen.astype("<u1").tobytes()), "componentType": 5121}
    values = {"bufferView": writer.view(rows[chosen].tobytes())}
    sparse = {"count": count, "indices": places, "values": values}
    if random.random() < 0.3:  # without a buffer view, rows that are not replaced are zeros
        rows[np.delete(np.arange(len(rows)), chosen)] = 0
        return {"sparse": sparse}
    base = rows.copy()
    base[chosen] = 0
    return {"sparse": sparse, "bufferView": writer.view(base.tobytes())}


def _skin(writer: Writer, random: Generator, nodes: int) -> int:
    """Add a skin of two joints, with or without inverse bind matrices."""
    first = int(random.integers(nodes))
    entry: dict[str, Any] = {"joints": [first, (first + 1) % nodes]}
    if random.random() < 0.7:
        matrices = np.zeros((2, 4, 4), "<f4")
        matrices[:, 3, 3] = 1
        matrices[:, :3] = random.normal(size=(2, 3, 4))
        entry["inverseBindMatrices"] = writer.array(matrices.transpose(0, 2, 1).reshape(2, 16))
    return writer.add("skins", **entry)
