"""Mesh files: numbered as trimesh numbers them, and no damaged one gets through."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.exceptions import ExceptionWrapper
from trimesh.exchange.load import mesh_loaders

from xfrustum.scenes import InputError
from xfrustum.scenes.files.meshes import load_mesh
from xfrustum.scenes.geometry.shapes import place

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no folder of test data beside the checkout")

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"


@needs_data
@pytest.mark.parametrize(("name", "triangles"), [("teapot.obj", 6_320), ("CesiumMilkTruck.glb", 3_624)])
def test_triangles_are_numbered_as_the_contract_says(name: str, triangles: int) -> None:
    ours = load_mesh(DATA / name)
    parts = trimesh.load_scene(str(DATA / name), process=False)
    for geometry in parts.geometry.values():
        geometry.visual = trimesh.visual.ColorVisuals()  # its textures would be packed for a second
    theirs = parts.to_mesh()
    assert len(ours.faces) == triangles
    np.testing.assert_array_equal(ours.faces, theirs.faces)
    np.testing.assert_array_equal(ours.vertices, theirs.vertices)


@needs_data
def test_parts_keep_their_textures_and_a_part_used_twice_shares_one() -> None:
    truck = load_mesh(DATA / "CesiumMilkTruck.glb")
    assert truck.uv is not None
    assert truck.texture_of_triangle is not None
    assert [texture.shape for texture in truck.textures] == [(2048, 2048, 4)] * 2
    assert np.bincount(truck.texture_of_triangle + 1).tolist() == [344, 1744, 1536]
    textured = truck.faces[truck.texture_of_triangle >= 0]
    assert np.isfinite(truck.uv[textured]).all()


def test_parts_are_placed_and_counted_as_often_as_they_are_used(tmp_path: Path) -> None:
    scene: Any = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), geom_name="wheel", node_name="left")
    shift = np.eye(4)
    shift[0, 3] = 5
    scene.graph.update("right", matrix=shift, geometry="wheel")
    path = tmp_path / "two.glb"
    scene.export(str(path))
    mesh = load_mesh(path)
    assert len(mesh.faces) == 24
    assert sorted({float(x) for x in mesh.vertices[:, 0]}) == [-0.5, 0.5, 4.5, 5.5]


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("empty.obj", "", "the mesh file is empty"),
        ("no-faces.obj", CORNERS, "no triangles"),
        ("nan.obj", CORNERS.replace("1 0 0", "1 nan 0") + "f 1 2 3\n", "1 of 3 vertices are NaN or infinite"),
        ("infinite.obj", CORNERS.replace("v 1 0 0", "v inf 0 0") + "f 1 2 3\n", "the first is number 1"),
        ("past.obj", CORNERS + "f 1 2 9\n", "faces point past the vertices"),
        ("before.obj", CORNERS + "f -1 -2 -9\n", "faces point past the vertices"),
        ("past.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "face"),
        ("past.ply", PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "past the vertices (index 7, 3 vertices)"),
        ("damaged.glb", "hello", "cannot be read"),
        ("damaged.ply", "ply\nnonsense", "damaged"),
        ("points.xyz", "1 2 3\n4 5 6\n", ""),
        ("picture.foo", "x", "use one of"),
    ],
)
def test_a_damaged_mesh_is_one_line_that_names_the_file(
    tmp_path: Path, name: str, text: str, told: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value) and told in str(caught.value)


def test_a_placement_that_overflows_is_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "big.obj"
    path.write_text("v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="NaN or infinite in scene coordinates"):
        place(load_mesh(path), np.diag([1e300, 1, 1, 1]))


def test_a_3mf_mesh_without_lxml_is_told_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.3mf"
    trimesh.creation.box().export(path)
    # So trimesh keeps the failure of its own import of lxml.
    failed = ExceptionWrapper(ImportError("No module named 'lxml'"))
    monkeypatch.setitem(mesh_loaders, "3mf", failed)
    with pytest.raises(InputError, match=r"not installed; for 3MF: pip install '\.\[3mf\]'"):
        load_mesh(path)
