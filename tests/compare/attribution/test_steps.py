"""What links add to displacement, at pixels where every image shows a surface."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.attribution.budget import Steps, StepSize
from xfrustum.compare.metrics.displacement import displacement, film_shifts
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import DoubleFrustum
from xfrustum.scenes.arrays import Floats


@pytest.fixture(scope="module")
def shifts() -> list[Floats]:
    """Displacements of a truth, a traced model, and a drawn picture, in single precision."""
    scene = view("asymmetric-recentered", (64, 48))
    aperture, settings = scene.plate.corners[0], DoubleFrustum(near=1.0)
    reference = Reference(scene)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, settings, normals=False, color=False)
    truth, model = reference.trace(aperture), reference.trace_model(aperture, settings, shaded=False)
    found = [film_shifts(image, truth.camera) for image in (truth, model, drawn)]
    for image, shift in zip((truth, model, drawn), found, strict=True):
        expected = displacement(image, truth.camera).reshape(-1, 2)
        assert 0 < np.isfinite(shift).sum() < shift.size
        np.testing.assert_array_equal(shift.T, expected)
    return found


def test_steps_are_those_of_pixels_at_which_every_image_shows_a_surface(shifts: list[Floats]) -> None:
    first, second, third = shifts
    moved = np.hypot(*(second - first)), np.hypot(*(third - second))
    known = np.isfinite(moved[0]) & np.isfinite(moved[1])
    steps = Steps.between((first, second, second, third))
    np.testing.assert_array_equal(steps.known, known)
    assert 0 < known.sum() < np.isfinite(first).all(axis=0).sum()
    assert steps.sizes() == (
        StepSize.of(moved[0][known]),
        StepSize(rms=0.0, p99=0.0),
        StepSize.of(moved[1][known]),
    )


def test_nothing_is_displaced_where_no_image_differs(shifts: list[Floats]) -> None:
    steps = Steps.between((shifts[0], shifts[0]))
    assert steps.lengths == (None,) and steps.sizes() == (StepSize(rms=0.0, p99=0.0),)
    assert Steps.between([np.full((2, 3), np.nan)] * 2).sizes() == (None,)


def test_one_more_link_displaces_the_pixels_that_it_changes_and_no_others() -> None:
    known = np.array([True, True, False, True, True])
    steps = Steps(known=known, lengths=(np.array([1.0, 2.0, 0.0, 4.0, 5.0]), None))
    # Pixel 1 moves, pixel 2 was not there, and pixel 4 shows no surface any more.
    more = steps.with_last(np.array([1, 2, 4]), np.array([7.0, 1.0, np.nan]))
    assert more.known.tolist() == [True, True, False, True, False]
    expected = [StepSize.of(np.array(values)) for values in ([1.0, 2.0, 4.0], [0.0] * 3, [0.0, 7.0, 0.0])]
    assert list(more.sizes()) == expected
    nothing = steps.with_last(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert nothing.sizes()[-1] == StepSize(rms=0.0, p99=0.0)
