"""Figures tell curves apart, and have readable labels in their right places."""

from __future__ import annotations

import math

import pytest

from xfrustum.reports.common.figure_style import COLORS, MARKERS, look
from xfrustum.reports.common.timing import Timing
from xfrustum.reports.cost.page import trade_off_figure
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
