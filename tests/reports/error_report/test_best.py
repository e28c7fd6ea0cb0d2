"""Which of the measured settings is called best, and what is said of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.support.rows import MIDDLE, NO_PREDICTION, comparison_numbers, measured_row
from xfrustum.compare import Spread
from xfrustum.compare.prediction.predict import Separations
from xfrustum.reports.error_report.best import (
    DISPLACEMENT_TIE_PX,
    SURFACE_TIE_FRACTION,
    best_setting,
    pixels,
    sentence,
)
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.scenes import Aperture, DepthFormat, DoubleFrustum
from xfrustum.scenes.plate.double_frustum import Pivot

CORNER = Aperture(column=0, row=0, x=-1.0, y=1.0)


def measured(
    near: float,
    surface: float,
    p99: float | None,
    *,
    depth: DepthFormat = DepthFormat.D24,
    aperture: Aperture = MIDDLE,
) -> Measurement:
    predicted = replace(
        NO_PREDICTION,
        displacement_px=Spread(rms=0.1, p50=0.1, p95=0.2, p99=0.25, max=0.3),
        silhouettes=0.1,
        depth=0.2,
        separation=Separations(c=1e-3, c_star=None),
    )
    row = measured_row(DoubleFrustum(near=near, depth=depth), comparison_numbers(3072, 1000, surface, p99))
    return replace(row, aperture=aperture, predicted=predicted)


def test_a_ratio_needs_both_numbers_and_a_prediction_that_is_not_zero() -> None:
    ratios = measured(1.0, 0.14, 0.5).measured_over_predicted
    # Causes that know nothing of each other: 1 - 0.9 * 0.8.
    assert ratios["surface"] == pytest.approx(0.14 / 0.28)
    assert ratios["displacement_p99"] == 2.0
    assert ratios["displacement_rms"] == 2.5
    nothing = measured(1.0, 0.0, None).measured_over_predicted
    assert nothing == {"displacement_rms": None, "displacement_p99": None, "surface": 0.0}


def test_least_surface_error_is_best_whatever_the_displacement() -> None:
    rows = [measured(1.0, 0.02, 0.1), measured(2.0, 0.01, 5.0)]
    assert best_setting(rows).settings.near == 2.0


def test_among_equal_surfaces_least_displacement_is_best() -> None:
    rows = [measured(1.0, 0.01, 0.5), measured(0.1, 0.01 + 0.9 * SURFACE_TIE_FRACTION, 0.05)]
    assert best_setting(rows).settings.near == 0.1
    # 30 and 90 of 3,072 pixels.
    rows = [measured(1.0, 0.01, 0.5), measured(0.1, 0.03, 0.05)]
    assert best_setting(rows).settings.near == 1.0


def test_where_all_displacements_are_seen_those_equal_to_the_least_are_best() -> None:
    rows = [
        measured(1e-6, 0.01, 0.3),
        measured(1e-5, 0.01, 0.3 + 0.9 * DISPLACEMENT_TIE_PX),
        measured(1e-4, 0.01, 0.3 + 1.1 * DISPLACEMENT_TIE_PX),
    ]
    best = best_setting(rows)
    assert (best.settings.near, best.window.low, best.window.high) == (1e-5, 1e-6, 1e-5)


def test_at_equal_near_the_depth_buffer_listed_first_is_best() -> None:
    rows = [measured(1.0, 0.01, 0.1, depth=depth) for depth in (DepthFormat.D24, DepthFormat.D32F)]
    assert best_setting(rows).settings.depth == DepthFormat.D24


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
    assert "at the worst of 2 apertures (0,0)" in sentence(rows, "mm", 150.0)


def test_the_sentence_names_near_format_surface_and_displacement() -> None:
    said = sentence([measured(0.015, 0.00012, 0.25)], "mm", 150.0)
    for words in ("near 0.015 mm", "0.0001 of the reach", "D24 standard", "0.012 %", "0.25 px"):
        assert words in said


def test_the_most_displaced_aperture_is_named_where_another_has_most_wrong_surfaces() -> None:
    rows = [measured(1.0, 0.005, 0.2), measured(1.0, 0.002, 0.4, aperture=CORNER)]
    best = best_setting(rows)
    assert (best.aperture, best.displaced_aperture) == (MIDDLE, CORNER)
    said = sentence(rows, "mm", 150.0)
    assert "at the worst of 2 apertures (1,1)" in said and "(the worst at 0,0)." in said


@pytest.mark.parametrize(("surface", "p99"), [(0.78, 12345.0), (0.0, 0.51), (0.0101, 0.1)])
def test_what_misses_a_tolerance_is_the_least_bad(surface: float, p99: float) -> None:
    rows = [measured(1.0, surface, p99), measured(2.0, surface + 0.2, p99)]
    said = sentence(rows, "mm", 150.0)
    assert said.startswith(
        "At hogel 1,1: no setting measured keeps to 0.5 px and 1 % wrong surfaces. "
        "The least bad of 2: near 1 mm"
    )
    assert sentence(rows[:1], "mm", 150.0).startswith(
        "At hogel 1,1: the one setting measured does not keep to 0.5 px"
    )


def test_a_best_that_keeps_the_tolerances_is_called_best() -> None:
    rows = [measured(1.0, 0.01, 0.5), measured(2.0, 0.5, 9.0)]
    assert sentence(rows, "mm", 150.0).startswith("At hogel 1,1: best of 2 settings: near 1 mm")


def test_nothing_is_denied_of_settings_that_keep_the_tolerances() -> None:
    """The one with the fewest wrong surfaces displaces too much; the other one does not."""
    rows = [measured(1.0, 0.0, 0.7), measured(0.1, 0.009, 0.1)]
    said = sentence(rows, "mm", 150.0)
    assert said.startswith(
        "At hogel 1,1: best of 2 settings by wrong surfaces, though only others keep to 0.5 px and 1 %"
    )


def test_the_cause_of_most_wrong_surfaces_is_named_and_no_other() -> None:
    row = measured(1.0, 0.5, 5.0)
    for most, said in ((0.6, True), (0.5, False)):
        counts = {"near offset": round(most * 1000), "depth": 1000 - round(most * 1000)}
        causes = tuple(replace(one, surface=counts.get(one.name, 0)) for one in row.causes)
        text = sentence([replace(row, causes=causes)], "mm", 150.0)
        assert ("wrong surface, most of them by the near offset, and" in text) is said
    assert "most of them" not in sentence([measured(1.0, 0.9 * SURFACE_TIE_FRACTION, 0.1)], "mm", 150.0)


def test_large_displacements_have_no_exponent() -> None:
    written = [pixels(value) for value in (0.0, 0.0123, 9.96, 53.4, 99.6, 123.0, 1e4)]
    assert written == ["0.001 px", "0.012 px", "10 px", "53 px", "100 px", "120 px", "10,000 px"]


def test_the_pivot_of_a_centered_frustum_is_not_named() -> None:
    rows = [measured(1.0, 0.0, 0.1)]
    rows.append(replace(rows[0], settings=replace(rows[0].settings, pivot=Pivot.CAMERA)))
    assert "and pivot" in sentence(rows, "mm", 150.0)
    assert "pivot" not in sentence(rows, "mm", 150.0, recentered=False)
