"""Radiance errors: differences, FLIP and SSIM, sRGB, and the test against a noisy reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from tests.support.worlds import World
from xfrustum.compare.comparison import (
    ALPHA,
    NoiseTest,
    away_from_edges,
    compare_images,
    compare_radiance,
    compare_with_noise,
    joint_chance,
    perceptual_difference,
    single_level,
)
from xfrustum.reference.transport import RadianceEstimate
from xfrustum.scenes import HogelImage
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.images import NOTHING, Certainty


@pytest.fixture
def truth(centered: World) -> HogelImage:
    return centered.truth()


def colored(image: HogelImage, color: NDArray[np.floating]) -> HogelImage:
    return replace(image, color=color.astype(np.float32))


def test_errors_are_raster_minus_truth_per_channel(truth: HogelImage) -> None:
    same = compare_radiance(truth, truth, perceptual=True).numbers
    assert same.rms == same.max == same.above_step == same.flip == 0 and same.ssim == 1
    shift = np.array([0.5, -0.25, 0.0])
    off = compare_radiance(truth, colored(truth, truth.color + shift)).numbers
    assert off.mean == pytest.approx(shift.mean(), abs=1e-6)
    assert off.rms == pytest.approx(np.sqrt(np.mean(shift**2)), abs=1e-6)
    assert off.max == pytest.approx(0.5, abs=1e-6) == off.p99
    assert off.above_step == 1


def test_ties_and_colors_that_are_no_numbers_are_not_judged(truth: HogelImage) -> None:
    color, certainty = truth.color.copy(), truth.certainty.copy()
    color[0, 0] += 1
    color[5, 5, 1] = np.nan
    certainty[0, 0] = Certainty.TIE
    difference = compare_radiance(replace(truth, certainty=certainty), colored(truth, color))
    assert difference and difference.numbers.max == 0
    ties = int((certainty == Certainty.TIE).sum())
    assert difference.numbers.pixels == truth.triangle.size - 1 - ties
    assert np.isnan(difference.error[0, 0]).all() and np.isnan(difference.error[5, 5]).all()
    bare = replace(truth, color=None)
    assert compare_images(truth, bare, None).summary()["radiance"] is None


def test_away_from_edges_both_show_the_same_triangle(truth: HogelImage) -> None:
    triangle = truth.triangle.copy()
    triangle[20:22] = NOTHING
    inside = away_from_edges(truth, replace(truth, triangle=triangle))
    np.testing.assert_array_equal(inside, truth.covered & (triangle != NOTHING))


def test_radiance_beyond_a_screens_white_does_not_look_different() -> None:
    white = np.full((16, 20, 3), 1.5)
    looks = perceptual_difference(white, 2 * white)
    assert looks.flip == 0 and looks.ssim == 1
    tiny = perceptual_difference(white[:4, :4], 0 * white[:4, :4])
    assert tiny.flip > 0.9 and tiny.ssim is None


SHAPE = (12, 10, 3)
SAMPLES = 8
EVERYWHERE = np.ones(SHAPE[:2], dtype=np.bool_)


def estimate(truth: Floats, sigma: float, seed: int) -> RadianceEstimate:
    """Sample a picture with normal noise; return estimates computed from the samples."""
    drawn = np.random.default_rng(seed).normal(truth, sigma, (SAMPLES, *SHAPE))
    return RadianceEstimate(
        mean=drawn.mean(axis=0),
        variance_of_mean=drawn.var(axis=0, ddof=1) / SAMPLES,
        samples=SAMPLES,
    )


def judge(shift: float, sigma: float, seed: int) -> NoiseTest:
    """Test a picture in which one pixel's green channel is off by `shift`."""
    truth = np.random.default_rng(seed + 10_000).random(SHAPE)
    picture = truth.copy()
    picture[4, 7, 1] += shift
    return compare_with_noise(picture, estimate(truth, sigma, seed), EVERYWHERE)


def test_false_alarms_occur_at_the_significance_level() -> None:
    """A share ALPHA of independent right pictures fails; p-values are uniform."""
    runs = [judge(0.0, 0.1, seed) for seed in range(600)]
    alarms = sum(not run.numbers.agrees for run in runs)
    assert alarms <= stats.binom.ppf(1 - 1e-6, len(runs), ALPHA)
    assert stats.kstest([run.numbers.p_value for run in runs], "uniform").pvalue > 1e-6
    assert all(run.numbers.agrees == (run.numbers.p_value >= ALPHA) for run in runs)


@pytest.mark.parametrize("shift_in_errors", [6.0, 12.0, 24.0])
def test_a_shift_is_detected_as_often_as_the_noncentral_t_predicts(
    shift_in_errors: float,
) -> None:
    """The deviation of a shifted pixel follows the noncentral t distribution."""
    sigma, runs = 0.1, 300
    shift = shift_in_errors * sigma / np.sqrt(SAMPLES)
    count = sum(bool(judge(shift, sigma, seed).differs[4, 7]) for seed in range(runs))
    threshold = stats.t.isf(single_level(ALPHA, int(np.prod(SHAPE))) / 2, SAMPLES - 1)
    power = stats.nct.sf(threshold, SAMPLES - 1, shift_in_errors)
    low, high = stats.binom.interval(1 - 1e-6, runs, power)
    # The pixel's other two channels may also raise an alarm, though rarely.
    assert low <= count <= high + 2


def test_a_picture_off_everywhere_by_little_shows_in_the_bias() -> None:
    truth = np.full(SHAPE, 0.5)
    off = compare_with_noise(truth + 0.03, estimate(truth, 0.1, 3), EVERYWHERE)
    assert off.numbers.bias > 5 * off.numbers.bias_error > 0
    right = compare_with_noise(truth, estimate(truth, 0.1, 3), EVERYWHERE)
    assert abs(right.numbers.bias) < 5 * right.numbers.bias_error


def test_where_nothing_varies_rounding_alone_decides() -> None:
    mean = np.full(SHAPE, 0.25)
    exact = RadianceEstimate(mean=mean, variance_of_mean=np.zeros(SHAPE), samples=SAMPLES)
    picture = mean.copy()
    picture[2, 3, 0] += 1e-6
    within, beyond = (
        compare_with_noise(picture, exact, EVERYWHERE, rounding=rounding)
        for rounding in (2e-6, 5e-7)
    )
    assert within.numbers.agrees and within.numbers.p_value == 1.0
    assert np.argwhere(beyond.differs).tolist() == [[2, 3]]
    assert beyond.numbers.p_value == 0.0


@given(st.floats(1e-12, 0.999), st.integers(1, 10**7))
def test_one_and_all_are_inverse_to_each_other(chance: float, tests: int) -> None:
    assert joint_chance(single_level(chance, tests), tests) == pytest.approx(chance, rel=1e-6)
