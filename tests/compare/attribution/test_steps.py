"""What links add to displacement: the same numbers compiled or not, and of whole images."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.views import view
from xfrustum.compare.attribution.steps import Steps, StepSize, shifts, step_lengths
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
    known = np.isfinite(moved[0]) & np.isfinite(moved[1])
    steps = Steps.between((truth, model, model, drawn), first)
    np.testing.assert_array_equal(steps.known, known)
    assert 0 < steps.count == known.sum() < np.isfinite(first).sum()
    near_offset, pivot, rasterization = steps.lengths
    assert near_offset is not None and pivot is None and rasterization is not None
    assert steps.sizes()[1] == StepSize(rms=0.0, p99=0.0)
    # NumPy's lengths may have one rounding more, where a processor cannot multiply and add in one.
    for found, expected in ((near_offset, moved[0]), (rasterization, moved[1])):
        np.testing.assert_array_max_ulp(found[known], expected[known], maxulp=1)
        assert not found[~known].any()
    pixels = np.flatnonzero(known)
    np.testing.assert_array_equal(step_lengths(model, drawn, truth.camera, pixels), rasterization[pixels])


def test_nothing_is_displaced_where_no_image_differs(images: tuple[HogelImage, ...]) -> None:
    truth = images[0]
    steps = Steps.between((truth, truth), shifts(truth, truth.camera))
    assert steps.lengths == (None,) and steps.sizes() == (StepSize(rms=0.0, p99=0.0),)


def test_one_more_link_displaces_the_pixels_that_it_changes_and_no_others() -> None:
    known = np.array([True, True, False, True, True])
    steps = Steps(known=known, count=4, lengths=(np.array([1.0, 2.0, 0.0, 4.0, 5.0]), None))
    # Pixel 1 moves, pixel 2 was not there, and pixel 4 shows no surface any more.
    more = steps.with_last(np.array([1, 2, 4]), np.array([7.0, 1.0, np.nan]))
    first, second, last = more.lengths
    assert more.known.tolist() == [True, True, False, True, False] and more.count == 3
    assert first is not None and second is None and last is not None
    assert first.tolist() == [1, 2, 0, 4, 0] and last.tolist() == [7]
    rms = [StepSize.of(np.array(values)) for values in ([1.0, 2.0, 4.0], [0.0] * 3, [0.0, 7.0, 0.0])]
    assert list(more.sizes()) == rms
    # Where every pixel keeps its surface, the same pixels are left.
    kept = steps.with_last(np.array([1, 2]), np.array([7.0, np.nan]))
    assert kept.known is known and kept.count == 4
    nothing = steps.with_last(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert nothing.sizes()[-1] == StepSize(rms=0.0, p99=0.0)


@settings(deadline=None)
@given(
    values=st.lists(st.floats(0, 1e6), min_size=1, max_size=300),
    zeros=st.integers(0, 300),
    seed=st.integers(0, 99),
)
def test_zeros_that_stand_for_nothing_change_no_size(values: list[float], zeros: int, seed: int) -> None:
    meant = np.array(values)
    beside = np.random.default_rng(seed).permutation(np.append(meant, np.zeros(zeros)))
    spread, expected = Spread.of(beside, len(values)), Spread.of(meant)
    assert spread is not None and expected is not None
    assert (spread.p50, spread.p95, spread.p99, spread.max) == (
        expected.p50,
        expected.p95,
        expected.p99,
        expected.max,
    )
    # Sums of other orders differ in their roundings, of which there are a few hundred.
    assert spread.rms == pytest.approx(expected.rms, rel=600 * 2**-53)
    whole, few = StepSize.of(meant), StepSize.of(meant[meant > 0], len(meant))
    assert whole is not None and few is not None
    assert few.p99 == whole.p99 and few.rms == pytest.approx(whole.rms, rel=600 * 2**-53)
    assert Spread.of(np.zeros(zeros), 0) is None and StepSize.of(np.zeros(zeros), 0) is None


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
