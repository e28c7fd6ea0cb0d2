"""A report recommends a window of near offsets that measurements cannot separate."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from xfrustum import Aperture, DepthFormat, DoubleFrustum, Offset
from xfrustum.compare import Spread
from xfrustum.compare.attribution import Cause
from xfrustum.compare.comparison import ComparisonNumbers, RadianceNumbers, SurfaceShare
from xfrustum.compare.error_maps import CONFIDENCE, PixelSet, is_worse
from xfrustum.reports.error_report.best import (
    SURFACE_TIE_FRACTION,
    Measurement,
    best_per_depth,
    best_setting,
    equally_good,
)
from xfrustum.reports.error_report.report import recommendation
from xfrustum.scenes.arrays import Mask

MIDDLE = Aperture(column=1, row=1, x=0.0, y=0.0)
CORNER = Aperture(column=0, row=0, x=-1.0, y=1.0)
PIXELS = 256 * 256
FEW = int(SURFACE_TIE_FRACTION * PIXELS)
GENERATOR = np.random.default_rng(7)


def some(count: int, first: int = 0) -> Mask:
    """Return the mask of a film with `count` consecutive pixels set, from pixel `first` on."""
    return np.isin(np.arange(PIXELS), np.arange(first, first + count))


def known(record: type[Any], **values: Any) -> Any:
    """Return a record in which all other fields are None."""
    return record(**(dict.fromkeys(field.name for field in fields(record)) | values))


def judged(
    near: float,
    surface: Mask | int,
    p99: float = 0.01,
    color: Mask | None = None,
    depth: DepthFormat = DepthFormat.D24,
    **changes: Any,
) -> Measurement:
    """Return a synthetic row with wrong pixels, a displacement, and optionally wrong colors."""
    surface = some(surface) if isinstance(surface, int) else surface
    wrong = {"surface": surface} | ({} if color is None else {"radiance": color})
    numbers = known(
        ComparisonNumbers,
        pixels=PIXELS,
        judged=PIXELS,
        covered=PIXELS,
        at_plate=0,
        surface=SurfaceShare(wrong=int(surface.sum()), fraction=float(surface.mean()), outside=0),
        displacement_px=Spread(rms=p99 / 2, p50=p99 / 3, p95=p99 / 1.5, p99=p99, max=2 * p99),
        radiance=None if color is None else known(RadianceNumbers, above_step=float(color.mean())),
    )
    row = {
        "aperture": MIDDLE,
        "settings": DoubleFrustum(near=near, depth=depth),
        "comparison": numbers,
        "causes": (),
        "wrong": {name: PixelSet.from_mask(mask) for name, mask in wrong.items()},
    }
    measurement: Measurement = known(Measurement, **(row | changes))
    return measurement


def test_surfaces_come_first_and_displacement_decides_among_equal_ones() -> None:
    cases = [
        ([judged(1.0, 1300, 0.1), judged(2.0, 650, 5.0)], 2.0),
        ([judged(1.0, 650, 0.5), judged(0.1, some(650 + FEW), 0.05)], 0.1),
        ([judged(1.0, 30, 0.5), judged(0.1, 90, 0.05)], 1.0),
    ]
    assert [best_setting(rows).settings.near for rows, _ in cases] == [near for _, near in cases]


def test_only_visible_displacement_decides() -> None:
    rows = [judged(1e-4, 0, 0.004), judged(1e-3, 0, 0.09), judged(1e-2, 0, 0.7)]
    assert {row.near for row in equally_good(rows)} == {1e-4, 1e-3}
    assert {row.near for row in equally_good([rows[2], judged(3e-2, 0, 2.0)])} == {1e-2}


def test_the_worst_aperture_counts() -> None:
    rows = [
        judged(1.0, 0, 0.1),
        judged(0.1, 650, 0.1),
        judged(1.0, 3300, 0.1, aperture=CORNER),
        judged(0.1, 1300, 0.3, aperture=CORNER),
    ]
    best = best_setting(rows)
    assert (best.settings.near, best.displacement_p99_px) == (0.1, 0.3)
    assert best.surface_fraction == 1300 / PIXELS
    assert best.aperture == best.displaced_aperture == CORNER
    assert "at the worst of 2 apertures (0,0)" in recommendation(rows, "mm", 150.0)


def test_even_a_certain_difference_below_1e_4_of_the_pixels_is_ignored() -> None:
    assert len(equally_good([judged(1e-3, 0), judged(2e-3, FEW)])) == 2
    assert is_worse(FEW + 10, 0)
    assert len(equally_good([judged(1e-3, 0), judged(2e-3, FEW + 10)])) == 1


def test_only_pixels_wrong_with_one_setting_decide() -> None:
    """Forty more wrong pixels count if no other pixel differs, and are noise if a thousand do."""
    worse = judged(2e-3, 540)
    assert len(equally_good([judged(1e-3, 500), worse])) == 1
    assert len(equally_good([judged(1e-3, GENERATOR.permutation(some(500))), worse])) == 2


@pytest.mark.parametrize(
    ("counts", "window"),
    [
        ({1e-4: 340, 5e-4: 64, 1e-3: 60, 2e-3: 70, 1e-2: 900}, (5e-4, 2e-3, 3)),
        # A worse near offset splits a window; the wider part counts.
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
    best = best_setting(rows)
    assert (best.window.low, best.window.high, best.window.nears) == window
    # The middle near offset of the window, by ratio
    assert best.settings.near == sorted(n for n in counts if window[0] <= n <= window[1])[1]


def test_of_depth_buffers_the_one_with_the_widest_window_is_best_and_else_the_first() -> None:
    rows = [judged(near, 500 if near < 1e-2 else 0) for near in (1e-3, 1e-2)]
    rows += [judged(near, 0, depth=DepthFormat.D32F) for near in (1e-3, 1e-2)]
    assert best_setting(rows).settings.depth == DepthFormat.D32F
    windows = [(best.settings.depth, best.window.nears) for best in best_per_depth(rows)]
    assert windows == [(DepthFormat.D24, 1), (DepthFormat.D32F, 2)]
    assert best_setting([rows[1], rows[3]]).settings.depth == DepthFormat.D24
    assert best_setting(rows).settings.near == 1e-2  # the larger of the two in the middle


def test_colors_decide_where_a_scene_is_shaded_after_surfaces_and_before_displacement() -> None:
    right, off = some(0), some(2000)
    rows = [judged(1e-3, right, 0.05, right), judged(1e-4, right, 0.004, off)]
    best = best_setting(rows)
    assert (best.settings.near, best.radiance_fraction) == (1e-3, 0.0)
    assert "0 % are off in color by more than a level of 255" in recommendation(rows, "mm", 150.0)
    assert best_setting([judged(1e-3, 500, color=right), rows[1]]).settings.near == 1e-4
    unshaded = [judged(1e-3, right)]
    assert best_setting(unshaded).radiance_fraction is None
    assert "color" not in recommendation(unshaded, "mm", 150.0)


@given(st.integers(0, 60), st.integers(0, 60), st.sampled_from([1, 10, 100]))
def test_the_paired_test_is_the_exact_one_of_a_coin(
    here: int, there: int, comparisons: int
) -> None:
    """With many comparisons, each of them needs a higher confidence."""
    total = here + there
    by_chance = binomtest(here, total, alternative="greater").pvalue if total else 1.0
    assert is_worse(here, there, comparisons) == (by_chance < (1 - CONFIDENCE) / comparisons)


def test_a_recommendation_states_the_tolerances_the_cause_and_the_gap() -> None:
    def charged(*pixels: int) -> list[Cause]:
        names = "near offset", "depth"
        return [known(Cause, name=n, surface=p) for n, p in zip(names, pixels, strict=True)]

    settings = DoubleFrustum(near=1.0, offset=Offset.NONE)
    wrong = [judged(1.0, 500, 0.7, causes=charged(300, 200), settings=settings)]
    sentence = recommendation(wrong, "mm", 150.0)
    assert sentence.startswith(
        "At hogel 1,1: the one setting measured, though beyond 0.5 px or 1 %"
    )
    assert "wrong surface, most of them charged to near offset, and 99 %" in sentence
    assert sentence.endswith("a gap of 1 mm on each side of the plate.")
    halves = [judged(1.0, 500, causes=charged(250, 250))]
    assert "charged" not in recommendation(halves, "mm", 150.0)
    others = [judged(1.0, 0, 0.7), judged(0.1, 590, 0.1)]
    assert "(others are within): near 1 mm (0.00667 of the reach)" in recommendation(
        others, "mm", 150.0
    )
