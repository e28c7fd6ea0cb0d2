"""Culling as in the paper: C culls back faces and C* front faces, the same faces for the viewer."""

import json
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from tests.support.views import lines_by_definition, reversed_d32f, soup, view
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import Cull, DoubleFrustum, Frustum, Scene
from xfrustum.scenes.arrays import Floats, Mask, Numbers
from xfrustum.scenes.files.exr import CAMERA_JSON, read_image

REACH = 40.0
FRUSTUM = Frustum(resolution=(64, 48), reach=(REACH, REACH), fov=(radians(60), radians(50)))
#: Near offset that displaces this film's points by less than 1e-4 px
NEAR = 1e-7 * REACH


def culled(near: float) -> DoubleFrustum:
    return replace(reversed_d32f(near), cull=Cull.BACK)


@pytest.mark.parametrize(
    ("name", "near_per_reach"),
    [("asymmetric-recentered", 0.02), pytest.param("car", 1e-6, marks=pytest.mark.slow)],
)
def test_culling_changes_no_pixel_of_closed_bodies_on_either_side(
    name: str, near_per_reach: float
) -> None:
    scene = view(name, (96, 72))
    near, aperture = near_per_reach * scene.frustum.longest_reach, scene.default_apertures()[-1]
    with Rasterizer(scene) as rasterizer:
        whole = rasterizer.render(aperture, reversed_d32f(near))
        drawn = rasterizer.render(aperture, culled(near))
    np.testing.assert_array_equal(drawn.triangle, whole.triangle)
    np.testing.assert_array_equal(drawn.color, whole.color)
    for side in (whole.height < 0, whole.height > 0):
        assert side.any()


def square(middle: float, z: float, size: float) -> Floats:
    """Return the corners (4, 3) of a square parallel to the plate, counterclockwise to viewers."""
    corners = size * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) + (middle, 0)
    return np.column_stack((corners, np.full(4, z)))


def shows(scene: Scene, corners: Floats) -> Mask:
    """Return the pixels whose lines meet a square, computed from its corners."""
    middle = scene.plate.middle
    lines = lines_by_definition(scene, middle)
    points = np.array([middle.x, middle.y, 0.0]) - corners[0, 2] * lines
    low, high = corners.min(axis=0), corners.max(axis=0)
    inside = (points[..., :2] > low[:2]) & (points[..., :2] < high[:2])
    return np.asarray(inside.all(axis=-1))


def squares(numbers: Numbers) -> Numbers:
    """Return the square, 0 or 1, that each pixel shows, and -1 for none."""
    return np.where(numbers < 0, -1, numbers // 2)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_culled_sheet_uncovers_the_surfaces_behind_it(side: float) -> None:
    """Pixels become empty exactly where the truth shows a back with nothing behind it.

    The nearer square shows its back; the farther one shows its front, and is half covered.
    """
    heights = (0.75, 0.4) if side > 0 else (-0.4, -0.75)
    turned, other = square(0.0, heights[0] * REACH, 4.1), square(5.0, heights[1] * REACH, 5.3)
    faces = [turned[[0, 2, 1]], turned[[0, 3, 2]], other[[0, 1, 2]], other[[0, 2, 3]]]
    scene = soup(np.array(faces), FRUSTUM)
    aperture = scene.plate.middle
    back, front = shows(scene, turned), shows(scene, other)
    truth = Reference(scene).trace(aperture)
    np.testing.assert_array_equal(
        squares(truth.triangle), np.where(back, 0, np.where(front, 1, -1))
    )
    with Rasterizer(scene) as rasterizer:
        whole = rasterizer.render(aperture, reversed_d32f(NEAR))
        drawn = rasterizer.render(aperture, culled(NEAR))
    np.testing.assert_array_equal(whole.triangle, truth.triangle)
    lost = truth.covered & ~drawn.covered
    np.testing.assert_array_equal(lost, back & ~front)
    assert lost.sum() > 50 and (back & front).sum() > 50
    np.testing.assert_array_equal(squares(drawn.triangle), np.where(front, 1, -1))


def test_culling_is_a_setting_of_images_and_those_written_before_cull_nothing(
    tmp_path: Path,
) -> None:
    out = tmp_path / "a.exr"
    assert main(["raster", "sheets", "--near", "1", "--cull", "back", "--out", str(out)]) == 0
    camera = read_image(out).camera
    assert camera.settings is not None and camera.settings.cull is Cull.BACK
    record = json.loads(CAMERA_JSON.dump_json(camera))
    assert record["settings"].pop("cull") == "back"
    settings = CAMERA_JSON.validate_json(json.dumps(record)).settings
    assert settings == replace(camera.settings, cull=Cull.NONE)
