"""N. Reed, "Depth Precision Visualized" (2015): his table comes out of the project's own projection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from xfrustum.raster.cameras.cameras import FilmWindow, SlabCamera, clip_from_eye
from xfrustum.raster.cameras.depth_formats import MAPPINGS
from xfrustum.scenes import DepthMapping
from xfrustum.scenes.arrays import Floats, Singles

NEAR, FAR = 0.1, 1e4
INFINITE = 1e30
"""A far plane so distant that the matrix, rounded to float32, is the one of an infinite far plane."""
SAMPLES, SEED = 10_001, 4177
HALF_HEIGHT = math.tan(0.65)
HALF_WIDTH = HALF_HEIGHT * 16 / 9

PUBLISHED = {
    # mapping, far: equal and swapped pairs in percent, as float32 and as 24 bits
    (DepthMapping.STANDARD, FAR): ((77.20, 0.01), (77.20, 0.01)),
    (DepthMapping.STANDARD, INFINITE): ((75.75, 0.01), (75.75, 0.01)),
    (DepthMapping.REVERSED, FAR): ((0.0, 0.0), (75.77, 0.0)),
    (DepthMapping.REVERSED, INFINITE): ((0.0, 0.0), (75.78, 0.0)),
    (DepthMapping.GL, FAR): ((77.34, 0.0), (77.34, 0.0)),
    (DepthMapping.GL, INFINITE): ((76.63, 0.0), (76.63, 0.0)),
}


def world_from_view() -> Floats:
    """Return his rotations about x, then y, and his translation, for row vectors."""
    (cx, sx), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (0.474747, 1.23123123))
    about_x = np.array([[1, 0, 0, 0], [0, cx, sx, 0], [0, -sx, cx, 0], [0, 0, 0, 1]])
    about_y = np.array([[cy, 0, -sy, 0], [0, 1, 0, 0], [sy, 0, cy, 0], [0, 0, 0, 1]])
    moved = np.eye(4)
    moved[3, :3] = 14.9914, 0.832148, 29.7142128
    return np.asarray(about_x @ about_y @ moved)


def world_points() -> Singles:
    """Return points at depths in equal steps, scattered over the view, rounded in world coordinates."""
    depth = np.linspace(NEAR, FAR, SAMPLES)
    x, y = np.random.default_rng(SEED).uniform(-1, 1, (2, SAMPLES))
    view = np.stack((x * HALF_WIDTH * depth, y * HALF_HEIGHT * depth, -depth, np.ones(SAMPLES)), axis=1)
    return np.asarray((view @ world_from_view()).astype(np.float32))


def view_from_world() -> Floats:
    return np.asarray(np.linalg.inv(world_from_view()), dtype=np.float64)


def projection(mapping: DepthMapping, far: float) -> Floats:
    """Return the rasterizer's own projection, for row vectors."""
    window = FilmWindow(axis=(0.0, 0.0), half_width=HALF_WIDTH, half_height=HALF_HEIGHT)
    camera = SlabCamera(orthoscopic=True, step=0.0, near=NEAR, far=far, heights=(NEAR, far), scale=1.0)
    return clip_from_eye(window, camera, MAPPINGS[mapping].ends).T


def transformed(points: Singles, matrix: Floats) -> Singles:
    """Apply a matrix in float32, term after term."""
    rounded = matrix.astype(np.float32)
    total = points[:, :1] * rounded[0]
    for k in range(1, 4):
        total = total + points[:, k, None] * rounded[k]
    return np.asarray(total)


def stored(clip: Singles, mapping: DepthMapping) -> Singles:
    """Return depth as OpenGL's viewport makes it, ascending with distance."""
    depth = clip[:, 2] / clip[:, 3]
    if mapping is DepthMapping.GL:
        depth = depth * np.float32(0.5) + np.float32(0.5)
    return -depth if mapping is DepthMapping.REVERSED else depth


def shares(depth: NDArray[np.floating]) -> tuple[float, float]:
    """Return the percentages of adjacent pairs that are equal, and that are swapped."""
    steps = np.diff(depth)
    return 100 * float(np.mean(steps == 0)), 100 * float(np.mean(steps < 0))


def in_24_bits(depth: Singles) -> Floats:
    return np.rint(depth.astype(np.float64) * (2**24 - 1))


@pytest.mark.parametrize(("mapping", "far"), PUBLISHED)
def test_his_table_comes_out(mapping: DepthMapping, far: float) -> None:
    clip = transformed(transformed(world_points(), view_from_world()), projection(mapping, far))
    depth = stored(clip, mapping)
    as_float, as_fixed = PUBLISHED[mapping, far]
    assert shares(depth) == pytest.approx(as_float, abs=0.1)
    assert shares(in_24_bits(depth)) == pytest.approx(as_fixed, abs=0.1)


@pytest.mark.parametrize("mapping", [DepthMapping.STANDARD, DepthMapping.REVERSED, DepthMapping.GL])
def test_the_distant_far_plane_is_an_infinite_one(mapping: DepthMapping) -> None:
    """The limits of the projection's third row: slope e_f, and n (e_n - e_f)."""
    ends = MAPPINGS[mapping].ends
    limit = [-ends.far, NEAR * (ends.near - ends.far)]
    np.testing.assert_allclose(projection(mapping, INFINITE)[2:, 2], limit, atol=1e-30)


def test_premultiplied_matrices_keep_the_order() -> None:
    """With one matrix for view and projection the numbers depend on summation, but not their order."""
    points = world_points()

    def wrong(mapping: DepthMapping, far: float) -> float:
        return sum(shares(stored(transformed(points, view_from_world() @ projection(mapping, far)), mapping)))

    hyperbolic = [wrong(mapping, far) for mapping, far in PUBLISHED if mapping is not DepthMapping.REVERSED]
    reversed_float = [wrong(DepthMapping.REVERSED, far) for far in (FAR, INFINITE)]
    assert max(reversed_float) < 0.1 * min(hyperbolic)
