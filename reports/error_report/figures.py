"""The figures of a report: errors, causes and camera geometries against near, with closed forms, dashed.

Every measured point carries its row number in the sweep as `customdata`, so that the page can show the
pictures of the point that was clicked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from xfrustum.compare.metrics.comparison import Share
from xfrustum.reports.common.figure_style import COLORS, INK, log_axis, look, style
from xfrustum.reports.error_report.images import CAUSE_COLORS
from xfrustum.reports.error_report.measurement import Measurement

Number = Callable[[Measurement], float | None]
Rows = Sequence[tuple[int, Measurement]]
"""Rows of one aperture and one camera geometry, with their numbers in the sweep."""

PANEL_PIXELS = 170
"""Height of the panel of causes of one depth buffer on the page."""

_HOVER = "near %{x:.3g} of the reach<br>"
_CLOSED_FORM = {"name": "closed form", "mode": "lines", "line": {"color": INK, "dash": "dash", "width": 2}}


def curves(rows: Rows, reach: float, *, shaded: bool) -> dict[str, go.Figure]:
    """Return the figures of one aperture and one camera geometry, by name; `reach` in scene units."""
    triangles = "pixels with another triangle"
    drawn = {
        "surface": _surface_figure(rows, reach),
        "displacement_p99": _displacement_figure(rows, reach, "p99", "99th percentile of displacement, px"),
        "displacement_rms": _displacement_figure(rows, reach, "rms", "rms displacement, px"),
        "triangle": _share_figure(rows, reach, lambda row: row.comparison.triangle, triangles),
    }
    if shaded:
        for name, key, title in (
            ("radiance", "rms", "rms radiance error, linear"),
            ("flip", "flip", "FLIP, mean over the picture"),
        ):

            def error(row: Measurement, key: str = key) -> float | None:
                found = row.comparison.radiance
                return None if found is None else getattr(found, key) or None

            drawn[name] = grouped_figure(_by_depth(rows), reach, error, title)
    return drawn


def grouped_figure(groups: Mapping[str, Rows], reach: float, number: Number, title: str) -> go.Figure:
    """Draw a number of each row against near, one line for each named group; zeros are left out."""
    figure = _lines(groups, reach, number)
    figure.update_traces(hovertemplate=_HOVER + "%{y:.3g}")
    return _log_axes(figure, title)


def pair_figure(
    nears: Sequence[float], measured: Sequence[float], predicted: Sequence[float], title: str
) -> go.Figure:
    """Draw a measured number against near, in fractions of the reach, and its closed form, dashed."""
    figure = go.Figure()
    points = {"name": "measured", "mode": "lines+markers", "line": {"color": COLORS[1], "width": 2}}
    for values, drawn in ((measured, points), (predicted, _CLOSED_FORM)):
        heights = [value or None for value in values]
        figure.add_scatter(x=nears, y=heights, hovertemplate=_HOVER + "%{y:.3g}", **drawn)
    return _log_axes(figure, title)


def _share_figure(
    rows: Rows, reach: float, share: Callable[[Measurement], Share | None], title: str
) -> go.Figure:
    """Draw a share of pixels; zeros, which a logarithmic axis lacks, lie at half a pixel and are hollow."""

    def known(row: Measurement) -> Share:
        found = share(row)
        assert found is not None, "a sweep knows the scene and all triangles"
        return found

    groups = _by_depth(rows)
    figure = _lines(groups, reach, lambda row: known(row).fraction or _half_pixel(row))
    for line, group in zip(figure.data, groups.values(), strict=True):
        symbol = line.marker.symbol
        line.marker.symbol = [symbol + ("" if known(row).wrong else "-open") for _, row in group]
        line.text = [f"{known(row).wrong:,} of {row.comparison.judged:,}" for _, row in group]
        line.hovertemplate = _HOVER + "%{text} pixels wrong"
    return write_percent(_log_axes(figure, title))


def _half_pixel(row: Measurement) -> float:
    """Return the share that half a pixel is of the judged ones."""
    return 0.5 / max(row.comparison.judged, 1)


def _surface_figure(rows: Rows, reach: float) -> go.Figure:
    """Draw the share of wrong surfaces with its closed forms, one for each depth buffer, dashed."""
    surfaces = "pixels with the wrong surface"
    figure = _share_figure(rows, reach, lambda row: row.comparison.surface, surfaces)
    if not any(row.predicted for _, row in rows):
        return figure
    for place, (label, group) in enumerate(_by_depth(rows).items()):
        predicted = [(row, row.predicted.surface_fraction) for _, row in group if row.predicted]
        figure.add_scatter(
            x=[row.settings.near / reach for row, _ in predicted],
            # Shares of less than half a pixel are drawn there too, where zeros are.
            y=[max(share, _half_pixel(row)) for row, share in predicted],
            name=f"{label}, closed form",
            mode="lines",
            showlegend=False,
            line={"color": look(place)[0], "dash": "dash", "width": 1.5},
            hovertemplate=_HOVER + "predicted %{y:.2~p}",
        )
    # The legend has one entry for all closed forms.
    return figure.add_scatter(x=[None], y=[None], **_CLOSED_FORM)


def _displacement_figure(rows: Rows, reach: float, statistic: str, title: str) -> go.Figure:
    """Draw a statistic of displacement with its closed-form prediction, dashed."""

    def measured(row: Measurement) -> float | None:
        displacement = row.comparison.displacement_px
        return None if displacement is None else getattr(displacement, statistic) or None

    figure = _lines(_by_depth(rows), reach, measured)
    figure.update_traces(hovertemplate=_HOVER + "%{y:.3g} px")
    forms = {row.settings.near / reach: row.predicted.displacement_px for _, row in rows if row.predicted}
    if forms:
        nears = sorted(near for near, spread in forms.items() if spread is not None)
        heights = [getattr(forms[near], statistic) or None for near in nears]
        figure.add_scatter(x=nears, y=heights, hovertemplate=_HOVER + "predicted %{y:.3g} px", **_CLOSED_FORM)
    return _log_axes(figure, title)


def _lines(groups: Mapping[str, Rows], reach: float, number: Number) -> go.Figure:
    figure = go.Figure()
    for place, (label, group) in enumerate(groups.items()):
        color, symbol = look(place)
        # Curves that coincide stay visible: each lies thinner on the one before.
        below = len(groups) - 1 - place
        ascending = sorted(group, key=lambda one: one[1].settings.near)
        figure.add_scatter(
            x=[row.settings.near / reach for _, row in ascending],
            y=[number(row) for _, row in ascending],
            customdata=[index for index, _ in ascending],
            name=label,
            mode="lines+markers",
            line={"color": color, "width": 1.6 + 0.8 * below},
            marker={"symbol": symbol, "size": 6 + below, "color": color},
        )
    return figure


def _by_depth(rows: Rows) -> dict[str, list[tuple[int, Measurement]]]:
    """Return the rows of each depth buffer, in the order of the sweep, nears ascending."""
    grouped: dict[str, list[tuple[int, Measurement]]] = {row.settings.depth_label: [] for _, row in rows}
    for index, row in sorted(rows, key=lambda item: item[1].settings.near):
        grouped[row.settings.depth_label].append((index, row))
    return grouped


def _log_axes(figure: go.Figure, title: str) -> go.Figure:
    style(figure)
    figure.update_layout(title={"text": title, "x": 0, "xref": "paper", "font": {"size": 15}}, height=400)
    nears = [x for trace in figure.data if trace.x is not None for x in trace.x if x is not None and x > 0]
    # Labels side by side take more room than above each other, and turned ones run into the legend.
    figure.update_xaxes(title_text="near plane / reach", tickangle=0, **log_axis(nears, ratio=30, labels=3))
    return figure.update_yaxes(**log_axis(_heights(figure)))


def write_percent(figure: go.Figure) -> go.Figure:
    """Label an axis of shares in percent, as sentences do: 0.0001 as `0.01%`."""
    return figure.update_yaxes(tickformat="~%", exponentformat="none")


def is_blank(figure: go.Figure) -> bool:
    """Return whether a figure with a logarithmic axis shows no point at all."""
    return not _heights(figure)


def _heights(figure: go.Figure) -> list[float]:
    return [y for trace in figure.data if trace.y is not None for y in trace.y if y is not None and y > 0]


def cause_figure(rows: Rows, reach: float) -> go.Figure | None:
    """Draw the share of each cause in the wrong surfaces over near, stacked, a panel for each depth buffer.

    `rows` are those of one aperture. None where no surface is wrong.
    """
    # By row number: the wrong surfaces of each cause, which add up to all wrong ones.
    counts = {number: {cause.name: cause.surface for cause in row.causes} for number, row in rows}
    panels = {
        label: shown
        for label, group in _by_depth(rows).items()
        if (shown := [one for one in group if sum(counts[one[0]].values())])
    }
    if not panels:
        return None
    figure = make_subplots(
        rows=len(panels),
        cols=1,
        shared_xaxes=True,
        subplot_titles=list(panels),
        vertical_spacing=0.3 / len(panels),
    )
    for place, group in enumerate(panels.values(), start=1):
        for name, color in CAUSE_COLORS.items():
            if not any(one.get(name) for one in counts.values()):
                continue
            pairs = [(counts[number].get(name, 0), sum(counts[number].values())) for number, _ in group]
            figure.add_scatter(
                x=[row.settings.near / reach for _, row in group],
                y=[100 * count / wrong for count, wrong in pairs],
                customdata=[number for number, _ in group],
                text=[f"{count:,} of {wrong:,} wrong pixels" for count, wrong in pairs],
                hovertemplate=f"{name}, {_HOVER}%{{y:.3g}} %: %{{text}}<extra></extra>",
                name=name,
                legendgroup=name,
                showlegend=place == 1,
                stackgroup=f"panel {place}",
                line={"width": 0.5, "color": color},
                fillcolor=color,
                row=place,
                col=1,
            )
    style(figure)
    figure.update_layout(height=110 + PANEL_PIXELS * len(panels))
    nears = [row.settings.near / reach for group in panels.values() for _, row in group]
    figure.update_xaxes(**log_axis(nears))
    figure.update_xaxes(title_text="near, as a share of the reach", row=len(panels), col=1)
    return figure.update_yaxes(range=[0, 100], ticksuffix=" %", nticks=3)
