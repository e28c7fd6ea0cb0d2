"""A report recommends a window of nears between which no measurement decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tests.support.rows import comparison_numbers, measured_row
from xfrustum.compare.metrics.error_maps import CONFIDENCE, PixelSet, is_worse
from xfrustum.reports.error_report.best import (
    SURFACE_TIE_FRACTION,
    best_per_depth,
    best_setting,
    equally_good,
    sentence,
)
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.scenes import DepthFormat, DoubleFrustum
from xfrustum.scenes.arrays import Mask

FILM = (256, 256)
PIXELS = FILM[0] * FILM[1]
GENERATOR = np.random.default_rng(7)


def some(count: int, first: int = 0) -> Mask:
    """Return a film on which so many pixels are set, from a first one on."""
    mask = np.zeros(FILM, dtype=np.bool_)
    mask.ravel()[first : first + count] = True
    return mask


def judged(
    near: float,
    surface: Mask,
    p99: float = 0.01,
    *,
    depth: DepthFormat = DepthFormat.D24,
    color: Mask | None = None,
) -> Measurement:
    wrong: dict[str, Mask] = {"surface": surface} | ({} if color is None else {"radiance": color})
    wrong_colors = None if color is None else float(color.mean())
    row = measured_row(
        DoubleFrustum(near=near, depth=depth),
        comparison_numbers(PIXELS, PIXELS, float(surface.mean()), p99, wrong_colors),
    )
    return replace(row, wrong={name: PixelSet.of(mask) for name, mask in wrong.items()})


def test_two_pixels_make_no_headline() -> None:
    """One setting has three wrong pixels, the other five: either near is as good."""
    rows = [judged(0.002, some(5)), judged(0.001, some(3, first=100))]
    window = best_setting(rows).window
    assert (window.low, window.high, window.nears) == (0.001, 0.002, 2)
    said = sentence(rows, "mm", 150.0)
    assert "near 0.001 to 0.002 mm" in said and "the 2 nears measured there are equally good" in said


def test_a_window_ends_where_more_pixels_are_wrong_beyond_chance() -> None:
    nears = {1e-4: 340, 5e-4: 64, 1e-3: 60, 2e-3: 70, 1e-2: 900}
    rows = [judged(near, some(count, 2000 * place)) for place, (near, count) in enumerate(nears.items())]
    window = best_setting(rows).window
    assert (window.low, window.high, window.nears) == (5e-4, 2e-3, 3)


def test_a_difference_below_one_pixel_in_ten_thousand_is_none_however_surely_it_is_there() -> None:
    few = int(SURFACE_TIE_FRACTION * PIXELS)
    assert len(equally_good([judged(1e-3, some(0)), judged(2e-3, some(few))])) == 2
    assert is_worse(few + 10, 0)
    assert len(equally_good([judged(1e-3, some(0)), judged(2e-3, some(few + 10))])) == 1


def test_pixels_wrong_in_both_say_nothing_and_those_of_one_alone_decide() -> None:
    """Forty pixels more decide where no other pixel differs, and are noise where a thousand do."""
    worse, better = some(540), some(500)
    shuffled = GENERATOR.permutation(some(500).ravel()).reshape(FILM)
    assert len(equally_good([judged(1e-3, better), judged(2e-3, worse)])) == 1
    assert len(equally_good([judged(1e-3, shuffled), judged(2e-3, worse)])) == 2


def test_the_command_is_for_the_middle_of_the_window_by_ratio() -> None:
    nears = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
    rows = [judged(near, some(0), p99=0.9 if near == 1e-1 else 0.01) for near in nears]
    assert best_setting(rows).settings.near in (1e-4, 1e-3)
    assert best_setting(rows[:3]).settings.near == 1e-4


def test_a_near_that_is_worse_parts_a_window_in_two_and_the_wider_one_counts() -> None:
    counts = {1e-5: 0, 1e-4: 0, 1e-3: 0, 1e-2: 500, 2e-2: 0}
    window = best_setting([judged(near, some(count)) for near, count in counts.items()]).window
    assert (window.low, window.high) == (1e-5, 1e-3)


def test_of_depth_buffers_the_one_with_the_widest_window_is_recommended() -> None:
    rows = [judged(near, some(500 if near < 1e-2 else 0)) for near in (1e-3, 1e-2)]
    rows += [judged(near, some(0), depth=DepthFormat.D32F) for near in (1e-3, 1e-2)]
    assert best_setting(rows).settings.depth == DepthFormat.D32F
    windows = [(one.settings.depth, one.window.nears) for one in best_per_depth(rows)]
    assert windows == [(DepthFormat.D24, 1), (DepthFormat.D32F, 2)]


def test_displacement_that_nobody_sees_does_not_decide_and_more_does() -> None:
    rows = [judged(1e-4, some(0), p99=0.004), judged(1e-3, some(0), p99=0.09), judged(1e-2, some(0), p99=0.7)]
    assert {one.near for one in equally_good(rows)} == {1e-4, 1e-3}
    assert {one.near for one in equally_good([rows[2], judged(3e-2, some(0), p99=2.0)])} == {1e-2}


def test_colors_decide_where_a_scene_is_shaded_after_surfaces_and_before_displacement() -> None:
    right, off = some(0), some(2000)
    rows = [judged(1e-3, right, p99=0.05, color=right), judged(1e-4, right, p99=0.004, color=off)]
    best = best_setting(rows)
    assert (best.settings.near, best.radiance_fraction) == (1e-3, 0.0)
    assert "0 % are off in color by more than a level of 255" in sentence(rows, "mm", 150.0)
    worse = judged(1e-3, some(500), color=right)
    assert best_setting([worse, rows[1]]).settings.near == 1e-4
    unshaded = [judged(1e-3, right)]
    assert best_setting(unshaded).radiance_fraction is None
    assert "color" not in sentence(unshaded, "mm", 150.0)


@given(st.integers(0, 60), st.integers(0, 60))
def test_the_paired_test_is_the_exact_one_of_a_coin(here: int, there: int) -> None:
    total = here + there
    certain = total > 0 and binomtest(here, total, alternative="greater").pvalue < 1 - CONFIDENCE
    assert is_worse(here, there) == (certain and here > there)
    # With many comparisons each one has to be surer.
    assert is_worse(here, there) or not is_worse(here, there, comparisons=10)


@pytest.mark.parametrize("comparisons", [1, 100])
def test_equally_wrong_pictures_are_called_worse_no_more_often_than_it_says(comparisons: int) -> None:
    """All outcomes of the coin are counted with their chances, so that the test depends on no sample."""
    total = 50
    chances = [binomtest(k, total, alternative="greater").pvalue for k in range(total + 1)]
    called = [p for k, p in enumerate(chances) if is_worse(k, total - k, comparisons)]
    assert 0 < max(called) < (1 - CONFIDENCE) / comparisons


@given(st.integers(0, 2**32 - 1))
def test_sets_of_pixels_know_what_they_share(seed: int) -> None:
    generator = np.random.default_rng(seed)
    one, other = (generator.random((13, 7)) < share for share in (0.3, 0.6))
    assert PixelSet.of(one).count == one.sum()
    assert PixelSet.of(one).shared_with(PixelSet.of(other)) == (one & other).sum()
