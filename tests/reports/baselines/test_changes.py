"""What got worse beyond noise is found: exactly without noise, and rarely by chance with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from xfrustum.reports.baselines.changes import Change, Changes, Edition, changes_of
from xfrustum.reports.baselines.measures import NAMES, HogelMeasures, Measures, Place, is_count, total
from xfrustum.reports.baselines.tolerance import FALSE_ALARMS, ROUNDING_PX, Noise, Stated, learnt
from xfrustum.scenes.errors import InputError

ZERO = Measures(**dict.fromkeys(NAMES, 0.0))


def hogel(place: Place = (0, 0), by: str | None = "triangle", **numbers: float | None) -> HogelMeasures:
    """Return a hogel whose other measures are zero."""
    return HogelMeasures(place=place, by=by, measures=replace(ZERO, **numbers))


MISSING = HogelMeasures(place=(0, 0), by=None, measures=Measures(missing=1.0))


def beside(
    now: Sequence[HogelMeasures], *runs: Sequence[HogelMeasures], stated: Stated | None = None
) -> Changes:
    """Compare hogels with some accepted runs of the same places."""
    return changes_of(now, {place: [one] for place, one in edition(*runs).items()}, stated)


def edition(*runs: Sequence[HogelMeasures], name: str = "") -> dict[Place, Edition]:
    """Return the hogels of some runs of the same places, as one edition."""
    names = tuple(f"{name}{number}" for number in range(len(runs)))
    return {places[0].place: Edition(runs=names, kept=tuple(places)) for places in zip(*runs, strict=True)}


def test_without_noise_one_pixel_more_is_worse_and_one_less_is_better() -> None:
    accepted = [[hogel(wrong_surfaces=7.0), hogel((1, 0))]] * 3
    assert beside(accepted[0], *accepted).change is Change.SAME
    worse = beside([hogel(wrong_surfaces=8.0), hogel((1, 0))], *accepted)
    assert worse.change is Change.WORSE
    (first, second) = worse.of_kind(Change.WORSE)
    assert first.words == "wrong surfaces of hogel 0,0: 7 accepted, 8 now"
    assert second.words == "wrong surfaces of the plate: 7 accepted, 8 now"
    assert beside([hogel(wrong_surfaces=6.0), hogel((1, 0))], *accepted).change is Change.BETTER


def test_a_sum_over_the_plate_hides_no_hogel() -> None:
    accepted = [[hogel(wrong_surfaces=5.0), hogel((1, 0), wrong_surfaces=5.0)]]
    found = beside([hogel(wrong_surfaces=9.0), hogel((1, 0), wrong_surfaces=1.0)], *accepted)
    assert found.change is Change.WORSE
    assert [one.aperture for one in found.of_kind(Change.WORSE)] == [(0, 0)]
    assert [one.aperture for one in found.of_kind(Change.BETTER)] == [(1, 0)]


def test_displacements_that_differ_by_rounding_are_the_same() -> None:
    accepted = [[hogel(displacement_p99_px=0.25)]]
    within = beside([hogel(displacement_p99_px=0.25 + ROUNDING_PX / 2)], *accepted)
    beyond = beside([hogel(displacement_p99_px=0.25 + 2 * ROUNDING_PX)], *accepted)
    assert (within.change, beyond.change) == (Change.SAME, Change.WORSE)


def test_a_missing_hogel_is_worse_once_and_one_that_is_back_is_better() -> None:
    there = hogel(wrong_surfaces=4.0)
    gone = beside([MISSING], [there])
    assert {one.measure for one in gone.of_kind(Change.WORSE)} == {"missing"}
    assert beside([there], [MISSING]).change is Change.BETTER


def test_what_is_not_known_any_more_is_worse_and_what_was_not_known_is_new() -> None:
    known, unknown = hogel(displacement_p99_px=0.1), hogel(displacement_p99_px=None)
    (lost,) = beside([unknown], [known]).of_kind(Change.WORSE)
    assert lost.words == "displacement (p99) of hogel 0,0: 0.1 px accepted, unknown now"
    found = beside([known], [unknown])
    assert found.change is Change.SAME
    assert [one.measure for one in found.of_kind(Change.NEW)] == ["displacement_p99_px"]


def test_wrong_triangles_are_not_compared_with_wrong_objects() -> None:
    found = beside([hogel(by="object", wrong_pixels=90.0)], [hogel(wrong_pixels=1.0)])
    assert "wrong_pixels" not in {one.measure for one in found.of_kind(Change.WORSE) if one.aperture}


def test_a_hogel_that_nobody_accepted_is_new() -> None:
    found = beside([hogel((5, 5), wrong_surfaces=3.0)], [hogel()])
    assert found.change is Change.NEW
    assert {one.change for one in (*found.plate, *found.hogels)} == {Change.NEW}


def test_an_unchanged_renderer_with_noise_fails_about_as_rarely_as_is_said() -> None:
    """Failures among 200 verifications of 8 hogels with normal noise are 1 %, or fewer.

    Their number is binomial: where each fails with a probability of 1 %, more than 8 of 200 do with one of
    2e-4.
    """
    draw = np.random.default_rng(7)
    failures = 0
    for _ in range(200):
        runs = [
            [
                hogel((place, 0), wrong_surfaces=float(1000 * (place + 1) + draw.normal(0, 5 * (place + 1))))
                for place in range(8)
            ]
            for _ in range(6)
        ]
        failures += beside(runs[0], *runs[1:]).change is Change.WORSE
    assert failures <= 8


def noisy(draw: Callable[[], NDArray[Any]], runs: int) -> list[list[HogelMeasures]]:
    """Return runs of a plate with a row of hogels whose numbers of wrong surfaces are drawn."""
    return [
        [
            HogelMeasures(place=(i, 0), by="triangle", measures=Measures(wrong_surfaces=float(number)))
            for i, number in enumerate(draw())
        ]
        for _ in range(runs)
    ]


def test_two_runs_of_many_hogels_say_how_noisy_each_is() -> None:
    """One degree of freedom for each of 25 hogels: Student's quantile of them all is about 4, not 13,000."""
    draw = np.random.default_rng(9)
    runs = noisy(lambda: 100 + draw.normal(0, 5, 25), 3)
    assert beside(runs[0], *runs[1:]).change is Change.SAME
    worse = [*runs[0][:-1], replace(runs[0][-1], measures=Measures(wrong_surfaces=170.0))]
    found = beside(worse, *runs[1:])
    assert (24, 0) in {one.aperture for one in found.of_kind(Change.WORSE)}
    assert all(one.limit is not None and one.limit < 250 for one in found.hogels)


def test_one_noisy_hogel_among_still_ones_has_its_own_freedom_and_the_runs_are_too_few() -> None:
    runs = [[hogel(wrong_surfaces=value), *(hogel((i, 0)) for i in range(1, 9))] for value in (90.0, 110.0)]
    found = beside([hogel(wrong_surfaces=150.0), *runs[0][1:]], *runs)
    assert found.change is Change.SAME
    assert found.uncertain > 0


def test_the_noise_of_a_plate_is_no_less_than_that_of_its_hogels_together() -> None:
    """In both runs the sum is 40, by chance: Poisson noise of 40 has a deviation of 6."""
    runs = [[hogel((i, 0), wrong_surfaces=float(4 + s * (-1) ** i)) for i in range(10)] for s in (-2, 2)]
    now = [hogel((i, 0), wrong_surfaces=5.0) for i in range(10)]
    assert beside(now, *runs).change is Change.SAME
    (limit,) = {one.limit for one in beside(now, *runs).plate if one.measure == "wrong_surfaces"}
    assert limit is not None and 50 < limit < 90


@pytest.mark.slow
@pytest.mark.parametrize("mean", [0.05, 0.2, 2.0, 100.0])
@pytest.mark.parametrize("runs", [2, 8])
def test_poisson_noise_that_was_seen_fails_one_verification_in_a_hundred_at_most(
    mean: float, runs: int
) -> None:
    """Failures among 1,000 verifications of 25 hogels are at most 10 by expectation, and 24 by chance.

    At a rate of 1 % more than 24 happen with a probability of 5e-5. Where all accepted runs were alike no
    noise was seen, and measures are compared exactly.
    """
    draw = np.random.default_rng(11)
    failures = 0
    for _ in range(1000):
        found, *accepted = noisy(lambda: draw.poisson(mean, 25), runs + 1)
        changes = beside(found, *accepted)
        failures += changes.noisy and changes.change is Change.WORSE
    assert failures <= 24


def test_a_change_of_several_deviations_is_found_in_spite_of_noise() -> None:
    draw = np.random.default_rng(8)
    runs = [[hogel(wrong_surfaces=float(1000 + draw.normal(0, 3)))] for _ in range(8)]
    assert beside([hogel(wrong_surfaces=1040.0)], *runs).change is Change.WORSE
    assert beside([hogel(wrong_surfaces=1000.0)], *runs).change is Change.SAME


def test_a_hogel_that_repeated_by_chance_has_the_noise_of_the_others() -> None:
    runs = [[hogel(wrong_surfaces=10.0), hogel((1, 0), wrong_surfaces=value)] for value in (8.0, 12.0, 10.0)]
    found = beside([hogel(wrong_surfaces=11.0), hogel((1, 0), wrong_surfaces=10.0)], *runs)
    assert found.noisy
    assert found.change is Change.SAME


def test_noise_that_was_learnt_stays_when_a_change_is_accepted() -> None:
    noisy = [[hogel(wrong_surfaces=value), hogel((1, 0))] for value in (97.0, 103.0, 100.0, 102.0, 98.0)]
    older = edition(*noisy, name="old")
    newer = edition([hogel(wrong_surfaces=300.0), hogel((1, 0))], name="new")
    accepted = {place: [newer[place], older[place]] for place in older}

    def found(value: float) -> Change:
        return changes_of([hogel(wrong_surfaces=value), hogel((1, 0))], accepted).change

    assert (found(304.0), found(296.0)) == (Change.SAME, Change.SAME)
    assert (found(340.0), found(100.0)) == (Change.WORSE, Change.BETTER)


@given(
    values=st.lists(st.integers(0, 10**6).map(float), min_size=2, max_size=8),
    compared=st.integers(1, 10**4),
)
def test_the_limit_lies_above_all_that_was_accepted_where_it_can_be_known(
    values: list[float], compared: int
) -> None:
    """No value of n is farther from their mean than (n - 1)/sqrt(n) deviations (Samuelson's inequality).

    That is less than t sqrt(1 + 1/n) at 99 % for all n up to eight.
    """
    allowed = learnt("wrong_surfaces", values, Noise.of([values]), compared)
    assert allowed.low <= min(values) and max(values) <= allowed.high
    more = learnt("wrong_surfaces", values, Noise.of([values]), compared + 1)
    assert more.high >= allowed.high


def test_the_limit_is_that_of_the_next_observation() -> None:
    """Student's quantile for 1 % and two degrees of freedom is 6.9646 (any table)."""
    allowed = learnt("displacement_max_px", [9.0, 10.0, 11.0], Noise.of([[9.0, 10.0, 11.0]]), 1)
    assert FALSE_ALARMS == 0.01
    assert allowed.high == pytest.approx(10 + 6.9646 * math.sqrt(4 / 3), rel=1e-4)


def test_stated_tolerances_go_before_learnt_ones() -> None:
    accepted = [[hogel(wrong_surfaces=100.0, displacement_p99_px=0.2)]]
    now = [hogel(wrong_surfaces=104.0, displacement_p99_px=0.21)]
    assert beside(now, *accepted).change is Change.WORSE
    assert beside(now, *accepted, stated=Stated.of("5%")).change is Change.SAME
    only = Stated.of("wrong-surfaces=4")
    assert {one.measure for one in beside(now, *accepted, stated=only).of_kind(Change.WORSE)} == {
        "displacement_p99_px"
    }


@pytest.mark.parametrize("text", ["", "5", "wrong=3", "wrong_surfaces=x", "-5%", "wrong_surfaces=-1", "nan%"])
def test_tolerances_that_mean_nothing_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="baseline tolerance"):
        Stated.of(text)


def test_a_plate_has_the_sum_of_counts_and_the_largest_displacement() -> None:
    found = total(
        [
            hogel(wrong_surfaces=2.0, displacement_p99_px=0.3).measures,
            hogel((1, 0), wrong_surfaces=5.0, displacement_p99_px=0.1).measures,
            MISSING.measures,
        ]
    )
    assert (found.wrong_surfaces, found.displacement_p99_px, found.missing) == (7.0, 0.3, 1.0)
    assert is_count("wrong_surfaces") and not is_count("displacement_p99_px")
