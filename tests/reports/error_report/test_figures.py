"""Figures tell curves apart, and have readable labels in their right places."""

from __future__ import annotations

import math

import plotly.graph_objects as go
import pytest

from xfrustum.reports.common.figure_style import COLORS, MARKERS, error_bars, log_axis, look
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.cost.figure import trade_off_figure
from xfrustum.reports.cost.trade_off import Option


def option(family: str, seconds: float, moved: float) -> Option:
    return Option(
        renderer="raster",
        label=family,
        family=family,
        configuration={},
        displacement_p99_px=moved,
        surface_fraction=0.0,
        time_s=Timing.of([0.5 * seconds, seconds, 3 * seconds]),
    )


def test_no_two_curves_of_a_figure_look_the_same() -> None:
    most = len(COLORS) * len(MARKERS)
    assert len({look(place) for place in range(most)}) == most
    families = [f"family {number}" for number in range(13)]
    figure = trade_off_figure([option(name, 1.0, 1.0) for name in families], 0.5)
    looks = {
        (trace.marker.color, trace.marker.symbol[0].removesuffix("-open"))
        for trace in figure.data
        if trace.name in families
    }
    assert len(looks) == len(families)


@pytest.mark.parametrize("tolerance", [0.5, 3.0, 1e-3])
def test_the_labels_of_tolerances_stand_on_their_lines(tolerance: float) -> None:
    """On a logarithmic axis plotly takes the value of a line, but the logarithm of where a label stands."""
    figure = trade_off_figure([option("D24", 1.0, 1.0)], tolerance)
    assert figure.layout.yaxis.type == "log"
    lines = [line.y0 for line in figure.layout.shapes]
    labels = [(label.text, label.y) for label in figure.layout.annotations]
    assert lines == pytest.approx([tolerance, tolerance / 5])
    assert [text for text, _ in labels] == [f"{line:g} px" for line in lines]
    assert [y for _, y in labels] == pytest.approx([math.log10(line) for line in lines])


def test_the_line_of_the_front_goes_through_options_that_are_on_the_front() -> None:
    """A lower median is no advantage where the repetitions do not tell times apart: less error is."""
    quicker, better = option("D16", 1.0, 0.3), option("D24", 1.2, 0.01)
    drawn = trade_off_figure([quicker, better], 0.5).data
    filled = [
        trace.name for trace in drawn if trace.marker.symbol and not trace.marker.symbol[0].endswith("-open")
    ]
    assert filled == ["D24"] and (drawn[-1].x, drawn[-1].y) == ((1200.0,), (0.01,))


def test_bars_of_repetitions_reach_from_the_lowest_to_the_highest() -> None:
    bars = error_bars([Timing.of([1.0, 2.0, 5.0])], factor=1000)
    assert (bars["array"], bars["arrayminus"]) == ([3000.0], [1000.0])
    (points, _) = trade_off_figure([option("D24", 1.0, 1.0)], 0.5).data
    assert points.x == (1000,) and points.error_x.array == (2000,) and points.error_x.arrayminus == (500,)


@pytest.mark.parametrize(
    ("values", "written"),
    [
        ([2e-4, 3e-4], "~g"),
        ([7e-6, 1.2e-5], "~e"),
        ([2e-5, 1e-3], "~e"),
        ([2e-5, 1.0], None),
        ([1.0, 40.0], "~g"),
        ([], None),
    ],
)
def test_labels_far_below_one_are_written_with_an_exponent(values: list[float], written: str | None) -> None:
    """0.000012 is wider than the margin, and lost its zero at the edge of the page."""
    axis = go.layout.YAxis(log_axis(values))
    assert axis.type == "log" and axis.tickformat == written
    assert axis.exponentformat == ("power" if written is None else "none")
