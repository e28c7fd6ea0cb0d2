"""The rasterizer: identical bits, cameras that compose, formats that work, no leaks."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.long_tail import thinned
from tests.support.views import reversed_d32f, view
from xfrustum.raster import Rasterizer
from xfrustum.raster.device import context
from xfrustum.raster.device.mesh import BYTES_PER_POINT
from xfrustum.reference import Reference
from xfrustum.reports.blocks import device_index
from xfrustum.scenes import (
    NOTHING,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    InputError,
)

DEPTHS = [(depth, mapping) for depth in DepthFormat for mapping in DepthMapping]
ARRAYS = ("triangle", "object", "position", "normal", "color")


@pytest.mark.parametrize(("depth", "mapping"), thinned(DEPTHS, 3))
def test_c_star_over_c_is_both(depth: DepthFormat, mapping: DepthMapping) -> None:
    scene = view("asymmetric-recentered", (160, 120))
    settings = DoubleFrustum(near=0.5, depth=depth, mapping=mapping)
    with Rasterizer(scene) as raster:
        both, c, c_star = (
            raster.render(scene.plate.middle, replace(settings, camera=camera))
            for camera in (Camera.BOTH, Camera.C, Camera.C_STAR)
        )
    assert (c.height[c.covered] <= 0).all()
    assert (c_star.height[c_star.covered] >= 0).all()
    for array in ARRAYS:
        over, under, shown = (getattr(image, array) for image in (c_star, c, both))
        on_top = c_star.covered if over.ndim == 2 else c_star.covered[..., None]
        np.testing.assert_array_equal(shown, np.where(on_top, over, under), err_msg=array)


def test_an_image_names_its_device_and_settings() -> None:
    scene = view("asymmetric-recentered", (64, 48))
    aperture, settings = scene.plate.corners[1], reversed_d32f(0.25)
    with Rasterizer(scene) as raster:
        image = raster.render(aperture, settings)
        bare = raster.render(aperture, settings, normals=False, color=False)
        assert bare.normal is None and bare.color is None
        assert set(raster.device) == {"vendor", "renderer", "version", "subpixel_bits"}
        assert int(raster.device["subpixel_bits"]) >= 4
        assert raster.device["renderer"] in image.camera.renderer
    truth = Reference(scene).trace(aperture).camera
    assert image.camera == replace(
        truth,
        renderer=image.camera.renderer,
        settings=settings,
        shear=image.camera.shear,
        half_extent=image.camera.half_extent,
    )
    np.testing.assert_allclose(image.camera.shear, truth.shear, rtol=1e-14)
    np.testing.assert_allclose(image.camera.half_extent, truth.half_extent, rtol=1e-14)
    covered = image.covered
    assert (image.object[covered] == scene.object_of_triangle[image.triangle[covered]]).all()
    np.testing.assert_allclose(
        image.normal[covered], scene.normals[image.triangle[covered]], atol=1e-7
    )
    assert np.isnan(image.position[~covered]).all() and np.isnan(image.normal[~covered]).all()
    assert (image.object[~covered] == NOTHING).all() and (image.color[~covered] == 0).all()


@pytest.mark.parametrize("near", [150.0, 1e9])
def test_near_beyond_the_reach_is_an_input_error(near: float) -> None:
    scene = view("asymmetric", (32, 32))
    with Rasterizer(scene) as raster, pytest.raises(InputError, match="near"):
        raster.render(scene.plate.middle, reversed_d32f(near))


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="asks Linux's /proc for its memory"
)
@pytest.mark.slow
def test_changing_formats_and_closed_rasterizers_do_not_grow_the_process() -> None:
    """A leaked render target of this size has 5 MiB: 225 of them would fill a gigabyte."""
    scene = view("asymmetric", (512, 512))

    def draw(rasterizers: int, images: int) -> None:
        for _ in range(rasterizers):
            with Rasterizer(scene) as raster:
                for n in range(images):
                    depth, mapping = DEPTHS[n % len(DEPTHS)]
                    chosen = DoubleFrustum(near=0.1 + n, depth=depth, mapping=mapping)
                    raster.render(scene.plate.middle, chosen)

    draw(3, len(DEPTHS))
    before = resident_mib()
    draw(1, 149)
    draw(25, 3)
    assert resident_mib() - before < 100


def test_without_usable_opengl_the_command_names_the_package_to_install(tmp_path: Path) -> None:
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}
    words = ["raster", "asymmetric", "--near", "1", "--out", str(tmp_path / "image.exr")]
    command = [sys.executable, "-m", "xfrustum", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    [line] = [line for line in done.stderr.splitlines() if line.strip()]
    assert "no OpenGL 4.5 through EGL" in line and "install" in line
    assert list(tmp_path.iterdir()) == []


def test_points_depend_neither_on_the_number_of_parts_nor_on_pictures_before() -> None:
    """Images with a coarse and with an exact depth buffer differ in their points."""
    width, height = 37, 23
    scene = view("crossing", (width, height))
    aperture, near = scene.plate.middle, 1e-7 * scene.frustum.longest_reach
    settings = [
        DoubleFrustum(near=near, depth=DepthFormat.D16),
        DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.LINEAR),
    ]
    alone = []
    for chosen in settings:
        with Rasterizer(scene) as rasterizer:
            alone.append(rasterizer.render(aperture, chosen))
    assert np.count_nonzero(alone[0].triangle != alone[1].triangle) > 2 * width
    with Rasterizer(scene) as rasterizer:
        for block in (None, 2 * width * BYTES_PER_POINT):
            if block is not None:
                rasterizer._positions._largest_block = block
            for chosen, expected in zip(settings, alone, strict=True):
                image = rasterizer.render(aperture, chosen)
                np.testing.assert_array_equal(image.position, expected.position)


def test_the_device_that_draws_is_a_gpu_unless_it_is_software() -> None:
    opened = context.open_context()
    renderer = context.describe(opened)["renderer"].lower()
    opened.release()
    software = any(name in renderer for name in ("llvmpipe", "softpipe", "swrast"))
    assert (device_index() in context.gpu_indices()) == (not software)
