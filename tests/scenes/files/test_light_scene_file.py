"""Light in the scene file: the scene has the light that it says, and every mistake is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.support.environment_maps import write_map
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.appearance.appearance import DEFAULT_LIGHT, DEFAULT_MATERIAL, Material
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.files.environment import read_environment

HEAD = (
    "[plate]\nsize = [80, 60]\nhogels = [81, 61]\n"
    "[frustum]\nresolution = [8, 8]\nfov_deg = [60, 60]\nreach = [150, 150]\n"
)
BOX = '[[object]]\nshape = "box"\n'
PAINT = "[material.paint]\n"
LIGHT = "[[light]]\ndirection = [0, 3, 4]\n"
MAP = '[environment]\nmap = "sky.exr"\n'

SHARED_EXPONENT = 2.0**-7
"""A Radiance HDR file cuts three channels to 8 bits below one power of two, which is at most twice the
largest of them: off by at most this share of it."""


def write(folder: Path, *tables: str) -> str:
    path = folder / "scene.toml"
    path.write_text(HEAD + "".join(tables))
    return str(path)


@pytest.fixture
def sky() -> Singles:
    """A map that no flip leaves as it is."""
    return np.random.default_rng(3).random((6, 12, 3), dtype=np.float32) * 5


def test_a_material_has_what_its_table_says_and_the_rest_from_the_defaults(tmp_path: Path) -> None:
    paint = PAINT + "ambient = 0.25\ndiffuse = [0.5, 0, 1]\nexponent = 7\nreflectivity = [0, 0.5, 1]\n"
    scene = open_scene(write(tmp_path, BOX, 'material = "paint"\n', BOX, paint))
    assert scene.materials == (
        Material(ambient=(0.25,) * 3, diffuse=(0.5, 0, 1), exponent=7, reflectivity=(0, 0.5, 1)),
        DEFAULT_MATERIAL,
    )


def test_lights_point_toward_the_light_and_have_a_color(tmp_path: Path) -> None:
    scene = open_scene(write(tmp_path, LIGHT, "color = [1, 0.5, 0]\n", LIGHT, "color = 0.25\n"))
    first, second = scene.appearance.lights
    assert (first.direction, first.color) == ((0.0, 0.6, 0.8), (1.0, 0.5, 0.0))
    assert second.color == (0.25, 0.25, 0.25)


@pytest.mark.parametrize(
    ("tables", "lights"),
    [
        ("", (DEFAULT_LIGHT,)),
        (BOX + PAINT, (DEFAULT_LIGHT,)),
        ("light = []\n", ()),
        (MAP, ()),
        (MAP + LIGHT, ((0.0, 0.6, 0.8),)),
    ],
)
def test_only_a_file_without_light_and_environment_gets_the_default_light(
    tmp_path: Path, sky: Singles, tables: str, lights: tuple[object, ...]
) -> None:
    write_map(tmp_path / "sky.exr", sky)
    path = tmp_path / "scene.toml"
    path.write_text(tables + HEAD if tables.startswith("light") else HEAD + tables)
    found = open_scene(str(path)).appearance.lights
    assert len(found) == len(lights)
    assert all(want in (light, light.direction) for light, want in zip(found, lights, strict=True))


def test_sampling_and_transport_are_off_unless_asked_for(tmp_path: Path) -> None:
    plain = open_scene(write(tmp_path))
    assert (plain.sampling, plain.transport) == (Sampling(), Transport())
    tables = "[sampling]\naperture = 16\nsupersample = 2\n[transport]\nshadows = true\nsamples = 8\n"
    asked = open_scene(write(tmp_path, tables))
    assert asked.sampling == Sampling(supersample=2, aperture=16)
    assert asked.transport == Transport(shadows=True, samples=8)


def test_smooth_gives_normals_to_what_has_none(tmp_path: Path) -> None:
    scene = open_scene(write(tmp_path, BOX, BOX, "smooth = true\n"))
    flat, smooth = scene.objects
    assert flat.vertex_normals is None
    assert smooth.vertex_normals is not None
    # The three faces at a corner of a box share it alike.
    np.testing.assert_allclose(smooth.vertex_normals, np.sign(smooth.vertices) / np.sqrt(3), atol=1e-15)


def test_an_environment_is_read_as_stored_from_openexr_and_radiance_files(
    tmp_path: Path, sky: Singles
) -> None:
    write_map(tmp_path / "sky.exr", sky)
    write_map(tmp_path / "sky.hdr", sky)
    scene = open_scene(write(tmp_path, MAP, "strength = 2.5\n"))
    assert scene.appearance.environment is not None
    assert scene.appearance.environment.strength == 2.5
    np.testing.assert_array_equal(scene.appearance.environment.radiance, sky)
    shared = read_environment(tmp_path / "sky.hdr").radiance
    assert (np.abs(shared - sky) <= SHARED_EXPONENT * sky.max(axis=2, keepdims=True)).all()


def test_channels_are_found_by_name_and_alpha_is_ignored(tmp_path: Path, sky: Singles) -> None:
    """OpenEXR sorts channels by name; another library wrote these."""
    planes = {name: np.ascontiguousarray(sky[..., index]) for index, name in enumerate("RGB")}
    planes["A"] = np.zeros_like(planes["R"])
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, planes) as file:
        file.write(str(tmp_path / "sky.exr"))
    np.testing.assert_array_equal(read_environment(tmp_path / "sky.exr").radiance, sky)


def test_a_bad_environment_is_one_line_that_says_what_is_wrong(tmp_path: Path, sky: Singles) -> None:
    negative, nan, infinite = sky.copy(), sky.copy(), sky.copy()
    negative[1, 2, 0], nan[1, 2, 0], infinite[1, 2, 0] = -1e-3, np.nan, np.inf
    pictures: dict[str, Singles] = {
        "negative.exr": negative,
        "nan.exr": nan,
        "infinite.exr": infinite,
        "gray.exr": sky[..., :1],
        "whole.hdr": sky,
        "whole.exr": sky,
    }
    for name, pixels in pictures.items():
        write_map(tmp_path / name, pixels)
    Image.new("RGB", (12, 6)).save(tmp_path / "plain.png")
    for kind in ("hdr", "exr"):
        whole = (tmp_path / f"whole.{kind}").read_bytes()
        (tmp_path / f"cut.{kind}").write_bytes(whole[: len(whole) * 2 // 3])
    told = {
        "negative.exr": "not negative",
        "nan.exr": "finite",
        "infinite.exr": "finite",
        "gray.exr": "RGB",
        "plain.png": "not an OpenEXR or Radiance HDR",
        "cut.hdr": "damaged",
        "cut.exr": "damaged",
        "scene.toml": "not an OpenEXR or Radiance HDR",
        "none.exr": "no such environment map",
    }
    for name, words in told.items():
        with pytest.raises(InputError, match=words) as caught:
            open_scene(write(tmp_path, MAP.replace("sky.exr", name)))
        message = str(caught.value)
        assert "\n" not in message
        assert "environment.map" in message
        assert name in message


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        (PAINT + "difuse = 1\n", ["material.paint.difuse", "nearest valid key is material.paint.diffuse"]),
        (PAINT + "diffuse = -1\n", ["material.paint.diffuse[0]", "equal to 0, not -1"]),
        (PAINT + "diffuse = [1, 2]\n", ["material.paint.diffuse[2] is missing"]),
        (PAINT + "specular = [1, nan, 0]\n", ["material.paint.specular", "nan"]),
        (PAINT + "ambient = true\n", ["material.paint.ambient", "True"]),
        (PAINT + "ambient = 'red'\n", ["material.paint.ambient", "'red'"]),
        (PAINT + "reflectivity = 1.5\n", ["material.paint.reflectivity[0]", "equal to 1, not 1.5"]),
        (PAINT + "exponent = 0\n", ["material.paint.exponent", "greater than 0"]),
        ('[material."car paint"]\nexponent = 0\n', ['material."car paint".exponent']),
        ("[material]\npaint = 3\n", ["material.paint", "not 3"]),
        (LIGHT + "colour = 1\n", ["light[0].colour", "light[0].color"]),
        (LIGHT + LIGHT.replace("3, 4", "0, 0"), ["light[1].direction", "a length"]),
        ("[[light]]\ncolor = 1\n", ["light[0].direction is missing"]),
        ("[light]\ndirection = [1, 0, 0]\n", ["light", "[[light]]"]),
        (MAP + "strength = -1\n", ["environment.strength", "equal to 0"]),
        (MAP + "rotate = 1\n", ["environment.rotate", "nearest valid key is environment."]),
        ("[environment]\n", ["environment.map is missing"]),
        ("[sampling]\naperture = 0\n", ["sampling.aperture", "equal to 1"]),
        ("[sampling]\nsupersample = 1.5\n", ["sampling.supersample", "1.5"]),
        ("[sampling]\nsamples = 4\n", ["sampling.samples", "nearest valid key is sampling.supersample"]),
        ("[transport]\nsamples = 1\n", ["transport.samples", "equal to 2"]),
        ("[transport]\nshadow = true\n", ["transport.shadow", "transport.shadows"]),
        ("[transport]\nshadows = 1\n", ["transport.shadows", "boolean, not 1"]),
        (BOX + "smooth = 1\n", ["object[0].smooth", "boolean"]),
        (BOX + "chord_tolerance = 1\n", ["object[0]", "only Bezier patches"]),
        (BOX + 'material = "gold"\n' + PAINT, ["object[0].material", "gold", "paint"]),
        ("[lights]\n", ["unknown key lights", "nearest valid key is light"]),
    ],
)
def test_a_mistake_is_one_line_with_file_key_and_what_is_allowed(
    tmp_path: Path, tables: str, told: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        open_scene(write(tmp_path, tables))
    message = str(caught.value)
    assert "\n" not in message
    for words in ["scene.toml", *told]:
        assert words in message
