"""The scene file: each key reaches the scene; every mistake is one line that names the key."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from tests.support.environment_maps import write_map
from xfrustum.scenes import InputError, Plate, Screen, open_scene
from xfrustum.scenes.appearance import (
    DEFAULT_LIGHT,
    DEFAULT_MATERIAL,
    Material,
    Sampling,
    Transport,
)
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.files.pictures import read_environment
from xfrustum.scenes.shapes import placement

PLATE = "[plate]\nsize = [80, 60.0]\nhogels = [81, 61]\n"
FRUSTUM = "[frustum]\nresolution = [512, 256]\nfov_deg = [60, 45.0]\nreach = [150, 100.0]\n"
BOX = '[[object]]\nshape = "box"\n'
PAINT = "[material.paint]\n"
LIGHT = "[[light]]\ndirection = [0, 3, 4]\n"
MAP = '[environment]\nmap = "sky.exr"\n'

SHARED_EXPONENT = 2.0**-7
"""Radiance HDR files quantize three channels to 8 bits below a common power of two, at most twice
the largest channel. The error is at most this share of the largest channel.
"""


def write(folder: Path, *tables: str) -> str:
    path = folder / "scene.toml"
    path.write_text("".join(tables))
    return str(path)


def test_every_key_arrives_in_the_scene(tmp_path: Path) -> None:
    scene = open_scene(write(tmp_path, 'name = "n"\nunits = "mm"\n', PLATE, FRUSTUM, BOX))
    assert (scene.name, scene.units) == ("n", "mm")
    assert scene.plate == Plate(size=(80, 60), hogels=(81, 61))
    assert scene.frustum.resolution == (512, 256)
    assert scene.frustum.fov == (math.radians(60), math.radians(45))
    assert scene.frustum.reach == (150.0, 100.0)
    assert not scene.frustum.recentered
    assert Path(scene.source) == tmp_path / "scene.toml"
    screen = "screen = { height = -5, center = [1, 2], size = [3, 4] }"
    scene = open_scene(write(tmp_path, PLATE, FRUSTUM.replace("fov_deg = [60, 45.0]", screen)))
    assert scene.frustum.screen == Screen(height=-5, center=(1, 2), size=(3, 4))
    assert len(scene.faces) == 0 and (scene.sampling, scene.transport) == (Sampling(), Transport())
    tables = (
        "[sampling]\naperture = 16\nsupersample = 2\n[transport]\nshadows = true\nsamples = 8\n"
    )
    opened = open_scene(write(tmp_path, PLATE, FRUSTUM, tables))
    assert opened.sampling == Sampling(supersample=2, aperture=16)
    assert opened.transport == Transport(shadows=True, samples=8)


def test_scale_then_rotate_about_fixed_x_y_z_then_translate() -> None:
    """By hand, (1, 2, 3) scales to (2, 4, 6), then turns to (2, -6, 4), (4, -6, -2), (6, 4, -2)."""
    matrix = placement(2.0, (90.0, 90.0, 90.0), (10.0, 20.0, 30.0))
    np.testing.assert_allclose(matrix @ [1, 2, 3, 1], [16, 24, 28, 1], atol=1e-13)


def test_transform_is_row_major_mesh_to_scene(tmp_path: Path) -> None:
    rows = "[[0, -2, 0, 10], [1, 0, 0, 20], [0, 0, 3, 30], [0, 0, 0, 1]]"
    moved = open_scene(write(tmp_path, PLATE, FRUSTUM, BOX, f"transform = {rows}\n")).vertices
    plain = open_scene(write(tmp_path, PLATE, FRUSTUM, BOX)).vertices
    x, y, z = plain.T
    np.testing.assert_array_equal(moved, np.stack([10 - 2 * y, 20 + x, 30 + 3 * z], axis=1))


def test_a_mesh_lies_beside_its_scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    write(tmp_path, PLATE, FRUSTUM, '[[object]]\nmesh = "meshes/one.obj"\n')
    monkeypatch.chdir(tmp_path.parent)
    scene = open_scene(f"{tmp_path.name}/scene.toml")
    assert len(scene.faces) == 1
    assert Path(scene.source).is_absolute(), "an image can be compared from another folder"


#: Lines of a valid file, by key
VALID = {
    "plate.size": "[80, 60.0]",
    "plate.hogels": "[81, 61]",
    "frustum.resolution": "[512, 256]",
    "frustum.fov_deg": "[60, 45.0]",
    "frustum.reach": "[150, 100.0]",
}
SCREEN = "{ height = 1, center = [0, 0], size = [1, 1] }"
ROWS = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
SINGULAR = ROWS.replace("[0,1,0,0]", "[2,0,0,0]")
SHEARED = ROWS.replace("[0,0,0,1]", "[0,0,1,1]")
#: A line that replaces a line of the valid file or is added to it, and words of the error
MISTAKES = f"""\
plate.size = [-80, 60.0] : plate.size[0] : greater than 0, not -80
plate.size = [80] : plate.size[1] is missing
plate.hogels = [0, 61] : plate.hogels[0] : equal to 1, not 0
plate.hogels = [81.5, 61] : plate.hogels[0] : valid integer : 81.5
frustum.reach = [0, 100.0] : frustum.reach[0] : greater than 0
frustum.fovdeg = [1, 1] : frustum.fovdeg : nearest valid key is frustum.fov_deg
frustum.fov_deg = [60, 180] : frustum.fov_deg[1] : less than 180, not 180
frustum.screen = {{ height = 1, centre = [0, 0] }} : frustum.screen.centre : center
frustum.screen = {SCREEN} : fov_deg : screen
object = [{{}}] : object[0] : mesh or shape : box, square, sphere
object = [{{ shape = "box", mesh = "a.obj" }}] : object[0] : not both
object = [{{ shape = "bax" }}] : object[0].shape : nearest is box
object = [{{ shape = "box", scale = 0 }}] : object[0].scale : greater than 0
object = [{{ shape = "box", scale = 1, transform = {ROWS} }}] : both transform and scale
object = [{{ shape = "box", transform = {SHEARED} }}] : its last row is [0.0, 0.0, 1.0, 1.0]
object = [{{ shape = "box", transform = {SINGULAR} }}] : are singular
object = [{{ shape = "box" }}, {{ shape = "box", scale = inf }}] : object[1].sc
object = {{ shape = "box" }} : object : [[object]]
object = [{{ mesh = "none.obj" }}] : object[0].mesh : none.obj : no such mesh
object = [{{ shape = "box", chord_tolerance = 1 }}] : object[0] : only Bezier patches
object = [{{ shape = "box", material = "gold" }}] : object[0].material : gold : none
plate = : not valid TOML : line 1
material.paint.difuse = 1 : material.paint.difuse : nearest valid key is material.paint.diffuse
material.paint.diffuse = -1 : material.paint.diffuse[0] : equal to 0, not -1
material.paint.reflectivity = 1.5 : material.paint.reflectivity[0] : equal to 1, not 1.5
material."car paint".exponent = 0 : material."car paint".exponent
material.paint = 3 : material.paint : not 3
light = {{ direction = [1, 0, 0] }} : light : [[light]]
lights = [] : unknown key lights : nearest valid key is light
light = [{{ direction = [0, 3, 4], colour = 1 }}] : light[0].colour : light[0].color
light = [{{ direction = [1, 0, 0] }}, {{ direction = [0, 0, 0] }}] : light[1].direction : a length
sampling.samples = 4 : sampling.samples : nearest valid key is sampling.supersample
transport.shadows = 1 : transport.shadows : boolean, not 1
"""


def refusal(folder: Path, lines: dict[str, str]) -> str:
    """Return the one-line error for a file of some lines."""
    with pytest.raises(InputError) as caught:
        open_scene(write(folder, *(f"{key} = {value}\n" for key, value in lines.items())))
    assert "\n" not in str(caught.value) and "scene.toml" in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("mistake", MISTAKES.splitlines())
def test_a_mistake_is_one_line_with_file_key_and_valid_values(tmp_path: Path, mistake: str) -> None:
    line, *expected = mistake.split(" : ")
    key, _, value = line.partition(" =")
    # The mistake comes first: TOML errors state the line number.
    message = refusal(tmp_path, {key: value} | {k: v for k, v in VALID.items() if k != key})
    assert [words for words in expected if words not in message] == []


def test_tables_and_angles_that_are_missing_are_named(tmp_path: Path) -> None:
    assert "frustum is missing" in refusal(
        tmp_path, {key: value for key, value in VALID.items() if key.startswith("plate")}
    )
    message = refusal(tmp_path, {k: v for k, v in VALID.items() if k != "frustum.fov_deg"})
    assert "fov_deg = [x, y] degrees" in message and "screen = {" in message


def test_a_mesh_in_place_of_a_scene_file_is_refused_with_advice(tmp_path: Path) -> None:
    (tmp_path / "beetle.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="write a scene file first: xfrustum new"):
        open_scene(str(tmp_path / "beetle.obj"))


def test_a_name_like_no_scene_gets_the_command_that_lists_all() -> None:
    with pytest.raises(InputError, match="called 'nosuch'; `xfrustum scenes` lists all"):
        open_scene("nosuch")


def test_lengths_that_32_bit_images_cannot_hold_and_a_screen_almost_in_the_plate_are_refused() -> (
    None
):
    scene = open_scene("asymmetric-recentered")
    for size in (1e-33, 1e31):
        with pytest.raises(InputError, match="choose another unit of length"):
            replace(open_scene("asymmetric"), plate=Plate(size=(size, size), hogels=(1, 1)))
    screen = Screen(height=1e-15, center=(0.0, 0.0), size=(100.0, 80.0))
    with pytest.raises(InputError, match=r"frustum\.screen\.height"):
        replace(scene, frustum=replace(scene.frustum, screen=screen))


@pytest.fixture
def sky() -> Singles:
    """Return a map that every flip changes."""
    return np.random.default_rng(3).random((6, 12, 3), dtype=np.float32) * 5


def test_a_material_has_the_values_of_its_table_and_defaults(tmp_path: Path) -> None:
    paint = (
        PAINT + "ambient = 0.25\ndiffuse = [0.5, 0, 1]\nexponent = 7\nreflectivity = [0, 0.5, 1]\n"
    )
    scene = open_scene(write(tmp_path, PLATE, FRUSTUM, BOX, 'material = "paint"\n', BOX, paint))
    assert scene.materials == (
        Material(ambient=(0.25,) * 3, diffuse=(0.5, 0, 1), exponent=7, reflectivity=(0, 0.5, 1)),
        DEFAULT_MATERIAL,
    )


def test_lights_point_toward_the_light_and_have_a_color(tmp_path: Path) -> None:
    scene = open_scene(
        write(tmp_path, PLATE, FRUSTUM, LIGHT, "color = [1, 0.5, 0]\n", LIGHT, "color = 0.25\n")
    )
    first, second = scene.appearance.lights
    assert (first.direction, first.color) == ((0.0, 0.6, 0.8), (1.0, 0.5, 0.0))
    assert second.color == (0.25, 0.25, 0.25)


@pytest.mark.parametrize(
    ("tables", "lights"),
    [
        ("", [DEFAULT_LIGHT.direction]),
        (BOX + PAINT, [DEFAULT_LIGHT.direction]),
        ("light = []\n", []),
        (MAP, []),
        (MAP + LIGHT, [(0.0, 0.6, 0.8)]),
    ],
)
def test_only_a_file_without_light_and_environment_gets_the_default_light(
    tmp_path: Path, sky: Singles, tables: str, lights: list[object]
) -> None:
    write_map(tmp_path / "sky.exr", sky)
    order = (tables, PLATE, FRUSTUM) if tables.startswith("light") else (PLATE, FRUSTUM, tables)
    scene = open_scene(write(tmp_path, *order))
    assert [light.direction for light in scene.appearance.lights] == lights


def test_an_environment_is_read_as_stored_from_openexr_and_radiance_files(
    tmp_path: Path, sky: Singles
) -> None:
    write_map(tmp_path / "sky.exr", sky)
    write_map(tmp_path / "sky.hdr", sky)
    scene = open_scene(write(tmp_path, PLATE, FRUSTUM, MAP, "strength = 2.5\n"))
    assert scene.appearance.environment is not None
    assert scene.appearance.environment.strength == 2.5
    np.testing.assert_array_equal(scene.appearance.environment.radiance, sky)
    shared = read_environment(tmp_path / "sky.hdr").radiance
    assert (np.abs(shared - sky) <= SHARED_EXPONENT * sky.max(axis=2, keepdims=True)).all()


def test_channels_are_found_by_name_and_alpha_is_ignored(tmp_path: Path, sky: Singles) -> None:
    """OpenEXR sorts channels by name; another library wrote these files."""
    planes = {name: np.ascontiguousarray(sky[..., index]) for index, name in enumerate("RGB")}
    planes["A"] = np.zeros_like(planes["R"])
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, planes) as file:
        file.write(str(tmp_path / "sky.exr"))
    np.testing.assert_array_equal(read_environment(tmp_path / "sky.exr").radiance, sky)


@pytest.mark.parametrize(
    ("first", "flip", "warned"), [(-2, "false", True), (-2, "true", False), (2, "false", False)]
)
def test_a_mirroring_transform_is_reported_unless_the_winding_is_flipped(
    tmp_path: Path, first: int, flip: str, warned: bool
) -> None:
    rows = f"[[{first}, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]"
    keys = f"flip_winding = {flip}\ntransform = {rows}\n"
    scene = open_scene(write(tmp_path, PLATE, FRUSTUM, BOX, keys))
    words = "object[0].transform mirrors box"
    assert any(words in warning for warning in scene.warnings) == warned
