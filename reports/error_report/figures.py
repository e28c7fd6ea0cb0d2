"""The curves of a report, as plotly figures: error against near, prediction drawn in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter

import plotly.graph_objects as go

from xfrustum.compare import Spread
from xfrustum.compare.metrics.comparison import Share
from xfrustum.reports.common.figure_style import COLORS, INK, log_axis, look, style
from xfrustum.reports.error_report.measurement import Measurement

Number = Callable[[Measurement], float | None]


def curves(rows: Sequence[tuple[int, Measurement]], reach: float) -> dict[str, go.Figure]:
    """Return the figures of the rows of one aperture and one camera geometry, by name.

    Every measured point carries its row number in the sweep as `customdata`, so that the page
    can show the pictures of the point that was clicked.
    """
    return {
        "surface": _surface_figure(rows, reach),
        "displacement_p99": _displacement_figure(
            rows, reach, attrgetter("p99"), "99th percentile of displacement, px"
        ),
        "displacement_rms": _displacement_figure(rows, reach, attrgetter("rms"), "rms displacement, px"),
        "triangle": _fraction_figure(
            rows, reach, lambda row: row.comparison.triangle, "pixels with another triangle"
        ),
    }


def number_figure(
    rows: Sequence[tuple[int, Measurement]], reach: float, number: Number, title: str
) -> go.Figure:
    """Draw a number of each row against near, one line for each depth buffer; zeros are left out."""
    return grouped_figure(_by_depth(rows), reach, number, title)


def grouped_figure(
    groups: Mapping[str, Sequence[tuple[int, Measurement]]], reach: float, number: Number, title: str
) -> go.Figure:
    """Draw a number of each row against near, one line for each named group; zeros are left out."""
    figure = go.Figure()
    _add_lines(
        figure,
        {name: sorted(g, key=lambda one: one[1].settings.near) for name, g in groups.items()},
        reach,
        number,
    )
    figure.update_traces(hovertemplate="near %{x:.3g} of the reach<br>%{y:.3g}")
    _log_axes(figure, title)
    return figure


def pair_figure(
    nears: Sequence[float], measured: Sequence[float], predicted: Sequence[float], title: str
) -> go.Figure:
    """Draw a measured number against near, in fractions of the reach, and its closed form, dashed."""
    figure = go.Figure()
    for name, values, line in (
        ("measured", measured, {"color": COLORS[1], "width": 2}),
        ("closed form", predicted, {"color": INK, "width": 2, "dash": "dash"}),
    ):
        mode = "lines+markers" if name == "measured" else "lines"
        figure.add_scatter(
            x=nears,
            y=[value or None for value in values],
            name=name,
            mode=mode,
            line=line,
            hovertemplate="near %{x:.3g} of the reach<br>%{y:.3g}",
        )
    _log_axes(figure, title)
    return figure


def _fraction_figure(
    rows: Sequence[tuple[int, Measurement]],
    reach: float,
    share: Callable[[Measurement], Share | None],
    title: str,
) -> go.Figure:
    """Draw a share of pixels; zeros, which a logarithmic axis lacks, lie at half a pixel and are hollow."""
    figure = go.Figure()

    def known(row: Measurement) -> Share:
        found = share(row)
        assert found is not None, "a sweep knows the scene and all triangles"
        return found

    _add_depth_lines(figure, rows, reach, lambda row: known(row).fraction or _half_pixel(row))
    for line, group in zip(figure.data, _by_depth(rows).values(), strict=True):
        symbol = line.marker.symbol
        line.marker.symbol = [symbol + ("" if known(row).wrong else "-open") for _, row in group]
        line.text = [f"{known(row).wrong:,} of {row.comparison.judged:,}" for _, row in group]
        line.hovertemplate = "near %{x:.3g} of the reach<br>%{text} pixels wrong"
    _log_axes(figure, title)
    write_percent(figure)
    return figure


def _half_pixel(row: Measurement) -> float:
    """Return the share that half a pixel is of the judged ones."""
    return 0.5 / max(row.comparison.judged, 1)


def _surface_figure(rows: Sequence[tuple[int, Measurement]], reach: float) -> go.Figure:
    """Draw the share of wrong surfaces with its closed forms, one for each depth buffer, dashed."""
    figure = _fraction_figure(
        rows, reach, lambda row: row.comparison.surface, "pixels with the wrong surface"
    )
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
            hovertemplate="near %{x:.3g} of the reach<br>predicted %{y:.2~p}",
        )
    # The legend has one entry for all closed forms.
    figure.add_scatter(
        x=[None], y=[None], name="closed form", mode="lines", line={"color": INK, "dash": "dash", "width": 2}
    )
    return figure


def _displacement_figure(
    rows: Sequence[tuple[int, Measurement]], reach: float, statistic: Callable[[Spread], float], title: str
) -> go.Figure:
    """Draw a statistic of displacement with its closed-form prediction, dashed."""
    figure = go.Figure()

    def measured(row: Measurement) -> float | None:
        displacement = row.comparison.displacement_px
        return None if displacement is None else statistic(displacement) or None

    _add_depth_lines(figure, rows, reach, measured)
    figure.update_traces(hovertemplate="near %{x:.3g} of the reach<br>%{y:.3g} px")
    forms = {row.settings.near / reach: row.predicted.displacement_px for _, row in rows if row.predicted}
    if not forms:
        _log_axes(figure, title)
        return figure
    predicted = {near: spread for near, spread in forms.items() if spread is not None}
    nears = sorted(predicted)
    figure.add_scatter(
        x=nears,
        y=[statistic(predicted[near]) or None for near in nears],
        name="closed form",
        mode="lines",
        line={"color": INK, "dash": "dash", "width": 2},
        hovertemplate="near %{x:.3g} of the reach<br>predicted %{y:.3g} px",
    )
    _log_axes(figure, title)
    return figure


def _add_depth_lines(
    figure: go.Figure, rows: Sequence[tuple[int, Measurement]], reach: float, number: Number
) -> None:
    _add_lines(figure, _by_depth(rows), reach, number)


def _add_lines(
    figure: go.Figure, groups: Mapping[str, Sequence[tuple[int, Measurement]]], reach: float, number: Number
) -> None:
    for place, (label, group) in enumerate(groups.items()):
        color, symbol = look(place)
        # Curves that coincide stay visible: each lies thinner on the one before.
        below = len(groups) - 1 - place
        figure.add_scatter(
            x=[row.settings.near / reach for _, row in group],
            y=[number(row) for _, row in group],
            customdata=[index for index, _ in group],
            name=label,
            mode="lines+markers",
            line={"color": color, "width": 1.6 + 0.8 * below},
            marker={"symbol": symbol, "size": 6 + below, "color": color},
        )


def _by_depth(rows: Sequence[tuple[int, Measurement]]) -> dict[str, list[tuple[int, Measurement]]]:
    grouped: dict[str, list[tuple[int, Measurement]]] = {}
    for index, row in sorted(rows, key=lambda item: item[1].settings.near):
        grouped.setdefault(row.settings.depth_label, []).append((index, row))
    order = dict.fromkeys(row.settings.depth_label for _, row in rows)
    return {label: grouped[label] for label in order}


def _log_axes(figure: go.Figure, title: str) -> None:
    style(figure)
    figure.update_layout(title={"text": title, "x": 0, "xref": "paper", "font": {"size": 15}}, height=400)
    # Labels side by side take more room than above each other, and turned ones run into the legend.
    figure.update_xaxes(
        title_text="near plane / reach", tickangle=0, **log_axis(_nears(figure), ratio=30, labels=3)
    )
    figure.update_yaxes(**log_axis(_heights(figure)))


def write_percent(figure: go.Figure) -> None:
    """Label an axis of shares in percent, as sentences do: 0.0001 as `0.01%`."""
    figure.update_yaxes(tickformat="~%", exponentformat="none")


def is_blank(figure: go.Figure) -> bool:
    """Return whether a figure with a logarithmic axis shows no point at all."""
    return not _heights(figure)


def _heights(figure: go.Figure) -> list[float]:
    return [y for trace in figure.data if trace.y is not None for y in trace.y if y is not None and y > 0]


def _nears(figure: go.Figure) -> list[float]:
    return [x for trace in figure.data if trace.x is not None for x in trace.x if x is not None and x > 0]
