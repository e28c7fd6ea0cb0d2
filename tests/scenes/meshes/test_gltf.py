"""glTF: each feature of a file gives the triangles of a plain file."""

import base64
import json
import sys
import tracemalloc
from pathlib import Path
from typing import Any
from urllib.parse import quote_from_bytes

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.support.gltf_writer import TENT, TENT_FACES, Writer
from xfrustum.scenes import InputError, SceneObject
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk import input_memory
from xfrustum.scenes.meshes.mesh_file import load_mesh

#: Corners of the triangles of `TENT` without any placement
PLAIN = TENT.astype(np.float64)[TENT_FACES.reshape(-1, 3)]
ROUNDING = 1e-12  # about ten operations of doubles on values of about 100
INSTANCES = "EXT_mesh_gpu_instancing"


def corners(mesh: SceneObject) -> Floats:
    """Return the corners (F, 3, 3) of all triangles, in the order of their numbers."""
    return mesh.vertices[mesh.faces]


def read(writer: Writer, folder: Path, name: str = "mesh.glb") -> SceneObject:
    return load_mesh(writer.save(folder / name))


def tent() -> Writer:
    writer = Writer()
    writer.node(mesh=writer.tent())
    return writer


def skinned() -> Writer:
    """Return the tent skinned to two joints that move together; the node's transform is ignored."""
    writer, back = Writer(), np.eye(4, dtype="<f4")
    attributes = {
        "JOINTS_0": writer.array(np.tile(np.array([0, 1, 0, 0], "<u1"), (5, 1))),
        "WEIGHTS_0": writer.array(
            np.tile(np.array([64, 191, 0, 0], "<u1"), (5, 1)), normalized=True
        ),
    }
    back[:3, 3] = (-3, 0, 0)
    binds = writer.array(np.stack([back.T, np.eye(4, dtype="<f4")]).reshape(2, 16))
    moved = writer.node(translation=[3, 0, 0])
    mesh = writer.tent(attributes=attributes)
    writer.node(mesh=mesh, skin=0, translation=[5, 5, 5], scale=[9, 9, 9])
    writer.add("skins", joints=[moved, writer.node()], inverseBindMatrices=binds)
    return writer


@pytest.mark.parametrize(
    ("mode", "faces"),
    [(5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]])],
)
def test_strips_and_fans_are_numbered_by_the_formulas_of_the_specification(
    mode: int, faces: list[list[int]], tmp_path: Path
) -> None:
    """Section 3.7.2.1 of glTF 2.0."""
    writer, order = Writer(), np.array([3, 0, 4, 1, 2], "<u4")
    writer.node(mesh=writer.mesh(TENT, order, mode=mode))
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), TENT[order[faces]])


def test_utm_coordinates_are_rounded_once(tmp_path: Path) -> None:
    writer, far = Writer(), (500000.123, 4.0e6, -7.25)
    turn = [0, 1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, *far, 1]  # by columns: x to y, y to z, z to x
    writer.node(mesh=writer.tent(), matrix=turn)
    vertices = read(writer, tmp_path).vertices
    np.testing.assert_array_equal(vertices, TENT[:, [2, 0, 1]].astype(np.float64) + far)


#: Separate corners for each triangle, with its normal
LOOSE = PLAIN.reshape(-1, 3).astype("<f4")
CROSS = np.cross(PLAIN[:, 1] - PLAIN[:, 0], PLAIN[:, 2] - PLAIN[:, 0])
NORMALS = np.repeat(CROSS / np.linalg.norm(CROSS, axis=1, keepdims=True), 3, axis=0)


def placed(place: str) -> Writer:
    """Return separate triangles with normals, placed by a node, by instances or by a joint."""
    writer = Writer()
    stored, whole = NORMALS.astype("<f4"), place == "quantized"
    if whole:
        stored = np.rint(NORMALS * 127).astype("<i1")
    attributes = {"NORMAL": writer.array(stored, normalized=whole)}
    if "joint" in place:
        first = np.tile(np.array([1, 0, 0, 0]), (18, 1))
        attributes["JOINTS_0"] = writer.array((first * 0).astype("<u1"))
        attributes["WEIGHTS_0"] = writer.array(first.astype("<f4"))
        scale = [-1 if "mirrored" in place else 1, 4, 1]
        writer.add("skins", joints=[writer.node(scale=scale, rotation=[1, 0, 0, 0])])
    node = {
        "sheared": {"matrix": [1, 0, 0.25, 0, 0.5, 2, 0, 0, 0, 0, -1, 0, 3, 0, 0, 1]},
        "instances": {"rotation": [0, 0, 0.5**0.5, 0.5**0.5]},
    }.get(place, {"skin": 0} if "joint" in place else {})
    number = writer.node(mesh=writer.mesh(LOOSE, attributes=attributes), **node)
    if place == "instances":
        sizes = {"SCALE": writer.array(np.array([[1, 3, 1], [-1, 1, 1]], "<f4"))}
        writer.extend("nodes", number, INSTANCES, {"attributes": sizes})
    return writer


@pytest.mark.parametrize("place", ["sheared", "instances", "joint", "mirrored joint", "quantized"])
def test_normals_follow_the_surface_through_every_placement(place: str, tmp_path: Path) -> None:
    """Faces and their normals point outward; the sheared transform also mirrors."""
    mesh = read(placed(place), tmp_path)
    assert mesh.vertex_normals is not None
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosines = np.einsum("fk,fck->fc", across, mesh.vertex_normals[mesh.faces])
    # Rounding of a quantized normal, 0.5 / 127 per component: 1 - cos < (sqrt(3) / 254)^2 / 2
    assert np.abs(cosines - 1).max() < 3e-5
    middle = corners(mesh).reshape(-1, 18, 3).mean(axis=1)  # middle of each instance
    outward = (a + b + c) / 3 - np.repeat(middle, 6, axis=0)
    assert np.einsum("fk,fk->f", outward, across).sum() > 0


def test_nodes_are_numbered_as_trimesh_numbers_them(tmp_path: Path) -> None:
    """Random trees have mirrors and meshes of two primitives.

    Matrices of three or more levels are multiplied in another order, and round differently.
    """
    chance = np.random.default_rng(51)
    for number in range(6):
        writer = Writer()
        meshes = [writer.tent(), writer.mesh(TENT * np.float32(0.3), TENT_FACES[:9]), writer.tent()]
        writer.tree["meshes"][2]["primitives"] *= 2
        nodes = writer.tree["nodes"]
        for index in range(9):
            parent = int(chance.integers(-2, index)) if index else -1
            node = writer.node(
                root=parent < 0,
                translation=chance.normal(size=3).tolist(),
                rotation=chance.normal(size=4).tolist(),
                scale=chance.normal(size=3).tolist(),
            )
            if parent >= 0:
                nodes[parent].setdefault("children", []).append(node)
            if chance.random() < 0.8:
                nodes[node]["mesh"] = meshes[chance.integers(3)]
        path = writer.save(tmp_path / f"{number}.glb")
        ours, theirs = load_mesh(path), trimesh.load_scene(str(path), process=False).to_mesh()
        np.testing.assert_array_equal(ours.faces, theirs.faces)
        np.testing.assert_allclose(ours.vertices, theirs.vertices, rtol=0, atol=ROUNDING)


def test_buffers_lie_in_the_file_beside_it_or_in_its_text(tmp_path: Path) -> None:
    writer = tent()
    (tmp_path / "a b.bin").write_bytes(writer.data + b"more")
    base64_uri = "data:application/gltf-buffer;base64," + base64.b64encode(writer.data).decode()
    percent_uri = "data:application/octet-stream," + quote_from_bytes(writer.data)
    for uri in ("a%20b.bin", base64_uri, percent_uri):
        writer.tree["buffers"] = [{"byteLength": len(writer.data), "uri": uri}]
        for name in ("mesh.gltf", "mesh.glb"):
            np.testing.assert_array_equal(corners(read(writer, tmp_path, name)), PLAIN)
    text = tmp_path / "mesh.gltf"  # a byte-order mark is no part of the text
    text.write_bytes(b"\xef\xbb\xbf" + text.read_bytes())
    np.testing.assert_array_equal(corners(load_mesh(text)), PLAIN)


# Colors and textures


def painted(folder: Path, uv: Any = ((0, 0),) * 5) -> Writer:
    """Return a tent with a texture of gray level 0, and a second image of level 1."""
    writer = Writer()
    for level in (0, 1):
        Image.new("RGB", (4, 4), (level,) * 3).save(folder / f"an image {level}.png")
        writer.add("images", uri=f"an%20image%20{level}.png")
    writer.add("textures", source=0)
    writer.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    second = {"TEXCOORD_1": writer.array(np.array(uv, "<f4"))}
    first = {"TEXCOORD_0": writer.array(np.full((5, 2), 9, "<f4"))}
    writer.node(mesh=writer.tent(material=0, attributes=first | second))
    return writer


def test_a_texture_is_placed_by_its_own_coordinates_and_transform(tmp_path: Path) -> None:
    """The example of KHR_texture_transform: the lower left quadrant, turned by 90 degrees."""
    writer = painted(tmp_path, [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    info = writer.tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["texCoord"] = 1
    plain = read(writer, tmp_path)
    assert plain.unread == () and len(plain.textures) == 1
    np.testing.assert_array_equal(plain.uv, [[0, 1], [1, 1], [1, 0], [0, 0], [0, 1]])
    transform = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    info["extensions"] = {"KHR_texture_transform": transform}
    expected = np.array([[0, 1], [0, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]])  # v points down in glTF
    turned = read(writer, tmp_path).uv
    np.testing.assert_allclose(turned, expected * (1, -1) + (0, 1), atol=1e-15)
    transform["texCoord"] = 0
    assert read(writer, tmp_path).uv[0].tolist() == pytest.approx([4.5, 4.5])


def test_a_texture_is_the_image_of_an_extension_that_is_honoured(tmp_path: Path) -> None:
    for extension, content, chosen in (
        ("EXT_texture_webp", {"source": 1}, 1),
        ("EXT_texture_webp", {}, 0),
        ("KHR_texture_basisu", {"source": 1}, 0),
    ):
        writer = painted(tmp_path)
        writer.extend("textures", 0, extension, content)
        [texture] = read(writer, tmp_path).textures
        assert texture[0, 0, 0] == chosen


# Ignored and refused features

UNREAD = """\
KHR_materials_sheen is not shown: materials are those of the scene file
ACME_dust is not read
animations are not played: all is at rest
alphaMode MASK is not applied: surfaces are opaque
normalTexture is not shown
wrap mode of a sampler is not applied: textures repeat
points and lines are not shown
texture number 0 without an image is missing; the surface is drawn without it"""


def test_features_that_change_no_triangle_are_listed(tmp_path: Path) -> None:
    writer = Writer()
    writer.add("samplers", wrapS=33071)
    writer.add("textures", sampler=0)
    info = {"index": 0}
    writer.add(
        "materials",
        extensions={"KHR_materials_sheen": {}},
        alphaMode="MASK",
        normalTexture=info,
        pbrMetallicRoughness={"baseColorTexture": info},
    )
    writer.node(mesh=writer.tent(material=0))
    writer.tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})
    writer.tree["extensionsUsed"] = ["KHR_materials_sheen", "ACME_dust", "KHR_node_visibility"]
    writer.add("animations", channels=[])
    assert "\n".join(map(str, read(writer, tmp_path).unread)) == UNREAD


def replaced(writer: Writer, path: list[Any], value: Any) -> None:
    """Replace one value of a document."""
    at: Any = writer.tree
    for key in path[:-1]:
        at = at[int(key) if isinstance(at, list) else key]
    at[int(path[-1]) if isinstance(at, list) else path[-1]] = value


#: Path in the tent's document, value put there, and words of the error
REFUSED = """\
extensionsRequired = ["ACME_bend"]  # extension ACME_bend
extensionsUsed = ["AGI_articulations"]  # extension AGI_articulations
extensions = {"CESIUM_RTC": {"center": [1, 2, 3]}}  # extension CESIUM_RTC
bufferViews 0 extensions = {"EXT_meshopt_compression": {}}  # extension EXT_meshopt_compression
nodes 0 extensions = {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": 2}}}  # no triangles
accessors 0 min = [0, 0, -1]  # min of accessor 0 is declared [0.0, 0.0, -1.0], its data have [0.0,
bufferViews 1 byteLength = 34  # 18 elements take 36 bytes, buffer view 1 has 34
bufferViews 1 byteOffset = 64  # buffer view 1 ends after its buffer
buffers = [{"byteLength": 999}]  # buffer 0 declares 999 bytes
buffers = [{"byteLength": 9, "uri": "lost.bin"}]  # there is no file
buffers = [{"byteLength": 9, "uri": "data:;base64,?"}]  # is no base64
accessors 0 count = 4  # index 4, 4 vertices
accessors 1 componentType = 5122  # does not hold unsigned integers
accessors 0 type = "VEC2"  # accessor 0 has 2 components, not 3
meshes 0 primitives 0 indices = 7  # accessor 7 of 3 does not exist
nodes = [{}, {"children": [0]}, {"children": [0]}]  # node 0 is a child twice
nodes = [{"children": [1]}, {"children": [0]}]  # nodes are their own children
scenes = [{"nodes": [0, 0]}]  # a root of the scene twice
scene = 3  # scene 3 of 1 does not exist
nodes 0 matrix = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]  # last row of a node's matrix
nodes 0 weights = [1, 1]  # 2 weights for 0 morph targets
nodes 0 skin = 0  # has no JOINTS_0
nodes 0 mesh = "0"  # nodes.0.mesh
asset = {"version": "1.0"}  # is glTF 1.0
nodes 0 scale = [1e308, 1e308, 1e308]  # vertices are NaN or infinite
nodes 0 scale = [1, 1, 1e999]  # nodes.0.scale
"""


@pytest.mark.parametrize("case", REFUSED.splitlines())
def test_a_document_that_would_be_misread_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    change, _, words = case.partition("  # ")
    place, _, value = change.partition(" = ")
    writer = tent()
    writer.add("accessors", componentType=5126, count=0, type="VEC3", bufferView=0)
    writer.add("skins", joints=[0])
    del writer.tree["accessors"][0]["min"], writer.tree["accessors"][0]["max"]
    replaced(writer, place.split(), json.loads(value))
    with pytest.raises(InputError) as caught:
        read(writer, tmp_path)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_bounds_may_be_printed_with_six_digits(tmp_path: Path) -> None:
    writer = tent()
    replaced(writer, ["accessors", 0, "max"], [4, 3, 5.00001])
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)


def test_joints_count_with_a_skin_alone_and_their_weights_add_up_to_one(tmp_path: Path) -> None:
    writer = skinned()
    writer.tree["accessors"][1]["normalized"] = False  # still weights, though not normalized
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)
    short = np.tile(np.array([64, 150, 0, 0], "<u1"), (5, 1))
    [primitive] = writer.tree["meshes"][0]["primitives"]
    primitive["attributes"]["WEIGHTS_0"] = writer.array(short)
    with pytest.raises(InputError, match="do not add up to one"):
        read(writer, tmp_path)
    del primitive["attributes"]["WEIGHTS_0"]
    writer.tree |= {"skins": [], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)


def test_objects_of_a_document_are_counted_before_they_are_made(tmp_path: Path) -> None:
    path = tmp_path / "many.gltf"
    path.write_text('{"nodes":[' + "{}," * 1_200_000 + "{}]}")
    with pytest.raises(InputError, match="objects of JSON"):
        load_mesh(path)


def test_instances_are_counted_before_they_are_placed(tmp_path: Path) -> None:
    """400 nodes with a thousand instances each: 100 KB that would become 400,000 tents."""
    writer = Writer()
    mesh, moves = writer.tent(), writer.array(np.zeros((1000, 3), "<f4"))
    for _ in range(400):
        extension = {"attributes": {"TRANSLATION": moves}}
        writer.node(mesh=mesh, extensions={INSTANCES: extension})
    path = writer.save(tmp_path / "mesh.glb")
    assert path.stat().st_size < 100_000
    with input_memory(1 << 26), pytest.raises(InputError, match="400 nodes with 400,000 instances"):
        load_mesh(path)


def test_vertices_that_a_primitive_does_not_use_are_left_out(tmp_path: Path) -> None:
    writer = Writer()
    writer.node(mesh=writer.mesh(TENT, TENT_FACES[-3:]))
    mesh = read(writer, tmp_path)
    assert len(mesh.vertices) == 3
    np.testing.assert_array_equal(corners(mesh), PLAIN[-1:])


@pytest.mark.parametrize("name", ["POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0", "inverse"])
def test_sparse_arrays_are_measured_before_they_are_made(name: str, tmp_path: Path) -> None:
    writer = skinned()
    attributes = writer.tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["NORMAL"] = writer.array(TENT)
    inverse = writer.tree["skins"][0]["inverseBindMatrices"]
    accessor = writer.tree["accessors"][attributes.get(name, inverse)]
    at = {"bufferView": accessor.pop("bufferView")}
    accessor |= {"count": 20_000_000, "sparse": {"count": 0, "indices": at, "values": at}}
    tracemalloc.start()
    with input_memory(1 << 26), pytest.raises(InputError):
        read(writer, tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 23
    tracemalloc.stop()


def test_draco_gives_the_triangles_that_were_compressed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draco_py = pytest.importorskip("DracoPy")
    faces = TENT_FACES.reshape(-1, 3).astype(np.uint32)
    data = draco_py.encode(TENT, faces=faces, quantization_bits=24, preserve_order=True)
    writer = tent()
    for accessor in writer.tree["accessors"]:
        del accessor["bufferView"]
    compressed = {"bufferView": writer.view(data), "attributes": {"POSITION": 0}}
    [primitive] = writer.tree["meshes"][0]["primitives"]
    primitive["extensions"] = {"KHR_draco_mesh_compression": compressed}
    writer.tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    step = 5 / 2**24  # 24 bits over the longest side
    np.testing.assert_allclose(corners(read(writer, tmp_path)), PLAIN, atol=step)
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "DracoPy", None)
        with pytest.raises(InputError, match="KHR_draco_mesh_compression needs a package"):
            read(writer, tmp_path)
    writer.tree["accessors"][0]["count"] = 4
    with pytest.raises(InputError, match="has 4 elements, its data 5"):
        read(writer, tmp_path)
    writer.data = writer.data[: -len(data)] + bytes(len(data))
    with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
        read(writer, tmp_path)
