"""Samples of hogels: content, bounds, and equal meaning of beyond in all commands."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from xfrustum.compare.beyond import displacement_p99, is_beyond
from xfrustum.compare.judging.judged import MeasuredBy
from xfrustum.compare.judging.verdict import Limits
from xfrustum.compare.metrics.error_maps import Spread
from xfrustum.compare.planning.measure import HogelResult
from xfrustum.compare.planning.requirement import Requirement
from xfrustum.compare.sampling import (
    GrowingSample,
    RandomSample,
    aperture_at,
    clean_sample,
    risk_of_claim,
    sample_hogels,
    share_at_most,
    share_beyond,
)
from xfrustum.scenes import Aperture, InputError, Plate

SEEDS = 200  #: simulated surveys of each kind

FAILURES = 0.05 + 3.1 * math.sqrt(0.05 * 0.95 / SEEDS)
"""Share of them whose bounds may fail: a risk of 0.05 exceeds it in one test of 1000."""


def plate(columns: int, rows: int) -> Plate:
    return Plate(size=(80.0, 60.0), hogels=(columns, rows))


PLATES = st.builds(plate, st.integers(1, 12), st.integers(1, 12))


@given(PLATES, st.integers(1, 40), st.integers(0, 5))
def test_each_sample_keeps_the_hogels_of_the_one_before_and_the_last_has_all(
    plate: Plate, first: int, seed: int
) -> None:
    sample = GrowingSample(hogels=math.prod(plate.hogels), first=first, seed=seed)
    before: set[int] = set()
    for look in range(sample.looks):
        places = sample.places(look).tolist()
        assert before <= set(places)
        assert len(places) == len(set(places)) == sample.size(look)
        assert set(sample.new_places(look).tolist()) == set(places) - before
        before = set(places)
    assert before == set(range(math.prod(plate.hogels)))
    assert {aperture_at(plate, place).index for place in before} == {
        a.index for a in plate.apertures()
    }


@given(PLATES, st.integers(1, 40), st.integers(0, 3))
def test_every_sample_has_one_hogel_of_each_of_as_many_runs(
    plate: Plate, first: int, look: int
) -> None:
    sample = GrowingSample(hogels=math.prod(plate.hogels), first=first)
    look = min(look, sample.looks - 1)
    runs, hogels = sample.first << look, sample.hogels
    if runs <= hogels:
        ends = np.arange(runs + 1) * hogels // runs
        assert np.array_equal(
            np.searchsorted(ends, sample.places(look), side="right") - 1, np.arange(runs)
        )


def test_every_hogel_of_a_run_is_drawn_as_often_also_after_the_sample_has_grown() -> None:
    drawn = np.zeros(21)
    for seed in range(SEEDS):
        drawn[
            GrowingSample(hogels=math.prod(plate(7, 3).hogels), first=3, seed=seed).places(1)
        ] += 1
    # Runs of 3 or 4 hogels after the first has been halved: each hogel 1/3 or 1/4 of the times.
    ends = np.arange(7) * 21 // 6
    expected = np.repeat(SEEDS / np.diff(ends), np.diff(ends))
    assert np.abs(drawn - expected).max() < 5 * math.sqrt(SEEDS * 0.25)


@pytest.mark.parametrize("spread", ["clustered", "scattered"])
@pytest.mark.parametrize("beyond", [5, 60, 400])
def test_the_bound_of_one_sample_holds_on_finite_plates(spread: str, beyond: int) -> None:
    whole = plate(40, 25)
    wrong = np.zeros(1000, dtype=bool)
    wrong[
        np.random.default_rng(1).permutation(1000)[:beyond]
        if spread == "scattered"
        else slice(beyond)
    ] = True
    failed = 0
    for seed in range(SEEDS):
        places = GrowingSample(hogels=math.prod(whole.hogels), first=130, seed=seed).places(0)
        failed += share_beyond(int(wrong[places].sum()), 130, 1000) < beyond / 1000
    assert failed / SEEDS < FAILURES


def test_the_bound_for_draws_with_replacement_is_conservative_for_draws_without() -> None:
    # Hypergeometric against binomial: how often a bound fails, computed and not simulated.
    for beyond in range(1, 100):
        seen = np.arange(beyond + 1)
        fails = [share_at_most(int(count), 40) < beyond / 100 for count in seen]
        risk = float(stats.hypergeom(100, beyond, 40).pmf(seen)[fails].sum())
        assert risk <= 0.05


def test_bounds_hold_wherever_a_survey_stops() -> None:
    wrong = np.zeros(1000, dtype=bool)
    wrong[np.random.default_rng(2).permutation(1000)[:55]] = True
    lies, first = 0, clean_sample(0.05, 1000, risk_of_claim(look=0))
    for seed in range(SEEDS):
        sample = GrowingSample(hogels=math.prod(plate(40, 25).hogels), first=first, seed=seed)
        for look in range(sample.looks):
            places = sample.places(look)
            bound = share_beyond(
                int(wrong[places].sum()), len(places), 1000, risk_of_claim(look=look)
            )
            if bound <= 0.05:
                lies += 1
                break
    assert lies / SEEDS < FAILURES


def test_the_risks_of_all_looks_add_up_to_what_is_allowed() -> None:
    assert sum(risk_of_claim(look=look) for look in range(100_000)) == pytest.approx(0.05, rel=1e-4)
    assert 3 * risk_of_claim(3) == pytest.approx(0.05)


def test_a_clean_sample_is_as_large_as_it_must_be_and_no_larger() -> None:
    # 299 clean hogels bound a share of 1 % where the plate is so large that its runs are as good as
    # equal.
    assert clean_sample(0.01, 10_000_000, 0.05) == 299
    for hogels in (100, 500, 4941):
        size = clean_sample(0.02, hogels, 0.05)
        assert share_beyond(0, size, hogels, 0.05) <= 0.02
        assert size <= hogels
    assert clean_sample(0.001, 100, 0.05) == 100


def test_fifty_nine_clean_hogels_bound_one_in_twenty_and_299_one_in_a_hundred() -> None:
    """(1 - q)^59 < 0.05 from q = 0.0495 on: Clopper and Pearson's bound where nothing was found."""
    assert share_at_most(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert share_at_most(0, 59) < 0.05 < share_at_most(0, 58)
    assert share_at_most(0, 299) < 0.01 < share_at_most(0, 298)
    assert share_at_most(59, 59) == 1.0


@given(beyond=st.integers(0, 20), more=st.integers(0, 20), share=st.floats(0.01, 0.99))
def test_the_bound_holds_as_often_as_it_says(beyond: int, more: int, share: float) -> None:
    """A share beyond the bound would show so few hogels, or fewer, with a chance of at most 5 %."""
    count = beyond + more + 1
    bound = share_at_most(beyond, count)
    if share > bound:
        chance = sum(
            math.comb(count, k) * share**k * (1 - share) ** (count - k) for k in range(beyond + 1)
        )
        assert chance <= 0.05 + 1e-9


@given(
    columns=st.integers(1, 30),
    rows=st.integers(1, 30),
    hogels=st.integers(1, 80),
    seed=st.integers(0, 99),
)
def test_a_sample_is_seeded_and_spread_and_leaves_out_what_it_must(
    columns: int, rows: int, hogels: int, seed: int
) -> None:
    plate, sample = (
        Plate(size=(1.0, 1.0), hogels=(columns, rows)),
        RandomSample(hogels=hogels, seed=seed),
    )
    taken = [plate.middle]
    drawn = [hogel.index for hogel in sample_hogels(plate, sample, taken)]
    assert drawn == [hogel.index for hogel in sample_hogels(plate, sample, taken)]
    assert len(set(drawn)) == len(drawn) == min(hogels, columns * rows - 1)
    assert plate.middle.index not in drawn
    if len(drawn) >= 4 * rows:
        # One of each part of the plate: no row is left out.
        assert {row for _, row in drawn} == set(range(rows))


def test_a_sample_of_nothing_is_refused() -> None:
    for wrong in ({"hogels": 0}, {"seed": -1}):
        with pytest.raises(InputError):
            RandomSample(**wrong)
    with pytest.raises(InputError, match="at least one hogel"):
        GrowingSample(hogels=math.prod(plate(2, 2).hogels), first=0)
    with pytest.raises(InputError, match="from 0"):
        GrowingSample(hogels=math.prod(plate(2, 2).hogels), first=1, seed=-1)


@given(st.integers(1, 500), st.data())
def test_bounds_lie_between_what_was_seen_and_what_is_possible(
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


def numbers(p99: float | None, at_plate: int = 0) -> Any:
    """Return a hogel's answer of a comparison, without the rest."""
    return SimpleNamespace(
        displacement_px=None if p99 is None else spread(p99), at_plate=at_plate, judged=JUDGED
    )


def test_the_99th_percentile_or_more_than_one_percent_of_wrong_surfaces_or_what_is_undefined() -> (
    None
):
    assert not is_beyond(0.5, 0.01, 0.5)
    assert is_beyond(0.501, 0.0, 0.5) and is_beyond(0.0, 0.0101, 0.5)
    for undefined in (None, float("nan"), float("inf")):
        assert is_beyond(undefined, 0.0, 0.5) and is_beyond(undefined, 0.0, float("inf"))
    # A hogel that shows nothing displaces nothing.
    assert displacement_p99(numbers(None)) == 0.0


@pytest.mark.parametrize(
    ("p99", "at_plate", "defined"),
    [(None, 1, False), (0.1, 10, True), (0.1, 11, False), (0.0, JUDGED, False)],
)
def test_displacement_is_undefined_where_the_plate_itself_is_shown(
    p99: float | None, at_plate: int, defined: bool
) -> None:
    """All that is shown, or more of the picture than the percentile leaves out."""
    assert (displacement_p99(numbers(p99, at_plate)) < float("inf")) == defined


@given(st.floats(0, 2), st.integers(0, 30), st.integers(0, 30))
def test_all_commands_say_the_same(p99: float, at_plate: int, wrong: int) -> None:
    """Where everything is shown, `verify` limits the share of all judged pixels."""
    moved, share = displacement_p99(numbers(p99, at_plate)), wrong / JUDGED
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
