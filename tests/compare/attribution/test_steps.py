"""What links add to displacement: the same numbers compiled or not, and of whole images."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.attribution.steps import Steps, StepSize, shifts
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


def test_steps_are_those_of_pixels_at_which_every_image_shows_a_surface() -> None:
    nowhere = complex(np.nan, np.nan)
    truth, model = np.array([0, 0, nowhere, 1j]), np.array([3 + 4j, nowhere, 1, 1j])
    steps = Steps.of([truth, model, model])
    near_offset, pivot = steps.lengths
    assert steps.pixels.tolist() == [0, 3] and pivot is None
    assert near_offset is not None and near_offset.tolist() == [5, 0]
    assert steps.sizes()[1] == StepSize(rms=0.0, p99=0.0)


def test_one_more_link_displaces_the_pixels_that_it_changes_and_no_others() -> None:
    steps = Steps.of([np.zeros(5, dtype=complex), np.array([1, 2, complex(np.nan, np.nan), 4, 5])])
    # Pixel 1 moves, pixel 2 was not there, and pixel 4 shows no surface any more.
    more = steps.with_last(np.array([1, 2, 4]), np.array([7.0, 1.0, np.nan]))
    first, last = more.lengths
    assert more.pixels.tolist() == [0, 1, 3]
    assert first is not None and last is not None
    assert first.tolist() == [1, 2, 4] and last.tolist() == [0, 7, 0]
    assert steps.with_last(np.zeros(0, dtype=np.int64), np.zeros(0)).lengths[-1] is None


@pytest.mark.parametrize("values", [[], [0.0, 0.0], [1.0], [3.0, 1.0, 2.0], np.arange(9000.0) ** 2])
def test_the_size_of_a_step_has_the_numbers_of_a_spread(values: list[float]) -> None:
    size, spread = StepSize.of(np.array(values)), Spread.of(np.array(values))
    assert (size is None) == (spread is None) == (not len(values))
    if size and spread:
        np.testing.assert_array_equal((size.rms, size.p99), (spread.rms, spread.p99))
