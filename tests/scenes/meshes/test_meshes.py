"""Mesh files as objects: albedos and textures come from the file; none are invented."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.scenes.meshes.soups import written
from tests.support.gltf_writer import Writer
from tests.support.scene_file import film
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum, InputError, open_scene
from xfrustum.scenes.meshes.mesh_file import load_mesh
from xfrustum.scenes.shapes import place

Color = tuple[float, ...]


def test_a_placement_that_overflows_is_an_input_error(tmp_path: Path) -> None:
    path = written(tmp_path, "big.obj", "v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="NaN or infinite in scene coordinates"):
        place(load_mesh(path), np.diag([1e300, 1, 1, 1]))


# Every file shows one sheet with an albedo in closed form. The files are written here, number by
# number, and not by trimesh.

STORED = (188, 64, 3)  #: in 8 bits: bright, dark, and on the linear part of sRGB
WORDS = (40000, 20000, 500)  #: in 16 bits
SHARES = (0.5, 0.25, 0.002)
WHITE = (1.0, 1.0, 1.0)

OBJ = """\
{head}
v -40 -40 0 {color}
v 40 -40 0 {color}
v 40 40 0 {color}
v -40 40 0 {color}
vt 0 0
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3 4/4
"""
PLY = """\
ply
format ascii 1.0
{head}
element vertex 4
property float x
property float y
property float z
{properties}
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
-40 -40 0 {color} 0 0
40 -40 0 {color} 1 0
40 40 0 {color} 1 1
-40 40 0 {color} 0 1
4 0 1 2 3
"""


def linear(stored: Color, largest: float = 255) -> Color:
    """Return linear values of sRGB values, by the definition in IEC 61966-2-1."""
    shares = [value / largest for value in stored]
    return tuple(s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares)


def words(values: Color) -> str:
    return " ".join(map(str, values))


def obj(head: str = "", color: Color = ()) -> str:
    """Return the sheet as OBJ, after the statements in `head`."""
    return OBJ.format(head=head, color=words(color))


def ply(kind: str = "", color: Color = (), head: str = "comment none") -> str:
    """Return the sheet as PLY, with a type of colors and texture coordinates s and t."""
    properties = "\n".join(f"property {kind} {name}" for name in ("red", "green", "blue") if kind)
    return PLY.format(head=head, properties=properties, color=words(color))


def gltf(
    material: dict[str, Any] | None = None, colors: np.ndarray | None = None, image: str = ""
) -> Writer:
    """Return the sheet as glTF with texture coordinates."""
    writer, uv = Writer(), np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4")
    attributes = {"TEXCOORD_0": writer.array(uv)}
    if colors is not None:
        whole = colors.dtype != np.float32
        attributes["COLOR_0"] = writer.array(np.tile(colors, (4, 1)), normalized=whole)
    more = {} if material is None else {"material": writer.add("materials", **material)}
    if image:
        writer.add("textures", source=writer.add("images", uri=image))
    points = np.pad(80 * uv - 40, ((0, 0), (0, 1)))
    faces = np.array([0, 1, 2, 0, 2, 3], "<u2")
    writer.node(mesh=writer.mesh(points, faces, attributes=attributes, **more))
    return writer


FACTOR, HALF = SHARES, (0.5, 1.0, 0.002)
BASE: dict[str, Any] = {"baseColorFactor": [*FACTOR, 1.0]}
PAINTED = {"pbrMetallicRoughness": BASE}
TEXTURED = {"pbrMetallicRoughness": {**BASE, "baseColorTexture": {"index": 0}}}
FLOATS = np.array([[*HALF, 1.0]], "<f4")
LIBRARY = "mtllib m.mtl\nusemtl "
ALBEDOS: dict[str, tuple[str | Writer, Color]] = {
    "OBJ without coordinates": (obj().replace("1/1 2/2 3/3 4/4", "1 2 3 4"), WHITE),
    "OBJ with colors": (obj(color=SHARES), linear(SHARES, 1)),
    # A material library provides only its texture; the scene file provides colors.
    "OBJ of a plain material": (obj(LIBRARY + "plain"), WHITE),
    "OBJ with a texture": (obj("# made\n" + LIBRARY + "wood"), linear(STORED)),
    "OBJ without its library": (obj("usemtl wood"), WHITE),
    # trimesh invents gray for missing textures, and Pillow clips 16 bits.
    "OBJ with gray of 16 bits": (obj(LIBRARY + "uint16"), linear((100,) * 3)),
    "PLY": (ply(), WHITE),
    "PLY with bytes": (ply("uchar", STORED), linear(STORED)),
    "PLY with words": (ply("ushort", WORDS), linear(WORDS, 65535)),
    "PLY with shares": (ply("float", SHARES), linear(SHARES, 1)),
    "PLY with floats up to 255": (ply("float", STORED), linear(STORED)),
    "PLY with integers": (ply("int", STORED), linear(STORED)),
    # Colors of glTF are linear; they are multiplied.
    "glTF": (gltf(), WHITE),
    "glTF with a factor": (gltf(PAINTED), FACTOR),
    "glTF with floats": (gltf(colors=FLOATS), HALF),
    "glTF with bytes": (gltf(colors=np.array([STORED], "u1")), tuple(np.divide(STORED, 255))),
    "glTF with words": (gltf({}, np.array([WORDS], "<u2")), tuple(np.divide(WORDS, 65535))),
    "glTF with floats and a factor": (gltf(PAINTED, FLOATS), tuple(np.multiply(FACTOR, HALF))),
    "glTF with a texture and a factor": (
        gltf(TEXTURED, image="wood.png"),
        tuple(np.multiply(FACTOR, linear(STORED))),
    ),
}


def saved(folder: Path, content: str | Writer) -> Path:
    """Save a mesh file, and a library with textures for it; return its path."""
    Image.new("RGB", (4, 2), STORED).save(folder / "wood.png")
    Image.fromarray(np.full((2, 2), 100 * 257, np.uint16)).save(folder / "uint16.png")
    library = "newmtl plain\nKd 0.2 0.3 0.4\n"
    library += "".join(f"newmtl {n}\nmap_Kd {n}.png\n" for n in ("wood", "uint16"))
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
    np.testing.assert_allclose(albedo, expected, rtol=1e-6)  # glTF floats have 24 bits
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


def test_reference_and_rasterizer_show_the_albedo(tmp_path: Path) -> None:
    """Under a light from the viewer, a diffuse sheet has radiance 0.5 times its albedo.

    The albedo is the product of a color at vertices and a texture.
    """
    content, albedo = ALBEDOS["glTF with a texture and a factor"]
    scene = open_scene(written(tmp_path, "a.toml", FILM + SCENE.format(saved(tmp_path, content))))
    truth = Reference(scene).trace(scene.plate.middle).color
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(scene.plate.middle, DoubleFrustum(near=0.01)).color
    for color in (truth, drawn):  # the rasterizer shades with about ten 32-bit operations
        np.testing.assert_allclose(color[3, 4], 0.5 * np.array(albedo), rtol=1e-5)


GLOSS = "KHR_materials_pbrSpecularGlossiness"
LOST: dict[str, str | Writer] = {
    "texture lost.png is missing": obj("mtllib lost.mtl\nusemtl wood"),
    "texture bad.png cannot be read": obj("mtllib bad.mtl\nusemtl wood"),
    "texture strange.dds cannot be read": obj("mtllib strange.mtl\nusemtl wood"),
    "material library none.mtl is missing": obj("mtllib none.mtl\nusemtl wood"),
    "lost.png is missing": ply(head="comment TextureFile lost.png"),
    "xture lost.png is missing": gltf(TEXTURED, image="lost.png"),
    "texture . cannot be read": gltf(TEXTURED, image="."),
    GLOSS: gltf({"extensions": {GLOSS: {}}}),
}


@pytest.mark.parametrize("warning", LOST)
def test_a_texture_that_is_missing_or_damaged_is_named(warning: str, tmp_path: Path) -> None:
    for name in ("lost.png", "bad.png", "strange.dds"):
        library = f"newmtl wood\nmap_Kd {name}\n"
        written(tmp_path, f"{name.partition('.')[0]}.mtl", library)
    written(tmp_path, "bad.png", "no picture")
    numbers = (0x20534444, 124, 0, 4, 4, *[0] * 14, 32, 4, 0x3F3F3F3F, *[0] * 10)
    written(tmp_path, "strange.dds", struct.pack("<32I", *numbers))  # compression "????"
    mesh = saved(tmp_path, LOST[warning])
    [line] = open_scene(written(tmp_path, "a.toml", FILM + SCENE.format(mesh))).warnings
    assert str(mesh) in line and warning in line
