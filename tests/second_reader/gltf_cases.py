"""Small glTF files for the neighbours of each known fault, with their shapes in closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tests.second_reader import making
from tests.second_reader.making import CORNERS, FACES, SOUP, Case, Gltf, case, moved, scale, shift

BYTE, UBYTE, SHORT, USHORT = making.BYTE, making.UBYTE, making.SHORT, making.USHORT
UINT, FLOAT = making.UINT, making.FLOAT
INSTANCING = "EXT_mesh_gpu_instancing"
HALF_TURN_X, HALF_TURN_Z = (1, 0, 0, 0), (0, 0, 1, 0)
TURN_X, TURN_Z = np.diag([1.0, -1, -1, 1]), np.diag([-1.0, -1, 1, 1])
QUARTER = [0, 0, 0.5**0.5, 0.5**0.5]


def columns(matrix: ArrayLike) -> list[float]:
    """Return a matrix as glTF stores it."""
    numbers: list[float] = np.asarray(matrix, dtype=np.float64).T.ravel().tolist()
    return numbers


def plain(**node: Any) -> tuple[Gltf, int]:
    """Return a file with the four triangles in one node."""
    file = Gltf()
    return file, file.node(mesh=file.mesh(), **node)


def cases() -> list[Case]:
    """Return all cases."""
    makers: list[Callable[[], Iterator[Case]]] = [
        topologies, indices, nodes, instances, skins, morphs, sparse, strides, normalized, visibility,
        scenes, containers, refusals,
    ]  # fmt: skip
    return [one for maker in makers for one in maker()]


def topologies() -> Iterator[Case]:
    ribbon = np.array([[x, (x % 2) * 2, x * x] for x in range(7)], dtype=np.float64)
    for count in (3, 4, 5, 6, 7):
        file = Gltf()
        file.node(mesh=file.mesh(file.positions(ribbon[:count]), -1, mode=5))
        strip = [ribbon[[i, i + 1 + i % 2, i + 2 - i % 2]] for i in range(count - 2)]
        yield case(f"strip{count}.glb", file.glb(), strip)
        file = Gltf()
        order = list(range(count))[::-1]
        file.node(mesh=file.mesh(file.positions(ribbon[:count]), file.indices(order), mode=6))
        fan = [ribbon[[order[i + 1], order[i + 2], order[0]]] for i in range(count - 2)]
        yield case(f"fan{count}.glb", file.glb(), fan)
    file = Gltf()
    file.node(mesh=file.mesh(file.positions(ribbon[:5]), -1, mode=5), scale=[-2, 1, 1])
    strip = [ribbon[[i, i + 1 + i % 2, i + 2 - i % 2]] for i in range(3)]
    yield case("strip_mirrored.glb", file.glb(), moved(scale(-2, 1, 1), np.array(strip)))
    file = Gltf()
    file.node(
        mesh=file.mesh(file.positions(ribbon), file.indices([0, 1, 2, 2, 3, 3, 4, 5]), mode=5)
    )
    walk = [[0, 1, 2], [1, 2, 2], [2, 2, 3], [2, 3, 3], [3, 3, 4], [3, 5, 4]]
    yield case("strip_joined_by_degenerates.glb", file.glb(), ribbon[walk])
    file = Gltf()
    file.node(mesh=file.mesh(file.positions(CORNERS[FACES].reshape(-1, 3)), -1))
    yield case("no_indices.glb", file.glb())
    file = Gltf()
    positions = file.positions()
    attributes = {"POSITION": positions}
    lines = [{"attributes": attributes, "mode": mode} for mode in (0, 1, 2, 3)]
    triangles = {"attributes": attributes, "indices": file.indices()}
    fan_of_all = {"attributes": attributes, "mode": 6}
    file.node(
        mesh=file.add("meshes", primitives=[*lines, triangles, {"attributes": {}}, fan_of_all])
    )
    yield case("lines_between.glb", file.glb(), [*SOUP, CORNERS[[1, 2, 0]], CORNERS[[2, 3, 0]]])


def indices() -> Iterator[Case]:
    for name, kind in (("ubyte", UBYTE), ("ushort", USHORT), ("uint", UINT)):
        file = Gltf()
        file.node(mesh=file.mesh(indices=file.indices(kind=kind)))
        yield case(f"indices_{name}.glb", file.glb())


def nodes() -> Iterator[Case]:
    yield case("mirrored_scale.glb", plain(scale=[-1, 2, 1])[0].glb(), moved(scale(-1, 2, 1)))
    shear = shift(1, 2, 3) @ np.array(
        [[1, 0.5, 0, 0], [0, 2, 0, 0], [0.25, 0, -1, 0], [0, 0, 0, 1]]
    )
    yield case("matrix_shear_mirrored.glb", plain(matrix=columns(shear))[0].glb(), moved(shear))
    file, child = plain(scale=[1, -1, 1], translation=[1, 0, 0])
    file.node(children=[child], scale=[-1, 1, 1], translation=[0, 5, 0])
    twice = shift(0, 5, 0) @ scale(-1, 1, 1) @ shift(1, 0, 0) @ scale(1, -1, 1)
    yield case("mirrored_twice.glb", file.glb(), moved(twice))
    file, child = plain(rotation=QUARTER, scale=[1, 2, 3], translation=[7, 0, 0])
    middle = file.node(children=[child], rotation=HALF_TURN_X)
    file.node(children=[middle], translation=[0, 0, 0.5], scale=[2, 2, 2])
    deep = (
        shift(0, 0, 0.5)
        @ scale(2, 2, 2)
        @ TURN_X
        @ shift(7, 0, 0)
        @ making.quarter_turn()
        @ scale(1, 2, 3)
    )
    yield case("three_deep.glb", file.glb(), moved(deep))
    east, north = 500_000.123456789, 5_412_345.987654321
    place = shift(east, north, 431.5)
    yield case("utm.glb", plain(translation=[east, north, 431.5])[0].glb(), moved(place))
    file = Gltf(cameras=[{"type": "orthographic"}], extensionsUsed=["KHR_lights_punctual"])
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    below = file.node(mesh=file.mesh(), translation=[0, 0, 1])
    light = {"KHR_lights_punctual": {"light": 0}}
    file.node(camera=0, children=[below], translation=[2, 0, 0], extensions=light)
    yield case("below_camera_and_light.glb", file.glb(), moved(shift(2, 0, 1)))
    file = Gltf()
    mesh = file.mesh()
    file.node(mesh=mesh, name="", translation=[1, 0, 0])
    file.node(mesh=mesh, name="", translation=[0, 1, 0])
    file.node(mesh=mesh, name="world")
    all_three = [moved(shift(1, 0, 0)), moved(shift(0, 1, 0)), SOUP]
    yield case("names_alike.glb", file.glb(), np.concatenate(all_three))


def instances() -> Iterator[Case]:
    def instanced(**attributes: int) -> dict[str, Any]:
        return {INSTANCING: {"attributes": attributes}}

    places = [[0, 0, 0], [10, 0, 0], [0, 10, 2]]
    for needed in (False, True):
        file = Gltf(
            extensionsUsed=[INSTANCING], **({"extensionsRequired": [INSTANCING]} if needed else {})
        )
        extension = instanced(TRANSLATION=file.accessor(places))
        file.node(mesh=file.mesh(), extensions=extension)
        soup = np.concatenate([moved(shift(*place)) for place in places])
        yield case(f"instances_{'required' if needed else 'used'}.glb", file.glb(), soup)
    for name, kind, one in (("byte", BYTE, 127), ("short", SHORT, 32767), ("float", FLOAT, 1)):
        file = Gltf(extensionsUsed=[INSTANCING])
        turns = np.array([HALF_TURN_Z, HALF_TURN_X, (0, 0, 0, 1)]) * one
        normal = {} if kind == FLOAT else {"normalized": True}
        sizes = np.array([[1.0, 2, 3], [-1, 1, 1], [0.5, 0.5, 0.5]])
        extension = instanced(
            TRANSLATION=file.accessor(places),
            ROTATION=file.accessor(turns, (kind, "VEC4"), **normal),
            SCALE=file.accessor(sizes),
            _ID=file.accessor([1, 2, 3], (FLOAT, "SCALAR")),
        )
        child = file.node(mesh=file.mesh(), translation=[0, 0, 100])
        inner = file.node(mesh=0, extensions=extension, translation=[1, 0, 0], children=[child])
        file.node(children=[inner], rotation=QUARTER, scale=[1, -1, 1])
        above = making.quarter_turn() @ scale(1, -1, 1) @ shift(1, 0, 0)
        each = [
            shift(*places[0]) @ TURN_Z @ scale(1, 2, 3),
            shift(*places[1]) @ TURN_X @ scale(-1, 1, 1),
            shift(*places[2]) @ scale(0.5, 0.5, 0.5),
        ]
        four = [moved(above @ one) for one in [*each, shift(0, 0, 100)]]
        yield case(f"instances_nested_{name}.glb", file.glb(), np.concatenate(four))


def skins() -> Iterator[Case]:
    def influence(
        file: Gltf, joints: ArrayLike, weights: ArrayLike, kinds: tuple[int, int], number: int = 0
    ) -> Any:
        normal = {} if kinds[1] == FLOAT else {"normalized": True}
        return {
            f"JOINTS_{number}": file.accessor(joints, (kinds[0], "VEC4")),
            f"WEIGHTS_{number}": file.accessor(weights, (kinds[1], "VEC4"), **normal),
        }

    outer, inner = shift(0, 0, 2) @ making.quarter_turn(), scale(2, 1, 1)
    back = [scale(1, 1, 0.5) @ shift(1, 0, 0), shift(0, -4, 0)]
    full = {UBYTE: 255, USHORT: 65535, FLOAT: 1}
    for name, kinds in (
        ("float", (UBYTE, FLOAT)),
        ("ubyte", (USHORT, UBYTE)),
        ("ushort", (UBYTE, USHORT)),
    ):
        file = Gltf()
        rows = [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]]
        shares = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]]) * full[kinds[1]]
        mesh = file.mesh(attributes=influence(file, rows, shares, kinds))
        joint = file.node(scale=[2, 1, 1])
        top = file.node(children=[joint], translation=[0, 0, 2], rotation=QUARTER)
        matrices = file.accessor([columns(one) for one in back], (FLOAT, "MAT4"))
        file.add("skins", joints=[top, joint], inverseBindMatrices=matrices)
        file.node(mesh=mesh, skin=0, translation=[50, 0, 0], scale=[3, 3, 3])
        placed = [outer @ back[0], outer @ inner @ back[1]]
        chosen = [0, 1, 0, 0]
        corners = [
            (placed[j] @ [*corner, 1])[:3] for j, corner in zip(chosen, CORNERS, strict=True)
        ]
        yield case(f"skin_{name}.glb", file.glb(), np.array(corners)[FACES])
    file = Gltf()
    ends = [file.node(translation=[0, 0, 8 * k]) for k in range(6)]
    first = influence(file, [[0, 1, 2, 3]] * 4, [[0.25, 0.25, 0.125, 0.125]] * 4, (UBYTE, FLOAT))
    second = influence(file, [[4, 5, 0, 0]] * 4, [[0.125, 0.125, 0, 0]] * 4, (UBYTE, FLOAT), 1)
    mesh = file.mesh(attributes={**first, **second})
    file.add("skins", joints=ends)
    file.node(mesh=mesh, skin=0)
    middle = 8 * (0.25 * 1 + 0.125 * (2 + 3 + 4 + 5))
    yield case("skin_six_joints.glb", file.glb(), moved(shift(0, 0, middle)))
    file = Gltf(extensionsUsed=["KHR_node_visibility"])
    joint = file.node(translation=[0, 3, 0], extensions={"KHR_node_visibility": {"visible": False}})
    every = influence(file, [[0] * 4] * 4, [[1, 0, 0, 0]] * 4, (UBYTE, FLOAT))
    target = [{"POSITION": file.accessor([[0, 0, 0], [0, 0, 0], [0, 0, 4], [0, 0, 0]])}]
    mesh = file.mesh(attributes=every, targets=target, weights=[0.5])
    file.add("skins", joints=[joint])
    below = file.node(mesh=mesh, skin=0)
    file.node(children=[below], translation=[9, 9, 9])
    morphed = CORNERS + np.array([[0, 3, 0], [0, 3, 0], [0, 3, 2], [0, 3, 0]])
    yield case("skin_morphed_below_a_moved_node.glb", file.glb(), morphed[FACES])


def morphs() -> Iterator[Case]:
    first = np.array([[1, 0, 0], [0, 0, 0], [0, 2, 0], [0, 0, 0]], dtype=np.float64)
    second = np.array([[0, 0, 0], [0, 0, 4], [0, 0, 0], [0, 0, -8]], dtype=np.float64)

    def file_of(node: dict[str, Any], **mesh: Any) -> bytes:
        file = Gltf()
        targets = [
            {"POSITION": file.accessor(first)},
            {"NORMAL": file.accessor(first), "POSITION": file.accessor(second)},
        ]
        file.node(mesh=file.mesh(targets=targets, **mesh), **node)
        return file.glb()

    yield case(
        "morph_of_mesh.glb",
        file_of({}, weights=[0.5, 0.25]),
        (CORNERS + first / 2 + second / 4)[FACES],
    )
    own = file_of({"weights": [-1, 0]}, weights=[0.5, 0.25])
    yield case("morph_of_node.glb", own, (CORNERS - first)[FACES])
    yield case("morph_without_weights.glb", file_of({}))
    file = Gltf(
        extensionsUsed=["KHR_mesh_quantization"], extensionsRequired=["KHR_mesh_quantization"]
    )
    whole = np.rint(CORNERS * 6553).astype(int)
    base = file.positions(whole, SHORT, normalized=True)
    target = file.accessor(
        [[127, 0, 0], [0, -127, 0], [0, 0, 64], [0, 0, 0]], (BYTE, "VEC3"), normalized=True
    )
    file.node(
        mesh=file.mesh(base, targets=[{"POSITION": target}], weights=[0.5]), scale=[10, 10, 10]
    )
    added = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 64 / 127], [0, 0, 0]])
    yield case("morph_normalized.glb", file.glb(), ((whole / 32767 + added / 2) * 10)[FACES])
    file = Gltf()
    far = {"count": 1, "indices": {"bufferView": file.view(b"\2"), "componentType": UBYTE}}
    far["values"] = {"bufferView": file.view(np.array([0, 0, 6], "<f4").tobytes())}
    target = file.add("accessors", componentType=FLOAT, type="VEC3", count=4, sparse=far)
    file.node(mesh=file.mesh(targets=[{"POSITION": target}], weights=[0.5]))
    yield case(
        "morph_sparse.glb", file.glb(), (CORNERS + np.diag([0, 0, 3, 0])[:, [0, 1, 2]])[FACES]
    )


def sparse() -> Iterator[Case]:
    new = np.array([[9, 8, 7], [-3, 2, 1]], dtype=np.float64)
    changed = CORNERS.copy()
    changed[[1, 3]] = new
    for name, kind in (("ubyte", "u1"), ("ushort", "<u2"), ("uint", "<u4")):
        for based in (True, False):
            file = Gltf()
            places = file.view(bytes(4) + np.array([1, 3], kind).tobytes())
            values = file.view(bytes(8) + new.astype("<f4").tobytes())
            code = {"u1": UBYTE, "<u2": USHORT, "<u4": UINT}[kind]
            entry: dict[str, Any] = {
                "count": 2,
                "indices": {"bufferView": places, "byteOffset": 4, "componentType": code},
                "values": {"bufferView": values, "byteOffset": 8},
            }
            result = (
                changed if based else np.where(np.isin(np.arange(4), [1, 3])[:, None], changed, 0.0)
            )
            bounds = {"min": result.min(axis=0).tolist(), "max": result.max(axis=0).tolist()}
            if based:
                positions = file.positions(**bounds, sparse=entry)
            else:
                positions = file.add(
                    "accessors", componentType=FLOAT, type="VEC3", count=4, sparse=entry, **bounds
                )
            file.node(mesh=file.mesh(positions))
            yield case(
                f"sparse_{name}_{'on_a_view' if based else 'on_zeros'}.glb",
                file.glb(),
                result[FACES],
            )
    file = Gltf()
    entry = {
        "count": 3,
        "indices": {"bufferView": file.view(bytes([3, 4, 5])), "componentType": UBYTE},
    }
    entry["values"] = {"bufferView": file.view(bytes([0, 1, 3]))}
    start = FACES.copy()
    start[1] = 0
    names = file.accessor(start.ravel(), (UBYTE, "SCALAR"), sparse=entry)
    file.node(mesh=file.mesh(indices=names))
    yield case("sparse_indices_of_triangles.glb", file.glb())
    file = Gltf(
        extensionsUsed=["KHR_mesh_quantization"], extensionsRequired=["KHR_mesh_quantization"]
    )
    entry = {"count": 1, "indices": {"bufferView": file.view(bytes([3])), "componentType": UBYTE}}
    entry["values"] = {"bufferView": file.view(bytes([255, 0, 51]))}
    whole = np.array([[0, 0, 0], [255, 0, 0], [0, 102, 0], [1, 2, 3]])
    final = np.array([[0, 0, 0], [255, 0, 0], [0, 102, 0], [255, 0, 51]])
    bounds = {"min": final.min(axis=0).tolist(), "max": final.max(axis=0).tolist()}
    positions = file.positions(whole, UBYTE, normalized=True, sparse=entry, **bounds)
    file.node(mesh=file.mesh(positions))
    yield case("sparse_normalized.glb", file.glb(), (final / 255)[FACES])


def strides() -> Iterator[Case]:
    file = Gltf()
    row = np.zeros((4, 9), "<f4")  # normal, position, texture, one number of nobody
    row[:, 3:6], row[:, 2], row[:, 6:8], row[:, 8] = (
        CORNERS,
        1,
        [[0, 0], [1, 0], [1, 1], [0, 1]],
        np.nan,
    )
    view = file.view(bytes(12) + row.tobytes(), byteStride=36)
    bounds = {"min": CORNERS.min(axis=0).tolist(), "max": CORNERS.max(axis=0).tolist()}
    parts = {"NORMAL": ("VEC3", 12), "POSITION": ("VEC3", 24), "TEXCOORD_0": ("VEC2", 36)}
    attributes = {}
    for name, (shape, offset) in parts.items():
        more: dict[str, Any] = bounds if name == "POSITION" else {}
        entry = {
            "bufferView": view,
            "byteOffset": offset,
            "componentType": FLOAT,
            "type": shape,
            "count": 4,
            **more,
        }
        attributes[name] = file.add("accessors", **entry)
    file.node(mesh=file.mesh(attributes["POSITION"], attributes=attributes))
    # The last row ends with the buffer: 4 rows of 36 bytes after 12, less the number of nobody.
    file.json["bufferViews"][view]["byteLength"] -= 4
    yield case("interleaved.glb", file.glb())


def normalized() -> Iterator[Case]:
    top = {
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
    }
    for name, kind, largest in (
        ("byte", BYTE, 127),
        ("ubyte", UBYTE, 255),
        ("short", SHORT, 32767),
        ("ushort", USHORT, 65535),
    ):
        file = Gltf(**top)
        whole = np.rint(CORNERS / 5 * largest).astype(int)
        file.node(
            mesh=file.mesh(file.positions(whole, kind, normalized=True)), scale=[0.02, 0.02, 0.02]
        )
        yield case(f"normalized_{name}.glb", file.glb(), (whole / largest * 0.02)[FACES])
        file = Gltf(**top)
        file.node(mesh=file.mesh(file.positions(whole, kind)), scale=[0.5, 0.5, 0.5])
        yield case(f"integers_{name}.glb", file.glb(), (whole * 0.5)[FACES])
    file = Gltf(**top)
    least = np.array([[-128, 0, 0], [127, 0, 0], [0, 127, -127], [0, 0, 127]])
    file.node(mesh=file.mesh(file.positions(least, BYTE, normalized=True)))
    yield case("normalized_least.glb", file.glb(), np.maximum(least / 127, -1)[FACES])


def visibility() -> Iterator[Case]:
    file = Gltf(extensionsUsed=["KHR_node_visibility"])
    mesh = file.mesh()
    hidden = {"KHR_node_visibility": {"visible": False}}
    shown = {"KHR_node_visibility": {"visible": True}}
    child = file.node(mesh=mesh, extensions=shown)
    file.node(children=[child], extensions=hidden)
    file.node(mesh=mesh, translation=[1, 0, 0], extensions=shown)
    file.node(mesh=mesh, translation=[2, 0, 0], extensions={"KHR_node_visibility": {}})
    seen = [moved(shift(1, 0, 0)), moved(shift(2, 0, 0))]
    yield case("hidden_parent.glb", file.glb(), np.concatenate(seen))
    file = Gltf(extensionsUsed=["KHR_node_visibility"], extensionsRequired=["KHR_node_visibility"])
    file.node(mesh=file.mesh(), extensions=hidden)
    yield case("all_hidden.glb", file.glb(), None)


def scenes() -> Iterator[Case]:
    file = Gltf()
    mesh = file.mesh()
    for k in range(3):
        file.node(mesh=mesh, translation=[k, 0, 0])
    file.json |= {"scenes": [{"nodes": [0]}, {"nodes": [2]}], "scene": 1}
    yield case("second_scene.glb", file.glb(), moved(shift(2, 0, 0)))
    file, child = plain(translation=[1, 0, 0])
    file.node(children=[child], scale=[2, 2, 2])
    file.json["scenes"] = []
    data = file.glb().replace(b'"scenes": []', b'"extras": 0 ')
    yield case("without_scenes.glb", data, moved(scale(2, 2, 2) @ shift(1, 0, 0)))


def containers() -> Iterator[Case]:
    yield case("data_uri.gltf", plain()[0].gltf())
    file = plain()[0]
    outside = case("beside.gltf", file.gltf("two%20words.bin"))
    yield Case(outside.name, outside.data, outside.polygons, (("two words.bin", bytes(file.blob)),))
    file = Gltf(
        extensionsUsed=["VENDOR_unknown", "KHR_materials_unlit"],
        extensionsRequired=["KHR_materials_unlit"],
    )
    file.node(mesh=file.mesh(), extensions={"VENDOR_unknown": {}})
    yield case("extension_of_looks_required.glb", file.glb())
    file = plain()[0]
    extension = {
        "EXT_meshopt_compression": {
            "buffer": 0,
            "byteLength": 4,
            "byteStride": 4,
            "mode": "ATTRIBUTES",
            "count": 1,
        }
    }
    file.json["bufferViews"][0]["extensions"] = extension
    file.json["extensionsUsed"] = ["EXT_meshopt_compression"]
    # Not required, so that the plain data may be read; no right reading depends on the extension.
    yield case("meshopt_with_plain_data.gltf", file.gltf(), may_refuse=True)


def draco(file: Gltf) -> None:
    """Replace the data of a file by a Draco stream that is none."""
    name = "KHR_draco_mesh_compression"
    file.json |= {"extensionsUsed": [name], "extensionsRequired": [name]}
    stream = {"bufferView": file.view(bytes(64)), "attributes": {"POSITION": 0}}
    file.json["meshes"][0]["primitives"][0]["extensions"] = {name: stream}
    for accessor in file.json["accessors"]:
        del accessor["bufferView"]


def refusals() -> Iterator[Case]:
    def broken(name: str, change: Callable[[Gltf], None], **node: Any) -> Case:
        file = plain(**node)[0]
        change(file)
        return case(f"{name}.glb", file.glb(), None)

    for name in ("VENDOR_bent", "EXT_meshopt_compression", "KHR_meshopt_compression", "CESIUM_RTC"):
        used = {"extensionsUsed": [name], "extensionsRequired": [name]}
        yield broken(f"required_{name}", lambda file, used=used: file.json.update(used))  # type: ignore[misc]
    yield broken("draco_of_zeros", draco)
    yield broken("version1", lambda file: file.json.update(asset={"version": "1.0"}))
    yield broken(
        "min_version", lambda file: file.json.update(asset={"version": "2.9", "minVersion": "2.9"})
    )
    yield broken(
        "in_a_circle", lambda file: file.json["nodes"].append({"children": [0]}), children=[1]
    )
    yield broken("below_itself", lambda file: None, children=[0])
    yield broken(
        "two_parents",
        lambda file: file.json["nodes"].extend([{"children": [0]}, {"children": [0]}]),
    )
    yield broken("index_too_large", lambda file: file.json["accessors"][0].update(count=3))
    yield broken("accessor_too_long", lambda file: file.json["accessors"][0].update(count=40))
    yield broken("view_too_long", lambda file: file.json["bufferViews"][1].update(byteLength=400))
    yield broken("no_such_mesh", lambda file: None, children=[7])
    yield broken("no_such_skin", lambda file: None, skin=3)
    whole = plain()[0].glb()
    yield case("cut_off.glb", whole[:-8], None)
    # The header ends the file before them.
    yield case("bytes_after_the_end.glb", whole + b"12345678", may_refuse=True)
    file = plain()[0]
    yield case("buffer_cut_off.gltf", file.gltf("data:,abc"), None)
    file = plain()[0]
    yield case("buffer_missing.gltf", file.gltf("nowhere.bin"), None)
    file = Gltf()
    file.node(mesh=file.mesh(indices=-1, mode=1))
    yield case("lines_alone.glb", file.glb(), None)
    file = Gltf()
    holes = np.where(CORNERS == 5, np.nan, CORNERS)
    file.node(mesh=file.mesh(file.positions(holes, min=[0, 0, 0], max=[4, 3, 5])))
    yield case("not_a_number.glb", file.glb(), None)
