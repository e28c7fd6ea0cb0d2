"""Causes of wrong surfaces over near: a stacked figure for each depth buffer, and which one dominates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from xfrustum.compare.prediction.chain import CULLING
from xfrustum.reports.common.figure_style import log_axis, style
from xfrustum.reports.error_report.best import SURFACE_TIE_FRACTION
from xfrustum.reports.error_report.measurement import Measurement
from xfrustum.scenes.notebook import digits

CAUSE_COLORS = {
    "near offset": "rgb(0,114,178)",
    "pivot": "rgb(86,180,233)",
    "fit": "rgb(204,121,167)",
    "slabs": "rgb(0,158,115)",
    CULLING: "rgb(90,90,90)",
    "rasterization": "rgb(230,159,0)",
    "depth": "rgb(213,94,0)",
}
"""Okabe and Ito's palette, told apart by people with any color vision, and gray, in the order of links."""

UNEXPLAINED_COLOR = "rgb(255,0,255)"
"""Color of pixels that are charged to rounding and bear none of its marks."""

PANEL_PIXELS = 170
"""Height of the panel of one depth buffer on the page."""


@dataclass(frozen=True, kw_only=True)
class Reign:
    """Consecutive nears of one depth buffer at which one cause makes most surfaces wrong.

    Attributes
    ----------
    cause
        Name of the cause; None where hardly a surface is wrong.
    low, high
        Smallest and largest near, scene units.
    """

    cause: str | None
    low: float
    high: float


def reigns(rows: Sequence[Measurement]) -> list[Reign]:
    """Return the dominant causes of one depth buffer at one aperture, the smallest near first."""
    ascending = sorted(rows, key=lambda row: row.settings.near)
    runs = [list(run) for _, run in groupby(ascending, key=dominant)]
    return [
        Reign(cause=dominant(run[0]), low=run[0].settings.near, high=run[-1].settings.near) for run in runs
    ]


def dominant(row: Measurement) -> str | None:
    """Return the cause of most wrong surfaces; None where no more are wrong than measurements tell."""
    if row.surface_fraction <= SURFACE_TIE_FRACTION:
        return None
    return max(row.causes, key=lambda cause: cause.surface).name


def sentences(rows: Sequence[Measurement], units: str) -> list[str]:
    """Say for each depth buffer which cause dominates where.

    Parameters
    ----------
    rows
        All rows of one aperture.
    units
        Length unit of the scene.
    """
    return [
        f"{label}: {_told(reigns(group), group[0].cause_words, units)}."
        for label, group in _by_depth_buffer(rows).items()
        if group
    ]


def _told(found: Sequence[Reign], words: Mapping[str, str], units: str) -> str:
    parts = []
    for reign in found:
        if reign.low == reign.high:
            where = f"at n = {digits(reign.low)} {units}"
        else:
            where = f"from n = {digits(reign.low)} to {digits(reign.high)} {units}"
        what = "hardly a surface is wrong" if reign.cause is None else f"{words[reign.cause]} dominates"
        parts.append(f"{where} {what}")
    return "; ".join(parts)


def cause_figure(rows: Sequence[tuple[int, Measurement]], reach: float) -> go.Figure | None:
    """Draw the share of each cause in the wrong surfaces over near, stacked, a panel for each depth buffer.

    Parameters
    ----------
    rows
        Rows of one aperture, with their numbers in the sweep.

    Returns
    -------
    None where no surface is wrong.
    """
    numbers = {id(row): number for number, row in rows}
    groups = {
        label: sorted((row for row in group if _wrong(row)), key=lambda row: row.settings.near)
        for label, group in _by_depth_buffer([row for _, row in rows]).items()
    }
    groups = {label: group for label, group in groups.items() if group}
    if not groups:
        return None
    figure = make_subplots(
        rows=len(groups),
        cols=1,
        shared_xaxes=True,
        subplot_titles=list(groups),
        vertical_spacing=0.3 / len(groups),
    )
    shown = [
        name for name in CAUSE_COLORS if any(_count(row, name) for group in groups.values() for row in group)
    ]
    for place, group in enumerate(groups.values(), start=1):
        for name in shown:
            figure.add_scatter(
                x=[row.settings.near / reach for row in group],
                y=[100 * _count(row, name) / _wrong(row) for row in group],
                customdata=[numbers[id(row)] for row in group],
                text=[f"{_count(row, name):,} of {_wrong(row):,} wrong pixels" for row in group],
                hovertemplate=hover(name),
                name=name,
                legendgroup=name,
                showlegend=place == 1,
                stackgroup=f"panel {place}",
                line={"width": 0.5, "color": CAUSE_COLORS[name]},
                fillcolor=CAUSE_COLORS[name],
                row=place,
                col=1,
            )
    style(figure)
    figure.update_layout(height=110 + PANEL_PIXELS * len(groups))
    nears = [row.settings.near / reach for group in groups.values() for row in group]
    figure.update_xaxes(**log_axis(nears))
    figure.update_xaxes(title_text="near, as a share of the reach", row=len(groups), col=1)
    figure.update_yaxes(range=[0, 100], ticksuffix=" %", nticks=3)
    return figure


def hover(name: str) -> str:
    """Return the words that a point of a cause shows under the cursor."""
    return f"{name}, near %{{x:.3g}} of the reach<br>%{{y:.3g}} %: %{{text}}<extra></extra>"


def _by_depth_buffer(rows: Sequence[Measurement]) -> dict[str, list[Measurement]]:
    grouped: dict[str, list[Measurement]] = {}
    for row in rows:
        grouped.setdefault(row.settings.depth_label, []).append(row)
    return grouped


def _wrong(row: Measurement) -> int:
    """Return the number of judged pixels with a wrong surface, which the causes add up to."""
    return sum(cause.surface for cause in row.causes)


def _count(row: Measurement, name: str) -> int:
    return next((cause.surface for cause in row.causes if cause.name == name), 0)
