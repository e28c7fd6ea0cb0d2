"""Mesh files as objects: triangle numbers, albedos and textures are the file's, none made up."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.scenes.meshes.soups import written
from tests.support.gltf_writer import Writer
from tests.support.scene_file import film
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, InputError, open_scene
from xfrustum.scenes.geometry.shapes import place
from xfrustum.scenes.meshes.mesh_file import load_mesh

Color = tuple[float, ...]


def test_a_placement_that_overflows_is_an_input_error(tmp_path: Path) -> None:
    path = written(tmp_path, "big.obj", "v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="NaN or infinite in scene coordinates"):
        place(load_mesh(path), np.diag([1e300, 1, 1, 1]))


# Every file shows one sheet. Its albedo is known in closed form: the files are written here, number
# by number, and not by trimesh.

SHEET = ((-40.0, -40.0, 0.0), (40.0, -40.0, 0.0), (40.0, 40.0, 0.0), (-40.0, 40.0, 0.0))
COORDINATES = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
STORED = (188, 64, 3)  #: in 8 bits: bright, dark, and on the straight part of sRGB
WORDS = (40000, 20000, 500)  #: in 16 bits
WHITE = (1.0, 1.0, 1.0)


def linear(stored: Color, largest: float = 255) -> Color:
    """Return linear light of sRGB values, by the definition in IEC 61966-2-1."""
    shares = [value / largest for value in stored]
    return tuple(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares)


def obj(*head: str, colors: Color = (), coordinates: bool = True) -> str:
    """Return the sheet as OBJ; statements of `head` come first."""
    lines = [*head, *(" ".join(map(str, ("v", *corner, *colors))) for corner in SHEET)]
    lines += [f"vt {u} {v}" for u, v in COORDINATES if coordinates]
    return "\n".join([*lines, "f 1/1 2/2 3/3 4/4" if coordinates else "f 1 2 3 4", ""])


def ply(kind: str = "", values: Color = (), head: str = "comment none") -> str:
    """Return the sheet as PLY, with colors of some type, placed by texture coordinates s and t."""
    colors = [f"{kind} {name}" for name in ("red", "green", "blue") if kind]
    names = ["float x", "float y", "float z", *colors, "float s", "float t"]
    lines = ["ply", "format ascii 1.0", head, "element vertex 4", *(f"property {n}" for n in names)]
    lines += ["element face 1", "property list uchar int vertex_indices", "end_header"]
    for corner, uv in zip(SHEET, COORDINATES, strict=True):
        lines.append(" ".join(map(str, (*corner, *values, *uv))))
    return "\n".join([*lines, "4 0 1 2 3", ""])


def gltf(
    material: dict[str, Any] | None = None, colors: np.ndarray | None = None, image: str = ""
) -> Writer:
    """Return the sheet as glTF with texture coordinates."""
    writer = Writer()
    attributes = {"TEXCOORD_0": writer.array(np.array(COORDINATES, "<f4"))}
    if colors is not None:
        normalized = {} if colors.dtype == np.float32 else {"normalized": True}
        attributes["COLOR_0"] = writer.array(np.tile(colors, (4, 1)), **normalized)
    more = {} if material is None else {"material": writer.add("materials", **material)}
    if image:
        writer.add("textures", source=writer.add("images", uri=image))
    faces = np.array([0, 1, 2, 0, 2, 3], "<u2")
    writer.node(mesh=writer.mesh(np.array(SHEET, "<f4"), faces, attributes=attributes, **more))
    return writer


FACTOR, HALF = (0.5, 0.25, 0.002), (0.5, 1.0, 0.002)
BASE: dict[str, Any] = {"baseColorFactor": [*FACTOR, 1.0]}
TEXTURED = {"pbrMetallicRoughness": {**BASE, "baseColorTexture": {"index": 0}}}
FLOATS = np.array([[*HALF, 1.0]], "<f4")
ALBEDOS: dict[str, tuple[str | Writer, Color]] = {
    "OBJ": (obj(), WHITE),
    "OBJ without coordinates": (obj(coordinates=False), WHITE),
    "OBJ with colors": (obj(colors=(0.5, 0.25, 0.002)), linear((0.5, 0.25, 0.002), 1)),
    # A material library gives its texture, and colors are of the scene file.
    "OBJ of a plain material": (obj("mtllib m.mtl", "usemtl plain"), WHITE),
    "OBJ with a texture": (obj("# made", "mtllib m.mtl", "usemtl wood"), linear(STORED)),
    "OBJ without its library": (obj("usemtl wood"), WHITE),
    # trimesh makes up gray where there is no texture, and Pillow clips 16 bits.
    "OBJ with gray of 8 bits": (obj("mtllib m.mtl", "usemtl uint8"), linear((100,) * 3)),
    "OBJ with gray of 16 bits": (obj("mtllib m.mtl", "usemtl uint16"), linear((100,) * 3)),
    "PLY": (ply(), WHITE),
    "PLY with bytes": (ply("uchar", STORED), linear(STORED)),
    "PLY with words": (ply("ushort", WORDS), linear(WORDS, 65535)),
    "PLY with shares": (ply("float", (1.0, 0.5, 0.0)), linear((1.0, 0.5, 0.0), 1)),
    "PLY with floats up to 255": (ply("float", STORED), linear(STORED)),
    "PLY with integers": (ply("int", STORED), linear(STORED)),
    # Colors of glTF are linear and multiply each other.
    "glTF": (gltf(), WHITE),
    "glTF with a factor": (gltf({"pbrMetallicRoughness": BASE}), FACTOR),
    "glTF with floats": (gltf(colors=FLOATS), HALF),
    "glTF with bytes": (gltf(colors=np.array([[*STORED, 255]], "u1")),
                        tuple(part / 255 for part in STORED)),
    "glTF with words": (gltf({}, np.array([[*WORDS, 65535]], "<u2")),
                        tuple(part / 65535 for part in WORDS)),
    "glTF with floats and a factor": (gltf({"pbrMetallicRoughness": BASE}, FLOATS),
                                      tuple(np.multiply(FACTOR, HALF))),
    "glTF with a texture and a factor": (gltf(TEXTURED, image="wood.png"),
                                         tuple(np.multiply(FACTOR, linear(STORED)))),
}  # fmt: skip


def saved(folder: Path, content: str | Writer) -> Path:
    """Write a mesh file, and a library with textures for it."""
    Image.new("RGB", (4, 2), STORED).save(folder / "wood.png")
    library = "newmtl plain\nKd 0.2 0.3 0.4\nnewmtl wood\nKd 0.2 0.3 0.4\nmap_Kd wood.png\n"
    for kind in (np.uint8, np.uint16):
        gray = np.full((2, 2), 100 * np.iinfo(kind).max // 255, kind)
        Image.fromarray(gray).save(folder / f"{kind.__name__}.png")
        library += f"newmtl {kind.__name__}\nmap_Kd {kind.__name__}.png\n"
    written(folder, "m.mtl", library)
    if isinstance(content, Writer):
        return content.save(folder / "sheet.gltf")
    return written(folder, f"sheet.{'ply' if content.startswith('ply') else 'obj'}", content)


@pytest.mark.parametrize("name", ALBEDOS)
def test_the_albedo_is_the_files_with_texture_coordinates_or_without(
    name: str, tmp_path: Path
) -> None:
    content, expected = ALBEDOS[name]
    mesh = load_mesh(saved(tmp_path, content))
    albedo = np.ones(3) if mesh.vertex_colors is None else mesh.vertex_colors[0]
    if mesh.texture_of_triangle is not None:
        assert mesh.texture_of_triangle.tolist() == [0, 0]
        albedo = albedo * linear(tuple(mesh.textures[0][0, 0, :3].tolist()))
    np.testing.assert_allclose(albedo, expected, rtol=1e-6)  # floats of glTF have 24 bits
    assert [str(feature) for feature in mesh.unread if "statements Kd" not in str(feature)] == []


SCENE = """
[[object]]
mesh = "{}"
translate = [0.0, 0.0, -10.0]
material = "matt"
[material.matt]
ambient = 0.0
diffuse = 0.5
[[light]]
direction = [0.0, 0.0, 1.0]
"""
FILM = film((8.0, 6.0), hogels=(3, 3), resolution=(9, 7), fov_deg=(40.0, 30.0), reach=(20.0, 20.0))


@pytest.mark.parametrize("name", [list(ALBEDOS)[k] for k in (4, 9, -1)])
def test_both_answers_show_the_albedo(name: str, tmp_path: Path) -> None:
    """A pixel of a diffuse sheet under a light from the viewer is 0.5 times the albedo."""
    content, albedo = ALBEDOS[name]
    scene = open_scene(written(tmp_path, "a.toml", FILM + SCENE.format(saved(tmp_path, content))))
    truth = Reference(scene).trace(scene.plate.middle).color
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(scene.plate.middle, DoubleFrustum(near=0.01)).color
    for color in (truth, drawn):  # the rasterizer shades in some ten operations of 32-bit floats
        np.testing.assert_allclose(color[3, 4], 0.5 * np.array(albedo), rtol=1e-5)


DDS = struct.pack("<32I", 0x20534444, 124, 0, 4, 4, *[0] * 14, 32, 4, 0x3F3F3F3F, *[0] * 10)
LOST: dict[str, Any] = {
    "texture lost.png is missing": obj("mtllib lost.mtl", "usemtl wood"),
    "texture bad.png cannot be read": obj("mtllib bad.mtl", "usemtl wood"),
    "texture empty.png cannot be read": obj("mtllib empty.mtl", "usemtl wood"),
    "texture strange.dds cannot be read": obj("mtllib strange.mtl", "usemtl wood"),
    "material library none.mtl is missing": obj("mtllib none.mtl", "usemtl wood"),
    "lost.png is missing": ply(head="comment TextureFile lost.png"),
    "xture lost.png is missing": gltf(TEXTURED, image="lost.png"),
    "texture . cannot be read": gltf(TEXTURED, image="."),
    "xture empty.png cannot be read": gltf(TEXTURED, image="empty.png"),
    "KHR_materials_pbrSpecularGlossiness": gltf(
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}}
    ),
}  # fmt: skip


@pytest.mark.parametrize("warning", LOST)
def test_a_texture_that_is_missing_or_damaged_is_named(
    warning: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("lost.png", "bad.png", "empty.png", "strange.dds"):
        library = f"newmtl wood\nmap_Kd {name}\n"
        written(tmp_path, f"{name.partition('.')[0]}.mtl", library)
    written(tmp_path, "bad.png", "no picture")
    written(tmp_path, "empty.png", "")
    written(tmp_path, "strange.dds", DDS)  # of compression "????"
    mesh = saved(tmp_path, LOST[warning])
    path = written(tmp_path, "a.toml", FILM + SCENE.format(mesh))
    [line] = open_scene(path).warnings
    assert str(mesh) in line and warning in line
    if warning == next(iter(LOST)):
        assert main(["check", str(path), "--json"]) == 0
        printed = capfd.readouterr()
        assert printed.err == f"xfrustum: warning: {line}\n"
        rows = {row["name"]: row for row in json.loads(printed.out)["effects"]}
        assert rows["textures"]["reason"] == "no object has a texture"
