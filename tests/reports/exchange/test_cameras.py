"""`camera`: files of C and C*, read by renderers that share no code with the rasterizer."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.views import view
from tests.support.worlds import World
from xfrustum import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    InputError,
    Offset,
    Pivot,
    Rasterizer,
    Scene,
    write_cameras,
)
from xfrustum.reports.exchange.cameras import write_triangles
from xfrustum.scenes.appearance import Appearance, Environment

JITTER_PX = 0.02
"""Shift of pixel centers that reveals pixels on edges. The rasterizer snaps vertices to 1/256 px.
On films of 96 pixels, rounding moves positions by less than another 1/256 px.
"""


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def draw(cameras: Any, triangles: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Draw pixels (N, 2), column and row, of the first aperture, using only the file.

    Intersect each pixel's line with each triangle in clip coordinates.
    """
    u, v = ((2 * pixels + 1) / cameras["frustum"]["resolution"] - 1).T * ((1,), (-1,))
    film = np.stack((u, v, np.ones(len(u))), axis=-1)
    picture = np.full(len(film), -1, dtype=np.int64)
    for each in cameras["apertures"][0]["passes"]:
        matrix, depth = np.array(each["clip_from_scene"])[[0, 1, 3]], each["depth"]
        n, f = each["near"], each["far"]
        stored = np.full(len(film), depth["clear"])
        xyw = triangles @ matrix[:, :3].T + matrix[:, 3]
        met = (
            (xyw[..., 2].max(1) >= n)
            & (xyw[..., 2].min(1) <= f)
            & (abs(np.linalg.det(xyw)) > 1e-12)
        )
        for index in np.flatnonzero(met):
            # In clip coordinates, the triangle's point w * (u, v, 1) is the mean of its corners
            # with weights w * weights.
            weights = film @ np.linalg.inv(xyw[index])
            with np.errstate(divide="ignore", invalid="ignore"):
                w = 1 / weights.sum(-1)
                inside = (weights * w[:, None] >= 0).all(-1) & (w >= n) & (w <= f)
                value = stored_depth(depth["function"], w, n, f)
                shown = inside & (value < stored if depth["test"] == "<" else value > stored)
            picture[shown], stored[shown] = index, value[shown]
        # The next pass overwrites this pass, whatever its depth.
    return picture


def stored_depth(function: str, w: np.ndarray, n: float, f: float) -> np.ndarray:
    """Return the depth by the file's formula."""
    formula = re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", function).replace("ln", "log")
    return np.asarray(eval(formula, {"log": np.log, "w": w, "n": n, "f": f}))


def small_view(name: str, resolution: tuple[int, int] = (20, 15)) -> Scene:
    scene = view(name, resolution)
    return replace(scene, frustum=replace(scene.frustum, resolution=resolution))


def test_the_numbered_triangles_lie_next_to_the_cameras(tiny: World, tmp_path: Path) -> None:
    """Read number, place, object and name of each triangle with NumPy."""
    scene = tiny.scene
    write_cameras(scene, "gltf", tmp_path, DoubleFrustum(near=0.1))
    with np.load(tmp_path / "scene.npz", allow_pickle=False) as stored:
        np.testing.assert_array_equal(stored["vertices"][stored["faces"]], scene.triangles)
        np.testing.assert_array_equal(stored["object_of_triangle"], scene.object_of_triangle)
        first, names = stored["first_triangle"], stored["names"].tolist()
    assert names == [part.name for part in scene.objects]
    assert [scene.object_of_triangle[number] for number in first[:-1]] == [0, 1, 2]
    sky = Environment(radiance=np.ones((2, 4, 3), np.float32))
    write_triangles(replace(scene, appearance=Appearance(environment=sky)), tmp_path / "lit.npz")
    with np.load(tmp_path / "lit.npz", allow_pickle=False) as stored:
        np.testing.assert_array_equal(stored["environment"], sky.radiance)


REVERSED = DoubleFrustum(
    near=3.0, slabs=(20.0,), depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED
)
CASES = {
    "reversed slabs": (REVERSED, (5, 50)),
    "pivot and fit": (DoubleFrustum(near=3.0, pivot=Pivot.CAMERA, fit=Fit.SCREEN), (70, 3)),
    "logarithmic": (DoubleFrustum(near=2.0, mapping=DepthMapping.LOGARITHMIC), (40, 30)),
    "no offset": (DoubleFrustum(near=2.0, offset=Offset.NONE, camera=Camera.C_STAR), (0, 0)),
}
FAST = "reversed slabs"


@pytest.mark.parametrize(
    "case", [FAST, *(pytest.param(c, marks=pytest.mark.slow) for c in CASES if c != FAST)]
)
def test_a_renderer_with_the_file_alone_draws_the_same_as_raster(case: str, tmp_path: Path) -> None:
    settings, index = CASES[case]
    recentered = case in ("reversed slabs", "pivot and fit")
    scene = small_view("asymmetric-recentered" if recentered else "asymmetric")
    aperture = scene.plate.aperture(*index)
    write_cameras(scene, "json", tmp_path, settings, [aperture])
    cameras = read(tmp_path / "cameras.json")
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, settings).triangle.reshape(-1)
    grid = np.meshgrid(*map(np.arange, scene.frustum.resolution))
    pixels = np.stack(grid, axis=-1).reshape(-1, 2)
    mine = draw(cameras, scene.triangles, pixels)
    other = mine != drawn
    assert other.mean() < 0.03
    moved = [pixels[other] + (x * JITTER_PX, y * JITTER_PX) for x in (-1, 1) for y in (-1, 1)]
    # A pixel lies on an edge only if its own picture changes within the jitter.
    again = draw(cameras, scene.triangles, np.concatenate(moved)).reshape(len(moved), -1)
    assert (again != mine[other]).any(axis=0).all()
    assert (drawn >= 0).mean() > 0.025
    assert cameras["scene_hash"] == scene.content_hash


def through_the_file(each: Any, points: np.ndarray) -> np.ndarray:
    """Return film coordinates u, v of points by the matrix of a pass."""
    clip = np.c_[points, np.ones(len(points))] @ np.array(each["clip_from_scene"]).T
    return np.asarray(clip[:, :2] / clip[:, 3:])


def points_before(each: Any, count: int = 40) -> np.ndarray:
    """Return random points of a pass's frustum, between its near and far planes."""
    low, high = (-1, -1, each["near"]), (1, 1, each["far"])
    u, v, depth = np.random.default_rng(2).uniform(low, high, (count, 3)).T
    w = np.stack((u, v, np.ones(count)), axis=-1) * depth[:, None]
    matrix = np.array(each["clip_from_scene"])[[0, 1, 3]]
    return np.linalg.solve(matrix[:, :3], (w - matrix[:, 3]).T).T


SETTINGS = DoubleFrustum(near=3.0, pivot=Pivot.CAMERA, fit=Fit.SCREEN, slabs=(40.0,))


def both_files(scene: Scene, other: str, tmp_path: Path) -> tuple[list[Any], Any]:
    apertures: list[Aperture] = [scene.plate.aperture(5, 50), scene.plate.aperture(70, 3)]
    settings = SETTINGS if scene.frustum.screen is not None else replace(SETTINGS, fit=None)
    write_cameras(scene, "json", tmp_path, settings, apertures)
    files = write_cameras(scene, other, tmp_path, settings, apertures).files
    passes = [
        each for each in read(tmp_path / "cameras.json")["apertures"] for each in each["passes"]
    ]
    return passes, read(files[0])


@pytest.mark.parametrize("name", ["asymmetric", "asymmetric-recentered"])
def test_a_gltf_camera_contains_the_film_at_the_stated_place(name: str, tmp_path: Path) -> None:
    scene = small_view(name)
    passes, document = both_files(scene, "gltf", tmp_path)
    assert len(document["nodes"]) == len(document["cameras"]) == len(passes)
    for each, node in zip(passes, document["nodes"], strict=True):
        lens = document["cameras"][node["camera"]]["perspective"]
        points = points_before(each)
        # A glTF camera looks along its -z; a half turn about y reverses the signs of x and z.
        turned = node.get("rotation") == [0, 1, 0, 0]
        eye = (points - node["translation"]) * ((-1, 1, -1) if turned else (1, 1, 1))
        half = np.tan(lens["yfov"] / 2) * np.array([lens["aspectRatio"], 1])
        picture = eye[:, :2] / -eye[:, 2:] / half
        film = node["extras"]["film"]
        left, right, bottom, top = (film[side] for side in ("left", "right", "bottom", "top"))
        u = (2 * picture[:, 0] - left - right) / (right - left)
        v = (2 * picture[:, 1] - bottom - top) / (top - bottom)
        v = -v if node["extras"]["rows_reversed"] else v
        assert np.allclose(np.stack((u, v), axis=-1), through_the_file(each, points))
        assert (lens["znear"], lens["zfar"]) == (each["near"], each["far"])
        assert np.isclose(max(-left, right), 1)
        assert np.isclose(max(-bottom, top), 1)


def test_mitsuba_sees_along_the_same_lines(tmp_path: Path) -> None:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("llvm_ad_rgb" if "llvm_ad_rgb" in mitsuba.variants() else "scalar_rgb")
    scene = small_view("asymmetric-recentered")
    passes, document = both_files(scene, "mitsuba", tmp_path)
    for each, entry in zip(passes, document["sensors"], strict=True):
        plugin = entry["sensor"]
        transform = mitsuba.ScalarTransform4f(np.array(plugin["to_world"]))
        sensor = mitsuba.load_dict({**plugin, "to_world": transform})
        for u, v in ((-0.9, 0.7), (0.0, 0.0), (0.6, -0.3)):
            row = -v if entry["rows_reversed"] else v
            place = mitsuba.Point2f((u + 1) / 2, (1 - row) / 2)
            ray, _ = sensor.sample_ray(0.0, 0.5, place, mitsuba.Point2f(0.5))
            origin, direction = (np.ravel(np.array(part)) for part in (ray.o, ray.d))
            place_on_film = through_the_file(each, (origin + 20 * direction)[None])[0]
            assert np.allclose(place_on_film, (u, v), atol=1e-4)


def test_mitsuba_has_square_pixels(tmp_path: Path) -> None:
    wide = small_view("asymmetric-recentered", (40, 12))
    with pytest.raises(InputError, match="square pixels"):
        write_cameras(wide, "mitsuba", tmp_path, SETTINGS)
    assert list(tmp_path.iterdir()) == []
