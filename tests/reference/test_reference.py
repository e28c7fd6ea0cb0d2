"""The reference against brute force: the same first surface along every line, to the last digits."""

import logging

import numpy as np
import pytest

from tests.support.brute_force import exact_s, first_hits, near_an_edge
from tests.support.long_tail import kept, thinned
from tests.support.views import at, lines_by_definition, soup, view
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.reference.tracers.proposals import CLEARANCE, pixel_rays
from xfrustum.scenes import NOTHING, Certainty, Frustum

LOG = logging.getLogger(__name__)
"""Log of the measured figures, shown with --log-cli-level=INFO."""

EDGE_PX = 1e-5
SECOND_SURFACE = 1e-6
"""Smallest distances that doubles decide: from an edge, px, and to a second surface, part of the reach."""

POSITION_OF_REACH = 1e-9
"""Largest error of a position as a part of the reach, where Moeller and Trumbore's t starts."""

CASES = [
    ("car", (48, 36), (40, 30)),
    ("car", (36, 48), (17, 52)),
    ("car-recentered", (48, 36), (0, 0)),
    ("asymmetric", (96, 96), (40, 30)),
    ("asymmetric", (95, 64), (80, 7)),
    ("asymmetric-recentered", (96, 72), (40, 30)),
    ("asymmetric-recentered", (96, 72), (80, 60)),
    ("asymmetric-recentered", (96, 72), (3, 55)),
    ("crossing", (64, 64), (40, 30)),
    ("crossing", (64, 64), (29, 12)),
    ("large-triangles", (96, 96), (40, 30)),
    ("sheets", (96, 96), (38, 33)),
    ("beetle", (48, 36), (11, 44)),
    ("teapot-recentered", (96, 72), (0, 0)),
    ("teapot-recentered", (72, 96), (77, 60)),
]

HALVED = [(name, (width // 2, height // 2), aperture) for name, (width, height), aperture in CASES]
"""The same views on films of a quarter of the pixels, for every day."""


@pytest.mark.parametrize(
    ("name", "resolution", "aperture"),
    [*thinned(HALVED, 4), *kept(CASES, ())],
)
def test_every_line_shows_what_brute_force_shows(
    name: str, resolution: tuple[int, int], aperture: tuple[int, int]
) -> None:
    scene = view(name, resolution)
    where = scene.plate.aperture(*aperture)
    image = Reference(scene).trace(where)
    center = np.array([where.x, where.y, 0.0])
    d = lines_by_definition(scene, where)
    lines, reach = d.reshape(-1, 3), scene.frustum.longest_reach
    s_range = (-scene.frustum.reach[0], scene.frustum.reach[1])
    expected = first_hits(scene.triangles, center, lines, s_range)

    steps = np.array([1 / abs(d[0, 1, 0] - d[0, 0, 0]), 1 / abs(d[1, 0, 1] - d[0, 0, 1])])
    hit = expected.triangle != NOTHING
    with np.errstate(invalid="ignore"):
        apart = ~hit | (expected.second - expected.s > SECOND_SURFACE * reach)
    compared = apart & ~near_an_edge(scene.triangles, center, lines, steps, EDGE_PX)
    share = compared.mean()
    LOG.info(
        f"{name} {resolution} {aperture}: {compared.sum()} of {compared.size} pixels, {hit.mean():.1%} hit"
    )
    assert share > 0.95
    assert hit[compared].mean() > 0.01

    triangle = image.triangle.ravel()
    np.testing.assert_array_equal(triangle[compared], expected.triangle[compared])
    np.testing.assert_array_equal(image.covered, image.triangle != NOTHING)
    shown = compared & hit
    position = image.position.reshape(-1, 3)
    np.testing.assert_allclose(-position[shown, 2], expected.s[shown], rtol=0, atol=POSITION_OF_REACH * reach)
    on_line = center + -position[shown, 2:] * lines[shown]
    np.testing.assert_allclose(position[shown], on_line, rtol=0, atol=1e-13 * reach)
    np.testing.assert_array_equal(image.height, image.position[..., 2])
    corners = scene.triangles[triangle[shown]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(image.normal.reshape(-1, 3)[shown], normal, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(image.object.ravel()[shown], scene.object_of_triangle[triangle[shown]])
    for nothing in (image.position, image.normal):
        assert np.isnan(nothing.reshape(-1, 3)[compared & ~hit]).all()
    assert not (image.certainty == Certainty.UNEXAMINED).any()


@pytest.mark.parametrize(
    "name", thinned(["car", "beetle", "crossing", "asymmetric-recentered", "teapot-recentered"], 2)
)
def test_s_is_right_to_a_billionth_of_itself(name: str) -> None:
    """Rational arithmetic knows the crossing of line and plane exactly."""
    scene = view(name, (96, 72))
    where = scene.plate.corners[1] if scene.frustum.recentered else scene.plate.aperture(35, 26)
    image = Reference(scene).trace(where)
    d = lines_by_definition(scene, where)
    center = np.array([where.x, where.y, 0.0])
    rows, columns = np.nonzero(image.covered)
    chosen = np.random.default_rng(3).permutation(len(rows))[:400]
    for row, column in zip(rows[chosen], columns[chosen], strict=True):
        exact = exact_s(scene.triangles[image.triangle[row, column]], center, d[row, column])
        s = float(exact)
        assert -image.height[row, column] == pytest.approx(s, rel=1e-9, abs=0)
        np.testing.assert_allclose(
            image.position[row, column], center + s * d[row, column], rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("size", [(200.0, 150.0, 100.0), (20.0, 20.0, 2000.0), (3.0, 500.0, 40.0)])
def test_rays_start_just_outside_the_scene_however_deep_and_narrow_it_is(
    size: tuple[float, float, float],
) -> None:
    """A float32 origin far beside the scene would spend its digits on that distance."""
    half = np.array(size) / 2
    corners = np.array([-half, half * (1, -1, -1), half])[None]
    scene = soup(corners, Frustum(resolution=(40, 30), reach=(size[2], size[2]), fov=(1.0, 1.0)))
    pencil = crossed_frustum(scene.frustum, at(0.3, -0.2))
    origins, directions = pixel_rays(scene, pencil, range(30))
    np.testing.assert_array_equal(directions, pencil.directions().reshape(-1, 3))
    s = -origins[:, 2]
    np.testing.assert_allclose(origins, pencil.center + s[:, None] * directions, rtol=1e-12, atol=1e-12)
    # Where the line passes through the scene's box, it does so behind the origin, which is just outside.
    along = pencil.center + np.linspace(-size[2] / 2, size[2] / 2, 401)[:, None, None] * directions
    inside = np.less_equal(np.abs(along), half).all(axis=2)
    assert isinstance(inside, np.ndarray)
    meets = inside.any(axis=0)
    assert meets.any()
    assert (np.where(inside, along[..., 2], -np.inf).max(axis=0) <= origins[:, 2]).all()
    clearance = CLEARANCE * np.linalg.norm(2 * half)
    outside = np.max(np.abs(origins[meets]) - half, axis=1)
    np.testing.assert_allclose(outside, clearance, rtol=1e-9)
