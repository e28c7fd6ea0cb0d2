"""What links add to displacement: the same numbers compiled or not, and of whole images."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.attribution.steps import KnownShifts, Steps, StepSize, shifts, step_lengths
from xfrustum.compare.metrics.displacement import Spread, displacement
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference, film_shifts
from xfrustum.scenes import DoubleFrustum, HogelImage

NEAR = 1.0


@pytest.fixture(scope="module")
def images() -> tuple[HogelImage, HogelImage, HogelImage]:
    """A truth, a traced model, and a drawn picture, in single precision."""
    scene = view("asymmetric-recentered", (64, 48))
    aperture, settings = scene.plate.corners[0], DoubleFrustum(near=NEAR)
    reference = Reference(scene)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, settings, normals=False, color=False)
    return reference.trace(aperture), reference.trace_model(aperture, settings, shaded=False), drawn


@pytest.mark.parametrize("compiled", [True, False])
def test_shifts_are_displacements_bit_by_bit(
    images: tuple[HogelImage, ...], compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(film_shifts, "compiled", lambda: False)
    camera = images[0].camera
    for image in images:
        found, expected = shifts(image, camera), displacement(image, camera).reshape(-1, 2)
        assert 0 < np.isfinite(found).sum() < found.size
        np.testing.assert_array_equal(found.real, expected[:, 0])
        np.testing.assert_array_equal(found.imag, expected[:, 1])


@pytest.mark.parametrize("compiled", [True, False])
def test_steps_are_those_of_pixels_at_which_every_image_shows_a_surface(
    images: tuple[HogelImage, ...], compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(film_shifts, "compiled", lambda: False)
    truth, model, drawn = images
    first, second, third = (shifts(image, truth.camera) for image in images)
    moved = np.abs(second - first), np.abs(third - second)
    known = np.flatnonzero(np.isfinite(moved[0]) & np.isfinite(moved[1]))
    steps = Steps.between((truth, model, model, drawn), KnownShifts.of(truth))
    np.testing.assert_array_equal(steps.pixels, known)
    assert 0 < len(known) < np.isfinite(first).sum()
    near_offset, pivot, rasterization = steps.lengths
    assert near_offset is not None and pivot is None and rasterization is not None
    assert steps.sizes()[1] == StepSize(rms=0.0, p99=0.0)
    # NumPy's lengths may have one rounding more, where a processor cannot multiply and add in one.
    for found, expected in ((near_offset, moved[0]), (rasterization, moved[1])):
        np.testing.assert_array_max_ulp(found, expected[known], maxulp=1)
    np.testing.assert_array_equal(step_lengths(model, drawn, truth.camera, known), rasterization)


def test_nothing_is_displaced_where_no_image_differs(images: tuple[HogelImage, ...]) -> None:
    truth = images[0]
    steps = Steps.between((truth, truth), KnownShifts.of(truth))
    assert steps.lengths == (None,) and steps.sizes() == (StepSize(rms=0.0, p99=0.0),)


def test_one_more_link_displaces_the_pixels_that_it_changes_and_no_others() -> None:
    steps = Steps(pixels=np.array([0, 1, 3, 4]), lengths=(np.array([1.0, 2.0, 4.0, 5.0]),))
    # Pixel 1 moves, pixel 2 was not there, and pixel 4 shows no surface any more.
    more = steps.with_last(np.array([1, 2, 4]), np.array([7.0, 1.0, np.nan]))
    first, last = more.lengths
    assert more.pixels.tolist() == [0, 1, 3]
    assert first is not None and last is not None
    assert first.tolist() == [1, 2, 4] and last.tolist() == [0, 7, 0]
    assert steps.with_last(np.zeros(0, dtype=np.int64), np.zeros(0)).lengths[-1] is None


@pytest.mark.parametrize(
    "values",
    [
        [],
        [0.0, 0.0],
        [1.0],
        [3.0, 1.0, 2.0],
        np.arange(9000.0) ** 2,
        *(np.arange(1001.0) * (np.arange(1001) < moved) for moved in (2, 10, 11, 12, 13)),
    ],
)
def test_the_size_of_a_step_has_the_numbers_of_a_spread(values: list[float]) -> None:
    size, spread = StepSize.of(np.array(values)), Spread.of(np.array(values))
    assert (size is None) == (spread is None) == (not len(values))
    if size and spread:
        np.testing.assert_array_equal((size.rms, size.p99), (spread.rms, spread.p99))
