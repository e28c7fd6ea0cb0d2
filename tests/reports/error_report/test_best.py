"""A report recommends a window of nears that no measurement separates, in a sentence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tests.support.rows import NO_CAUSES, comparison_numbers, measured_row
from xfrustum.compare.metrics.error_maps import CONFIDENCE, PixelSet, is_worse
from xfrustum.reports.error_report.best import (
    SURFACE_TIE_FRACTION,
    Measurement,
    best_per_depth,
    best_setting,
    equally_good,
)
from xfrustum.reports.error_report.words import cause_sentences, recommendation
from xfrustum.scenes import Aperture, DepthFormat, DoubleFrustum, Offset
from xfrustum.scenes.arrays import Mask

CORNER = Aperture(column=0, row=0, x=-1.0, y=1.0)
FILM = (256, 256)
PIXELS = FILM[0] * FILM[1]
GENERATOR = np.random.default_rng(7)


def measured(near: float, surface: float, p99: float | None, **changes: object) -> Measurement:
    """Return a made-up row with a share of wrong surfaces and a displacement."""
    row = measured_row(DoubleFrustum(near=near), comparison_numbers(3072, 1000, surface, p99))
    return replace(row, **changes)  # type: ignore[arg-type]


def some(count: int, first: int = 0) -> Mask:
    """Return a film with a number of set pixels, from a first one on."""
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
    """Return a synthetic row with its wrong pixels."""
    wrong: dict[str, Mask] = {"surface": surface} | ({} if color is None else {"radiance": color})
    wrong_colors = None if color is None else float(color.mean())
    numbers = comparison_numbers(PIXELS, PIXELS, float(surface.mean()), p99, wrong_colors)
    row = measured_row(DoubleFrustum(near=near, depth=depth), numbers)
    return replace(row, wrong={name: PixelSet.from_mask(mask) for name, mask in wrong.items()})


# Which setting is best
# -----------------------------------------------------------------------------------


def test_surfaces_come_first_and_displacement_decides_among_equal_ones() -> None:
    cases = [
        ([measured(1.0, 0.02, 0.1), measured(2.0, 0.01, 5.0)], 2.0),
        ([measured(1.0, 0.01, 0.5), measured(0.1, 0.01 + 0.9 * SURFACE_TIE_FRACTION, 0.05)], 0.1),
        ([measured(1.0, 0.01, 0.5), measured(0.1, 0.03, 0.05)], 1.0),  # 30 and 90 of 3,072 pixels
    ]
    assert [best_setting(rows).settings.near for rows, _ in cases] == [near for _, near in cases]


def test_displacement_that_nobody_sees_does_not_decide_and_more_does() -> None:
    rows = [
        judged(1e-4, some(0), p99=0.004),
        judged(1e-3, some(0), p99=0.09),
        judged(1e-2, some(0), p99=0.7),
    ]
    assert {row.near for row in equally_good(rows)} == {1e-4, 1e-3}
    assert {row.near for row in equally_good([rows[2], judged(3e-2, some(0), p99=2.0)])} == {1e-2}


def test_the_worst_aperture_counts() -> None:
    rows = [
        measured(1.0, 0.0, 0.1),
        measured(0.1, 0.01, 0.1),
        measured(1.0, 0.05, 0.1, aperture=CORNER),
        measured(0.1, 0.02, 0.3, aperture=CORNER),
    ]
    best = best_setting(rows)
    assert (best.settings.near, best.surface_fraction, best.displacement_p99_px) == (0.1, 0.02, 0.3)
    assert best.aperture == best.displaced_aperture == CORNER
    assert "at the worst of 2 apertures (0,0)" in recommendation(rows, "mm", 150.0)


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


@pytest.mark.parametrize(
    ("counts", "window"),
    [
        ({1e-4: 340, 5e-4: 64, 1e-3: 60, 2e-3: 70, 1e-2: 900}, (5e-4, 2e-3, 3)),
        # A near that is worse parts a window in two, and the wider one counts.
        ({1e-5: 0, 1e-4: 0, 1e-3: 0, 1e-2: 500, 2e-2: 0}, (1e-5, 1e-3, 3)),
    ],
)
def test_a_window_ends_where_more_pixels_are_wrong_beyond_chance(
    counts: dict[float, int], window: tuple[float, float, int]
) -> None:
    rows = [
        judged(near, some(count, 2000 * place))
        for place, (near, count) in enumerate(counts.items())
    ]
    best = best_setting(rows).window
    assert (best.low, best.high, best.nears) == window


def test_of_depth_buffers_the_one_with_the_widest_window_is_recommended_and_else_the_first() -> (
    None
):
    rows = [judged(near, some(500 if near < 1e-2 else 0)) for near in (1e-3, 1e-2)]
    rows += [judged(near, some(0), depth=DepthFormat.D32F) for near in (1e-3, 1e-2)]
    assert best_setting(rows).settings.depth == DepthFormat.D32F
    windows = [(best.settings.depth, best.window.nears) for best in best_per_depth(rows)]
    assert windows == [(DepthFormat.D24, 1), (DepthFormat.D32F, 2)]
    assert best_setting([rows[1], rows[3]]).settings.depth == DepthFormat.D24


def test_colors_decide_where_a_scene_is_shaded_after_surfaces_and_before_displacement() -> None:
    right, off = some(0), some(2000)
    rows = [judged(1e-3, right, p99=0.05, color=right), judged(1e-4, right, p99=0.004, color=off)]
    best = best_setting(rows)
    assert (best.settings.near, best.radiance_fraction) == (1e-3, 0.0)
    assert "0 % are off in color by more than a level of 255" in recommendation(rows, "mm", 150.0)
    worse = judged(1e-3, some(500), color=right)
    assert best_setting([worse, rows[1]]).settings.near == 1e-4
    unshaded = [judged(1e-3, right)]
    assert best_setting(unshaded).radiance_fraction is None
    assert "color" not in recommendation(unshaded, "mm", 150.0)


@given(st.integers(0, 60), st.integers(0, 60), st.sampled_from([1, 10, 100]))
def test_the_paired_test_is_the_exact_one_of_a_coin(
    here: int, there: int, comparisons: int
) -> None:
    """With many comparisons each one has to be surer."""
    total = here + there
    by_chance = binomtest(here, total, alternative="greater").pvalue if total else 1.0
    certain = by_chance < (1 - CONFIDENCE) / comparisons
    assert is_worse(here, there, comparisons) == (certain and here > there)


# Sentences of the recommendation
# --------------------------------------------------------------------------------------


LIMITS = "0.5 px and 1 % wrong surfaces"


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (
            [(1.0, 0.78, 12345.0), (2.0, 0.98, 12345.0)],
            f"no setting measured keeps to {LIMITS}. The least bad",
        ),
        ([(1.0, 0.01, 0.5), (2.0, 0.5, 9.0)], "best of 2 settings: near 1 mm"),
        # The one with the fewest wrong surfaces displaces too much; the other one does not.
        (
            [(1.0, 0.0, 0.7), (0.1, 0.009, 0.1)],
            f"best of 2 settings by wrong surfaces, though only others keep to {LIMITS}: near 1 mm",
        ),
    ],
)
def test_a_setting_is_praised_as_far_as_it_keeps_the_tolerances(
    rows: list[tuple[float, float, float]], text: str
) -> None:
    assert recommendation([measured(*row) for row in rows], "mm", 150.0).startswith(
        f"At hogel 1,1: {text}"
    )


# Causes over near
# ----------------------------------------------------------------------------------------


def caused(near: float, offset: Offset = Offset.PLATE, **surface: int) -> Measurement:
    """Return a made-up row whose causes have numbers of wrong surfaces; _ stands for a space."""
    named = {name.replace("_", " "): count for name, count in surface.items()}
    causes = tuple(replace(cause, surface=named.get(cause.name, 0)) for cause in NO_CAUSES)
    settings = DoubleFrustum(near=near, offset=offset)
    return measured(near, sum(surface.values()) / 10_000, 0.1, causes=causes, settings=settings)


def test_each_cause_reigns_where_it_makes_most_surfaces_wrong() -> None:
    rows = [
        caused(1.0, near_offset=500),
        caused(1e-6, depth=900, near_offset=3),
        caused(1e-2, rasterization=1),
        caused(0.1, near_offset=50, depth=20),
        caused(1e-4, depth=40),
    ]
    assert cause_sentences(rows, "mm") == [
        "D24 standard: from n = 1e-6 to 0.0001 mm the depth buffer dominates; at n = 0.01 mm "
        "hardly a "
        "surface is wrong; from n = 0.1 to 1 mm the near offset dominates."
    ]
    stays = caused(1.0, Offset.NONE, near_offset=500)
    assert cause_sentences([stays], "mm") == [
        "D24 standard: at n = 1 mm the gap at the plate dominates."
    ]
