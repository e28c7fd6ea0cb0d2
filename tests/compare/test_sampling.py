"""Samples of hogels: their content, their bounds, and one definition of "beyond" everywhere."""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from xfrustum.compare.error_maps import Spread
from xfrustum.compare.judging.judged import MeasuredBy
from xfrustum.compare.judging.verdict import Limits
from xfrustum.compare.planning.requirement import Requirement
from xfrustum.compare.planning.views import HogelResult
from xfrustum.compare.sampling import (
    GrowingSample,
    RandomSample,
    aperture_at,
    clean_sample,
    displacement_p99,
    is_beyond,
    risk_of_claim,
    sample_hogels,
    share_at_most,
    share_beyond,
)
from xfrustum.scenes import Aperture, InputError, Plate
from xfrustum.scenes.arrays import Mask

SEEDS = 200  #: number of simulated surveys of each kind

FAILURES = 0.05 + 3.1 * math.sqrt(0.05 * 0.95 / SEEDS)
"""Largest share of failing bounds: with a risk of 0.05, one test of 1000 exceeds it."""


def plate(columns: int, rows: int) -> Plate:
    return Plate(size=(80.0, 60.0), hogels=(columns, rows))


PLATES = st.builds(plate, st.integers(1, 12), st.integers(1, 12))


@given(PLATES, st.integers(1, 40), st.integers(0, 5))
def test_samples_are_nested_with_one_hogel_of_each_run_and_the_last_has_all(
    plate: Plate, first: int, seed: int
) -> None:
    hogels = math.prod(plate.hogels)
    sample = GrowingSample(hogels=hogels, first=first, seed=seed)
    before: set[int] = set()
    for look in range(sample.looks):
        places = sample.places(look)
        now, size = set(places.tolist()), min(sample.first << look, hogels)
        assert before <= now and len(places) == len(now) == size
        assert set(sample.new_places(look).tolist()) == now - before
        if size < hogels:
            ends = np.arange(size + 1) * hogels // size
            run_of = np.searchsorted(ends, places, side="right") - 1
            np.testing.assert_array_equal(run_of, np.arange(size))
        before = now
    assert before == set(range(hogels))
    assert {aperture_at(plate, place) for place in before} == set(plate.apertures())


def test_hogels_of_a_run_are_drawn_equally_often_even_after_the_sample_has_grown() -> None:
    drawn = np.zeros(21)
    for seed in range(SEEDS):
        drawn[GrowingSample(hogels=21, first=3, seed=seed).places(1)] += 1
    # The first halving leaves runs of 3 or 4 hogels: a hogel is drawn with chance 1/3 or 1/4.
    ends = np.arange(7) * 21 // 6
    expected = np.repeat(SEEDS / np.diff(ends), np.diff(ends))
    assert np.abs(drawn - expected).max() < 5 * math.sqrt(SEEDS * 0.25)


@cache
def bound(count: int, judged: int, *risk: float) -> float:
    """Return the bound of a sample of 1000 hogels, computed once."""
    return share_beyond(count, judged, 1000, *risk)


def beyond_of(count: int, *, scattered: bool) -> Mask:
    """Return a mask of 1000 hogels with a number of hogels beyond the tolerance."""
    places = np.random.default_rng(1).permutation(1000) if scattered else np.arange(1000)
    return np.asarray(places < count)


@pytest.mark.parametrize(("count", "scattered"), [(5, True), (400, False)])
def test_the_bound_of_one_sample_holds_on_finite_plates(count: int, scattered: bool) -> None:
    beyond, failed = beyond_of(count, scattered=scattered), 0
    for seed in range(SEEDS):
        places = GrowingSample(hogels=1000, first=130, seed=seed).places(0)
        failed += bound(int(beyond[places].sum()), 130) < count / 1000
    assert failed / SEEDS < FAILURES


@pytest.mark.parametrize("longest", [1, 100, 400])
def test_the_bound_holds_if_only_the_longest_runs_are_beyond(longest: int) -> None:
    """A sample of 1000 of 1501 hogels has 501 runs of two hogels: they weigh more in the plate."""
    assert share_beyond(longest, 1000, 1501) >= 2 * longest / 1501


def test_the_bound_for_draws_with_replacement_is_conservative_for_draws_without() -> None:
    """Compute how often the bound fails, with the hypergeometric and the binomial distribution."""
    bounds = np.array([share_at_most(count, 40) for count in range(41)])
    for beyond in range(1, 100):
        count = np.arange(min(beyond, 40) + 1)
        fails = bounds[count] < beyond / 100
        assert stats.hypergeom(100, beyond, 40).pmf(count)[fails].sum() <= 0.05


def test_bounds_hold_wherever_a_survey_stops() -> None:
    beyond, wrong, first = beyond_of(55, scattered=True), 0, clean_sample(0.05, 1000, 0.025)
    for seed in range(SEEDS):
        sample = GrowingSample(hogels=1000, first=first, seed=seed)
        claims = []
        for look in range(sample.looks):
            places = sample.places(look)
            count = int(beyond[places].sum())
            claims.append(bound(count, len(places), risk_of_claim(look=look)) <= 0.05)
        wrong += any(claims)
    assert wrong / SEEDS < FAILURES


def test_the_risks_of_all_looks_add_up_to_the_allowed_risk() -> None:
    assert sum(risk_of_claim(look=look) for look in range(100_000)) == pytest.approx(0.05, rel=1e-4)
    assert 3 * risk_of_claim(3) == pytest.approx(0.05) == 2 * risk_of_claim(look=0)


def test_a_clean_sample_is_as_large_as_it_must_be_and_no_larger() -> None:
    # 299 clean hogels bound a share of 1 % if the plate is so large that its runs are nearly equal.
    assert clean_sample(0.01, 10_000_000, 0.05) == 299
    for hogels in (100, 500, 4941):
        size = clean_sample(0.02, hogels, 0.05)
        assert share_beyond(0, size, hogels, 0.05) <= 0.02
        assert size <= hogels
    assert clean_sample(0.001, 100, 0.05) == 100


def test_fifty_nine_clean_hogels_bound_one_in_twenty_and_299_one_in_a_hundred() -> None:
    """(1 - q)^59 < 0.05 for q > 0.0495: the Clopper-Pearson bound of a sample without errors."""
    assert share_at_most(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert share_at_most(0, 59) < 0.05 < share_at_most(0, 58)
    assert share_at_most(0, 299) < 0.01 < share_at_most(0, 298)
    assert share_at_most(59, 59) == 1.0


@given(
    columns=st.integers(1, 30),
    rows=st.integers(1, 30),
    hogels=st.integers(1, 80),
    seed=st.integers(0, 99),
)
def test_a_sample_is_seeded_and_spread_and_omits_excluded_hogels(
    columns: int, rows: int, hogels: int, seed: int
) -> None:
    whole, sample = plate(columns, rows), RandomSample(hogels=hogels, seed=seed)
    drawn, again = (
        [hogel.index for hogel in sample_hogels(whole, sample, [whole.middle])] for _ in range(2)
    )
    assert drawn == again
    assert len(set(drawn)) == len(drawn) == min(hogels, columns * rows - 1)
    assert whole.middle.index not in drawn
    if len(drawn) >= 4 * rows:
        # One hogel from each part of the plate: no row is missing.
        assert {row for _, row in drawn} == set(range(rows))


@pytest.mark.parametrize("wrong", [{"hogels": 0}, {"seed": -1}])
def test_a_sample_of_nothing_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(InputError, match=r"at least one hogel|from 0"):
        RandomSample(**wrong)


@given(st.integers(1, 500), st.data())
def test_bounds_lie_between_the_observed_and_the_largest_possible_share(
    hogels: int, data: st.DataObject
) -> None:
    judged = data.draw(st.integers(1, hogels))
    beyond = data.draw(st.integers(0, judged))
    bound = share_beyond(beyond, judged, hogels)
    assert beyond / hogels <= bound <= (hogels - judged + beyond) / hogels
    if judged == hogels:
        assert bound == beyond / hogels


JUDGED = 1000


def spread(p99: float) -> Spread:
    return Spread(rms=p99, p50=p99, p95=p99, p99=p99, max=p99)


def moved_by(p99: float | None, at_plate: int = 0) -> float:
    """Return a comparison's percentile of displacement, with pixels in the plate."""
    shown: Any = SimpleNamespace(
        displacement_px=None if p99 is None else spread(p99), at_plate=at_plate, judged=JUDGED
    )
    return displacement_p99(shown)


def test_beyond_is_the_99th_percentile_or_one_percent_of_wrong_surfaces_or_undefined() -> None:
    assert not is_beyond(0.5, 0.01, 0.5)
    assert is_beyond(0.501, 0.0, 0.5) and is_beyond(0.0, 0.0101, 0.5)
    for undefined in (None, float("nan"), float("inf")):
        assert is_beyond(undefined, 0.0, float("inf"))
    # A hogel without surfaces has no displacement. Displacement is undefined if all surfaces lie in
    # the plate, or more of the picture than the percentile leaves out.
    assert moved_by(None) == 0.0 and moved_by(0.1, 10) == 0.1
    assert moved_by(None, 1) == moved_by(0.1, 11) == math.inf


@given(st.floats(0, 2), st.integers(0, 30), st.integers(0, 30))
def test_all_commands_have_the_same_verdict(p99: float, at_plate: int, wrong: int) -> None:
    """Every pixel shows a surface, because `verify` limits the share among all judged pixels."""
    moved, share = moved_by(p99, at_plate), wrong / JUDGED
    beyond = is_beyond(moved, share, 0.5)
    hogel = HogelResult(
        aperture=Aperture(column=0, row=0, x=0.0, y=0.0),
        displacement_p99_px=moved,
        surface_fraction=share,
        depth_wrong=0.0,
        covered=JUDGED,
    )
    assert hogel.beyond(0.5) == Requirement().missed_by(hogel) == beyond
    if at_plate * 100 <= JUDGED:
        counts: Any = SimpleNamespace(
            shown=JUDGED,
            limited=wrong,
            limited_figure="wrong surfaces",
            radiance=None,
            invalid=0,
            displacement_px=spread(p99),
            displacement_by=MeasuredBy.POINTS,
            outlines=None,
        )
        figures: Any = SimpleNamespace(numbers=counts, claimed=JUDGED)
        assert all(check.held for check in Limits().checks(figures)) != beyond
