"""What a survey leaves behind: the page with its figures, and survey.json, beside the rows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from scipy.spatial import cKDTree

from xfrustum.reports.common.figure_style import log_axis, look, style
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.provenance import versions
from xfrustum.reports.common.raster_command import raster_command
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import page as inspection
from xfrustum.reports.inspection.plate_map import PlateMap
from xfrustum.reports.scout import LABEL, MARK, finish_map
from xfrustum.reports.survey.answer import Survey, percent_up
from xfrustum.reports.survey.jobs import ShownHogel
from xfrustum.reports.survey.rows import depth_ends
from xfrustum.reports.survey.tally import FRACTION, MAP_COLUMNS, P99, SURFACE, Tally, WorstHogel
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.plate import Plate

FILES = PAGE, DATA, INSPECTION = "index.html", "survey.json", inspection.PAGE

MARKED_HOGELS = 3
"""Number of the worst hogels that are marked on the map of displacement: more would cover it."""

LENGTHS = ("height_rms",)
"""Columns whose numbers are lengths in the scene's unit."""

MIN_DECADES = 2
"""Number of powers of ten beyond which a color bar is labeled at them; else five labels are spread evenly."""

DISTRIBUTION_MARGIN = 3.0
"""Factor by which the axis of displacement reaches beyond the smallest and the largest value."""


Pictured = Sequence[tuple[WorstHogel, ShownHogel]]
"""The worst hogels with their pictures."""


def _readable(value: float) -> str:
    """Write a number with three digits, and thousands in full: `7,470` and no `7.47e3`."""
    return f"{float(f'{value:.3g}'):,.0f}" if 1e3 <= abs(value) < 1e9 else digits(value)


def write_survey(found: Survey, pictured: Pictured, out: Path) -> tuple[Path, ...]:
    """Write the page, the JSON object and the inspection page, all or nothing.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with Staging(out, FILES) as staging:
        (staging.folder / PAGE).write_text(render_page(found, pictured), encoding="utf-8")
        write_json(staging.folder / DATA, found.record)
        inspection.write_inspection(staging.folder, _inspection(found, pictured))
        with inspection.replacing_inspection(out):
            return staging.commit()


def _inspection(found: Survey, pictured: Pictured) -> inspection.Inspection:
    """Return what the inspection page shows: the worst hogels of the best setting."""
    settings, tally = found.settings[found.best], found.tallies[found.best]
    name = next((one for one in (P99, SURFACE, FRACTION) if one in tally.maps), None)
    drawn = "images" if settings is None else f"near {digits(settings.near)}, {settings.depth_label}"
    if name is None:
        plate_map = PlateMap.of(found.scene.plate, "", ())
    else:
        plate_map = PlateMap(words=words_of(name).capitalize(), cells=tally.maps[name])
    return inspection.Inspection(
        command="survey",
        scene=found.scene,
        told=(f"The worst of the {found.extent.judged:,} hogels that were judged: {drawn}.",),
        hogels=[one.inspected for _, one in pictured if one.inspected is not None],
        plate_map=plate_map,
    )


def render_page(found: Survey, pictured: Pictured) -> str:
    """Return one HTML document that needs nothing else; of the same rows, always the same."""
    scene = found.scene
    depth = depth_figure(found)
    maps = map_figures(found)
    places = {f"map-{number}": figure for number, figure in enumerate(maps)}
    figures = {**places, "distribution": distribution_figure(found)}
    if depth is not None:
        figures["depth"] = depth
    settings = found.settings[found.best]
    worst = pictured[0][0].aperture if pictured else None
    command = None
    if settings is not None and worst is not None:
        command = raster_command(scene, scene.plate.aperture(*worst), settings)
    values = {
        "found": found,
        "record": found.record,
        "pictured": pictured,
        "maps": list(places),
        "figures": figures,
        "command": command,
        "versions": versions(),
    }
    filters = {"percent": percent, "percent_up": percent_up, "digits": _readable}
    return html_page("survey.html.j2", filters, values)


def map_figures(found: Survey) -> list[go.Figure]:
    """Draw each measure of the best setting that is not zero everywhere over the plate."""
    tally = found.tallies[found.best]
    figures = []
    for name, values in tally.maps.items():
        if np.nanmax(values, initial=0.0) > 0:
            words = words_of(name) + (f", {found.scene.units}" if name in LENGTHS else "")
            figure = _map(values, found.scene.plate, words, logarithmic=name == P99)
            if name == P99:
                _mark(figure, tally, found.scene.plate.hogels)
            figures.append(figure)
    return figures


def words_of(column: str) -> str:
    """Return a column in words: those of causes by their names."""
    if column in MAP_COLUMNS:
        return MAP_COLUMNS[column]
    cause = column.removeprefix("cause_").removesuffix("_surface").replace("_", " ")
    return f"wrong surfaces by {cause}, pixels"


def distribution_figure(found: Survey) -> go.Figure:
    """Draw the share of hogels that are displaced by more than each tolerance, a curve for each setting."""
    figure = go.Figure()
    ends: list[float] = []
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        tolerances, shares = tally.share_beyond()
        # The curve is level where no hogel is: what is shown begins and ends with hogels.
        ends += [tolerances[place] for place in np.flatnonzero(tally.displaced)]
        color, _ = look(number)
        figure.add_scatter(
            x=tolerances,
            y=shares,
            mode="lines",
            line={"color": color, "shape": "hv"},
            name="image" if settings is None else f"near {digits(settings.near)}",
        )
    figure.add_vline(x=found.tolerance_px, line={"color": MARK, "dash": "dot"})
    style(figure)
    low = min((*ends, found.tolerance_px)) / DISTRIBUTION_MARGIN
    high = max((*ends, found.tolerance_px)) * DISTRIBUTION_MARGIN
    figure.update_xaxes(
        **log_axis([low, high]), range=[np.log10(low), np.log10(high)], title_text="displacement (p99), px"
    )
    figure.update_yaxes(title_text="share of judged hogels beyond", tickformat=".0%", rangemode="tozero")
    figure.update_layout(height=380)
    return figure


def depth_figure(found: Survey) -> go.Figure | None:
    """Draw displacement by depth of content, rms and largest; None where nothing was measured by depth."""
    if not any(tally.depth_pixels.any() for tally in found.tallies):
        return None
    figure = go.Figure()
    reach, ends = found.scene.frustum.longest_reach, depth_ends()
    names = [f"{digits(low * reach)}-{digits(high * reach)}" for low, high in pairwise(ends)]
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        color, marker = look(number)
        label = "" if settings is None or len(found.settings) == 1 else f"near {digits(settings.near)}: "
        shown = tally.depth_pixels > 0
        for word, values, dash in (
            ("rms", tally.depth_rms_px, "solid"),
            ("largest", tally.depth_max_px, "dot"),
        ):
            figure.add_scatter(
                x=names,
                y=[
                    float(value) if is_shown and value > 0 else None
                    for value, is_shown in zip(values, shown, strict=True)
                ],
                mode="lines+markers",
                marker={"symbol": marker},
                line={"color": color, "dash": dash},
                name=f"{label}{word}",
            )
    style(figure)
    figure.update_xaxes(title_text=f"|z| of the content, {found.scene.units}", type="category")
    figure.update_yaxes(type="log", dtick=1, exponentformat="power", title_text="displacement, px")
    figure.update_layout(height=380)
    return figure


def _map(values: Floats, plate: Plate, title: str, *, logarithmic: bool) -> go.Figure:
    """Draw a number over the plate; cells without a judged hogel have the color of the nearest with one."""
    filled = _filled(values)
    shown = np.log10(np.where(filled > 0, filled, np.nan)) if logarithmic else filled
    rows, columns = values.shape
    hogels = plate.hogels
    figure = go.Figure()
    figure.add_heatmap(
        x=(np.arange(columns) + 0.5) * hogels[0] / columns - 0.5,
        y=(np.arange(rows) + 0.5) * hogels[1] / rows - 0.5,
        z=[[None if np.isnan(value) else float(value) for value in line] for line in shown],
        customdata=filled,
        hovertemplate="column %{x:.0f}, row %{y:.0f}: %{customdata:.3g}<extra></extra>",
        colorscale="Viridis",
        colorbar={"thickness": 12, "outlinewidth": 0, **(_powers(shown) if logarithmic else {})},
    )
    finish_map(figure, plate, title)
    return figure


def _filled(values: Floats) -> Floats:
    """Return a map whose cells without a value have that of the nearest cell with one."""
    known = np.argwhere(np.isfinite(values))
    if not len(known) or len(known) == values.size:
        return values
    _, nearest = cKDTree(known).query(np.argwhere(np.ones_like(values)))
    return np.asarray(values[tuple(known[nearest].T)]).reshape(values.shape)


def _powers(logarithms: Floats) -> dict[str, Sequence[float] | Sequence[str]]:
    """Return the labels of a color bar whose scale is logarithmic."""
    known = logarithms[np.isfinite(logarithms)]
    if not known.size:
        return {}
    ticks = np.arange(np.ceil(known.min()), np.floor(known.max()) + 1)
    if len(ticks) <= MIN_DECADES:
        ticks = np.linspace(known.min(), known.max(), 5)
    return {"tickvals": ticks.tolist(), "ticktext": [digits(float(10**tick)) for tick in ticks]}


def _mark(figure: go.Figure, tally: Tally, hogels: tuple[int, int]) -> None:
    """Mark the worst hogels with their columns and rows."""
    worst = tally.worst[:MARKED_HOGELS]
    figure.add_scatter(
        x=[one.aperture[0] for one in worst],
        y=[one.aperture[1] for one in worst],
        mode="markers",
        marker={"symbol": "circle-open", "size": 14, "color": MARK, "line": {"width": 3}},
        hoverinfo="skip",
        showlegend=False,
        cliponaxis=False,
    )
    for one in worst[:1]:
        column, row = one.aperture
        side = -1 if 2 * column > hogels[0] else 1
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
