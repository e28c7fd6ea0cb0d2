"""The cost of accuracy: Pareto front, recommendations, and confidence intervals of times."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.commands import Command
from tests.support.worlds import World
from xfrustum import compare_images
from xfrustum.reports import cost as cost_module
from xfrustum.reports.common.timing import CONFIDENCE, Timing
from xfrustum.reports.cost import Option, pareto, rank, sentences
from xfrustum.reports.text import DISPLACEMENT_TIE_PX
from xfrustum.scenes import Certainty
from xfrustum.tolerances import MAX_WRONG


def option(seconds: float, moved: float, wrong: float = 0.0, slowest: float = 0.0) -> Option:
    return Option(
        renderer="raster",
        label=f"{seconds} s",
        family="family",
        configuration={},
        displacement_p99_px=moved,
        surface_fraction=wrong,
        time_s=Timing(median=seconds, lowest=seconds, highest=max(seconds, slowest), repetitions=5),
    )


numbers = st.integers(1, 4).map(float)


@given(st.lists(st.builds(option, numbers, numbers, numbers), min_size=1, max_size=12))
def test_the_front_has_all_options_that_no_other_dominates(options: list[Option]) -> None:
    front = [way for way, best in zip(options, pareto(options), strict=True) if best]
    assert front
    assert not any(way.beats(other) for way in options for other in front)
    assert all(way in front or any(other.beats(way) for other in front) for way in options)


def test_the_cheapest_is_fast_enough_and_within_the_tolerance() -> None:
    fast, slow, wrong = option(1, 0.4), option(2, 0.01), option(0.5, 0.0, wrong=2 * MAX_WRONG)
    assert rank([slow, fast, wrong], 0.5).option is fast
    assert rank([slow, fast, wrong], 0.1).option is slow
    assert rank([fast, wrong], 0.1).option is None


def timed(label: str, milliseconds: list[float], moved: float) -> Option:
    return replace(
        option(1, moved), label=label, time_s=Timing.from_values([ms / 1000 for ms in milliseconds])
    )


def test_sentences_state_the_ratio_of_times_and_the_way_to_take() -> None:
    quick, careful = (
        timed("quick", [40, 40, 40, 41, 42], 0.4),
        timed("careful", [80, 80, 80, 80, 84], 0.05),
    )
    noisy = timed("noisy", [40, 41, 42, 43, 60], 0.01)
    _, strict, take = sentences([quick, careful], 0.5)
    assert "2.00 times (1.90 to 2.10) the time" in strict
    assert take == "Take quick: the fastest within 0.5 px."
    assert sentences([quick], 0.1)[-1].startswith("Nothing stays within 0.1 px")
    assert sentences([quick, noisy, careful], 0.5)[-1].startswith("Take noisy: the least error")


repeated = st.lists(st.integers(1, 9), min_size=5, max_size=12)


@given(st.lists(repeated, min_size=1, max_size=8))
def test_no_way_is_left_out_whose_interval_overlaps_with_that_of_the_fastest(
    times: list[list[int]],
) -> None:
    options = [
        timed(str(number), [float(seconds) for seconds in each], 0.1)
        for number, each in enumerate(times)
    ]
    ranking = rank(options, 0.5)
    least = min(options, key=lambda way: way.time_s.median)
    for way in options:
        apart = least.time_s.interval[1] < way.time_s.interval[0]
        assert (way in ranking.fastest) != apart
    assert ranking.fastest[0].time_s.median == least.time_s.median


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=40))
def test_the_interval_of_a_median_holds_it_with_its_confidence(values: list[float]) -> None:
    spread = Timing.from_values(values)
    low, high = spread.interval
    assert spread.lowest <= low <= spread.median <= high <= spread.highest
    # The ends are the i-th smallest and largest of n distinct values: the median lies outside if n
    # coin tosses show fewer than i heads, or fewer than i tails.
    ordered = Timing.from_values(range(len(values)))
    outside = int(ordered.interval[0])
    beyond = (
        2 * sum(math.comb(len(values), heads) for heads in range(outside + 1)) / 2 ** len(values)
    )
    assert beyond <= 1 - CONFIDENCE or len(values) < 6
    assert 2 * sum(math.comb(len(values), heads) for heads in range(outside + 2)) > 0.05 * 2 ** len(
        values
    )


def test_visibility_proven_by_the_truth_needs_no_second_ray(recentered: World) -> None:
    coarse = replace(recentered.settings, near=10 * recentered.near)
    truth, drawn = recentered.truth((0, 2)), recentered.raster(coarse, (0, 2))
    unexamined = replace(truth, certainty=np.full_like(truth.certainty, Certainty.UNEXAMINED))
    proven, again = (
        compare_images(image, drawn, recentered.reference).maps for image in (truth, unexamined)
    )
    assert proven.surface.sum() > 100
    np.testing.assert_array_equal(proven.surface, again.surface & proven.judged)


def test_cost_prints_one_object_and_writes_a_page(
    tiny: World, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cost_module, "NEARS_PER_REACH", (1e-2, 1e-5))
    line = f"cost {tiny.scene_file} --repeat 1 --quiet --json --out {tmp_path}"
    printed = command(line).record
    assert {row["renderer"] for row in printed["rows"]} == {
        "raster", "embree", "mitsuba", "certified",
    }  # fmt: skip
    (turned,) = (row for row in printed["rows"] if row["way"] == "directions")
    assert turned["error"]["displacement_p99_px"] == 0 and turned["memory_bytes"] > 0
    assert {row["way"] for row in printed["rows"]} == {"two cameras", "slabs", "directions", None}
    stays = [row for row in printed["rows"] if row.get("offset") == "none"]
    # Cameras in the aperture displace nothing: the measured displacement is the rounding of
    # positions.
    assert stays and all(row["error"]["displacement_p99_px"] < DISPLACEMENT_TIE_PX for row in stays)
    assert any(row["pareto"] for row in printed["rows"])
    assert [answer["tolerance_px"] for answer in printed["answers"]] == pytest.approx([0.5, 0.1])
    page = (tmp_path / "index.html").read_text()
    # The recommendation precedes the plot.
    words = printed["answers"][0]["sentence"].split(":")[0].split(".")[0]
    assert words in page[: page.index('id="plot"')]
    assert json.loads((tmp_path / "cost.json").read_text()) == printed
