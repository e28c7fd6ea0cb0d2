"""`seams`, along which clipping may split a triangle, agree with polygons clipped by hand."""

from typing import Any

import numpy as np
import pytest

from xfrustum.compare.rounding.edges import clipped, seams
from xfrustum.reference.lines import RayBundle
from xfrustum.scenes.arrays import Floats

SIZE = 128
STRAIGHT = (0.0, 0.0)
ROUNDING_PX = 2e-9
"""Largest difference of film positions, px: far above a dozen roundings of some 100 pixels."""


def bundle(side: int, near: float = 0.1) -> RayBundle:
    """Return the lines of a camera in the plate, with a sheared film of 90 degrees."""
    ends = (near, 10.0) if side > 0 else (-10.0, -near)
    return RayBundle(
        center=(0.2, -0.1, 0.0),
        shear=(0.3, -0.2),
        half_extent=(1.0, 1.0),
        resolution=(SIZE, SIZE),
        s_range=ends,
    )


def seen_at(places: Floats, s: Floats, lines: RayBundle) -> Floats:
    """Return points (N, 3) at distances s that an unsheared camera images at positions (N, 2)."""
    u, v = places[:, 0] * 2 / SIZE - 1, 1 - places[:, 1] * 2 / SIZE
    d = np.stack((u + lines.shear[0], v + lines.shear[1], -np.ones(len(s))), axis=1)
    return np.asarray(lines.center) + s[:, None] * d


def assert_same_segments(segments: Floats, expected: list[tuple[Floats, Floats]]) -> None:
    """Assert that two sets of line segments are equal in any order and direction."""

    def ordered(some: Any) -> list[Any]:
        return sorted(sorted(end.tolist() for end in each) for each in np.asarray(some).round(9))

    np.testing.assert_allclose(ordered(segments), ordered(expected), rtol=0, atol=ROUNDING_PX)


CUT = np.array([(40.0, 40.0), (90.0, 60.0), (60.0, 148.0)])
"""A triangle with its third corner 20 pixels below the film."""


@pytest.mark.parametrize("side", [1, -1])
def test_a_triangle_over_one_border_leaves_a_quadrangle_with_two_diagonals(side: int) -> None:
    lines = bundle(side)
    corners = seen_at(CUT, side * np.array([2.0, 1.0, 3.0]), lines)
    a, b, c = CUT
    on_bc, on_ca = (p + (c - p) * (SIZE - p[1]) / (c[1] - p[1]) for p in (b, a))
    assert_same_segments(seams(corners, lines, STRAIGHT), [(a, on_bc), (b, on_ca)])


@pytest.mark.parametrize("side", [1, -1])
def test_the_near_plane_cuts_in_depth(side: int) -> None:
    """Edges are cut where s equals near: s is linear along an edge, and 1/s along its image."""
    lines = bundle(side, near=1.0)
    a, b, c = places = np.array([(40.0, 40.0), (90.0, 60.0), (60.0, 100.0)])
    s = np.array([2.0, 3.0, 0.5])
    to_c = (1 / s[:2] - 1) / (1 / s[:2] - 1 / s[2])
    on_ca, on_bc = (p + (c - p) * share for p, share in zip((a, b), to_c, strict=True))
    corners = seen_at(places, side * s, lines)
    assert_same_segments(seams(corners, lines, STRAIGHT), [(a, on_bc), (b, on_ca)])


@pytest.mark.parametrize("side", [1, -1])
def test_no_triangle_that_is_not_clipped_has_a_seam(side: int) -> None:
    lines, random = bundle(side, near=1.0), np.random.default_rng(1)
    places = random.uniform(-SIZE / 8, 9 * SIZE / 8, (300, 3, 2))
    depths = side * random.uniform(0.9, 10.5, (300, 3))
    triangles = np.array([seen_at(*pair, lines) for pair in zip(places, depths, strict=True)])
    split = np.array([len(seams(triangle, lines, (0.25, -0.5))) > 0 for triangle in triangles])
    marked = clipped(triangles, lines, (0.25, -0.5))
    assert not (split & ~marked).any()
    # Some triangles are clipped, and some are not.
    assert split.sum() > 20 and (~marked).sum() > 20
