"""The scene file: the scene is as the file says, and every mistake is one line that names the key."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from xfrustum.scenes import InputError, Plate, Screen, open_scene
from xfrustum.scenes.geometry.operations import placement

PLATE = "[plate]\nsize = [80, 60.0]\nhogels = [81, 61]\n"
FRUSTUM = "[frustum]\nresolution = [512, 256]\nfov_deg = [60, 45.0]\nreach = [150, 100.0]\n"
BOX = '[[object]]\nshape = "box"\n'


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


def test_a_screen_makes_the_frustum_recentered(tmp_path: Path) -> None:
    frustum = FRUSTUM.replace(
        "fov_deg = [60, 45.0]", "screen = { height = -5, center = [1, 2], size = [3, 4] }"
    )
    scene = open_scene(write(tmp_path, PLATE, frustum))
    assert scene.frustum.screen == Screen(height=-5, center=(1, 2), size=(3, 4))


def test_a_scene_without_objects_is_legal(tmp_path: Path) -> None:
    assert len(open_scene(write(tmp_path, PLATE, FRUSTUM)).faces) == 0


def test_scale_then_rotate_about_fixed_x_y_z_then_translate() -> None:
    """By hand, (1, 2, 3) becomes (2, 4, 6), about x (2, -6, 4), about y (4, -6, -2), about z (6, 4, -2)."""
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


def test_a_material_names_a_table(tmp_path: Path) -> None:
    material = "[material.paint]\ndiffuse = [1, 0, 0]\n"
    scene = open_scene(write(tmp_path, PLATE, FRUSTUM, BOX, 'material = "paint"\n', material))
    assert scene.objects[0].material == "paint"


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ([PLATE], ["frustum is missing"]),
        ([PLATE, FRUSTUM, "fovdeg = [1, 1]\n"], ["frustum.fovdeg", "nearest valid key is frustum.fov_deg"]),
        ([PLATE, FRUSTUM.replace("reach", "reech")], ["frustum.reech", "frustum.reach"]),
        ([PLATE, FRUSTUM, BOX, BOX, "rotate = [0, 0, 0]\n"], ["object[1].rotate", "object[1].rotate_deg"]),
        (["nmae = 'x'\n", PLATE, FRUSTUM], ["nmae", "nearest valid key is name"]),
        ([PLATE.replace("81", "81.5"), FRUSTUM], ["plate.hogels[0]", "valid integer", "81.5"]),
        ([PLATE.replace("81", "0"), FRUSTUM], ["plate.hogels[0]", "equal to 1, not 0"]),
        ([PLATE.replace("80", "-80"), FRUSTUM], ["plate.size[0]", "greater than 0, not -80"]),
        ([PLATE.replace("80", "nan"), FRUSTUM], ["plate.size[0]", "finite number, not nan"]),
        ([PLATE.replace("80", "'80'"), FRUSTUM], ["plate.size[0]", "valid number, not '80'"]),
        ([PLATE.replace("80", "true"), FRUSTUM], ["plate.size[0]", "not True"]),
        ([PLATE.replace("[80, 60.0]", "[80]"), FRUSTUM], ["plate.size[1] is missing"]),
        ([PLATE.replace("[80, 60.0]", "80"), FRUSTUM], ["plate.size", "not 80"]),
        ([PLATE, FRUSTUM.replace("150", "0")], ["frustum.reach[0]", "greater than 0"]),
        ([PLATE, FRUSTUM.replace("45.0", "180")], ["frustum.fov_deg[1]", "less than 180, not 180"]),
        ([PLATE, FRUSTUM.replace("512", "0")], ["frustum.resolution[0]", "equal to 1, not 0"]),
        ([PLATE, FRUSTUM.replace("fov_deg = [60, 45.0]\n", "")], ["fov_deg = [x, y] degrees", "screen = {"]),
        ([PLATE, FRUSTUM, "screen = {height = 1, center = [0, 0], size = [1, 1]}\n"], ["fov_deg", "screen"]),
        ([PLATE, FRUSTUM, "screen = { height = 1, centre = [0, 0] }\n"], ["frustum.screen.centre", "center"]),
        ([PLATE, FRUSTUM, "[[object]]\n"], ["object[0]", "mesh or shape", "box, square, sphere"]),
        ([PLATE, FRUSTUM, BOX, 'mesh = "a.obj"\n'], ["object[0]", "not both"]),
        ([PLATE, FRUSTUM, BOX.replace("box", "bax")], ["object[0].shape", "nearest is box"]),
        ([PLATE, FRUSTUM, BOX, "scale = 0\n"], ["object[0].scale", "greater than 0"]),
        ([PLATE, FRUSTUM, BOX, "rotate_deg = [1, 2]\n"], ["object[0].rotate_deg[2] is missing"]),
        (
            [PLATE, FRUSTUM, BOX, "scale = 1\ntransform = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"],
            ["both transform and scale", "any of scale, rotate_deg and translate"],
        ),
        (
            [PLATE, FRUSTUM, BOX, "transform = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]\n"],
            ["object[0].transform must be four rows", "its last row is [0.0, 0.0, 1.0, 1.0]"],
        ),
        ([PLATE, FRUSTUM, BOX, "transform = [[1,0,0,0],[2,0,0,0],[0,0,1,0],[0,0,0,1]]\n"], ["are singular"]),
        (
            [PLATE, FRUSTUM, BOX, "scale = 1e300\ntranslate = [1, 1, 1]\n", BOX, "scale = inf\n"],
            ["object[1].sc"],
        ),
        ([PLATE, FRUSTUM, BOX, 'material = "gold"\n'], ["object[0].material", "gold"]),
        ([PLATE, FRUSTUM, "[object]\nshape = 'box'\n"], ["object", "[[object]]"]),
        ([PLATE, FRUSTUM, '[[object]]\nmesh = "none.obj"\n'], ["object[0].mesh", "none.obj", "no such mesh"]),
        (["plate = \n"], ["not valid TOML", "line 1"]),
    ],
)
def test_a_mistake_is_one_line_with_file_key_and_what_is_allowed(
    tmp_path: Path, tables: list[str], told: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        open_scene(write(tmp_path, *tables))
    message = str(caught.value)
    assert "\n" not in message
    for words in ["scene.toml", *told]:
        assert words in message


def test_a_mesh_in_place_of_a_scene_file_is_told_to_need_one(tmp_path: Path) -> None:
    (tmp_path / "beetle.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="write a scene file first: xfrustum new"):
        open_scene(str(tmp_path / "beetle.obj"))


def test_unreadable_files_are_input_errors(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name, words in [("missing", "no such"), ("folder", "is a folder"), ("bytes", "not valid")]:
        with pytest.raises(InputError, match=words):
            open_scene(str(tmp_path / f"{name}.toml"))


def test_an_unknown_name_names_the_nearest_scene() -> None:
    with pytest.raises(InputError, match="did you mean asymmetric"):
        open_scene("asymetric")
    with pytest.raises(InputError, match="called 'nosuch'; `xfrustum scenes` lists all"):
        open_scene("nosuch")


@pytest.mark.parametrize("size", [1e-33, 1e31])
def test_lengths_that_32_bit_images_cannot_hold_are_refused(size: float) -> None:
    with pytest.raises(InputError, match="choose another unit of length"):
        replace(open_scene("asymmetric"), plate=Plate(size=(size, size), hogels=(1, 1)))


def test_a_screen_almost_in_the_plate_is_refused() -> None:
    scene = open_scene("asymmetric-recentered")
    screen = Screen(height=1e-15, center=(0.0, 0.0), size=(100.0, 80.0))
    with pytest.raises(InputError, match=r"frustum\.screen\.height"):
        replace(scene, frustum=replace(scene.frustum, screen=screen))
