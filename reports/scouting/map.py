"""The scout as a map of the plate: nearest visible |z| and outlines over columns and rows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from scipy.spatial import cKDTree

from xfrustum.compare.scouting.automatic import AutoApertures
from xfrustum.reports.common.figure_style import style
from xfrustum.reports.common.formatting import digits
from xfrustum.scenes.arrays import Floats, Indices

MAX_MAP_CELLS = 120
"""Largest number of cells along a side of the map: a cell of a larger plate stands for several hogels, and
each is five pixels wide on the page."""

MAP_PIXELS = 340
"""Height of the map of a plate as high as wide, on the page."""

MARK = "#D55E00"
"""Color of the marks of chosen apertures."""

LABEL = "#1b1f24"
"""Color of their labels, which lie on white on light and on dark paper."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapCells:
    """Cells that cover a plate, each with the look nearest to it.

    Attributes
    ----------
    columns, rows
        Hogels in the middle of the cells, along the plate.
    look
        (rows, columns) number of the nearest look.
    """

    columns: Floats
    rows: Floats
    look: Indices

    @classmethod
    def of(cls, auto: AutoApertures) -> MapCells:
        """Cover the plate of a scout."""
        hogels = auto.scout.scene.plate.hogels
        columns, rows = (_cells(count) for count in hogels)
        looked = np.array([one.index for one in auto.scout.apertures], dtype=np.float64)
        places = np.stack(np.meshgrid(columns, rows), axis=-1)
        _, nearest = cKDTree(looked).query(places)
        return cls(columns=columns, rows=rows, look=nearest)


def _cells(hogels: int) -> Floats:
    """Return the middles of equal cells along some hogels, in hogels."""
    count = min(hogels, MAX_MAP_CELLS)
    return (np.arange(count) + 0.5) * hogels / count - 0.5


def map_figure(auto: AutoApertures) -> go.Figure:
    """Draw the plate twice: the nearest visible |z| on a logarithmic color scale, and the outlines."""
    cells = MapCells.of(auto)
    scene = auto.scout.scene
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.16,
        subplot_titles=(f"nearest visible |z|, {scene.units}", "length of outlines, widths of the picture"),
    )
    nearest = np.array([look.nearest for look in auto.scout.looks])
    outlines = np.array([look.outline_widths for look in auto.scout.looks])
    text = _hover(auto)
    known, powers = _logarithms(nearest)
    seen = np.where(np.isfinite(nearest), outlines, np.nan)
    # Both scales are bright where the error is large: a near surface, long outlines.
    panels = ((known, "Viridis_r", 0.43), (seen, "Viridis", 1.01))
    for column, (values, colors, right) in enumerate(panels, start=1):
        figure.add_heatmap(
            x=cells.columns,
            y=cells.rows,
            z=_with_blanks(values[cells.look]),
            text=np.array(text)[cells.look],
            hovertemplate="%{text}<extra></extra>",
            colorscale=colors,
            colorbar={"thickness": 12, "outlinewidth": 0, "x": right},
            row=1,
            col=column,
        )
        _mark(figure, auto, column)
    bar = {
        "tickvals": [math.log10(value) for value in powers],
        "ticktext": [digits(value) for value in powers],
    }
    figure.update_traces(colorbar=bar, selector={"type": "heatmap"}, row=1, col=1)
    _finish(figure, scene.plate.hogels)
    return figure


def _with_blanks(values: Floats) -> list[list[float | None]]:
    return [[None if math.isnan(value) else float(value) for value in row] for row in values]


def _logarithms(nearest: Floats) -> tuple[Floats, list[float]]:
    """Return decimal logarithms, NaN where nothing is seen, and the lengths that a color bar is labeled at.

    A surface in the aperture itself, at 0, has the color of the smallest other length.
    """
    positive = nearest[(nearest > 0) & np.isfinite(nearest)]
    smallest, largest = (float(positive.min()), float(positive.max())) if len(positive) else (1.0, 1.0)
    known = np.where(np.isfinite(nearest), np.log10(np.maximum(nearest, smallest)), np.nan)
    return known, _ticks(smallest, largest)


def _ticks(low: float, high: float) -> list[float]:
    """Return powers of ten between two lengths, with 2 and 5 times each where there are few."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1.0,) if high > 1000 * low else (1.0, 2.0, 5.0)
    inside = [
        step * 10.0**exponent
        for exponent in exponents
        for step in steps
        if low <= step * 10.0**exponent <= high
    ]
    return inside if len(inside) > 1 else [low, high]


def _hover(auto: AutoApertures) -> list[str]:
    units = auto.scout.scene.units
    found = []
    for look in auto.scout.looks:
        place = f"looked through {look.aperture.column},{look.aperture.row}"
        if math.isfinite(look.nearest):
            seen = (
                f"nearest |z| {digits(look.nearest)} {units}<br>outlines {digits(look.outline_widths)} widths"
            )
        else:
            seen = "nothing is seen"
        found.append(f"{place}<br>{seen}")
    return found


def _mark(figure: go.Figure, auto: AutoApertures, panel: int) -> None:
    """Mark the chosen apertures in one panel, each with its column and row."""
    columns = [one.aperture.column for one in auto.chosen]
    rows = [one.aperture.row for one in auto.chosen]
    figure.add_scatter(
        x=columns,
        y=rows,
        mode="markers",
        marker={"symbol": "circle-open", "size": 15, "color": MARK, "line": {"width": 3}},
        text=[f"{one.aperture.column},{one.aperture.row}<br>{one.why}" for one in auto.chosen],
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
        cliponaxis=False,
        row=1,
        col=panel,
    )
    for column, row in zip(columns, rows, strict=True):
        # Labels go toward the middle of the plate, so that they stay on it.
        side = -1 if 2 * column > auto.scout.scene.plate.hogels[0] else 1
        figure.add_annotation(
            x=column,
            y=row,
            text=f"<b>{column},{row}</b>",
            showarrow=False,
            xanchor="left" if side > 0 else "right",
            xshift=13 * side,
            bgcolor="rgba(255, 255, 255, 0.85)",
            font={"color": LABEL, "size": 12},
            row=1,
            col=panel,
        )


def _finish(figure: go.Figure, hogels: tuple[int, int]) -> None:
    """Give the panels the proportions of rows and columns, row 0 at the top."""
    style(figure)
    columns, rows = hogels
    figure.update_layout(height=120 + round(MAP_PIXELS * min(max(rows / columns, 0.3), 1.5)))
    figure.update_xaxes(title_text="column", range=[-0.5, columns - 0.5], showgrid=False)
    figure.update_yaxes(title_text="row", range=[rows - 0.5, -0.5], showgrid=False)
