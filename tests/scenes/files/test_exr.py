"""Hogel images as OpenEXR: complete round trips, one-line errors, and foreign files."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from xfrustum.scenes import (
    NOTHING,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelCamera,
    HogelImage,
    InputError,
    open_scene,
)
from xfrustum.scenes.appearance import Sampling, Transport
from xfrustum.scenes.files.exr import image_writer, read_image, write_image
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.images import Rendering

WIDTH, HEIGHT = 37, 21


def a_camera() -> HogelCamera:
    return HogelCamera(
        aperture=open_scene("car").plate.aperture(3, 7),
        resolution=(WIDTH, HEIGHT),
        shear=(1 / 3, -math.pi),
        half_extent=(math.tan(0.5), 5e-324),
        reach=(150.0, 1e300),
        scene='a "scene" of \u00e9',
        scene_hash="ab12",
        light_paths=64,
        renderer="nobody 1.0",
        settings=DoubleFrustum(
            near=0.1 + 0.2,
            depth=DepthFormat.D32F,
            mapping=DepthMapping.REVERSED,
            camera=Camera.C_STAR,
        ),
    )


def an_image() -> HogelImage:
    rng = np.random.default_rng(7)
    size = (HEIGHT, WIDTH)
    triangle = rng.integers(0, 2**31 - 1, size).astype(np.int32)
    triangle[:5] = NOTHING
    nothing = triangle == NOTHING
    position, normal = (
        np.where(nothing[..., None], np.nan, rng.normal(size=(*size, 3))) for _ in "PN"
    )
    color, variance = (rng.random((*size, 3), dtype=np.float32) for _ in range(2))
    return HogelImage(
        camera=a_camera(),
        triangle=triangle,
        object=np.where(nothing, NOTHING, 2).astype(np.int32),
        position=100 * position,
        normal=normal,
        color=color,
        variance=variance,
        certainty=rng.integers(0, 4, size).astype(np.uint8),
        rendering=Rendering.from_effects(
            [Effect.SPECULAR, Effect.C],
            Sampling(supersample=2, multisample=4, aperture=16),
            Transport(shadows=True, samples=64),
        ),
    )


ARRAYS = ("normal", "color", "variance", "certainty")


def rows(image: HogelImage, start: int, stop: int) -> HogelImage:
    names = ("triangle", "object", "position", *ARRAYS)
    return replace(image, **{name: getattr(image, name)[start:stop] for name in names})


def assert_same(image: HogelImage, expected: HogelImage) -> None:
    assert image.camera == expected.camera
    assert image.rendering == expected.rendering
    for name in ("triangle", "object", "position", *ARRAYS):
        array, other = getattr(image, name), getattr(expected, name)
        assert (array is None) == (other is None), name
        if array is not None:
            np.testing.assert_array_equal(array, np.asarray(other, dtype=array.dtype))


def write_foreign(path: Path, channels: dict[str, Any], **header: Any) -> None:
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    copies = {name: plane.copy() for name, plane in channels.items()}
    OpenEXR.File(kind | header, copies).write(str(path))


NUMBERS = {"id.triangle", "id.object", "certainty"}
NAMED = {*"RGBZ", *(f"{v}.{a}" for v in "PN" for a in "XYZ"), *(f"variance.{c}" for c in "RGB")}


@pytest.mark.parametrize("rows_per_band", [5, HEIGHT])
def test_every_array_and_every_double_of_the_camera_returns_in_channels_of_the_contract(
    tmp_path: Path, rows_per_band: int
) -> None:
    path, image = tmp_path / "image.exr", an_image()
    with image_writer(path, image.camera, ARRAYS, image.rendering) as write:
        for start in range(0, HEIGHT, rows_per_band):
            write(rows(image, start, start + rows_per_band))
            assert not path.exists(), "the file appears only when it is complete"
    assert_same(read_image(path), image)
    file = OpenEXR.File(str(path), separate_channels=True)
    channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert channels.keys() == NUMBERS | NAMED
    assert {name for name, pixels in channels.items() if pixels.dtype == np.uint32} == NUMBERS
    np.testing.assert_array_equal(channels["id.triangle"], image.triangle.astype(np.int64) + 1)
    np.testing.assert_array_equal(channels["Z"], channels["P.Z"])
    np.testing.assert_array_equal(channels["P.Y"], image.position[..., 1].astype(np.float32))


def test_absent_arrays_have_no_channels(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    nothing: dict[str, Any] = dict.fromkeys((*ARRAYS, "rendering"))
    bare = replace(an_image(), camera=replace(a_camera(), settings=None), **nothing)
    write_image(path, bare)
    assert_same(read_image(path), bare)
    names = OpenEXR.File(str(path), separate_channels=True).channels().keys()
    assert sorted(names) == ["P.X", "P.Y", "P.Z", "Z", "id.object", "id.triangle"]


def test_an_exception_between_bands_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path, image = tmp_path / "image.exr", an_image()
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), image_writer(path, image.camera) as write:
        write(rows(image, 0, 4))
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["image.exr"]


def test_a_foreign_image_gets_the_stated_camera_and_lacks_unstored_arrays(
    tmp_path: Path,
) -> None:
    path = tmp_path / "foreign.exr"
    numbers = np.arange(WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    write_foreign(path, {"id.triangle": numbers, "depth": numbers})
    with pytest.raises(InputError, match="xfrustum:camera"):
        read_image(path)
    image = read_image(path, a_camera())
    assert image.camera == a_camera()
    np.testing.assert_array_equal(image.triangle, numbers - 1)
    assert (image.object == NOTHING).all() and np.isnan(image.position).all()
    assert (image.normal, image.color, image.certainty) == (None, None, None)
    height = np.full((HEIGHT, WIDTH), np.nan, dtype=np.float32)
    height[3:9] = 4.0
    write_foreign(path, dict.fromkeys(("P.X", "P.Y", "P.Z"), height))
    image = read_image(path, a_camera())
    assert (image.triangle == NOTHING).all()
    np.testing.assert_array_equal(image.covered, np.isfinite(height))


def test_the_camera_of_the_file_wins_except_for_a_foreign_renderer(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    write_image(path, an_image())
    assert read_image(path, replace(a_camera(), scene="another")).camera.scene == a_camera().scene
    image = read_image(path, replace(a_camera(), scene="another"), partial=True)
    assert (image.camera.scene, image.rendering) == ("another", None)


ONES = np.ones((HEIGHT, WIDTH), np.float32)
WHOLE = dict.fromkeys(("P.X", "P.Y", "P.Z", "id.triangle"), ONES)


REFUSED: dict[str, tuple[dict[str, Any], dict[str, str]]] = {
    "neither id.triangle nor P.X": ({"R": ONES}, {}),
    "no channel P.Y": ({"P.X": ONES, "P.Z": ONES}, {}),
    "whole numbers": (WHOLE | {"id.triangle": ONES / 2}, {}),
    "its camera says 37 x 21": (dict.fromkeys(WHOLE, ONES[1:]), {}),
    "not a camera (JSON": (WHOLE, {"camera": "{"}),
    "not a camera (aperture: Field required)": (WHOLE, {"camera": "{}"}),
    "not a camera (near must be a positive length, not -1.0)": (
        WHOLE,
        {"camera": '{"settings": {"near": -1}}'},
    ),
    "not a rendering (effects.0: ": (WHOLE, {"rendering": '{"effects": ["magic"]}'}),
}


@pytest.mark.parametrize("message", REFUSED)
def test_an_unreadable_file_is_refused_in_one_line_with_its_name(
    tmp_path: Path, message: str
) -> None:
    path, (channels, header) = tmp_path / "foreign.exr", REFUSED[message]
    write_foreign(path, channels, **{f"xfrustum:{name}": text for name, text in header.items()})
    with pytest.raises(InputError) as caught:
        read_image(path, a_camera())
    assert "foreign.exr" in str(caught.value) and message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_image_beyond_the_count_of_openexr_is_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    huge = replace(a_camera(), resolution=(1 << 15, (1 << 14) + 1))
    message = r"32768 x 16385 pixels .* lower frustum\.resolution"
    with pytest.raises(InputError, match=message), image_writer(tmp_path / "huge.exr", huge):
        pass
    assert not list(tmp_path.iterdir())
