"""Brightness of mesh files against pixels computed by hand: nothing that trimesh makes up is drawn.

Every file shows one sheet that faces the viewer and a white light from there, on a material that is
diffuse alone: by CONVENTIONS.md, "Light", a pixel of it has the radiance DIFFUSE times the albedo. The
files are written here, number by number, and not by trimesh.
"""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.support.scene_file import film
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, Scene, open_scene
from xfrustum.scenes.arrays import Floats

DIFFUSE = 0.5
FLOAT32_ROUNDING = 1e-5
"""Largest relative error: the rasterizer shades in some ten operations of 32-bit floats, 6e-8 each."""

CORNERS = ((-40.0, -40.0, 0.0), (40.0, -40.0, 0.0), (40.0, 40.0, 0.0), (-40.0, 40.0, 0.0))
COORDINATES = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
STORED = (188, 64, 3)
"""A color in 8 bits: bright, dark, and on the straight part of sRGB."""

FLOAT, SHORT, BYTE = 5126, 5123, 5121
"""Component types of glTF."""


def linear(stored: int, full_scale: int = 255) -> float:
    """Return linear light of an sRGB value, by the definition in IEC 61966-2-1."""
    share = stored / full_scale
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


def sheet_scene(folder: Path, mesh: str, *, smooth: bool = False) -> Scene:
    """Return the scene of a mesh file that lies in a folder."""
    path = folder / "scene.toml"
    path.write_text(
        film((8.0, 6.0), hogels=(3, 3), resolution=(9, 7), fov_deg=(40.0, 30.0), reach=(20.0, 20.0))
        + f"""
        [[object]]
        mesh = "{mesh}"
        translate = [0.0, 0.0, -10.0]
        material = "matt"
        smooth = {str(smooth).lower()}
        [material.matt]
        ambient = 0.0
        diffuse = {DIFFUSE}
        [[light]]
        direction = [0.0, 0.0, 1.0]
        """
    )
    return open_scene(str(path))


def radiance(scene: Scene) -> Floats:
    """Return the middle pixel's color, the same in the reference's and in the rasterizer's image."""
    aperture = scene.plate.middle
    truth = Reference(scene).trace(aperture).color
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, DoubleFrustum(near=0.01)).color
    assert truth is not None
    assert drawn is not None
    np.testing.assert_allclose(drawn, truth, rtol=FLOAT32_ROUNDING)
    return np.asarray(truth[3, 4], dtype=np.float64)


def assert_albedo(scene: Scene, albedo: tuple[float, ...]) -> None:
    np.testing.assert_allclose(radiance(scene), DIFFUSE * np.array(albedo), rtol=FLOAT32_ROUNDING)


def write_obj(
    path: Path,
    *,
    coordinates: bool = False,
    head: str = "",
    colors: tuple[float, ...] = (),
    material: str | None = None,
) -> str:
    """Write the sheet as OBJ and return the file's name."""
    lines = [head] if head else []
    lines += ["v " + " ".join(map(str, (*corner, *colors))) for corner in CORNERS]
    lines += [f"vt {u} {v}" for u, v in COORDINATES if coordinates]
    lines += [f"usemtl {material}"] if material else []
    corner = "{0}/{0}" if coordinates else "{0}"
    lines += ["f " + " ".join(corner.format(number) for number in face) for face in ((1, 2, 3), (1, 3, 4))]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def write_ply(
    path: Path,
    properties: tuple[str, ...],
    values: tuple[float, ...],
    *,
    coordinates: bool = False,
    head: str = "",
) -> str:
    """Write the sheet as PLY, with more properties of its vertices, and return the file's name."""
    placed = ("float s", "float t") if coordinates else ()
    names = ("float x", "float y", "float z", *properties, *placed)
    lines = ["ply", "format ascii 1.0", *([head] if head else []), "element vertex 4"]
    lines += [f"property {name}" for name in names]
    lines += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    for corner, uv in zip(CORNERS, COORDINATES, strict=True):
        lines.append(" ".join(map(str, (*corner, *values, *(uv if coordinates else ())))))
    path.write_text("\n".join([*lines, "3 0 1 2", "3 0 2 3"]) + "\n")
    return path.name


def write_gltf(
    path: Path,
    *,
    material: dict[str, Any] | None = None,
    colors: NDArray[Any] | None = None,
    kind: int = BYTE,
    image: str | None = None,
) -> str:
    """Write the sheet as glTF with texture coordinates, and return the file's name."""
    arrays = [np.array(CORNERS, "<f4"), np.array(COORDINATES, "<f4"), np.array([0, 1, 2, 0, 2, 3], "<u2")]
    accessors: list[dict[str, Any]] = [
        {"componentType": FLOAT, "count": 4, "type": "VEC3", "min": [-40, -40, 0], "max": [40, 40, 0]},
        {"componentType": FLOAT, "count": 4, "type": "VEC2"},
        {"componentType": SHORT, "count": 6, "type": "SCALAR"},
    ]
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
    if colors is not None:
        arrays.append(np.tile(colors, (4, 1)))
        accessors.append({"componentType": kind, "count": 4, "type": "VEC4", "normalized": kind != FLOAT})
        primitive["attributes"]["COLOR_0"] = 3
    views, data = [], b""
    for number, array in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors[number]["bufferView"] = number
        data += array.tobytes() + bytes(-array.nbytes % 4)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
    }
    if material is not None:
        tree["materials"], primitive["material"] = [material], 0
    if image is not None:
        tree["images"], tree["textures"] = [{"uri": image}], [{"source": 0}]
    path.write_text(json.dumps(tree))
    return path.name


def write_picture(path: Path, color: tuple[int, ...] = STORED) -> str:
    Image.new("RGB", (4, 2), color).save(path)
    return path.name


PAINTED = tuple(linear(part) for part in STORED)
WHITE = (1.0, 1.0, 1.0)


@pytest.mark.parametrize("smooth", [False, True])
def test_a_mesh_is_as_bright_with_texture_coordinates_as_without(tmp_path: Path, smooth: bool) -> None:
    """Coordinates place a texture. Where there is none they change nothing."""
    for coordinates in (False, True):
        obj = write_obj(tmp_path / f"{coordinates}.obj", coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, obj, smooth=smooth), WHITE)
        ply = write_ply(tmp_path / f"{coordinates}.ply", (), (), coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, ply, smooth=smooth), WHITE)


def test_colors_at_vertices_are_as_bright_with_texture_coordinates_as_without(tmp_path: Path) -> None:
    shares = (0.5, 0.25, 0.002)
    albedo = (((0.5 + 0.055) / 1.055) ** 2.4, ((0.25 + 0.055) / 1.055) ** 2.4, 0.002 / 12.92)
    for coordinates in (False, True):
        obj = write_obj(tmp_path / f"{coordinates}.obj", coordinates=coordinates, colors=shares)
        assert_albedo(sheet_scene(tmp_path, obj), albedo)


def test_a_material_library_gives_its_texture_and_not_its_colors(tmp_path: Path) -> None:
    """CONVENTIONS.md, Light: colors of other materials than glTF's are not read."""
    write_picture(tmp_path / "wood.png")
    (tmp_path / "m.mtl").write_text(
        "newmtl plain\nKd 0.2 0.3 0.4\nnewmtl wood\nKd 0.2 0.3 0.4\nmap_Kd wood.png\n"
    )
    for coordinates in (False, True):
        name = f"plain-{coordinates}.obj"
        write_obj(tmp_path / name, coordinates=coordinates, head="mtllib m.mtl", material="plain")
        scene = sheet_scene(tmp_path, name)
        assert scene.warnings == ()
        assert_albedo(scene, WHITE)
    head = "# made by hand\nmtllib m.mtl"
    name = write_obj(tmp_path / "wood.obj", coordinates=True, head=head, material="wood")
    scene = sheet_scene(tmp_path, name)
    assert scene.warnings == ()
    assert_albedo(scene, PAINTED)
    # A material that no library has.
    name = write_obj(tmp_path / "none.obj", coordinates=True, material="wood")
    assert_albedo(sheet_scene(tmp_path, name), WHITE)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_gray_textures_count_though_trimesh_makes_up_the_same_and_pillow_clips_16_bits(
    tmp_path: Path, kind: type[np.unsignedinteger[Any]]
) -> None:
    Image.fromarray(np.full((2, 2), 100 * np.iinfo(kind).max // 255, kind)).save(tmp_path / "gray.png")
    (tmp_path / "m.mtl").write_text("newmtl gray\nmap_Kd gray.png\n")
    name = write_obj(tmp_path / "gray.obj", coordinates=True, head="mtllib m.mtl", material="gray")
    assert_albedo(sheet_scene(tmp_path, name), (linear(100),) * 3)


@pytest.mark.parametrize(
    ("kind", "values", "albedo"),
    [
        ("uchar", STORED, PAINTED),
        ("ushort", (40000, 20000, 500), tuple(linear(part, 65535) for part in (40000, 20000, 500))),
        ("float", (1.0, 0.5, 0.0), (1.0, ((0.5 + 0.055) / 1.055) ** 2.4, 0.0)),
        ("float", STORED, PAINTED),
        ("int", STORED, PAINTED),
    ],
)
def test_ply_colors_of_any_type_are_decoded_from_srgb(
    tmp_path: Path, kind: str, values: tuple[float, ...], albedo: tuple[float, ...]
) -> None:
    properties = tuple(f"{kind} {name}" for name in ("red", "green", "blue"))
    for coordinates in (False, True):
        name = write_ply(tmp_path / f"{coordinates}.ply", properties, values, coordinates=coordinates)
        assert_albedo(sheet_scene(tmp_path, name), albedo)


def test_gltf_colors_are_linear_and_multiply_each_other(tmp_path: Path) -> None:
    write_picture(tmp_path / "wood.png")
    factor = (0.5, 0.25, 0.002)
    base = {"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0]}}
    textured = {"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0], "baseColorTexture": {"index": 0}}}
    half = np.array([[0.5, 1.0, 0.002, 1.0]], "<f4")
    bytes_ = np.array([[188, 64, 3, 255]], "u1")
    words = np.array([[40000, 20000, 500, 65535]], "<u2")
    of_bytes, of_words = (188 / 255, 64 / 255, 3 / 255), (40000 / 65535, 20000 / 65535, 500 / 65535)
    product = tuple(one * two for one, two in zip(factor, (0.5, 1.0, 0.002), strict=True))
    files: list[tuple[dict[str, Any], tuple[float, ...]]] = [
        ({}, WHITE),
        ({"material": {}}, WHITE),
        ({"material": base}, factor),
        ({"colors": half, "kind": FLOAT}, (0.5, 1.0, 0.002)),
        ({"colors": bytes_}, of_bytes),
        ({"colors": words, "kind": SHORT}, of_words),
        ({"colors": words, "kind": SHORT, "material": {}}, of_words),
        ({"colors": half, "kind": FLOAT, "material": base}, product),
        (
            {"material": textured, "image": "wood.png"},
            tuple(one * two for one, two in zip(factor, PAINTED, strict=True)),
        ),
    ]
    for number, (content, albedo) in enumerate(files):
        name = write_gltf(tmp_path / f"{number}.gltf", **content)
        assert_albedo(sheet_scene(tmp_path, name), albedo)


def named_in_vain(folder: Path) -> list[tuple[str, str]]:
    """Write mesh files that name what is not there, and return each with what must be said of it."""
    (folder / "m.mtl").write_text("newmtl wood\nmap_Kd lost.png\n")
    (folder / "bad.png").write_bytes(b"no picture")
    (folder / "b.mtl").write_text("newmtl wood\nmap_Kd bad.png\n")
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    uses: dict[str, Any] = {"coordinates": True, "material": "wood"}
    head, glossy = "comment TextureFile lost.png", "KHR_materials_pbrSpecularGlossiness"
    return [
        (write_obj(folder / "a.obj", head="mtllib m.mtl", **uses), "texture lost.png is missing"),
        (write_obj(folder / "b.obj", head="mtllib b.mtl", **uses), "texture bad.png cannot be read"),
        (write_obj(folder / "c.obj", head="mtllib lost.mtl", **uses), "material library lost.mtl is missing"),
        (write_ply(folder / "d.ply", (), (), coordinates=True, head=head), "texture lost.png is missing"),
        (write_gltf(folder / "e.gltf", material=texture, image="lost.png"), "texture lost.png is missing"),
        (write_gltf(folder / "f.gltf", material={"extensions": {glossy: {}}}), glossy),
    ]


def test_a_texture_that_is_named_and_missing_is_a_warning_that_names_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for mesh, told in named_in_vain(tmp_path):
        scene = sheet_scene(tmp_path, mesh)
        [line] = scene.warnings
        assert mesh in line
        assert told in line
        assert_albedo(scene, WHITE)
    capfd.readouterr()
    assert main(["explain", scene.source, "--repeat", "0", "--json"]) == 0
    printed = capfd.readouterr()
    assert printed.err == f"xfrustum: warning: {line}\n"
    rows = {row["name"]: row for row in json.loads(printed.out)["effects"]}
    assert rows["textures"]["reason"] == "no object has a texture"
