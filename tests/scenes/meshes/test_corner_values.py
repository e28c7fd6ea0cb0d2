"""Normals and texture coordinates of glTF: normals follow the surface through every placement."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.second_reader import making
from tests.second_reader.gltf_data import LARGEST
from tests.second_reader.making import BYTE, FLOAT, SOUP, UBYTE, USHORT, Case, Gltf, case
from tests.second_reader.model import Floats
from xfrustum.scenes.meshes.mesh_file import load_mesh

#: Each triangle has corners of its own, whose stored normal is the triangle's.
POINTS = SOUP.reshape(-1, 3)
CROSS = np.cross(SOUP[:, 1] - SOUP[:, 0], SOUP[:, 2] - SOUP[:, 0])
NORMALS = np.repeat(CROSS / np.linalg.norm(CROSS, axis=1, keepdims=True), 3, axis=0)
SHEAR = np.array([[1, 0.5, 0, 3], [0, 2, 0, 0], [0.25, 0, -1, 0], [0, 0, 0, 1]])
EVERY = [[1.0, 0, 0, 0]] * len(POINTS)


def flat(file: Gltf, normals: int | None = None) -> int:
    """Add the triangles with their normals."""
    if normals is None:
        normals = file.accessor(NORMALS)
    return file.mesh(file.positions(POINTS), -1, attributes={"NORMAL": normals})


def cases() -> Iterator[Case]:
    """Return files whose normals must be those of their triangles."""
    nodes: dict[str, dict[str, Any]] = {
        "still": {},
        "uneven": {"scale": [1, 5, 0.2]},
        "mirrored": {"scale": [-1, 2, 1]},
        "sheared": {"matrix": SHEAR.T.ravel().tolist()},
    }
    for name, node in nodes.items():
        file = Gltf()
        file.node(mesh=flat(file), **node)
        yield case(f"{name}.glb", file.glb())
    file = Gltf(
        extensionsUsed=["KHR_mesh_quantization"], extensionsRequired=["KHR_mesh_quantization"]
    )
    bytes_of_normals = file.accessor(np.rint(NORMALS * 127), (BYTE, "VEC3"), normalized=True)
    file.node(mesh=flat(file, bytes_of_normals))
    yield case("quantized.glb", file.glb())
    file = Gltf(extensionsUsed=["EXT_mesh_gpu_instancing"])
    sizes = file.accessor(np.array([[1.0, 3, 1], [-1, 1, 1]]))
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": sizes}}}
    file.node(mesh=flat(file), rotation=[0, 0, 0.5**0.5, 0.5**0.5], extensions=instancing)
    yield case("instances.glb", file.glb())
    file = Gltf()
    mesh = flat(file)
    joints = file.accessor(np.zeros((len(POINTS), 4)), (UBYTE, "VEC4"))
    shares = file.accessor(EVERY, (FLOAT, "VEC4"))
    file.json["meshes"][mesh]["primitives"][0]["attributes"] |= {
        "JOINTS_0": joints,
        "WEIGHTS_0": shares,
    }
    joint = file.node(scale=[1, 4, 1], rotation=[1, 0, 0, 0])
    file.add("skins", joints=[joint])
    file.node(mesh=mesh, skin=0)
    yield case("skin.glb", file.glb())


@pytest.mark.parametrize("case", [*cases()], ids=lambda case: case.name)
def test_stored_normals_are_those_of_the_triangles(case: making.Case, tmp_path: Path) -> None:
    mesh = load_mesh(case.write(tmp_path))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    stored = mesh.vertex_normals[mesh.faces]
    cosines = np.einsum("fk,fck->fc", across, stored)
    # Rounding of a quantized normal, 0.5 / 127 a component: 1 - cos < (sqrt(3) / 254)^2 / 2.
    assert np.abs(cosines - 1).max() < 3e-5


UV = np.array([[0, 0], [1, 0], [1, 1], [0.25, 0.5]])
OTHER = UV[::-1] / 2


def textured(name: str, sets: list[int], **texture: int) -> Case:
    """Return a file with texture coordinates of these component types, and a texture of one pixel."""
    png = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNgYGAAAAAEAAH2FzhVAAAAAElFTkSuQmCC"
    file = Gltf(images=[{"uri": f"data:image/png;base64,{png}"}], textures=[{"source": 0}])
    file.json["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, **texture}}}
    ]
    attributes = {}
    for number, (kind, values) in enumerate(zip(sets, (UV, OTHER), strict=False)):
        largest = LARGEST.get(kind)
        rows = values if largest is None else np.rint(values * largest)
        more = {} if largest is None else {"normalized": True}
        attributes[f"TEXCOORD_{number}"] = file.accessor(rows, (kind, "VEC2"), **more)
    file.node(mesh=file.mesh(attributes=attributes, material=0))
    return case(name, file.glb())


TEXTURED = [
    (textured("float.glb", [FLOAT]), UV),
    (textured("ubyte.glb", [UBYTE]), np.rint(UV * 255) / 255),
    (textured("ushort.glb", [USHORT]), np.rint(UV * 65535) / 65535),
    (textured("second_set.glb", [FLOAT, UBYTE], texCoord=1), np.rint(OTHER * 255) / 255),
]


@pytest.mark.parametrize(("case", "expected"), TEXTURED, ids=[one.name for one, _ in TEXTURED])
def test_texture_coordinates_are_of_the_set_that_the_material_names(
    case: Case, expected: Floats, tmp_path: Path
) -> None:
    mesh = load_mesh(case.write(tmp_path))
    assert mesh.uv is not None
    corners = mesh.vertices[mesh.faces].reshape(-1, 1, 3)
    numbers = np.abs(corners - making.CORNERS).max(axis=2).argmin(axis=1)
    right = np.column_stack([expected[:, 0], 1 - expected[:, 1]])  # v = 0 at the bottom
    assert np.abs(mesh.uv[mesh.faces].reshape(-1, 2) - right[numbers]).max() <= 2.0**-52
