"""The test against a noisy reference raises few false alarms, and finds real differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from xfrustum.compare.metrics.radiance import ALPHA, NoiseTest, compare_with_noise, joint_chance, single_level
from xfrustum.reference.transport.transport import RadianceEstimate
from xfrustum.scenes.arrays import Floats

SHAPE = (12, 10, 3)
SAMPLES = 8
EVERYWHERE = np.ones(SHAPE[:2], dtype=np.bool_)


def estimate(truth: Floats, sigma: float, seed: int) -> RadianceEstimate:
    """Sample a picture with normal noise, and know it only from the samples."""
    drawn = np.random.default_rng(seed).normal(truth, sigma, (SAMPLES, *SHAPE))
    return RadianceEstimate(
        mean=drawn.mean(axis=0), variance_of_mean=drawn.var(axis=0, ddof=1) / SAMPLES, samples=SAMPLES
    )


def judge(shift: float, sigma: float, seed: int) -> NoiseTest:
    """Test a picture of which one pixel's green is off by so much."""
    truth = np.random.default_rng(seed + 10_000).random(SHAPE)
    picture = truth.copy()
    picture[4, 7, 1] += shift
    return compare_with_noise(picture, estimate(truth, sigma, seed), EVERYWHERE)


def test_false_alarms_are_as_rare_as_the_level_says() -> None:
    """A share of ALPHA of independent right pictures fails; p-values are uniform."""
    runs = [judge(0.0, 0.1, seed) for seed in range(600)]
    alarms = sum(not run.numbers.agrees for run in runs)
    assert alarms <= stats.binom.ppf(1 - 1e-6, len(runs), ALPHA)
    assert stats.kstest([run.numbers.p_value for run in runs], "uniform").pvalue > 1e-6
    assert all(run.numbers.agrees == (run.numbers.p_value >= ALPHA) for run in runs)


@pytest.mark.parametrize("shift_in_errors", [6.0, 12.0, 24.0])
def test_a_shift_is_found_as_often_as_its_noncentral_distribution_says(shift_in_errors: float) -> None:
    """The deviation of a shifted pixel follows the noncentral t."""
    sigma, runs = 0.1, 300
    shift = shift_in_errors * sigma / np.sqrt(SAMPLES)
    found = sum(bool(judge(shift, sigma, seed).differs[4, 7]) for seed in range(runs))
    threshold = stats.t.isf(single_level(ALPHA, int(np.prod(SHAPE))) / 2, SAMPLES - 1)
    power = stats.nct.sf(threshold, SAMPLES - 1, shift_in_errors)
    low, high = stats.binom.interval(1 - 1e-6, runs, power)
    # The two other channels of the pixel may raise an alarm too, rarely.
    assert low <= found <= high + 2


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
    within = compare_with_noise(picture, exact, EVERYWHERE, rounding=2e-6)
    assert (
        within.numbers.agrees
        and within.numbers.p_value == 1.0
        and within.numbers.without_noise == EVERYWHERE.size
    )
    beyond = compare_with_noise(picture, exact, EVERYWHERE, rounding=5e-7)
    assert np.argwhere(beyond.differs).tolist() == [[2, 3]]
    assert beyond.numbers.p_value == 0.0 and beyond.numbers.farthest == np.inf


def test_only_judged_pixels_count() -> None:
    mean = np.zeros(SHAPE)
    exact = RadianceEstimate(mean=mean, variance_of_mean=np.zeros(SHAPE), samples=SAMPLES)
    picture = mean.copy()
    picture[0, 0], picture[1, 1] = 1.0, np.nan
    judged = EVERYWHERE.copy()
    judged[0, 0] = False
    outcome = compare_with_noise(picture, exact, judged)
    assert outcome.numbers.agrees and outcome.numbers.tests == 3 * (EVERYWHERE.size - 2)
    nothing = compare_with_noise(picture, exact, np.zeros_like(judged))
    assert nothing.numbers.agrees and nothing.numbers.tests == 0 and nothing.numbers.p_value == 1.0


@given(st.floats(1e-12, 0.999), st.integers(1, 10**7))
def test_one_and_all_are_inverse_to_each_other(chance: float, tests: int) -> None:
    assert joint_chance(single_level(chance, tests), tests) == pytest.approx(chance, rel=1e-6)
