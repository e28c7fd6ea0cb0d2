"""Hogel images as OpenEXR: what is written comes back, whole or not at all, and foreign files are read."""

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
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.files.exr import image_writer, read_image, write_image
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.hogel_image import Rendering

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
    triangle = rng.integers(0, 2**31 - 1, (HEIGHT, WIDTH)).astype(np.int32)
    triangle[:5] = NOTHING
    nothing = (triangle == NOTHING)[..., None]
    position = np.where(nothing, np.nan, rng.normal(size=(HEIGHT, WIDTH, 3)) * 100)
    normal = np.where(nothing, np.nan, rng.normal(size=(HEIGHT, WIDTH, 3)))
    return HogelImage(
        camera=a_camera(),
        triangle=triangle,
        object=np.where(triangle == NOTHING, NOTHING, 2).astype(np.int32),
        position=position,
        normal=normal,
        color=rng.random((HEIGHT, WIDTH, 3), dtype=np.float32),
        variance=rng.random((HEIGHT, WIDTH, 3), dtype=np.float32),
        certainty=rng.integers(0, 4, (HEIGHT, WIDTH)).astype(np.uint8),
        rendering=Rendering.from_effects(
            [Effect.SPECULAR, Effect.C],
            Sampling(supersample=2, multisample=4, aperture=16),
            Transport(shadows=True, samples=64),
        ),
    )


def rows(image: HogelImage, start: int, stop: int) -> HogelImage:
    names = ("triangle", "object", "position", "normal", "color", "variance", "certainty")
    cut: dict[str, Any] = {
        name: None if getattr(image, name) is None else getattr(image, name)[start:stop]
        for name in names
    }
    return replace(image, **cut)


def assert_same(found: HogelImage, expected: HogelImage) -> None:
    assert found.camera == expected.camera
    assert found.rendering == expected.rendering
    np.testing.assert_array_equal(found.triangle, expected.triangle)
    np.testing.assert_array_equal(found.object, expected.object)
    np.testing.assert_array_equal(found.position, expected.position.astype(np.float32))
    for name in ("normal", "color", "variance", "certainty"):
        one, other = getattr(found, name), getattr(expected, name)
        assert (one is None) == (other is None), name
        if one is not None:
            np.testing.assert_array_equal(one, np.asarray(other, dtype=one.dtype))


def write_foreign(path: Path, channels: dict[str, Any], **header: Any) -> None:
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(kind | header, channels).write(str(path))


def test_every_array_and_every_double_of_the_camera_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    write_image(path, an_image())
    assert_same(read_image(path), an_image())
    assert [p.name for p in tmp_path.iterdir()] == ["image.exr"]


def test_what_an_image_has_not_is_not_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    nothing: dict[str, Any] = dict.fromkeys(
        ("normal", "color", "variance", "certainty", "rendering")
    )
    bare = replace(an_image(), camera=replace(a_camera(), settings=None), **nothing)
    write_image(path, bare)
    assert_same(read_image(path), bare)
    names = OpenEXR.File(str(path), separate_channels=True).channels().keys()
    assert sorted(names) == ["P.X", "P.Y", "P.Z", "Z", "id.object", "id.triangle"]


def test_channels_are_those_of_the_contract(tmp_path: Path) -> None:
    path, image = tmp_path / "image.exr", an_image()
    write_image(path, image)
    file = OpenEXR.File(str(path), separate_channels=True)
    channels = {name: channel.pixels for name, channel in file.channels().items()}
    numbers = {"id.triangle", "id.object", "certainty"}
    others = "R G B variance.R variance.G variance.B P.X P.Y P.Z N.X N.Y N.Z Z"
    assert channels.keys() == numbers | set(others.split())
    assert {name for name, pixels in channels.items() if pixels.dtype == np.uint32} == numbers
    np.testing.assert_array_equal(channels["id.triangle"], image.triangle.astype(np.int64) + 1)
    np.testing.assert_array_equal(channels["Z"], channels["P.Z"])
    np.testing.assert_array_equal(channels["P.Y"], image.position[..., 1].astype(np.float32))


@pytest.mark.parametrize("rows_per_band", [5, 16])
def test_bands_make_the_same_image_as_one_piece(tmp_path: Path, rows_per_band: int) -> None:
    path, image = tmp_path / "bands.exr", an_image()
    arrays = ("normal", "color", "variance", "certainty")
    with image_writer(path, image.camera, arrays, image.rendering) as write:
        for start in range(0, HEIGHT, rows_per_band):
            write(rows(image, start, start + rows_per_band))
            assert not path.exists(), "the file appears only when it is complete"
    assert_same(read_image(path), image)


def test_an_exception_between_bands_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path, image = tmp_path / "image.exr", an_image()
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), image_writer(path, image.camera) as write:
        write(rows(image, 0, 4))
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["image.exr"]


def test_a_foreign_image_with_numbers_only_takes_the_camera_that_is_given(tmp_path: Path) -> None:
    path = tmp_path / "foreign.exr"
    numbers = np.arange(WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    write_foreign(path, {"id.triangle": numbers, "depth": numbers.copy()})
    with pytest.raises(InputError, match="xfrustum:camera"):
        read_image(path)
    image = read_image(path, a_camera())
    assert image.camera == a_camera()
    np.testing.assert_array_equal(image.triangle, numbers - 1)
    assert (image.object == NOTHING).all()
    assert np.isnan(image.position).all()
    assert (image.normal, image.color, image.certainty) == (None, None, None)


def test_a_foreign_image_with_positions_only_is_covered_where_they_are_numbers(
    tmp_path: Path,
) -> None:
    path = tmp_path / "foreign.exr"
    height = np.full((HEIGHT, WIDTH), np.nan, dtype=np.float32)
    height[3:9] = 4.0
    write_foreign(path, {name: height.copy() for name in ("P.X", "P.Y", "P.Z")})
    image = read_image(path, a_camera())
    assert (image.triangle == NOTHING).all()
    np.testing.assert_array_equal(image.covered, np.isfinite(height))


def test_the_files_own_camera_comes_first_but_for_a_foreign_file(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    write_image(path, an_image())
    assert read_image(path, replace(a_camera(), scene="another")).camera.scene == a_camera().scene
    image = read_image(path, replace(a_camera(), scene="another"), partial=True)
    assert (image.camera.scene, image.rendering) == ("another", None)


def _whole() -> dict[str, Any]:
    return {
        name: np.ones((HEIGHT, WIDTH), np.float32) for name in ("P.X", "P.Y", "P.Z", "id.triangle")
    }


@pytest.mark.parametrize(
    ("channels", "header", "told"),
    [
        ({"R": np.ones((HEIGHT, WIDTH), np.float32)}, {}, "neither id.triangle nor P.X"),
        ({"A": np.ones((HEIGHT, WIDTH), np.float32)}, {}, "neither id.triangle nor P.X"),
        ({name: plane for name, plane in _whole().items() if name != "P.Y"}, {}, "no channel P.Y"),
        (
            _whole() | {"id.triangle": np.full((HEIGHT, WIDTH), 0.5, np.float32)},
            {},
            "whole numbers",
        ),
        ({name: plane[1:] for name, plane in _whole().items()}, {}, "its camera says 37 x 21"),
        (_whole(), {"xfrustum:camera": "{"}, "not a camera"),
        (_whole(), {"xfrustum:camera": "{}"}, "not a camera (aperture: Field required)"),
        (
            _whole(),
            {"xfrustum:camera": '{"settings": {"near": -1}}'},
            "not a camera (near must be a positive length, not -1.0)",
        ),
        (
            _whole(),
            {"xfrustum:rendering": '{"effects": ["magic"]}'},
            "not a rendering (effects.0: ",
        ),
    ],
)
def test_what_cannot_be_understood_is_one_line_that_names_the_file(
    tmp_path: Path, channels: dict[str, Any], header: dict[str, Any], told: str
) -> None:
    path = tmp_path / "foreign.exr"
    write_foreign(path, {name: plane.copy() for name, plane in channels.items()}, **header)
    with pytest.raises(InputError) as caught:
        read_image(path, a_camera())
    assert "foreign.exr" in str(caught.value) and told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_image_larger_than_openexr_counts_is_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    huge = replace(a_camera(), resolution=(1 << 15, (1 << 14) + 1))
    told = r"32768 x 16385 pixels .* lower frustum\.resolution"
    with pytest.raises(InputError, match=told), image_writer(tmp_path / "huge.exr", huge):
        pass
    assert not list(tmp_path.iterdir())
