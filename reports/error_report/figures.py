"""The figures of a report: errors, causes and camera geometries against near, with closed forms, dashed.

Every measured point carries its row number in the sweep as `customdata`, so that the page can show the
pictures of the point that was clicked.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from xfrustum.compare.metrics.comparison import Share
from xfrustum.reports.common.figure_style import COLORS, INK, Figure, log_axis, look, styled, titled
from xfrustum.reports.error_report.images import CAUSE_COLORS
from xfrustum.reports.error_report.measurement import Measurement

Number = Callable[[Measurement], float | None]
Rows = Sequence[tuple[int, Measurement]]
"""Rows of one aperture and one camera geometry, with their numbers in the sweep."""

PANEL_PIXELS = 170
"""Height of the panel of causes of one depth buffer on the page."""

_HOVER = "near %{x:.3g} of the reach<br>"
_CLOSED_FORM = {"name": "closed form", "mode": "lines", "line": {"color": INK, "dash": "dash", "width": 2}}
PERCENT = {"tickformat": "~%", "exponentformat": "none"}
"""Labels of an axis of shares in percent, as sentences have them: 0.0001 as `0.01%`."""


def curves(rows: Rows, reach: float, *, shaded: bool) -> dict[str, Figure]:
    """Return the figures of one aperture and one camera geometry, by name; `reach` in scene units."""
    drawn = {
        "surface": _surface_figure(rows, reach),
        "displacement_p99": _displacement_figure(rows, reach, "p99", "99th percentile of displacement, px"),
        "displacement_rms": _displacement_figure(rows, reach, "rms", "rms displacement, px"),
        "triangle": _log_figure(
            _share_lines(rows, reach, lambda row: row.comparison.triangle),
            "pixels with another triangle",
            PERCENT,
        ),
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


def grouped_figure(
    groups: Mapping[str, Rows],
    reach: float,
    number: Number,
    title: str,
    axis: Mapping[str, Any] | None = None,
) -> Figure:
    """Draw a number of each row against near, one line for each named group; zeros are left out."""
    return _log_figure(_lines(groups, reach, number, _HOVER + "%{y:.3g}"), title, axis)


def pair_figure(
    nears: Sequence[float], measured: Sequence[float], predicted: Sequence[float], title: str
) -> Figure:
    """Draw a measured number against near, in fractions of the reach, and its closed form, dashed."""
    points = {"name": "measured", "mode": "lines+markers", "line": {"color": COLORS[1], "width": 2}}
    data = [
        {"x": nears, "y": [value or None for value in values], "hovertemplate": _HOVER + "%{y:.3g}", **drawn}
        for values, drawn in ((measured, points), (predicted, _CLOSED_FORM))
    ]
    return _log_figure(data, title)


def _share_lines(rows: Rows, reach: float, share: Callable[[Measurement], Share | None]) -> list[Figure]:
    """Return lines of a share of pixels; zeros, which have no logarithm, are hollow, at half a pixel."""

    def known(row: Measurement) -> Share:
        found = share(row)
        assert found is not None, "a sweep knows the scene and all triangles"
        return found

    groups = _by_depth(rows)
    hover = _HOVER + "%{text} pixels wrong"
    lines = _lines(groups, reach, lambda row: known(row).fraction or _half_pixel(row), hover)
    for line, group in zip(lines, groups.values(), strict=True):
        symbol = line["marker"]["symbol"]
        line["marker"]["symbol"] = [symbol + ("" if known(row).wrong else "-open") for _, row in group]
        line["text"] = [f"{known(row).wrong:,} of {row.comparison.judged:,}" for _, row in group]
    return lines


def _half_pixel(row: Measurement) -> float:
    """Return the share that half a pixel is of the judged ones."""
    return 0.5 / max(row.comparison.judged, 1)


def _surface_figure(rows: Rows, reach: float) -> Figure:
    """Draw the share of wrong surfaces with its closed forms, one for each depth buffer, dashed."""
    lines = _share_lines(rows, reach, lambda row: row.comparison.surface)
    if any(row.predicted for _, row in rows):
        for place, (label, group) in enumerate(_by_depth(rows).items()):
            predicted = [(row, row.predicted.surface_fraction) for _, row in group if row.predicted]
            lines.append(
                {
                    "x": [row.settings.near / reach for row, _ in predicted],
                    # Shares of less than half a pixel are drawn there too, where zeros are.
                    "y": [max(share, _half_pixel(row)) for row, share in predicted],
                    "name": f"{label}, closed form",
                    "mode": "lines",
                    "showlegend": False,
                    "line": {"color": look(place)[0], "dash": "dash", "width": 1.5},
                    "hovertemplate": _HOVER + "predicted %{y:.2~p}",
                }
            )
        # The legend has one entry for all closed forms.
        lines.append({"x": [None], "y": [None], **_CLOSED_FORM})
    return _log_figure(lines, "pixels with the wrong surface", PERCENT)


def _displacement_figure(rows: Rows, reach: float, statistic: str, title: str) -> Figure:
    """Draw a statistic of displacement with its closed-form prediction, dashed."""

    def measured(row: Measurement) -> float | None:
        displacement = row.comparison.displacement_px
        return None if displacement is None else getattr(displacement, statistic) or None

    lines = _lines(_by_depth(rows), reach, measured, _HOVER + "%{y:.3g} px")
    forms = {row.settings.near / reach: row.predicted.displacement_px for _, row in rows if row.predicted}
    if forms:
        nears = sorted(near for near, spread in forms.items() if spread is not None)
        heights = [getattr(forms[near], statistic) or None for near in nears]
        hover = _HOVER + "predicted %{y:.3g} px"
        lines.append({"x": nears, "y": heights, "hovertemplate": hover, **_CLOSED_FORM})
    return _log_figure(lines, title)


def _lines(groups: Mapping[str, Rows], reach: float, number: Number, hover: str) -> list[Figure]:
    """Return a line for each named group of rows, as plotly.js takes it."""
    lines = []
    for place, (label, group) in enumerate(groups.items()):
        color, symbol = look(place)
        # Curves that coincide stay visible: each lies thinner on the one before.
        below = len(groups) - 1 - place
        ascending = sorted(group, key=lambda one: one[1].settings.near)
        lines.append(
            {
                "x": [row.settings.near / reach for _, row in ascending],
                "y": [number(row) for _, row in ascending],
                "customdata": [index for index, _ in ascending],
                "name": label,
                "mode": "lines+markers",
                "line": {"color": color, "width": 1.6 + 0.8 * below},
                "marker": {"symbol": symbol, "size": 6 + below, "color": color},
                "hovertemplate": hover,
            }
        )
    return lines


def _by_depth(rows: Rows) -> dict[str, list[tuple[int, Measurement]]]:
    """Return the rows of each depth buffer, in the order of the sweep, nears ascending."""
    grouped: dict[str, list[tuple[int, Measurement]]] = {row.settings.depth_label: [] for _, row in rows}
    for index, row in sorted(rows, key=lambda item: item[1].settings.near):
        grouped[row.settings.depth_label].append((index, row))
    return grouped


def _log_figure(lines: list[Figure], title: str, axis: Mapping[str, Any] | None = None) -> Figure:
    nears = [x for line in lines for x in line["x"] if x is not None and x > 0]
    # Labels side by side take more room than above each other, and turned ones run into the legend.
    near = {"title": "near plane / reach", "tickangle": 0, **log_axis(nears, ratio=30, labels=3)}
    layout = {"title": titled(title), "height": 400, "xaxis": near}
    return styled(lines, {**layout, "yaxis": {**log_axis(_heights(lines)), **(axis or {})}})


def is_blank(figure: Figure) -> bool:
    """Return whether a figure with a logarithmic axis shows no point at all."""
    return not _heights(figure["data"])


def _heights(lines: Sequence[Figure]) -> list[float]:
    return [y for line in lines for y in line["y"] if y is not None and y > 0]


def cause_figure(rows: Rows, reach: float) -> Figure | None:
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
    areas: list[Figure] = []
    layout: Figure = {"annotations": []}
    axes = ["y", *(f"y{number}" for number in range(2, len(panels) + 1))]
    for axis, (label, group) in zip(axes, panels.items(), strict=True):
        for name, color in CAUSE_COLORS.items():
            if not any(one.get(name) for one in counts.values()):
                continue
            pairs = [(counts[number].get(name, 0), sum(counts[number].values())) for number, _ in group]
            areas.append(
                {
                    "x": [row.settings.near / reach for _, row in group],
                    "y": [100 * count / wrong for count, wrong in pairs],
                    "yaxis": axis,
                    "customdata": [number for number, _ in group],
                    "text": [f"{count:,} of {wrong:,} wrong pixels" for count, wrong in pairs],
                    "hovertemplate": f"{name}, {_HOVER}%{{y:.3g}} %: %{{text}}<extra></extra>",
                    "name": name,
                    "legendgroup": name,
                    "showlegend": axis == "y",
                    "mode": "lines",
                    "stackgroup": f"panel {axis}",
                    "line": {"width": 0.5, "color": color},
                    "fillcolor": color,
                }
            )
        layout[axis.replace("y", "yaxis")] = {"range": [0, 100], "ticksuffix": " %", "nticks": 3}
        above = {"yref": f"{axis} domain", "y": 1, "yanchor": "bottom", "showarrow": False}
        layout["annotations"].append(
            {"text": label, "xref": "paper", "x": 0.5, "font": {"size": 16}, **above}
        )
    layout["grid"] = {
        "columns": 1,
        "rows": len(panels),
        "subplots": [[f"x{axis}"] for axis in axes],
        "ygap": 0.3,
    }
    nears = [row.settings.near / reach for group in panels.values() for _, row in group]
    layout["xaxis"] = {"title": "near, as a share of the reach", **log_axis(nears)}
    return styled(areas, {"height": 110 + PANEL_PIXELS * len(panels), **layout})
