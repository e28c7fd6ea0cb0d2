"""Files that nobody should have sent: pipes, devices, and a few bytes that declare gigabytes."""

import json
import os
import re
import struct
import zipfile
from pathlib import Path

import pytest
from PIL import Image

from tests.scenes.files.test_exr import a_camera, an_image
from tests.support.scene_file import film
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.disk.input_files import allowed_memory, input_memory
from xfrustum.scenes.files.exr import read_header, read_image, write_image
from xfrustum.scenes.files.foreign_images import Encoding, read_foreign
from xfrustum.scenes.files.meshes import load_mesh
from xfrustum.scenes.files.pictures import read_environment, read_rgb
from xfrustum.scenes.geometry.tessellation import load_patches

GIBIBYTE = 1 << 30
FILM = film((10.0, 10.0), hogels=(3, 3), resolution=(16, 12), fov_deg=(60.0, 60.0), reach=(20.0, 20.0))
SCENE = FILM + "[[object]]\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


def refusal(path: Path) -> str:
    """Return the one line with which a scene of one mesh is refused."""
    scene = path.with_suffix(".toml")
    scene.write_text(SCENE + f'mesh = "{path.name}"\n')
    with pytest.raises(InputError) as caught:
        open_scene(str(scene))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def a_small_image(tmp_path: Path) -> Path:
    path = tmp_path / "image.exr"
    write_image(path, an_image())
    return path


def test_pipes_are_refused_instead_of_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.exr"
    os.mkfifo(pipe)
    camera = a_camera()
    for read in (
        lambda: open_scene(str(pipe)),
        lambda: load_mesh(pipe),
        lambda: load_patches(pipe),
        lambda: read_environment(pipe),
        lambda: read_image(pipe),
        lambda: read_foreign(pipe, camera, Encoding.RGB),
    ):
        with pytest.raises(InputError, match=r"is a pipe; an? .* must be a regular file"):
            read()
    with pytest.raises(InputError, match="/dev/zero: is a device"):
        open_scene("/dev/zero")


def test_a_texture_that_is_a_pipe_refuses_the_mesh(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "skin.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + TRIANGLE)
    assert "skin.png: is a pipe" in refusal(tmp_path / "a.obj")


def test_a_gltf_of_some_hundred_bytes_cannot_ask_for_gigabytes(tmp_path: Path) -> None:
    count = 150_000_000
    accessors = [{"componentType": 5126, "type": "VEC3", "count": count}]
    accessors.append({"componentType": 5125, "type": "SCALAR", "count": count})
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
    }
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    told = refusal(tmp_path / "a.gltf")
    assert "GiB of memory" in told
    assert "--max-input-memory" in told


def test_an_archive_is_refused_by_what_its_members_declare(tmp_path: Path) -> None:
    with (
        zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.obj", "w") as member,
    ):
        for _ in range(70):
            member.write(b"v 0 0 0\n" * (1 << 17))
        member.write(b"f 1 2 3\n")
    assert (tmp_path / "a.zip").stat().st_size < 1 << 20
    assert "unpacking" in refusal(tmp_path / "a.zip")
    (tmp_path / "a.zip").write_bytes(b"PK\x03\x04 and then nothing")
    assert "cannot be unpacked" in refusal(tmp_path / "a.zip")


def test_the_bound_grows_with_the_file_and_can_be_raised() -> None:
    assert allowed_memory(10) == GIBIBYTE
    assert allowed_memory(GIBIBYTE) == 64 * GIBIBYTE
    with input_memory(3 * GIBIBYTE):
        assert allowed_memory(10) == 3 * GIBIBYTE
    assert allowed_memory(10) == GIBIBYTE


def test_pictures_and_textures_are_refused_by_the_pixels_that_they_declare(tmp_path: Path) -> None:
    Image.new("1", (300, 300)).save(tmp_path / "skin.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + TRIANGLE)
    told = r"300 x 300 pixels.*--max-input-memory"
    with input_memory(1 << 16), pytest.raises(InputError, match=told):
        read_rgb(tmp_path / "skin.png")
    with input_memory(1 << 16):
        assert re.search(told, refusal(tmp_path / "a.obj"))


@pytest.mark.parametrize("name", [b"certainty", b"P.X", b"channels", b"dataWindow"])
def test_a_name_in_an_openexr_file_that_is_no_utf8_is_damage(tmp_path: Path, name: bytes) -> None:
    path = a_small_image(tmp_path)
    data = path.read_bytes()
    if name not in data:
        name = b"id.object"
    path.write_bytes(data.replace(name, b"\xff" + name[1:], 1))
    with pytest.raises(InputError, match="damaged"):
        read_image(path)


def test_an_image_cannot_declare_more_pixels_than_its_file_may_hold(tmp_path: Path) -> None:
    path = a_small_image(tmp_path)
    data = path.read_bytes()
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    path.write_bytes(data[:at] + struct.pack("<iiii", 0, 0, 40_000, 40_000) + data[at + 16 :])
    with pytest.raises(InputError, match="--max-input-memory"):
        read_header(path)


def test_control_points_and_chords_beyond_numbers_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    assert "three coordinates" in refusal(tmp_path / "a.obj")
    path = tmp_path / "a.bpt"
    path.write_text("9" * 4400 + "\n")
    assert "number of patches must be at most" in refusal(path)
    path.write_text(
        "1\n2 2\n" + "".join(f"{x} {y} {1e300 * (x == y == 1)}\n" for x in range(3) for y in range(3))
    )
    with pytest.raises(InputError, match="beyond 1e\\+100"):
        load_patches(path)
    path.write_text("1\n3 3\n" + "".join(f"{x} {y} {x * y}\n" for x in range(4) for y in range(4)))
    with pytest.raises(InputError, match="choose a larger chord_tolerance"):
        load_patches(path, chord_tolerance=1e-40)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("size = [10.0", "size = [1" + "0" * 400, "plate.size"),
        ("reach = [20.0, 20.0]", "reach = " + "[" * 600 + "]" * 600, "nested too deeply"),
        (
            "fov_deg = [60.0, 60.0]",
            "screen = { height = 20.0, center = [0.0, 0.0], size = [60.0, 5e-22] }",
            "no image resolves such angles",
        ),
        ("fov_deg = [60.0, 60.0]", "fov_deg = [60.0, 1e-20]", "no image resolves such angles"),
        ("[[object]]", "[[light]]\ndirection = [0.0, 0.0, 1.0]\ncolor = 1e308\n[[object]]", "light[0].color"),
        ("[[object]]", "[material.m]\ndiffuse = 1e308\n[[object]]", "material.m.diffuse"),
    ],
)
def test_numbers_that_nothing_can_hold_are_one_line(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace(old, new) + 'shape = "sphere"\n')
    with pytest.raises(InputError) as caught:
        open_scene(str(path))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
