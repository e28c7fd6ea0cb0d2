"""Error against time as a figure, the Pareto front drawn through the options that are on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import plotly.graph_objects as go

from xfrustum.reports.common.figure_style import INK, error_bars, look, style
from xfrustum.reports.cost.trade_off import Option, pareto
from xfrustum.scenes.notebook import percent
from xfrustum.tolerances import MAX_WRONG

SMALLEST_DRAWN_PX = 1e-4
"""Displacement at which all smaller ones are drawn: 32-bit positions cannot tell them apart, and a
logarithmic axis has no zero."""


def trade_off_figure(options: Sequence[Option], tolerance_px: float) -> go.Figure:
    """Draw the displacement of every option against its time; options on the front are filled.

    More options are on the front of displacement, time and wrong surfaces than the line goes through: a
    picture with many wrong surfaces may be fast and displaced little.
    """
    front = pareto(options)
    figure = go.Figure()
    for place, family in enumerate(dict.fromkeys(option.family for option in options)):
        mine = [(one, best) for one, best in zip(options, front, strict=True) if one.family == family]
        color, symbol = look(place)
        figure.add_scatter(
            x=[1000 * one.time_s.median for one, _ in mine],
            y=[max(one.displacement_p99_px, SMALLEST_DRAWN_PX) for one, _ in mine],
            error_x=error_bars([one.time_s for one, _ in mine], factor=1000),
            name=family,
            mode="markers",
            marker={
                "symbol": [symbol + ("" if best else "-open") for _, best in mine],
                "size": [12 if best else 8 for _, best in mine],
                "color": color,
            },
            text=[f"{one.label}<br>wrong surface {one.surface_fraction:.3g}" for one, _ in mine],
            hovertemplate="%{text}<br>%{x:.3g} ms, %{y:.3g} px<extra></extra>",
        )
    best_options = _planar_front(options)
    figure.add_scatter(
        x=[1000 * one.time_s.median for one in best_options],
        y=[max(one.displacement_p99_px, SMALLEST_DRAWN_PX) for one in best_options],
        name=f"front, at most {percent(MAX_WRONG)} wrong surfaces",
        mode="lines",
        line={"color": INK, "width": 1.5, "shape": "hv"},
        hoverinfo="skip",
    )
    # The two lines are less than a decade apart: one label stands above its line, one below.
    _add_limit(figure, tolerance_px, "bottom")
    _add_limit(figure, tolerance_px / 5, "top")
    _lay_out(figure)
    return figure


def _add_limit(figure: go.Figure, limit_px: float, anchor: str) -> None:
    figure.add_hline(y=limit_px, line={"color": INK, "dash": "dot", "width": 1})
    # Shapes on a logarithmic axis take values, annotations their logarithms.
    figure.add_annotation(
        text=f"{limit_px:g} px",
        x=1,
        xref="x domain",
        xanchor="right",
        y=math.log10(limit_px),
        yref="y",
        yanchor=anchor,
        showarrow=False,
    )


def _lay_out(figure: go.Figure) -> None:
    style(figure)
    figure.update_layout(height=520)
    # A range of less than a decade has no power of ten in it, and digits alone are read as numbers.
    ticks = [digit * 10.0**power for power in range(-2, 6) for digit in (1, 2, 3, 5, 7)]
    figure.update_xaxes(
        title_text="time of a picture with read-back, ms",
        type="log",
        tickvals=ticks,
        ticktext=[f"{value:g}" for value in ticks],
    )
    figure.update_yaxes(
        title_text="99th percentile of displacement, px",
        type="log",
        exponentformat="power",
        dtick=1,
    )


def _planar_front(options: Sequence[Option]) -> list[Option]:
    """Return, fastest first, the options with few wrong surfaces that none beats in time and displacement.

    Times are compared as in `pareto`, and displacements that the figure draws at one height are equal.
    """
    fair = [one for one in options if one.surface_fraction <= MAX_WRONG]
    drawn = [
        replace(
            one, displacement_p99_px=max(one.displacement_p99_px, SMALLEST_DRAWN_PX), surface_fraction=0.0
        )
        for one in fair
    ]
    front = [one for one, best in zip(fair, pareto(drawn), strict=True) if best]
    return sorted(front, key=lambda one: one.time_s.median)
