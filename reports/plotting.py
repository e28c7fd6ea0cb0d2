"""Figures for plotly.js: the style of all figures, and heat maps of plates.

A heat map shows a scan of a plate and the apertures selected by it, with reasons.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from xfrustum.compare.scout import (
    FILM_PIXELS,
    MAX_APERTURES,
    AutoApertures,
    ChosenAperture,
    Criterion,
    scout,
)
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.scenes import Plate, Scene
from xfrustum.scenes.arrays import Floats, Mask
from xfrustum.scenes.representation import digits, plain
from xfrustum.tolerances import TOLERANCE_PX

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


#: Largest number of cells along a side of a map; such a cell is five pixels wide on the page. On a
#: larger plate a cell stands for several hogels.
MAX_MAP_CELLS = 120

#: height of the map of a square plate on the page, px
MAP_PIXELS = 260
#: color of the marks of apertures
MARK = "#D55E00"
#: color of the labels; their background is white on light and dark pages
LABEL = "#1b1f24"


def auto_apertures(scene: Scene, *, progress: bool = False) -> AutoApertures:
    """Scan apertures all over a plate, and choose the middle one and the worst."""
    with progress_bar(None, "scout", "aperture", shown=progress) as bar:
        return AutoApertures.from_scan(scout(scene, bar.update))


def why(choice: ChosenAperture, units: str) -> str:
    """Return the reason for the choice of an aperture."""
    view = choice.view
    if view is None:
        return "the middle of the plate; nothing seen"
    limit = "none at any near"
    if view.pixels_per_near:
        near = plain(f"{TOLERANCE_PX / view.pixels_per_near:.2g}")
        limit = f"over {TOLERANCE_PX:g} px from near {near} {units} on"
    reasons = {
        Criterion.MIDDLE: "the middle of the plate",
        Criterion.DISPLACEMENT: f"largest displacement ({limit})",
        Criterion.NEAREST: "surface nearest to the plate",
        Criterion.OUTLINES: f"longest outlines ({view.outline_widths:.2g} widths of the picture)",
    }
    seen = f"nearest visible |z| {view.nearest:.2g} {units}"
    return "; ".join([*(reasons[criterion] for criterion in choice.criteria), seen])


def choices(auto: AutoApertures) -> list[dict[str, Any]]:
    """Return the chosen apertures with their reasons, as JSON has them."""
    units = auto.scout.scene.units
    return [
        {"aperture": choice.aperture.index, "why": why(choice, units)} for choice in auto.chosen
    ]


def notes(auto: AutoApertures) -> list[str]:
    """Return a line on the scan of apertures, and a line on each choice with its reason."""
    hogels, looks = math.prod(auto.scout.scene.plate.hogels), len(auto.scout.looks)
    scanned = "all" if looks == hogels else f"{looks} of the"
    lines = [
        f"looked through {scanned} {hogels:,} apertures of the plate (at most {MAX_APERTURES:,}), "
        f"along {FILM_PIXELS**2} lines each"
    ]
    if auto.blocked:
        lines.append(
            f"at {auto.blocked} of these a surface lies in the aperture itself, which no settings "
            "draw"
        )
    chosen = ("aperture {},{}: {}".format(*row["aperture"], row["why"]) for row in choices(auto))
    return [f"auto: {line}" for line in (*lines, *chosen)]


def scout_record(auto: AutoApertures) -> dict[str, Any]:
    """Return the record of a plate scan: numbers of apertures, and the chosen ones."""
    return {
        "hogels": math.prod(auto.scout.scene.plate.hogels),
        "scouted": len(auto.scout.looks),
        "blocked": auto.blocked,
        "lines": FILM_PIXELS**2,
        "chosen": choices(auto),
    }


def map_figures(auto: AutoApertures) -> tuple[Figure, Figure]:
    """Draw maps of the plate's nearest visible |z| and outlines, bright where errors are large."""
    plate, looks = auto.scout.scene.plate, auto.scout.looks
    nearest, outlines = (
        np.array([getattr(look, name) for look in looks]) for name in ("nearest", "outline_widths")
    )
    nothing = ~np.isfinite(nearest)
    nearest[nothing] = outlines[nothing] = np.nan
    # A surface in the aperture itself, at 0, has the color of the smallest other length.
    nearest = np.maximum(nearest, min(nearest[nearest > 0], default=1.0))
    places = [aperture.index for aperture in auto.scout.apertures]
    nearest, looked = plate_cells(plate.hogels, places, nearest, np.fmin)
    outlines, _ = plate_cells(plate.hogels, places, outlines)
    marks = [(choice["aperture"], choice["why"]) for choice in choices(auto)]
    title = f"nearest visible |z|, {auto.scout.scene.units}"
    heights = plate_map(plate, nearest, title, known=looked, logarithmic=True)
    heights["data"][0] |= {"colorscale": "Viridis", "reversescale": True}
    widths = plate_map(plate, outlines, "length of outlines, widths of the picture", known=looked)
    for figure in (heights, widths):
        mark(figure, plate, marks, labels=len(marks))
    return heights, widths


def plate_cells(
    hogels: tuple[int, int], places: ArrayLike, values: ArrayLike, worst: np.ufunc = np.fmax
) -> tuple[Floats, Mask]:
    """Return values (A,) of hogels on map cells (rows, columns), and the mask of filled cells.

    `places` (A, 2) are columns and rows. `worst` is `np.fmin` or `np.fmax`, which selects among
    hogels in the same cell.
    """
    cells = tuple(min(count, MAX_MAP_CELLS) for count in hogels)
    columns, rows = (np.reshape(places, (-1, 2)).astype(np.int64) * cells // hogels).T
    shown, looked = np.full(cells[::-1], np.nan), np.zeros(cells[::-1], dtype=bool)
    worst.at(shown, (rows, columns), values)
    looked[rows, columns] = True
    return shown, looked


def plate_map(
    plate: Plate,
    values: Floats,
    title: str,
    *,
    known: Mask | None = None,
    logarithmic: bool = False,
) -> Figure:
    """Draw values (rows, columns) as a map in the plate's proportions, row 0 at the top.

    NaN is blank. Cells that are not `known`, by default cells without a value, have the value of
    the nearest known cell. The color scale may be `logarithmic`. Where the title begins with
    "share", numbers are in percent.
    """
    known = np.isfinite(values) if known is None else known
    if known.any():
        values = values[
            tuple(distance_transform_edt(~known, return_distances=False, return_indices=True))
        ]
    shown = np.log10(np.where(values > 0, values, np.nan)) if logarithmic else values
    (columns, rows), (width, height) = plate.hogels, plate.size
    heat: dict[str, Any] = {
        "type": "heatmap",
        "x": (np.arange(values.shape[1]) + 0.5) * columns / values.shape[1] - 0.5,
        "y": (np.arange(values.shape[0]) + 0.5) * rows / values.shape[0] - 0.5,
        "z": shown,
        "customdata": values,
        "hovertemplate": "column %{x:.0f}, row %{y:.0f}: %{customdata:.3g}<extra></extra>",
        "colorscale": "Viridis",
        "colorbar": {"thickness": 12, "outlinewidth": 0},
    }
    if title.startswith("share"):
        heat["colorbar"]["tickformat"] = "~%"
        heat["hovertemplate"] = "column %{x:.0f}, row %{y:.0f}: %{customdata:.2~p}<extra></extra>"
    if logarithmic and (exponents := shown[np.isfinite(shown)]).size:
        # Use powers of ten as ticks, or five evenly spaced ticks if the range has few powers.
        ticks = np.arange(np.ceil(exponents.min()), np.floor(exponents.max()) + 1)
        if len(ticks) <= 2:
            ticks = np.linspace(exponents.min(), exponents.max(), 5)
        heat["colorbar"] |= {
            "tickvals": ticks,
            "ticktext": [digits(float(10**tick)) for tick in ticks],
        }
    # Labels and color bars take additional room: equal scales of both axes keep a square plate
    # square.
    same = {
        "scaleanchor": "x",
        "scaleratio": height / rows / (width / columns),
        "constraintoward": "top",
    }
    axis = {"showgrid": False, "constrain": "domain"}
    layout = {
        "title": titled(title),
        "height": 120 + round(MAP_PIXELS * min(max(height / width, 0.3), 1.5)),
        "xaxis": {"title": "column", "range": [-0.5, columns - 0.5], **axis},
        "yaxis": {"title": "row", "range": [rows - 0.5, -0.5], **axis, **same},
        "annotations": [],
    }
    return styled([heat], layout)


def mark(
    figure: Figure, plate: Plate, marks: Sequence[tuple[tuple[int, int], str]], labels: int
) -> None:
    """Mark apertures on a map by rings with hover text, and label the first `labels` of them."""
    points = {
        "x": [column for (column, _), _ in marks],
        "y": [row for (_, row), _ in marks],
        "mode": "markers",
        "marker": {"symbol": "circle-open", "size": 15, "color": MARK, "line": {"width": 3}},
        "text": [f"{column},{row}<br>{words}" for (column, row), words in marks],
        "hovertemplate": "%{text}<extra></extra>",
        "showlegend": False,
        "cliponaxis": False,
    }
    figure["data"].append(points)
    for (column, row), _ in marks[:labels]:
        # Labels are placed toward the middle of the plate, so that they do not leave it.
        right = 2 * column <= plate.hogels[0]
        label = {
            "text": f"<b>{column},{row}</b>",
            "font": {"color": LABEL, "size": 12},
            "x": column,
            "y": row,
            "xanchor": "left" if right else "right",
            "xshift": 13 if right else -13,
            "showarrow": False,
            "bgcolor": "rgba(255, 255, 255, 0.85)",
        }
        figure["layout"]["annotations"].append(label)
