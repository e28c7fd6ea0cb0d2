"""glTF files of random features, for the comparison of both readers without a closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from tests.second_reader.making import BYTE, FLOAT, SHORT, UBYTE, UINT, USHORT, Gltf
from tests.second_reader.model import Floats

EXTENSIONS = ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility"]
KINDS = {BYTE: 127, UBYTE: 255, SHORT: 32767, USHORT: 65535}
NUMPY = {BYTE: "i1", UBYTE: "u1", SHORT: "<i2", USHORT: "<u2", UINT: "<u4", FLOAT: "<f4"}


def random_gltf(seed: int) -> bytes:
    """Return a file of up to three meshes in a random tree of up to seven nodes."""
    random = np.random.default_rng(seed)
    file = Gltf(extensionsUsed=EXTENSIONS, extensionsRequired=EXTENSIONS)
    nodes = int(random.integers(1, 8))
    for number in range(nodes):
        file.node(**placement(random))
        if number and random.random() < 0.7:
            parent = file.json["nodes"][int(random.integers(number))]
            parent.setdefault("children", []).append(number)
    meshes = [mesh(file, random, skinned=False) for _ in range(int(random.integers(1, 4)))]
    skinned = mesh(file, random, skinned=True)
    for node in file.json["nodes"]:
        chance = random.random()
        if chance < 0.15:
            node |= {"mesh": skinned, "skin": skin(file, random, nodes)}
        elif chance < 0.8:
            node["mesh"] = int(random.choice(meshes))
            if random.random() < 0.3:
                extensions = node.setdefault("extensions", {})
                extensions["EXT_mesh_gpu_instancing"] = {"attributes": instances(file, random)}
        if "mesh" in node and random.random() < 0.2:
            targets = file.json["meshes"][node["mesh"]]["primitives"][0].get("targets", [])
            if targets:
                node["weights"] = random.normal(size=len(targets)).tolist()
        if random.random() < 0.1:
            hidden = {"visible": bool(random.random() < 0.3)}
            node.setdefault("extensions", {})["KHR_node_visibility"] = hidden
    return file.glb()


def placement(random: Generator) -> dict[str, Any]:
    """Return a random transform of a node: none, a matrix, or parts of T R S, mirrored or not."""
    if random.random() < 0.2:
        matrix = np.eye(4)
        matrix[:3] = random.normal(size=(3, 4))
        return {"matrix": matrix.T.ravel().tolist()}
    parts: dict[str, Any] = {}
    if random.random() < 0.6:
        parts["translation"] = (random.normal(size=3) * 10.0 ** random.integers(0, 7)).tolist()
    if random.random() < 0.6:
        parts["rotation"] = unit(random, 1)[0].tolist()
    if random.random() < 0.6:
        parts["scale"] = (random.choice([-1, 1], 3) * random.uniform(0.2, 3, 3)).tolist()
    return parts


def unit(random: Generator, count: int) -> Floats:
    """Return random quaternions of length one."""
    rows = random.normal(size=(count, 4))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def instances(file: Gltf, random: Generator) -> dict[str, int]:
    """Return attributes of instances, at least one."""
    count = int(random.integers(1, 5))
    found = {}
    if random.random() < 0.7:
        found["TRANSLATION"] = file.accessor(random.normal(size=(count, 3)))
    if random.random() < 0.7:
        turns = unit(random, count)
        kind = int(random.choice([FLOAT, BYTE, SHORT]))
        whole = turns if kind == FLOAT else np.rint(turns * KINDS[kind])
        more = {} if kind == FLOAT else {"normalized": True}
        found["ROTATION"] = file.accessor(whole, (kind, "VEC4"), **more)
    if random.random() < 0.7 or not found:
        found["SCALE"] = file.accessor(
            random.choice([-1, 1], (count, 3)) * random.uniform(0.2, 3, (count, 3))
        )
    return found


def mesh(file: Gltf, random: Generator, skinned: bool) -> int:
    """Add a mesh of one or two primitives with the same count of morph targets."""
    targets = int(random.integers(0, 3))
    primitives = [
        primitive(file, random, targets, skinned) for _ in range(int(random.integers(1, 3)))
    ]
    entry: dict[str, Any] = {"primitives": primitives}
    if targets and random.random() < 0.8:
        entry["weights"] = random.normal(size=targets).tolist()
    return file.add("meshes", **entry)


def primitive(file: Gltf, random: Generator, targets: int, skinned: bool) -> dict[str, Any]:
    """Return a primitive of random positions, indices and mode."""
    count = int(random.integers(3, 12))
    attributes = {"POSITION": vectors(file, random, count)}
    if skinned:
        weights = random.dirichlet(np.ones(4), count)
        whole = np.rint(weights * 255)
        whole[:, 3] = 255 - whole[:, :3].sum(axis=1)
        negative = whole[:, 3] < 0
        whole[negative] = [255, 0, 0, 0]
        attributes["JOINTS_0"] = file.accessor(random.integers(0, 2, (count, 4)), (UBYTE, "VEC4"))
        attributes["WEIGHTS_0"] = file.accessor(whole, (UBYTE, "VEC4"), normalized=True)
    mode = int(random.choice([4, 4, 5, 6]))
    found: dict[str, Any] = {"attributes": attributes, "mode": mode}
    if random.random() < 0.7:
        length = 3 * int(random.integers(1, 6)) if mode == 4 else int(random.integers(3, 12))
        values = random.integers(0, count, length).astype(np.float64).reshape(-1, 1)
        form = (int(random.choice([UBYTE, USHORT, UINT])), "SCALAR")
        start = values.copy()
        more = sparse(file, random, (values, start), form)
        found["indices"] = file.accessor(start, form, **more)
    elif mode == 4:
        found["mode"] = int(random.choice([5, 6]))
    if targets:
        found["targets"] = [{"POSITION": vectors(file, random, count)} for _ in range(targets)]
    return found


def vectors(file: Gltf, random: Generator, count: int) -> int:
    """Add an accessor of vectors of a random component type, sparse or not."""
    rows = random.uniform(-1, 1, (count, 3))
    kind = int(random.choice([FLOAT, FLOAT, *KINDS]))
    if kind != FLOAT:
        low = 0 if kind in (UBYTE, USHORT) else -KINDS[kind]
        rows = random.integers(low, KINDS[kind] + 1, (count, 3)).astype(np.float64)
    start = rows.copy()
    more = sparse(file, random, (rows, start), (kind, "VEC3"))
    final = rows.astype(NUMPY[kind]).astype(np.float64)
    more |= {"min": final.min(axis=0).tolist(), "max": final.max(axis=0).tolist()}
    if kind != FLOAT and random.random() < 0.7:
        more["normalized"] = True
    return file.accessor(start, (kind, "VEC3"), **more)


def sparse(
    file: Gltf, random: Generator, rows: tuple[Floats, Floats], form: tuple[int, str]
) -> dict[str, Any]:
    """Return replacements of some rows by the first array; the second becomes the one replaced in."""
    values, start = rows
    if random.random() < 0.7:
        return {}
    chosen = np.sort(random.choice(len(start), int(random.integers(1, len(start))), replace=False))
    start[chosen] = 0
    kind = int(random.choice([UBYTE, USHORT, UINT]))
    places = file.view(chosen.astype(NUMPY[kind]).tobytes())
    replaced = file.view(values[chosen].astype(NUMPY[form[0]]).tobytes())
    indices = {"bufferView": places, "componentType": kind}
    return {
        "sparse": {"count": len(chosen), "indices": indices, "values": {"bufferView": replaced}}
    }


def skin(file: Gltf, random: Generator, nodes: int) -> int:
    """Add a skin of two joints, with or without inverse bind matrices."""
    joints = random.integers(0, nodes, 2).tolist()
    if joints[0] == joints[1]:
        joints = joints[:1] * 1 + [(joints[0] + 1) % nodes]
    entry: dict[str, Any] = {"joints": joints}
    if random.random() < 0.7:
        matrices = np.zeros((2, 4, 4))
        matrices[:, 3, 3] = 1
        matrices[:, :3] = random.normal(size=(2, 3, 4))
        columns = matrices.transpose(0, 2, 1).reshape(2, 16)
        entry["inverseBindMatrices"] = file.accessor(columns, (FLOAT, "MAT4"))
    return file.add("skins", **entry)
