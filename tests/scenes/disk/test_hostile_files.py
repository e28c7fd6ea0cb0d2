"""Damaged files and malicious files: one line that names the file, and no other message."""

import io
import json
import os
import re
import struct
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.scenes.files.test_exr import a_camera, an_image
from tests.support.environment_maps import write_map
from tests.support.scene_file import film
from xfrustum.compare.recorded import read_frames
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.disk import allowed_memory, input_memory
from xfrustum.scenes.files.exr import read_image, write_image
from xfrustum.scenes.files.pictures import Encoding, read_environment, read_foreign, read_rgb
from xfrustum.scenes.meshes.mesh_file import load_mesh
from xfrustum.scenes.meshes.tessellation import load_patches
from xfrustum.scenes.model.device_model import DeviceModel

GIBIBYTE = 1 << 30
SCENE = film(
    (10.0, 10.0), hogels=(3, 3), resolution=(16, 12), fov_deg=(60.0, 60.0), reach=(20.0, 20.0)
)
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TRIANGLE = CORNERS + "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
NET = "1\n2 2\n" + "".join(f"{x} {y} {x * y}\n" for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0))
"""File of one Bezier patch."""


@cache
def made(suffix: str, value: float = 1.0, channels: int = 3) -> bytes:
    """Return a hogel image (`image.exr`), or an environment with one pixel of some value."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / suffix
        if suffix == "image.exr":
            write_image(path, an_image())
        else:
            pixels = np.random.default_rng(3).random((6, 12, channels), dtype=np.float32)
            pixels[1, 2, 0] = value
            write_map(path, pixels)
        return path.read_bytes()


def image(damage: Callable[[bytes], bytes]) -> Callable[[], bytes]:
    return lambda: damage(made("image.exr"))


def renamed(name: bytes) -> Callable[[], bytes]:
    """Return a function that makes an image with a non-UTF-8 attribute or channel name."""
    return image(lambda data: data.replace(name, b"\xff" + name[1:], 1))


def enlarged(data: bytes) -> bytes:
    """Change the size that an image declares to 40,000 x 40,000 pixels."""
    at = data.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    return data[:at] + struct.pack("<iiii", 0, 0, 40_000, 40_000) + data[at + 16 :]


def reordered(data: bytes) -> bytes:
    """Store an image's line order in two bytes, 2 and 0, instead of one."""
    name = b"lineOrder\0lineOrder\0"
    before, after = data.split(name)
    return before + name + b"\2\0\0\0" + b"\2\0" + after[5:]


def gltf_of_gigabytes() -> str:
    count = 150_000_000
    accessors = [{"componentType": 5126, "type": "VEC3", "count": count}]
    accessors.append({"componentType": 5125, "type": "SCALAR", "count": count})
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]
    tree = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    return json.dumps({**tree, "meshes": meshes, "accessors": accessors})


def archive_of_megabytes() -> bytes:
    """Return a small archive of a mesh that is a thousand times larger."""
    held = io.BytesIO()
    with (
        zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.obj", "w") as member,
    ):
        for _ in range(70):
            member.write(b"v 0 0 0\n" * (1 << 17))
        member.write(b"f 1 2 3\n")
    assert len(held.getvalue()) < 1 << 20
    return held.getvalue()


def picture() -> bytes:
    held = io.BytesIO()
    Image.new("RGB", (12, 6)).save(held, format="png")
    return held.getvalue()


def scene(old: str, new: str) -> str:
    return (SCENE + '[[object]]\nshape = "sphere"\n').replace(old, new)


def cut(data: bytes, share: float = 0.5) -> bytes:
    return data[: int(len(data) * share)]


def zeroed(data: bytes) -> bytes:
    """Replace 16 bytes in the middle of an image by zeros."""
    middle = len(data) // 2
    return data[:middle] + bytes(16) + data[middle + 16 :]


SCREEN = "screen = { height = 20.0, center = [0.0, 0.0], size = [60.0, 5e-22] }"
LIGHT = "[[light]]\ndirection = [0.0, 0.0, 1.0]\ncolor = 1e308\n[[object]]"
BEYOND = "1\n2 2\n" + "".join(
    f"{x} {y} {1e300 * (x == y == 1)}\n" for x in range(3) for y in range(3)
)

Content = str | bytes | Callable[[], bytes]
DAMAGED: list[tuple[str, Content, str]] = [
    ("mesh.obj", "", "the mesh file is empty"),
    ("mesh.obj", CORNERS.replace("v 1 0 0", "v inf 0 0") + "f 1 2 3\n", "the first is number 1"),
    ("mesh.gltf", gltf_of_gigabytes(), "--max-input-memory"),
    ("mesh.3mf", archive_of_megabytes, "unpacking"),
    ("mesh.bpt", "", "the patch file is empty"),
    ("mesh.bpt", "9" * 4400 + "\n", "number of patches must be at most"),
    ("mesh.bpt", NET[:-20], "ends within the control points of patch 0"),
    ("mesh.bpt", NET.replace("0.5", "half", 1), "a control point of patch 0 is not a number"),
    ("mesh.bpt", BEYOND, "beyond 1e+100"),
    ("mesh.bpt", b"\xff\xfe\x00", "not a text of Bezier patches"),
    ("image.exr", "hello", "not an OpenEXR image"),
    *(("image.exr", image(partial(cut, share=share)), "damaged") for share in (0.02, 0.998)),
    ("image.exr", image(zeroed), "damaged"),
    ("image.exr", image(reordered), "damaged"),
    *(("image.exr", renamed(name), "damaged") for name in (b"P.X", b"dataWindow")),
    ("image.exr", image(enlarged), "--max-input-memory"),
    ("sky.exr", partial(made, "sky.exr", np.nan), "finite"),
    ("sky.exr", partial(made, "sky.exr", -1e-3), "not negative"),
    ("sky.exr", partial(made, "sky.exr", 1.0, 1), "RGB"),
    ("sky.hdr", lambda: cut(made("sky.hdr")), "damaged"),
    ("sky.exr", picture, "not an OpenEXR or Radiance HDR"),
    ("scene.toml", scene("size = [10.0", "size = [1" + "0" * 400), "plate.size"),
    ("scene.toml", scene("[20.0, 20.0]", "[" * 600 + "]" * 600), "nested too deeply"),
    ("scene.toml", scene("fov_deg = [60.0, 60.0]", SCREEN), "no image resolves such angles"),
    ("scene.toml", scene("[[object]]", LIGHT), "light[0].color"),
    (
        "scene.toml",
        scene("[[object]]", "[material.m]\ndiffuse = 1e308\n[[object]]"),
        "material.m.diffuse",
    ),
]
"""File name, which selects the reader; content, or a function that makes it; error message."""


def scene_of(path: Path) -> Path:
    """Write a scene file beside a mesh or an environment, which it uses."""
    table = "[environment]\nmap" if path.name.startswith("sky") else "[[object]]\nmesh"
    path.with_name("scene.toml").write_text(f'{SCENE}{table} = "{path.name}"\n')
    return path.with_name("scene.toml")


def refusal(path: Path) -> str:
    """Return the one-line error for a file."""
    with pytest.raises(InputError) as caught:
        if path.stem == "image":
            read_image(path)
        else:
            open_scene(path if path.stem == "scene" else scene_of(path))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "expected"), DAMAGED, ids=[f"{n}: {t}" for n, _, t in DAMAGED]
)
def test_a_damaged_file_is_one_line_that_names_it_without_library_messages(
    name: str, content: Content, expected: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    made_of = content() if callable(content) else content
    (tmp_path / name).write_bytes(made_of if isinstance(made_of, bytes) else made_of.encode())
    message = refusal(tmp_path / name)
    assert name in message and expected in message
    key = {"mesh": "object[0].mesh", "sky": "environment.map"}.get(name.partition(".")[0], "")
    assert key in message
    assert capfd.readouterr() == ("", "")


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    for read, name, message in (
        (read_image, "missing.exr", "no such image"),
        (load_mesh, "missing.obj", "no such mesh"),
        (load_patches, "missing.bpt", "no such patch file"),
        (read_environment, "missing.exr", "no such environment map"),
        (open_scene, "missing.toml", "no such scene"),
    ):
        with pytest.raises(InputError, match=message):
            read(tmp_path / name)
    with pytest.raises(InputError, match="is a folder"):
        open_scene(tmp_path)


def test_pipes_are_refused_instead_of_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.exr"
    os.mkfifo(pipe)
    readers: list[Callable[[Path], object]] = [
        *(open_scene, load_mesh, load_patches, read_environment, read_image),
        *(DeviceModel.read, read_frames),
        partial(read_foreign, camera=a_camera(), encoding=Encoding.RGB),
    ]
    for read in readers:
        with pytest.raises(InputError, match=r"is a pipe; an? .* must be a regular file"):
            read(pipe)
    with pytest.raises(InputError, match="/dev/zero: is a device"):
        open_scene("/dev/zero")


def test_textures_that_are_pipes_are_unread_and_those_of_too_many_pixels_refused(
    tmp_path: Path,
) -> None:
    skin = tmp_path / "skin.png"
    (tmp_path / "mesh.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    (tmp_path / "mesh.obj").write_text("mtllib mesh.mtl\nusemtl m\n" + TRIANGLE)
    os.mkfifo(skin)
    [unread] = load_mesh(tmp_path / "mesh.obj").unread
    assert unread.feature == "texture skin.png"
    skin.unlink()
    Image.new("1", (300, 300)).save(skin)
    message = r"300 x 300 pixels.*--max-input-memory"
    with input_memory(1 << 16), pytest.raises(InputError, match=message):
        read_rgb(skin)
    with input_memory(1 << 16):
        assert re.search(message, refusal(tmp_path / "mesh.obj"))


def test_the_bound_of_memory_grows_with_the_file_and_can_be_raised() -> None:
    assert allowed_memory(10) == GIBIBYTE
    assert allowed_memory(GIBIBYTE) == 64 * GIBIBYTE
    with input_memory(3 * GIBIBYTE):
        assert allowed_memory(10) == 3 * GIBIBYTE
    assert allowed_memory(10) == GIBIBYTE


def test_a_chord_tolerance_that_would_take_too_many_triangles_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bpt"
    path.write_text(NET)
    for tolerance in (1e-15, 1e-40):
        with pytest.raises(InputError, match="choose a larger chord_tolerance"):
            load_patches(path, chord_tolerance=tolerance)
