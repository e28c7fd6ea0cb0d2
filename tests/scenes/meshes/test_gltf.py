"""glTF: each feature of a file gives the triangles of its twin, which is written plainly."""

import base64
import json
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote_from_bytes

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.scenes.meshes.soups import assert_reads
from tests.support.gltf_writer import TENT, TENT_FACES, Writer
from xfrustum.scenes import InputError, SceneObject
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.disk.input_files import input_memory
from xfrustum.scenes.meshes.mesh_file import load_mesh

#: Corners of the triangles of `TENT`, where nothing moves it.
PLAIN = TENT.astype(np.float64)[TENT_FACES.reshape(-1, 3)]
ROUNDING = 1e-12  # some ten operations of doubles on values of size one hundred


def corners(mesh: SceneObject) -> Floats:
    """Return the corners of all triangles, (F, 3, 3), in the order of their numbers."""
    return mesh.vertices[mesh.faces]


def read(writer: Writer, folder: Path, name: str = "mesh.glb") -> SceneObject:
    return load_mesh(writer.save(folder / name))


def tent() -> Writer:
    writer = Writer()
    writer.node(mesh=writer.tent())
    return writer


def sparse() -> Writer:
    """Return the tent of zeros, some of which are replaced."""
    writer = Writer()
    rows = np.flatnonzero(TENT.any(axis=1))
    replaced = {
        "count": len(rows),
        "indices": {"bufferView": writer.view(rows.astype("<u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": writer.view(TENT[rows].tobytes())},
    }
    points = writer.array(TENT, sparse=replaced)
    primitive = {"attributes": {"POSITION": points}, "indices": writer.array(TENT_FACES)}
    writer.node(mesh=writer.add("meshes", primitives=[primitive]))
    return writer


def interleaved() -> Writer:
    writer, stored = Writer(), np.full((5, 5), 77, "<f4")
    stored[:, 1:4] = TENT
    points = writer.array(
        TENT, bufferView=writer.view(stored.tobytes(), byteStride=20), byteOffset=4
    )
    primitive = {"attributes": {"POSITION": points}, "indices": writer.array(TENT_FACES)}
    writer.node(mesh=writer.add("meshes", primitives=[primitive]))
    return writer


def skinned() -> Writer:
    """Return the tent hung on two joints that are moved together; its node's place is ignored."""
    writer = Writer()
    joints = writer.array(np.tile(np.array([0, 1, 0, 0], "<u1"), (5, 1)))
    weights = writer.array(np.tile(np.array([64, 191, 0, 0], "<u1"), (5, 1)), normalized=True)
    mesh = writer.tent(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights})
    back = np.eye(4, dtype="<f4")
    back[:3, 3] = (-3, 0, 0)
    binds = writer.array(np.stack([back.T, np.eye(4, dtype="<f4")]).reshape(2, 16))
    moved = writer.node(translation=[3, 0, 0])
    writer.node(mesh=mesh, skin=0, translation=[5, 5, 5], scale=[9, 9, 9])
    writer.add("skins", joints=[moved, writer.node()], inverseBindMatrices=binds)
    return writer


def instanced() -> Writer:
    """Return the tent behind a hidden tent, in one place of an instance undone by its node."""
    writer = Writer()
    mesh = writer.tent()
    attributes = {
        "TRANSLATION": writer.array(np.array([[1, 2, 3]], "<f4")),
        "ROTATION": writer.array(np.array([[0, 0, 32767, 0]], "<i2"), normalized=True),
        "SCALE": writer.array(np.array([[2, 2, 2]], "<f4")),
    }
    undone = [-0.5, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0.5, 0, 0.5, 1, -1.5, 1]
    node = writer.node(mesh=mesh, matrix=undone)
    writer.extend("nodes", node, "EXT_mesh_gpu_instancing", {"attributes": attributes})
    hidden = writer.node(children=[writer.node(mesh=mesh, root=False)])
    writer.extend("nodes", hidden, "KHR_node_visibility", {"visible": False})
    return writer


def below_others() -> Writer:
    """Return the tent below a camera, below a line; its node is in no scene of none."""
    writer = Writer()
    tent = writer.node(mesh=writer.tent(), translation=[-2, 0, 0], root=False)
    camera = writer.node(children=[tent], camera=0, translation=[2, 0, -1], root=False)
    line = writer.mesh(TENT, mode=3)
    writer.node(mesh=line, children=[camera], translation=[0, 0, 1])
    del writer.tree["scenes"], writer.tree["scene"]
    return writer


WRITTEN: dict[str, Callable[[], Writer]] = {
    "sparse without a base": sparse,
    "byteStride": interleaved,
    "skin": skinned,
    "instances and hidden nodes": instanced,
    "below a line and a camera, without scenes": below_others,
}


@pytest.mark.parametrize("feature", WRITTEN)
def test_a_feature_gives_the_triangles_that_are_written_plainly(
    feature: str, tmp_path: Path
) -> None:
    path = WRITTEN[feature]().save(tmp_path / "mesh.glb")
    assert_reads(path, PLAIN, ROUNDING if feature.startswith("instances") else 0.0)
    # In the order of the file; a quaternion turns the instance, and rounds.
    np.testing.assert_allclose(corners(load_mesh(path)), PLAIN, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("kind", ["<i1", "<u1", "<i2", "<u2"])
def test_normalized_integers_are_shares_of_the_largest(kind: str, tmp_path: Path) -> None:
    bounds = np.iinfo(kind)
    stored = np.array([[bounds.min, 0, 0], [bounds.max, 0, 1], [0, bounds.max // 2, 0]], kind)
    writer = Writer()
    points = writer.array(stored, normalized=True)  # its bounds are the stored numbers' bounds
    color = writer.array(np.array([[255, 51, 0]] * 3, "<u1"), normalized=True)
    attributes = {"POSITION": points, "COLOR_0": color}
    writer.node(mesh=writer.add("meshes", primitives=[{"attributes": attributes}]))
    mesh = read(writer, tmp_path)
    np.testing.assert_array_equal(mesh.vertices, np.maximum(stored / bounds.max, -1))
    np.testing.assert_array_equal(mesh.vertex_colors, [[1, 0.2, 0]] * 3)


@pytest.mark.parametrize(
    ("mode", "order", "expected"),
    [
        (5, [0, 1, 2, 3, 4], [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, [0, 1, 2, 3, 4], [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
        (4, [0, 1, 2, 2, 1, 3], [[0, 1, 2], [2, 1, 3]]),
    ],
)
def test_faces_are_those_of_the_specification(
    mode: int, order: list[int], expected: list[list[int]], tmp_path: Path
) -> None:
    """Section 3.7.2.1: the formulas of strips and fans, with indices and without."""
    writer = Writer()
    writer.node(mesh=writer.mesh(TENT, np.array(order, "<u4"), mode=mode))
    assert read(writer, tmp_path).faces.tolist() == expected
    if mode != 4:
        writer = Writer()
        writer.node(mesh=writer.mesh(TENT, mode=mode))
        assert read(writer, tmp_path).faces.tolist() == expected


def test_utm_coordinates_are_rounded_once(tmp_path: Path) -> None:
    writer = Writer()
    far, turn = (500000.123, 4.0e6, -7.25), np.eye(4)
    turn[:3] = [[0, 0, 1, far[0]], [1, 0, 0, far[1]], [0, 1, 0, far[2]]]
    writer.node(mesh=writer.tent(), matrix=turn.T.ravel().tolist())
    vertices = read(writer, tmp_path).vertices
    np.testing.assert_array_equal(vertices, TENT[:, [2, 0, 1]].astype(np.float64) + far)


#: Corners of their own for each triangle, with its normal.
LOOSE = PLAIN.reshape(-1, 3)
CROSS = np.cross(PLAIN[:, 1] - PLAIN[:, 0], PLAIN[:, 2] - PLAIN[:, 0])
NORMALS = np.repeat(CROSS / np.linalg.norm(CROSS, axis=1, keepdims=True), 3, axis=0)
SHEAR = np.array([[1, 0.5, 0, 3], [0, 2, 0, 0], [0.25, 0, -1, 0], [0, 0, 0, 1]])


def loose(**attributes: Any) -> tuple[Writer, int]:
    """Return a writer and the number of a mesh of triangles that share no corners."""
    writer = Writer()
    more = {name: writer.array(np.tile(row, (18, 1))) for name, row in attributes.items()}
    more.setdefault("NORMAL", writer.array(NORMALS.astype("<f4")))
    return writer, writer.mesh(LOOSE.astype("<f4"), attributes=more)


def placed_by_node(**node: Any) -> Writer:
    writer, mesh = loose()
    writer.node(mesh=mesh, **node)
    return writer


def placed_by_instances() -> Writer:
    writer, mesh = loose()
    node = writer.node(mesh=mesh, rotation=[0, 0, 0.5**0.5, 0.5**0.5])
    sizes = writer.array(np.array([[1, 3, 1], [-1, 1, 1]], "<f4"))
    writer.extend("nodes", node, "EXT_mesh_gpu_instancing", {"attributes": {"SCALE": sizes}})
    return writer


def placed_by_joint(scale: tuple[int, int, int]) -> Writer:
    first = np.array([1, 0, 0, 0])
    writer, mesh = loose(JOINTS_0=(first * 0).astype("<u1"), WEIGHTS_0=first.astype("<f4"))
    joint = writer.node(scale=scale, rotation=[1, 0, 0, 0])
    writer.add("skins", joints=[joint])
    writer.node(mesh=mesh, skin=0)
    return writer


def quantized() -> Writer:
    writer, mesh = loose()
    stored = writer.array(np.rint(NORMALS * 127).astype("<i1"), normalized=True)
    writer.tree["meshes"][mesh]["primitives"][0]["attributes"]["NORMAL"] = stored
    writer.node(mesh=mesh)
    return writer


@pytest.mark.parametrize(
    "make",
    [
        lambda: placed_by_node(scale=[-1, 5, 0.2]),
        lambda: placed_by_node(matrix=SHEAR.T.ravel().tolist()),
        placed_by_instances,
        lambda: placed_by_joint((1, 4, 1)),
        lambda: placed_by_joint((-1, 4, 1)),
        quantized,
    ],
    ids=["uneven mirror", "sheared", "instances", "joint", "mirrored joint", "quantized"],
)
def test_normals_follow_the_surface_through_every_placement(
    make: Callable[[], Writer], tmp_path: Path
) -> None:
    """Faces look outward, on the side of their normals: they enclose a positive volume."""
    mesh = read(make(), tmp_path)
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    cosines = np.einsum("fk,fck->fc", across, mesh.vertex_normals[mesh.faces])
    # Rounding of a quantized normal, 0.5 / 127 a component: 1 - cos < (sqrt(3) / 254)^2 / 2.
    assert np.abs(cosines - 1).max() < 3e-5
    middle = corners(mesh).reshape(-1, 18, 3).mean(axis=1)  # of each instance
    outward = (a + b + c) / 3 - np.repeat(middle, 6, axis=0)
    assert np.einsum("fk,fk->f", outward, across).sum() > 0


def test_nodes_are_numbered_as_trimesh_numbers_them(tmp_path: Path) -> None:
    """Random trees, with mirrors and meshes of two primitives.

    Matrices of three and more levels are multiplied in another order, so that vertices round
    otherwise.
    """
    chance = np.random.default_rng(51)
    for number in range(12):
        writer = Writer()
        meshes = [writer.tent(), writer.mesh(TENT * np.float32(0.3), TENT_FACES[:9]), writer.tent()]
        writer.tree["meshes"][2]["primitives"] *= 2
        for index in range(9):
            placed = {
                "translation": chance.normal(size=3).tolist(),
                "scale": chance.normal(size=3).tolist(),
            }
            rotation = chance.normal(size=4)
            node = writer.node(
                rotation=(rotation / np.linalg.norm(rotation)).tolist(), **placed, root=False
            )
            if chance.random() < 0.8:
                writer.tree["nodes"][node]["mesh"] = meshes[chance.integers(3)]
            parent = chance.integers(-2, index) if index else -1
            of = writer.tree["scenes"][0]["nodes"] if parent < 0 else None
            (writer.tree["nodes"][parent].setdefault("children", []) if of is None else of).append(
                node
            )
        path = writer.save(tmp_path / f"{number}.glb")
        ours, theirs = load_mesh(path), trimesh.load_scene(str(path), process=False).to_mesh()
        np.testing.assert_array_equal(ours.faces, theirs.faces)
        np.testing.assert_allclose(ours.vertices, theirs.vertices, rtol=0, atol=ROUNDING)


# Where data lie.


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


# Colors and textures.


def test_a_texture_is_placed_by_its_own_coordinates_and_transform(tmp_path: Path) -> None:
    """The example of KHR_texture_transform: the image's lower left quadrant, a quarter turned."""
    Image.new("RGB", (4, 4), (1, 2, 3)).save(tmp_path / "a b.png")
    writer = Writer()
    writer.add("images", uri="a%20b.png")
    writer.add("textures", source=0)
    first, second = (
        np.array(uv, "<f4") for uv in ([[9, 9]] * 5, [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    )
    info: dict[str, Any] = {"index": 0, "texCoord": 1}
    writer.add("materials", pbrMetallicRoughness={"baseColorTexture": info})
    attributes = {"TEXCOORD_0": writer.array(first), "TEXCOORD_1": writer.array(second)}
    writer.node(mesh=writer.tent(material=0, attributes=attributes))
    plain = read(writer, tmp_path)
    assert plain.unread == () and len(plain.textures) == 1
    np.testing.assert_array_equal(plain.uv, [[0, 1], [1, 1], [1, 0], [0, 0], [0, 1]])
    transform = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    info["extensions"] = {"KHR_texture_transform": transform}
    turned = read(writer, tmp_path)
    expected = np.array([[0, 1], [0, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]])  # v down, as glTF counts
    np.testing.assert_allclose(turned.uv, expected * (1, -1) + (0, 1), atol=1e-15)
    transform["texCoord"] = 0
    assert read(writer, tmp_path).uv[0].tolist() == pytest.approx([4.5, 4.5])


@pytest.mark.parametrize(
    ("extension", "content", "chosen"),
    [
        ("EXT_texture_webp", {"source": 1}, 1),
        ("EXT_texture_webp", {}, 0),
        ("KHR_texture_basisu", {"source": 1}, 0),
        ("EXT_foo", {}, 0),
    ],
)
def test_a_texture_is_the_image_of_an_extension_that_is_honoured(
    extension: str, content: dict[str, int], chosen: int, tmp_path: Path
) -> None:
    writer = painted(tmp_path)
    writer.add("images", uri="1.png")
    Image.new("RGB", (4, 4), (1, 1, 1)).save(tmp_path / "1.png")
    writer.extend("textures", 0, extension, content)
    [texture] = read(writer, tmp_path).textures
    assert texture[0, 0, 0] == chosen


def painted(folder: Path) -> Writer:
    """Return a tent with a texture."""
    Image.new("RGB", (4, 4)).save(folder / "0.png")
    writer = Writer()
    writer.add("images", uri="0.png")
    writer.add("textures", source=0)
    material = writer.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    attributes = {"TEXCOORD_0": writer.array(np.zeros((5, 2), "<f4"))}
    writer.node(mesh=writer.tent(material=material, attributes=attributes))
    return writer


# Unread and refused.


def test_features_that_change_no_triangle_are_listed(tmp_path: Path) -> None:
    writer = Writer()
    writer.add("samplers", wrapS=33071)
    writer.add("textures", sampler=0)
    writer.add(
        "materials",
        extensions={"KHR_materials_sheen": {}},
        alphaMode="MASK",
        normalTexture={"index": 0},
        pbrMetallicRoughness={"baseColorTexture": {"index": 0}},
    )
    mesh = writer.tent(material=0)
    writer.tree["meshes"][mesh]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 0})
    writer.node(mesh=mesh)
    writer.tree["extensionsUsed"] = ["KHR_materials_sheen", "ACME_dust", "KHR_node_visibility"]
    writer.add("animations", channels=[])
    lines = [str(feature) for feature in read(writer, tmp_path).unread]
    assert lines == [
        "KHR_materials_sheen is not shown: materials are those of the scene file",
        "ACME_dust is not read",
        "animations are not played: all is at rest",
        "alphaMode MASK is not applied: surfaces are opaque",
        "normalTexture is not shown",
        "wrap mode of a sampler is not applied: textures repeat",
        "points and lines are not shown",
        "texture number 0 without an image is missing; the surface is drawn without it",
    ]


def changed(*path: Any, to: Any) -> Callable[[Writer], None]:
    """Return the change of one value of a document."""

    def change(writer: Writer) -> None:
        at: Any = writer.tree
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = to

    return change


def draco(writer: Writer) -> None:
    compressed = {"bufferView": 0, "attributes": {"POSITION": 0}}
    extensions = {"KHR_draco_mesh_compression": compressed}
    writer.tree["meshes"][0]["primitives"][0]["extensions"] = extensions
    for accessor in writer.tree["accessors"]:
        del accessor["bufferView"]


def no_instances(writer: Writer) -> None:
    none = writer.add("accessors", componentType=5126, count=0, type="VEC3", bufferView=0)
    extension = {"attributes": {"TRANSLATION": none}}
    writer.extend("nodes", 0, "EXT_mesh_gpu_instancing", extension)


REFUSED: dict[str, Callable[[Writer], None]] = {
    "the mesh has no triangles": no_instances,
    "extension ACME_bend": changed("extensionsRequired", to=["ACME_bend"]),
    "extension CESIUM_RTC": changed("extensions", to={"CESIUM_RTC": {"center": [1, 2, 3]}}),
    "extension EXT_meshopt_compression": changed(
        "bufferViews", 0, "extensions", to={"EXT_meshopt_compression": {}}
    ),
    "extension AGI_articulations": changed("extensionsUsed", to=["AGI_articulations"]),
    "KHR_draco_mesh_compression needs a package": draco,
    "min of accessor 0 is declared [0.0, 0.0, -1.0], its data have [0.0, 0.0, 0.0]": changed(
        "accessors", 0, "min", to=[0, 0, -1]
    ),
    "18 elements take 36 bytes, buffer view 1 has 34": changed(
        "bufferViews", 1, "byteLength", to=34
    ),
    "buffer view 1 ends after its buffer": changed("bufferViews", 1, "byteOffset", to=64),
    "buffer 0 declares 999 bytes": changed("buffers", to=[{"byteLength": 999}]),
    "there is no file": changed("buffers", to=[{"byteLength": 9, "uri": "lost.bin"}]),
    "is no base64": changed("buffers", to=[{"byteLength": 9, "uri": "data:;base64,?"}]),
    "index 4, 4 vertices": changed("accessors", 0, to={
        "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}),
    "does not hold unsigned integers": changed("accessors", 1, "componentType", to=5122),
    "accessor 0 has 2 components, not 3": changed("accessors", 0, "type", to="VEC2"),
    "accessor 7 of 2 does not exist": changed("meshes", 0, "primitives", 0, "indices", to=7),
    "node 0 is a child twice": changed("nodes", to=[{}, {"children": [0]}, {"children": [0]}]),
    "nodes are their own children": changed("nodes", to=[{"children": [1]}, {"children": [0]}]),
    "a root of the scene twice": changed("scenes", to=[{"nodes": [0, 0]}]),
    "scene 3 of 1 does not exist": changed("scene", to=3),
    "last row of a node's matrix": changed("nodes", 0, "matrix", to=[1.0] * 16),
    "2 weights for 0 morph targets": changed("nodes", 0, "weights", to=[1, 1]),
    "has no JOINTS_0": lambda writer: writer.tree.update(
        skins=[{"joints": [0]}], nodes=[{"mesh": 0, "skin": 0}]
    ),
    "nodes.0.mesh": changed("nodes", 0, "mesh", to="0"),
    "is glTF 1.0": changed("asset", to={"version": "1.0"}),
    "nodes.0.scale": changed("nodes", 0, "scale", to=[1, 1, 1e999]),
    "textures.0.extensions.EXT_texture_webp": changed("textures", to=[
        {"extensions": {"EXT_texture_webp": {"source": 1e999}}}]),
    "vertices are NaN or infinite": changed("nodes", 0, "scale", to=[1e308] * 3),
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_would_be_misread_is_refused_in_one_line(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    writer = tent()
    REFUSED[words](writer)
    with pytest.raises(InputError) as caught:
        read(writer, tmp_path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bounds_may_be_printed_with_six_digits(tmp_path: Path) -> None:
    writer = tent()
    changed("accessors", 0, "max", to=[4, 3, 5.00001])(writer)
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)


def test_weights_of_joints_add_up_to_one(tmp_path: Path) -> None:
    writer = skinned()
    writer.tree["accessors"][1]["normalized"] = False  # shares all the same
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)
    writer = Writer()
    joints = writer.array(np.zeros((5, 4), "<u1"))
    weights = writer.array(np.full((5, 4), 0.2, "<f4"))
    mesh = writer.tent(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights})
    writer.add("skins", joints=[writer.node(mesh=mesh, skin=0)])
    with pytest.raises(InputError, match="do not add up to one"):
        read(writer, tmp_path)


def places(tree: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value of a document."""
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield (*at, key)
        if isinstance(value, dict | list):
            yield from places(value, (*at, key))


STRANGE: tuple[Any, ...] = (None, True, "7", -1, 3, 1.5, 10**30, 1e300, [], {}, [9] * 16)


@pytest.mark.parametrize("make", [skinned, instanced, sparse], ids=lambda make: make.__name__)
def test_values_of_any_type_end_in_a_mesh_or_in_one_line(
    make: Callable[[], Writer], tmp_path: Path
) -> None:
    """Every value of three documents replaced by values of some JSON types, one at a time."""
    writer = make()
    text = writer.save(tmp_path / "mesh.gltf").read_text()
    outcomes = [0, 0]
    for number, path in enumerate(places(json.loads(text))):
        for strange in STRANGE[number % 4 :: 4]:  # three or two of the values at each place
            writer.tree = json.loads(text)
            changed(*path, to=strange)(writer)
            try:
                read(writer, tmp_path, "mesh.gltf")
                outcomes[0] += 1
            except InputError as error:
                assert "\n" not in str(error)
                outcomes[1] += 1
    assert min(outcomes) > 0


def test_a_text_nested_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.gltf"
    path.write_text('{"extras":' * 200_000)
    with pytest.raises(InputError, match="recursion"):
        load_mesh(path)
    path.write_text('{"nodes":[' + "{}," * 1_200_000 + "{}]}")
    with pytest.raises(InputError, match="objects of JSON"):
        load_mesh(path)


def test_instances_are_counted_before_they_are_placed(tmp_path: Path) -> None:
    """400 nodes with a thousand instances each: 100 KB that become 400,000 tents."""
    writer = Writer()
    mesh, places = writer.tent(), writer.array(np.zeros((1000, 3), "<f4"))
    for _ in range(400):
        extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
        writer.node(mesh=mesh, extensions=extension)
    path = writer.save(tmp_path / "mesh.glb")
    assert path.stat().st_size < 100_000
    with input_memory(1 << 26), pytest.raises(InputError, match="400 nodes with 400,000 instances"):
        load_mesh(path)


def test_vertices_that_a_primitive_does_not_use_are_left_out(tmp_path: Path) -> None:
    """A hundred primitives share 20,000 vertices."""
    writer, count = Writer(), 20_000
    points = np.random.default_rng(4).normal(size=(count, 3)).astype("<f4")
    mesh = writer.mesh(points, attributes={"NORMAL": writer.array(points)})
    [primitive] = writer.tree["meshes"][mesh].pop("primitives")
    faces = np.arange(count - count % 3, dtype="<u4").reshape(-1, 3)[:, ::-1]
    writer.tree["meshes"][mesh]["primitives"] = [
        {**primitive, "indices": writer.array(own.ravel())} for own in np.array_split(faces, 100)
    ]
    writer.node(mesh=mesh)
    with input_memory(1 << 26):
        whole = read(writer, tmp_path)
    assert len(whole.vertices) == faces.size
    np.testing.assert_array_equal(corners(whole), points[faces])
    assert whole.vertex_normals is not None
    normals = points[faces] / np.linalg.norm(points[faces], axis=-1, keepdims=True)
    np.testing.assert_allclose(whole.vertex_normals[whole.faces], normals, atol=1e-6)


def test_a_texture_of_many_primitives_and_materials_is_one_picture(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4)).save(tmp_path / "0.png")
    writer = Writer()
    writer.add("images", uri="0.png")
    writer.add("textures", source=0)
    for _ in range(2):
        writer.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    mesh = writer.tent(attributes={"TEXCOORD_0": writer.array(np.zeros((5, 2), "<f4"))})
    [primitive] = writer.tree["meshes"][mesh]["primitives"]
    primitives = [{**primitive, "material": material} for material in (0, 0, 1)]
    writer.tree["meshes"][mesh]["primitives"] = primitives
    writer.node(mesh=mesh)
    whole = read(writer, tmp_path)
    assert len(whole.textures) == 1
    assert whole.texture_of_triangle is not None and not whole.texture_of_triangle.any()


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


def test_joints_count_only_where_there_is_a_skin(tmp_path: Path) -> None:
    writer = skinned()
    del writer.tree["skins"], writer.tree["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]
    writer.tree["nodes"] = [{"mesh": 0}] * len(writer.tree["nodes"])
    writer.tree["scenes"] = [{"nodes": [0]}]
    np.testing.assert_array_equal(corners(read(writer, tmp_path)), PLAIN)


def test_draco_gives_the_triangles_that_were_compressed(tmp_path: Path) -> None:
    draco_py = pytest.importorskip("DracoPy")
    faces = TENT_FACES.reshape(-1, 3).astype(np.uint32)
    data = draco_py.encode(TENT, faces=faces, quantization_bits=24, preserve_order=True)
    writer = Writer()
    points = writer.array(TENT, bufferView=None)
    indices = writer.array(TENT_FACES.astype("<u4"), bufferView=None)
    compressed = {"bufferView": writer.view(data), "attributes": {"POSITION": 0}}
    extensions = {"KHR_draco_mesh_compression": compressed}
    primitive = {"attributes": {"POSITION": points}, "indices": indices, "extensions": extensions}
    writer.node(mesh=writer.add("meshes", primitives=[primitive]))
    writer.tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    step = 5 / 2**24  # of the longest side
    np.testing.assert_allclose(corners(read(writer, tmp_path)), PLAIN, atol=step)
    writer.tree["accessors"][points]["count"] = 4
    with pytest.raises(InputError, match="has 4 elements, its data 5"):
        read(writer, tmp_path)
    writer.data = writer.data[:40] + bytes(len(writer.data) - 40)
    with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
        read(writer, tmp_path)
