"""How every figure looks: colors that are told apart, axes that can be read."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

# Okabe and Ito's palette: told apart by color-blind readers, and on white as on black.
COLORS = ("#E69F00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#D55E00", "#8C8C8C", "#B5A900")
MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star", "triangle-down")
INK = "#80868f"
_GRID = "rgba(128, 134, 143, 0.22)"

_LEAST_WRITTEN_OUT = 1e-4
"""Axes that go below it write 1.5e-5 where 0.000015 would be wider than the margin."""


def look(place: int) -> tuple[str, str]:
    """Return color and marker of the curve at a place; no pair repeats among the first 64."""
    # After each full cycle of the colors the markers are one further.
    cycle = place // len(COLORS)
    return COLORS[place % len(COLORS)], MARKERS[(place + cycle) % len(MARKERS)]


def log_axis(values: Sequence[float], ratio: float = 1000.0, labels: int = 6) -> dict[str, str | int | None]:
    """Return a logarithmic axis, labeled at powers of ten where the values span that ratio or more.

    So few powers of ten as there are below it label little or nothing: 1, 2 and 5 times each, which
    plotly writes as a bare 2 or 5 unless a format is given. Over less than one step from 1 to 5,
    plotly's own choice, of about as many labels as are asked for.
    """
    if not values or max(values) >= ratio * min(values):
        return {"type": "log", "dtick": 1, "exponentformat": "power"}
    steps = {"dtick": "D2"} if max(values) >= 5 * min(values) else {"dtick": None, "nticks": labels}
    written = "~e" if min(values) < _LEAST_WRITTEN_OUT else "~g"
    return {"type": "log", **steps, "exponentformat": "none", "tickformat": written}


def style(figure: go.Figure) -> None:
    """Set ink and grid that read on light and on dark paper; the page's own background shows through."""
    figure.update_layout(
        template="none",
        paper_bgcolor="rgba(0, 0, 0, 0)",
        plot_bgcolor="rgba(0, 0, 0, 0)",
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        legend={"orientation": "h", "yref": "container", "yanchor": "bottom", "y": 0, "x": 0},
        margin={"l": 62, "r": 12, "t": 44, "b": 64},
        modebar={"bgcolor": "rgba(0, 0, 0, 0)", "color": _GRID, "activecolor": INK},
        hovermode="closest",
    )
    axes = {"gridcolor": _GRID, "linecolor": INK, "zeroline": False, "ticks": "outside", "tickcolor": _GRID}
    # Margins grow with the labels, and titles keep clear of them.
    axes |= {"automargin": True, "title_standoff": 8}
    figure.update_yaxes(**axes)
    # Labels without room turn so that they end under their ticks: the last one stays on the page.
    figure.update_xaxes(**axes, autotickangles=[0, -30, -90])
