"""The truth is exact: it agrees with rational arithmetic, whatever way a scene is described in."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.support.brute_force import exact_first
from tests.support.long_tail import examples
from tests.support.strategies import (
    apertures,
    coincidences,
    frusta,
    near_misses,
    triangles,
)
from tests.support.views import at, lines_by_definition, soup, view
from xfrustum.reference import Reference
from xfrustum.reference.lines.lines import crossed_frustum
from xfrustum.scenes import (
    NOTHING,
    Aperture,
    Certainty,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Scene,
    Screen,
    open_scene,
)
from xfrustum.scenes.arrays import Floats, Indices

Winners = list[list[frozenset[int]]]


def winners(image: HogelImage, parent: Indices | None = None) -> Winners:
    """Return for each pixel the set of all triangles that are first there."""
    number = (
        np.arange(image.triangle.max() + 1 + len(image.tied_triangles))
        if parent is None
        else parent
    )
    height, width = image.triangle.shape
    shared: dict[tuple[int, int], set[int]] = {}
    for row, column, triangle in image.tied_triangles.tolist():
        shared.setdefault((row, column), set()).add(triangle)
    ties = {
        (int(row), int(column)) for row, column in np.argwhere(image.certainty == Certainty.TIE)
    }
    assert set(shared) == ties
    result: Winners = []
    for row in range(height):
        result.append([])
        for column in range(width):
            triangle = int(image.triangle[row, column])
            group = shared.get((row, column), set() if triangle == NOTHING else {triangle})
            assert not group or triangle == min(group), "the smallest number is shown"
            result[-1].append(frozenset(int(number[t]) if parent is not None else t for t in group))
    return result


def s_of(image: HogelImage) -> Floats:
    return np.asarray(-image.height, dtype=np.float64)


@st.composite
def exact_scenes(draw: st.DrawFn) -> tuple[Scene, Aperture]:
    frustum, aperture = draw(frusta(exact=True)), draw(apertures())
    empty = Scene(name="", plate=open_scene("car").plate, frustum=frustum, objects=())
    lines = lines_by_definition(empty, aperture).reshape(-1, 3)
    center = np.array([aperture.x, aperture.y, 0.0])
    return soup(draw(coincidences(center, lines)), frustum), aperture


@st.composite
def rounded_scenes(draw: st.DrawFn) -> tuple[Scene, Aperture]:
    frustum, aperture = draw(frusta()), draw(apertures())
    bundle = crossed_frustum(frustum, aperture)
    return soup(
        draw(near_misses(np.array(bundle.center), bundle.directions().reshape(-1, 3))), frustum
    ), aperture


class TestAgainstRationalNumbers:
    """Scenes with corners on lines and in the aperture, shared edges, coincident triangles."""

    @examples(30)
    @given(exact_scenes())
    def test_every_pixel_shows_the_first_surface_and_names_every_tie(
        self, request: tuple[Scene, Aperture]
    ) -> None:
        scene, aperture = request
        image = Reference(scene).trace(aperture)
        s_range = (-scene.frustum.reach[0], scene.frustum.reach[1])
        self.assert_first_surfaces(
            scene, image, [(np.array([aperture.x, aperture.y, 0.0]), s_range)], aperture
        )

    @examples(30)
    @given(rounded_scenes())
    def test_so_it_does_where_lines_and_edges_miss_by_one_rounding(
        self, request: tuple[Scene, Aperture]
    ) -> None:
        scene, aperture = request
        bundle = crossed_frustum(scene.frustum, aperture)
        d, center = bundle.directions(), np.array(bundle.center)
        image = Reference(scene).trace(aperture)
        for row, column in np.ndindex(*image.triangle.shape):
            _, first = exact_first(scene.triangles, center, d[row, column], bundle.s_range)
            assert image.triangle[row, column] == (first[0] if first else NOTHING)
            assert (image.certainty[row, column] == Certainty.TIE) == (len(first) > 1)

    @examples(20)
    @given(exact_scenes(), st.sampled_from([0.125, 1.0, 3.0]))
    def test_so_do_the_two_offset_cameras_overlaid(
        self, request: tuple[Scene, Aperture], near: float
    ) -> None:
        scene, aperture = request
        viewer, back = scene.frustum.reach
        screen = scene.frustum.screen
        # k = (m - a) / ss with ss = -zs; C stands at a - n k + n z, C* at a + n k - n z.
        k = (np.array(screen.center) - [aperture.x, aperture.y]) / -screen.height
        away = near * np.append(-k, 1.0)
        middle = np.array([aperture.x, aperture.y, 0.0])
        image = Reference(scene).trace_model(aperture, DoubleFrustum(near=near))
        cameras = [(middle - away, (-near - viewer, -near)), (middle + away, (near, near + back))]
        self.assert_first_surfaces(scene, image, cameras, aperture)

    def assert_first_surfaces(
        self,
        scene: Scene,
        image: HogelImage,
        cameras: list[tuple[Floats, tuple[float, float]]],
        aperture: Aperture,
    ) -> None:
        """Compare pixel by pixel; of several cameras the first that meets something is shown."""
        d = lines_by_definition(scene, aperture)
        shared: dict[tuple[int, int], list[int]] = {}
        for row, column, triangle in image.tied_triangles.tolist():
            shared.setdefault((row, column), []).append(triangle)
        for row, column in np.ndindex(*image.triangle.shape):
            line = d[row, column]
            met = [(c, *exact_first(scene.triangles, c, line, s_range)) for c, s_range in cameras]
            center, s, first = next((m for m in met if m[2]), met[-1])
            assert image.triangle[row, column] == (first[0] if first else NOTHING)
            assert (image.certainty[row, column] == Certainty.TIE) == (len(first) > 1)
            assert image.certainty[row, column] != Certainty.UNEXAMINED
            assert shared.get((row, column), []) == (first if len(first) > 1 else [])
            if s is not None:
                point = center + float(s) * line
                np.testing.assert_allclose(
                    image.position[row, column], point, rtol=1e-12, atol=1e-12
                )


def test_most_pixels_of_real_scenes_are_proven_and_none_unexamined() -> None:
    for name in ("car", "asymmetric-recentered"):
        scene = view(name, (128, 96))
        certainty = Reference(scene).trace(scene.plate.corners[0]).certainty
        assert (certainty == Certainty.PROVEN).mean() > 0.99
        assert not (certainty == Certainty.UNEXAMINED).any()


def test_twins_are_ties_and_the_first_of_them_is_shown() -> None:
    """With each triangle twice, every pixel with a surface is a tie of two."""
    scene = view("asymmetric", (64, 64))
    doubled = replace(scene, objects=scene.objects * 2)
    once, twice = (Reference(s).trace(scene.plate.middle) for s in (scene, doubled))
    np.testing.assert_array_equal(once.triangle, twice.triangle)
    np.testing.assert_array_equal(twice.certainty == Certainty.TIE, once.covered)
    twins = [
        [group | {t + len(scene.faces) for t in group} for group in row] for row in winners(once)
    ]
    assert winners(twice) == twins


def turned_frustum(frustum: Frustum, swap: bool, signs: tuple[int, int]) -> Frustum:
    """Return the frustum after x and y are swapped, or not, and then multiplied by signs."""

    def pair(values: tuple[Any, Any]) -> tuple[Any, Any]:
        return values[::-1] if swap else values

    screen = frustum.screen
    if screen is not None:
        x, y = pair(screen.center)
        screen = Screen(
            height=screen.height, center=(x * signs[0], y * signs[1]), size=pair(screen.size)
        )
    return Frustum(
        resolution=pair(frustum.resolution),
        reach=frustum.reach,
        fov=None if frustum.fov is None else pair(frustum.fov),
        screen=screen,
    )


Picture = Callable[[NDArray[Any]], NDArray[Any]]
MOVES: dict[str, tuple[bool, tuple[int, int], Picture]] = {
    "mirrored in x": (False, (-1, 1), lambda image: image[:, ::-1]),
    "a quarter turn": (True, (-1, 1), lambda image: np.rot90(image, 1)),
}


@pytest.mark.parametrize("move", MOVES)
@examples(25)
@given(triangles(), frusta(), apertures())
def test_a_scene_moved_about_the_plates_normal_gives_the_picture_moved(
    move: str, corners: Floats, frustum: Frustum, aperture: Aperture
) -> None:
    swap, signs, picture = MOVES[move]
    axes = [1, 0, 2] if swap else [0, 1, 2]
    moved = corners[..., axes] * [*signs, 1]
    x, y = np.array([aperture.x, aperture.y])[axes[:2]] * signs
    item = Reference(soup(corners, frustum)).trace(aperture)
    other = Reference(soup(moved, turned_frustum(frustum, swap, signs))).trace(
        at(float(x), float(y))
    )
    np.testing.assert_array_equal(other.triangle, picture(item.triangle))
    ties, moved_ties = item.certainty == Certainty.TIE, other.certainty == Certainty.TIE
    np.testing.assert_array_equal(moved_ties, picture(ties))
    np.testing.assert_allclose(s_of(other), picture(s_of(item)), rtol=1e-9, atol=1e-12)
