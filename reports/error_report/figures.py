"""Figures of the report for plotly.js: errors over near planes, and shares of causes.

Every measured point carries its row number in the sweep as `customdata`, so that the page can show
the pictures of the point that was clicked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from xfrustum.reports.common.figure_style import COLORS, INK, Figure, log_axis, look, styled, titled
from xfrustum.reports.common.pictures import CAUSE_COLORS
from xfrustum.reports.error_report.best import Measurement, grouped
from xfrustum.scenes.representation import digits, percent

Number = Callable[[Measurement], float | None]
Rows = Sequence[tuple[int, Measurement]]
"""Rows of one aperture and one camera geometry, with their row numbers in the sweep."""

#: height of the panel of causes of one depth buffer on the page
PANEL_PIXELS = 170

_DASHED: Figure = {"name": "closed form", "mode": "lines", "line": {"color": INK, "dash": "dash"}}
_HOVER = "near %{x:.3g} of the reach<br>%{text}"


def _moved(statistic: str) -> Number:
    """Return the function that reads a statistic of a row's displacement."""
    return lambda row: getattr(row.comparison.displacement_px, statistic, None)


def _predicted(statistic: str) -> Number:
    """Return the function that reads a statistic of a row's predicted displacement."""
    return lambda row: getattr(getattr(row.predicted, "displacement_px", None), statistic, None)


def _radiance(name: str) -> Number:
    """Return the function that reads a radiance error from a row."""
    return lambda row: getattr(row.comparison.radiance, name, None)


@dataclass(frozen=True)
class Quantity:
    """An error over near planes: title of its axis, and functions that read it from a row."""

    title: str
    measured: Number
    #: closed form; None if there is none
    predicted: Number | None = None
    #: True for a share of the judged pixels; False for a number on a logarithmic axis without zero
    is_share: bool = False

    def figure(self, groups: Mapping[str, Rows], reach: float) -> Figure | None:
        """Draw a line for each named group, and closed forms dashed; None if there are no points.

        Zeros of a share are hollow marks at half a pixel, below the smallest measurable share.
        """
        lines: list[Figure] = []
        forms: dict[tuple[float | None, ...], Figure] = {}
        write = percent if self.is_share else digits
        for place, (label, group) in enumerate(groups.items()):
            color, symbol = look(place)
            rows = sorted(group, key=lambda item: item[1].settings.near)
            nears = [row.settings.near / reach for _, row in rows]
            values = [self.measured(row) for _, row in rows]
            floors = [
                0.5 / max(row.comparison.judged, 1) if self.is_share else 0 for _, row in rows
            ]
            # Each curve is thinner than the curve below it, so that coinciding curves are visible.
            below = len(groups) - 1 - place
            marks = [symbol if value else f"{symbol}-open" for value in values]
            lines.append(
                {
                    "x": nears,
                    "y": [
                        value or floor or None for value, floor in zip(values, floors, strict=True)
                    ],
                    "customdata": [number for number, _ in rows],
                    "text": ["" if value is None else write(value) for value in values],
                    "name": label,
                    "mode": "lines+markers",
                    "line": {"color": color, "width": 1.6 + 0.8 * below},
                    "marker": {"symbol": marks, "size": 6 + below, "color": color},
                    "hovertemplate": _HOVER,
                }
            )
            if self.predicted is not None:
                expected = (self.predicted(row) for _, row in rows)
                form = [
                    None if value is None else max(value, floor) or None
                    for value, floor in zip(expected, floors, strict=True)
                ]
                # Equal closed forms, such as displacement's, are drawn once, in a separate color.
                ink = INK if tuple(form) in forms else color
                line = {"color": ink, "dash": "dash"}
                forms[tuple(form)] = {"x": nears, "y": form, **_DASHED, "line": line}
        for dashed in forms.values():
            # The legend has one entry for all closed forms.
            lines.append(dashed | {"showlegend": lines[-1]["name"] != dashed["name"]})
        return _log_figure(lines, self.title, percents=self.is_share)


FIGURES = {
    "surface": Quantity(
        "pixels with the wrong surface",
        lambda row: row.surface_fraction,
        lambda row: getattr(row.predicted, "surface_fraction", None),
        is_share=True,
    ),
    "displacement_p99": Quantity(
        "99th percentile of displacement, px", _moved("p99"), _predicted("p99")
    ),
    "displacement_rms": Quantity("rms displacement, px", _moved("rms"), _predicted("rms")),
    "triangle": Quantity(
        "pixels with another triangle",
        lambda row: getattr(row.comparison.triangle, "fraction", None),
        is_share=True,
    ),
}
SHADED_FIGURES = {
    "radiance": Quantity("rms radiance error, linear", _radiance("rms")),
    "flip": Quantity("FLIP, mean over the picture", _radiance("flip")),
}
GEOMETRY_FIGURES = {
    "geometry_surface": Quantity(
        "share of pixels with the wrong surface", lambda row: row.surface_fraction, is_share=True
    ),
    "geometry_displacement": Quantity(
        "99th percentile of displacement, px", lambda row: row.displacement_p99_px
    ),
}
"""Figures of one aperture, by the names of their plots in the page's script."""


def by_depth(rows: Rows) -> dict[str, Rows]:
    """Return the rows of each depth buffer, in the order of the sweep."""
    groups = grouped(rows, lambda item: item[1].settings.depth_label)
    return {group[0][1].settings.depth_label: group for group in groups}


def pair_figure(points: Sequence[tuple[float, float, float]], title: str) -> Figure | None:
    """Draw a measured number and its closed form, dashed, against near as a share of the reach."""
    nears, *heights = (list(column) for column in zip(*points, strict=True))
    marked: Figure = {
        "name": "measured",
        "mode": "lines+markers",
        "line": {"color": COLORS[1], "width": 2},
    }
    lines: list[Figure] = [
        {"x": nears, "y": [height or None for height in column], **style}
        for column, style in zip(heights, (marked, _DASHED), strict=True)
    ]
    return _log_figure(lines, title)


def _log_figure(lines: list[Figure], title: str, *, percents: bool = False) -> Figure | None:
    """Return a figure of lines over near on logarithmic axes; None if there are no points."""
    nears, heights = ([at for line in lines for at in line[axis] if at] for axis in "xy")
    if not heights:
        return None
    # Labels side by side need more space than stacked labels, and rotated labels overlap the
    # legend.
    near = {"title": "near plane / reach", "tickangle": 0, **log_axis(nears, ratio=30, labels=3)}
    # Shares have labels as in sentences: 0.0001 as `0.01%`.
    labels = {"tickformat": "~%", "exponentformat": "none"} if percents else {}
    axes = {"xaxis": near, "yaxis": log_axis(heights) | labels}
    return styled(lines, {"title": titled(title), "height": 400, **axes})


def cause_figure(rows: Rows, reach: float) -> Figure | None:
    """Draw the share of each cause in the wrong surfaces over near; None without wrong surfaces."""
    # By row number: the wrong surfaces of each cause, which add up to all wrong surfaces.
    counts = {number: {cause.name: cause.surface for cause in row.causes} for number, row in rows}
    groups = by_depth([item for item in rows if any(counts[item[0]].values())])
    if not groups:
        return None
    # The legend lists only causes that occur in the figure.
    occurring = [name for name in CAUSE_COLORS if any(here.get(name) for here in counts.values())]
    areas: list[Figure] = []
    layout: Figure = {"annotations": []}
    axes = ["y", *(f"y{number}" for number in range(2, len(groups) + 1))]
    for axis, (label, unordered) in zip(axes, groups.items(), strict=True):
        group = sorted(unordered, key=lambda item: item[1].settings.near)
        for name in occurring:
            pairs = [
                (counts[number].get(name, 0), sum(counts[number].values())) for number, _ in group
            ]
            areas.append(
                {
                    "x": [row.settings.near / reach for _, row in group],
                    "y": [100 * count / wrong for count, wrong in pairs],
                    "yaxis": axis,
                    "customdata": [number for number, _ in group],
                    "text": [f"{count:,} of {wrong:,} wrong pixels" for count, wrong in pairs],
                    "hovertemplate": f"{name}, {_HOVER}<extra></extra>",
                    "name": name,
                    "legendgroup": name,
                    # One legend entry per cause, from the first panel.
                    "showlegend": axis == "y",
                    "mode": "lines",
                    "stackgroup": f"panel {axis}",
                    "line": {"width": 0.5, "color": CAUSE_COLORS[name]},
                    "fillcolor": CAUSE_COLORS[name],
                }
            )
        layout[axis.replace("y", "yaxis")] = {"range": [0, 100], "ticksuffix": " %", "nticks": 3}
        above = {"yref": f"{axis} domain", "y": 1, "yanchor": "bottom", "showarrow": False}
        heading = {"text": label, "xref": "paper", "x": 0.5, "font": {"size": 16}}
        layout["annotations"].append(heading | above)
    subplots = [[f"x{axis}"] for axis in axes]
    layout["grid"] = {"columns": 1, "rows": len(axes), "subplots": subplots, "ygap": 0.3}
    layout["xaxis"] = {
        "title": "near, as a share of the reach",
        **log_axis([near for area in areas for near in area["x"]]),
    }
    return styled(areas, {"height": 110 + PANEL_PIXELS * len(axes), **layout})
