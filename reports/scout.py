"""What people see of the scout of a plate: chosen apertures with their reasons, and a map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from scipy.spatial import cKDTree

from xfrustum.compare.scout import (
    FILM_PIXELS,
    MAX_APERTURES,
    AutoApertures,
    ChosenAperture,
    Look,
    scout,
)
from xfrustum.reports.common.figure_style import style
from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.progress import progress_bar
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Plate

MAX_MAP_CELLS = 120
"""Largest number of cells along a side of the map: a cell of a larger plate stands for several hogels, and
each is five pixels wide on the page."""

MAP_PIXELS = 340
"""Height of the map of a plate as high as wide, on the page."""

MARK = "#D55E00"
"""Color of the marks of chosen apertures."""

LABEL = "#1b1f24"
"""Color of their labels, which lie on white on light and on dark paper."""


def auto_apertures(scene: Scene, *, progress: bool = False) -> AutoApertures:
    """Look through apertures all over a plate, and choose the middle one and the worst.

    Parameters
    ----------
    progress
        Show a progress bar on standard error.
    """
    with progress_bar(None, "scout", "aperture", shown=progress) as bar:
        return AutoApertures.of(scout(scene, bar.update))


def notes(auto: AutoApertures) -> list[str]:
    """Say in a sentence each how the apertures were chosen, and which and why."""
    columns, rows = auto.scout.scene.plate.hogels
    looks = len(auto.scout.looks)
    everything = "all" if looks == columns * rows else f"{looks} of the"
    lines = [
        f"auto: looked through {everything} {columns * rows:,} apertures of the plate (at most "
        f"{MAX_APERTURES:,}), along {FILM_PIXELS**2} lines each"
    ]
    if auto.blocked:
        lines.append(
            f"auto: at {auto.blocked} of these a surface lies in the aperture itself, which no settings draw"
        )
    return [*lines, *(f"auto: {spelled(one)}" for one in auto.chosen)]


def spelled(chosen: ChosenAperture) -> str:
    """Return an aperture with the reason for which it was chosen."""
    return f"aperture {chosen.aperture.column},{chosen.aperture.row}: {chosen.why}"


@dataclass(frozen=True, kw_only=True)
class ChoiceRecord:
    """An aperture by its column and row, and the reason for which it was chosen."""

    aperture: tuple[int, int]
    why: str

    @classmethod
    def of(cls, chosen: ChosenAperture) -> ChoiceRecord:
        """Return how a chosen aperture is written."""
        return cls(aperture=chosen.aperture.index, why=chosen.why)


def choices(auto: AutoApertures | None) -> tuple[ChoiceRecord, ...] | None:
    """Return how chosen apertures are written; None where nothing was to be chosen."""
    return None if auto is None else tuple(ChoiceRecord.of(one) for one in auto.chosen)


@dataclass(frozen=True, kw_only=True)
class LookRecord:
    """What the coarse film of one aperture shows; see `scout.Look`.

    Attributes
    ----------
    nearest
        Smallest visible |z|, scene units; null where nothing is seen.
    pixels_per_near
        The 99th percentile of displacement over a small n; null where a surface lies in the aperture.
    outline_widths
        Length of the outlines in widths of the film.
    """

    aperture: tuple[int, int]
    nearest: float
    pixels_per_near: float
    outline_widths: float

    @classmethod
    def of(cls, look: Look) -> LookRecord:
        """Return how a look is written."""
        return cls(
            aperture=look.aperture.index,
            nearest=look.nearest,
            pixels_per_near=look.pixels_per_near,
            outline_widths=look.outline_widths,
        )


@dataclass(frozen=True, kw_only=True)
class ScoutRecord:
    """The scout of a plate, and what was chosen from it.

    Attributes
    ----------
    hogels, scouted, blocked
        Hogels of the plate; of these, how many were looked through, and of those, in how many a surface lies.
    lines
        Lines through each aperture that was looked through.
    chosen
        The apertures that were taken, with their reasons.
    looks
        What each look saw.
    """

    hogels: int
    scouted: int
    blocked: int
    lines: int
    chosen: tuple[ChoiceRecord, ...]
    looks: tuple[LookRecord, ...]

    @classmethod
    def of(cls, auto: AutoApertures) -> ScoutRecord:
        """Return how a scout is written."""
        columns, rows = auto.scout.scene.plate.hogels
        return cls(
            hogels=columns * rows,
            scouted=len(auto.scout.looks),
            blocked=auto.blocked,
            lines=FILM_PIXELS**2,
            chosen=tuple(ChoiceRecord.of(one) for one in auto.chosen),
            looks=tuple(LookRecord.of(look) for look in auto.scout.looks),
        )


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


def map_figures(auto: AutoApertures) -> tuple[go.Figure, go.Figure]:
    """Draw the plate twice: the nearest visible |z| on a logarithmic color scale, and the outlines.

    These are two figures, so that a page can set them side by side or one above the other.
    """
    nearest = np.array([look.nearest for look in auto.scout.looks])
    outlines = np.array([look.outline_widths for look in auto.scout.looks])
    known, powers = _logarithms(nearest)
    seen = np.where(np.isfinite(nearest), outlines, np.nan)
    units = auto.scout.scene.units
    # Both scales are bright where the error is large: a near surface, long outlines.
    heights = _map(auto, known, f"nearest visible |z|, {units}", "Viridis_r")
    heights.update_traces(
        colorbar={
            "tickvals": [math.log10(value) for value in powers],
            "ticktext": [digits(value) for value in powers],
        },
        selector={"type": "heatmap"},
    )
    return heights, _map(auto, seen, "length of outlines, widths of the picture", "Viridis")


def _map(auto: AutoApertures, values: Floats, title: str, colors: str) -> go.Figure:
    """Draw a number of each look over the plate, with its title and its scale of colors."""
    cells = MapCells.of(auto)
    figure = go.Figure()
    figure.add_heatmap(
        x=cells.columns,
        y=cells.rows,
        z=_with_blanks(values[cells.look]),
        text=np.array(_hover(auto))[cells.look],
        hovertemplate="%{text}<extra></extra>",
        colorscale=colors,
        colorbar={"thickness": 12, "outlinewidth": 0},
    )
    _mark(figure, auto)
    finish_map(figure, auto.scout.scene.plate, title)
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


def _mark(figure: go.Figure, auto: AutoApertures) -> None:
    """Mark the chosen apertures, each with its column and row."""
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
        )


def finish_map(figure: go.Figure, plate: Plate, title: str) -> None:
    """Give a map its title, and the proportions of the plate itself, row 0 at the top."""
    style(figure)
    (columns, rows), (width, height) = plate.hogels, plate.size
    pitch_ratio = height / rows / (width / columns)
    figure.update_layout(title={"text": title, "x": 0, "xref": "paper", "font": {"size": 15}})
    figure.update_layout(height=120 + round(MAP_PIXELS * min(max(height / width, 0.3), 1.5)))
    figure.update_xaxes(title_text="column", range=[-0.5, columns - 0.5], showgrid=False, constrain="domain")
    figure.update_yaxes(title_text="row", range=[rows - 0.5, -0.5], showgrid=False, constrain="domain")
    # Labels and color bars take room of their own: equal scales keep a square plate square beside them.
    figure.update_yaxes(scaleanchor="x", scaleratio=pitch_ratio, constraintoward="top")
