"""Style of every figure: distinct colors, readable axes."""

from collections.abc import Sequence
from typing import Any

# Palette of Okabe and Ito: distinct for color-blind readers, on white and on black.
COLORS = ("#E69F00", "#0072B2", "#56B4E9", "#009E73", "#CC79A7", "#D55E00", "#8C8C8C", "#B5A900")
MARKERS = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star", "triangle-down")
INK = "#80868f"
_GRID = "rgba(128, 134, 143, 0.22)"

_LEAST_WRITTEN_OUT = (
    #: axes with smaller values use labels such as 1.5e-5, because 0.000015 is wider than the margin
    1e-4
)

Figure = dict[str, Any]
"""Data and layout of plotly.js: the classes of plotly take longer than writing a page."""


def look(place: int) -> tuple[str, str]:
    """Return color and marker of curve number `place`; the first 64 curves have different pairs."""
    # After each full cycle of the colors, the markers advance by one.
    cycle = place // len(COLORS)
    return COLORS[place % len(COLORS)], MARKERS[(place + cycle) % len(MARKERS)]


def log_axis(values: Sequence[float], ratio: float = 1000.0, labels: int = 6) -> dict[str, Any]:
    """Return a logarithmic axis, labeled at powers of ten where the values span that ratio or more.

    Smaller ranges contain too few powers of ten: label 1, 2 and 5 times each, which plotly writes
    as a bare 2 or 5 unless a format is given. For ranges of less than one such step, plotly chooses
    about as many labels.
    """
    if not values or max(values) >= ratio * min(values):
        return {"type": "log", "dtick": 1, "exponentformat": "power"}
    steps = {"dtick": "D2"} if max(values) >= 5 * min(values) else {"nticks": labels}
    written = "~e" if min(values) < _LEAST_WRITTEN_OUT else "~g"
    return {"type": "log", **steps, "exponentformat": "none", "tickformat": written}


def styled(data: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    """Return a figure with ink and grid for light and dark paper.

    Titles of axes may be plain strings.
    """
    axis = {
        "gridcolor": _GRID,
        "linecolor": INK,
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": _GRID,
    }
    axes = {}
    for name, own in ({"xaxis": {}, "yaxis": {}} | layout).items():
        if name.startswith(("xaxis", "yaxis")):
            # Margins grow with the labels, and titles keep clear of them. Labels without room turn
            # so that they end under their ticks: the last one stays on the page.
            turned = {"autotickangles": [0, -30, -90]} if name.startswith("x") else {}
            title = {"text": own.get("title", ""), "standoff": 8}
            axes[name] = {**axis, "automargin": True, **turned, **own, "title": title}
    usual = {
        "paper_bgcolor": "rgba(0, 0, 0, 0)",
        "plot_bgcolor": "rgba(0, 0, 0, 0)",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "legend": {"orientation": "h", "yref": "container", "yanchor": "bottom", "y": 0, "x": 0},
        "margin": {"l": 62, "r": 12, "t": 44, "b": 64},
        "modebar": {"bgcolor": "rgba(0, 0, 0, 0)", "color": _GRID, "activecolor": INK},
        "hovermode": "closest",
    }
    return {"data": data, "layout": {**usual, **layout, **axes}}


def titled(text: str) -> dict[str, Any]:
    """Return the title of a figure in a layout: at the left, over the axes."""
    return {"text": text, "x": 0, "xref": "paper", "font": {"size": 15}}
