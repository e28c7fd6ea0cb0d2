"""The truth agrees with rational arithmetic, however a scene is described."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.support.exact_brute_force import hold_to_fractions
from tests.support.long_tail import examples
from tests.support.strategies import apertures, coincidences, frusta, near_misses
from tests.support.views import lines_by_definition, soup, view
from xfrustum.reference import Reference
from xfrustum.reference.lines import crossed_frustum
from xfrustum.scenes import Aperture, Certainty, DoubleFrustum, HogelImage, Scene
from xfrustum.scenes.arrays import Floats


@st.composite
def exact_scenes(draw: st.DrawFn) -> tuple[Scene, Aperture]:
    """Draw scenes with corners on lines and in the aperture, shared edges, and duplicates."""
    frustum, aperture = draw(frusta(exact=True)), draw(apertures())
    lines = lines_by_definition(soup(np.eye(3)[None], frustum), aperture).reshape(-1, 3)
    center = np.array([aperture.x, aperture.y, 0.0])
    return soup(draw(coincidences(center, lines)), frustum), aperture


@st.composite
def rounded_scenes(draw: st.DrawFn) -> tuple[Scene, Aperture]:
    """Draw scenes with edges that lines miss by a single rounding."""
    frustum, aperture = draw(frusta()), draw(apertures())
    bundle = crossed_frustum(frustum, aperture)
    lines = bundle.directions().reshape(-1, 3)
    return soup(draw(near_misses(np.array(bundle.center), lines)), frustum), aperture


def assert_points(image: HogelImage, points: Floats) -> None:
    np.testing.assert_allclose(image.position, points, rtol=1e-12, atol=1e-12)


@examples(30)
@given(exact_scenes())
def test_every_pixel_shows_the_first_surface_and_names_every_tie(
    request: tuple[Scene, Aperture],
) -> None:
    scene, aperture = request
    image, d = Reference(scene).trace(aperture), lines_by_definition(scene, aperture)
    s_range = (-scene.frustum.reach[0], scene.frustum.reach[1])
    cameras = [(np.array([aperture.x, aperture.y, 0.0]), s_range)]
    assert_points(image, hold_to_fractions(image, scene.triangles, d, cameras))


@examples(30)
@given(rounded_scenes())
def test_every_pixel_is_exact_where_lines_miss_edges_by_one_rounding(
    request: tuple[Scene, Aperture],
) -> None:
    scene, aperture = request
    bundle = crossed_frustum(scene.frustum, aperture)
    cameras = [(np.array(bundle.center), bundle.s_range)]
    image = Reference(scene).trace(aperture)
    hold_to_fractions(image, scene.triangles, bundle.directions(), cameras)


@examples(20)
@given(exact_scenes(), st.sampled_from([0.125, 1.0, 3.0]))
def test_every_pixel_of_two_overlaid_offset_cameras_is_exact(
    request: tuple[Scene, Aperture], near: float
) -> None:
    scene, aperture = request
    (viewer, back), screen = scene.frustum.reach, scene.frustum.screen
    # k = (m - a) / ss with ss = -zs; C stands at a - n k + n z, C* at a + n k - n z.
    k = (np.array(screen.center) - [aperture.x, aperture.y]) / -screen.height
    away = near * np.append(-k, 1.0)
    middle = np.array([aperture.x, aperture.y, 0.0])
    cameras = [(middle - away, (-near - viewer, -near)), (middle + away, (near, near + back))]
    image = Reference(scene).trace_model(aperture, DoubleFrustum(near=near))
    d = lines_by_definition(scene, aperture)
    assert_points(image, hold_to_fractions(image, scene.triangles, d, cameras))


def test_most_pixels_of_real_scenes_are_proven_and_none_unexamined() -> None:
    for name in ("car", "asymmetric-recentered"):
        scene = view(name, (128, 96))
        certainty = Reference(scene).trace(scene.plate.corners[0]).certainty
        assert (certainty == Certainty.PROVEN).mean() > 0.99
        assert not (certainty == Certainty.UNEXAMINED).any()
