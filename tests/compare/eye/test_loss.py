"""Losses of an eye's view by the display and by the renderer, on small plates."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tests.support.moved_scene import moved_scene
from tests.support.views import reversed_d32f, view
from xfrustum.compare.eye_loss import (
    DEFAULT_COLOR,
    Collector,
    Views,
    collected,
    display_loss,
    drawn_hogels,
    film_parts,
    shown_at,
)
from xfrustum.raster import Rasterizer
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference.eye import EyeReference
from xfrustum.research.replays import disparity_errors
from xfrustum.scenes import DoubleFrustum, Scene
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.images import ColorType, PlateContent

NEAR = 6.0
LEFT, RIGHT = (Eye(position=(x, -4.0, 500.0), resolution=(60, 45)) for x in (-30.0, 35.0))


def small(name: str) -> Scene:
    """Return a scene with a plate of 20 x 15 hogels of 64 x 48 pixels."""
    scene = view(name, (64, 48))
    return replace(scene, plate=replace(scene.plate, hogels=(20, 15)))


def views_of(
    reference: EyeReference,
    settings: DoubleFrustum,
    eyes: Sequence[Eye],
    color: ColorType = DEFAULT_COLOR,
) -> list[Views]:
    """Return the three pictures of each eye."""
    scene = reference.scene
    takes = [reference.replay(eye) for eye in eyes]
    collectors = [
        Collector(scene, eye, taken, settings) for eye, taken in zip(eyes, takes, strict=True)
    ]
    with PlateRenderer(scene, settings, PlateContent(color=color, ids=True)) as renderer:
        drawn = collected(drawn_hogels(renderer, film_parts(takes)), collectors)
    return [
        Views(
            true=reference.true_view(eye),
            replayed=reference.replayed(eye),
            drawn=image,
            taken=taken,
        )
        for eye, image, taken in zip(eyes, drawn, takes, strict=True)
    ]


@pytest.fixture(scope="module")
def asymmetric() -> tuple[EyeReference, list[Views]]:
    reference = EyeReference(small("asymmetric"))
    return reference, views_of(reference, reversed_d32f(NEAR), [LEFT, RIGHT])


def test_a_renderer_shows_the_replayed_truth_of_the_moved_scene_but_for_edges(
    asymmetric: tuple[EyeReference, list[Views]],
) -> None:
    """Rasterizing changes few pixels, at edges; the near offset changes ten times as many."""
    reference, (views, _) = asymmetric
    moved = moved_scene(reference.scene, reversed_d32f(NEAR))
    seen = EyeReference(moved.scene).replayed(views.eye, shaded=False).triangle
    assert views.drawn is not None
    assert (views.drawn.triangle != views.replayed.triangle).mean() > 0.05
    assert views.taken.shown.columns.size == LEFT.resolution[0]
    assert (views.drawn.triangle != np.append(moved.number, -1)[seen]).mean() < 0.005


def test_the_renderers_displacement_is_the_closed_form_of_the_near_offset(
    asymmetric: tuple[EyeReference, list[Views]],
) -> None:
    reference, (views, _) = asymmetric
    assert views.drawn is not None
    point, shown, plate = views.drawn.position, views.taken.shown, reference.scene.plate
    at = shown_at(reference.scene, views.taken, views.drawn)
    place = np.full_like(point, np.nan)
    for row, column in product(shown.rows, shown.columns):
        aperture = plate.aperture(int(shown.hogel_column[column]), int(shown.hogel_row[row]))
        place[row, column] = aperture.x, aperture.y, 0.0
    expected = (place - point) * NEAR / (np.abs(point[..., 2:]) + NEAR)
    known = np.isfinite(point[..., 0])
    # Points are exact to about 1e-13 of the scene's coordinates.
    np.testing.assert_allclose((at - point)[known][:, :2], expected[known][:, :2], atol=1e-9)


def test_two_eyes_see_every_point_n_farther_from_the_plate(
    asymmetric: tuple[EyeReference, list[Views]],
) -> None:
    reference, (left, right) = asymmetric
    error = disparity_errors(reference, left, right)
    known = np.isfinite(error)
    assert left.drawn is not None and known.sum() > 100
    # Disparity is base / distance; the shown disparity belongs to another distance.
    base = right.eye.position[0] - left.eye.position[0]
    distance = left.eye.position[2] - left.drawn.position[..., 2][known]
    shift = base / (base / distance + error[known]) - distance
    # Points behind the plate appear n too far away, and points before it n too near. On a sloping
    # surface two eyes see points up to a pitch apart, through hogels up to half a pitch beside
    # their rays.
    assert np.percentile(shift, (1, 99)) == pytest.approx([-NEAR, NEAR], abs=NEAR / 3)


def test_an_eye_is_shown_the_pixels_of_whole_hogels_bit_for_bit() -> None:
    scene = small("car")
    settings = DoubleFrustum(near=1.0)
    reference = EyeReference(scene)
    (views,) = views_of(reference, settings, [LEFT], ColorType.FLOAT32)
    assert views.drawn is not None and views.drawn.color is not None
    shown = views.taken.shown
    with Rasterizer(scene) as rasterizer:
        for column, row in views.taken.hogels[40::97]:
            whole = rasterizer.render(scene.plate.aperture(column, row), settings)
            rows, columns = shown.hogel_row == row, shown.hogel_column == column
            here = np.ix_(rows, columns)
            there = np.ix_(shown.film_row[rows], shown.film_column[columns])
            assert whole.color is not None
            np.testing.assert_array_equal(views.drawn.triangle[here], whole.triangle[there])
            np.testing.assert_array_equal(views.drawn.color[here], whole.color[there])
            # Whole hogels have points in single precision; the view has points of sloping
            # triangles in double precision.
            size = 150 * 4 * 2.0**-23
            np.testing.assert_allclose(views.drawn.position[here], whole.position[there], atol=size)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "published"), [("asymmetric", (13.7, 0.04, 2.4, 2.3)), ("car", (32.3, 0.0, 2.3, 2.4))]
)
def test_the_drawn_view_of_a_whole_plate_is_that_of_the_moved_scene(
    name: str, published: tuple[float, ...]
) -> None:
    """Percentages of docs/method.md: drawn against replayed, and replayed against true views.

    Both are computed for the scene itself and for the moved scene.
    """
    reference = EyeReference(view(name, (256, 256)))
    eye = replace(LEFT, position=(40.0, 20.0, 600.0), resolution=(320, 240))
    (views,) = views_of(reference, reversed_d32f(NEAR), [eye])
    moved = moved_scene(reference.scene, reversed_d32f(NEAR))
    seen = EyeReference(moved.scene)
    as_moved = Views(
        true=seen.true_view(eye), replayed=seen.replayed(eye), drawn=None, taken=views.taken
    )
    assert views.drawn is not None
    others = (views.replayed.triangle, np.append(moved.number, -1)[as_moved.replayed.triangle])
    shares = [(views.drawn.triangle != other).mean() for other in others]
    shares += [
        display_loss(*item).numbers().fraction or 0.0
        for item in ((reference, views), (seen, as_moved))
    ]
    np.testing.assert_allclose(100 * np.array(shares), published, atol=0.06)
