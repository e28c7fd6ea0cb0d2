"""What a survey leaves behind: the page with its figures, and survey.json, beside the rows."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from xfrustum.reports import inspection
from xfrustum.reports.common.figure_style import Figure, log_axis, look, styled
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.provenance import raster_command, versions
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import PlateMap
from xfrustum.reports.scout import MARK, mark, plate_map
from xfrustum.reports.survey.answer import Survey
from xfrustum.reports.survey.jobs import ShownHogel
from xfrustum.reports.survey.rows import DEPTH_ENDS, FRACTION, MAP_COLUMNS, P99, SURFACE, WorstHogel
from xfrustum.scenes.notebook import digits

FILES = PAGE, DATA, INSPECTION = "index.html", "survey.json", inspection.PAGE

MARKED_HOGELS = 3  # of the worst, on the map of displacement: more would cover it
DISTRIBUTION_MARGIN = 3.0  # by which the axis of displacement reaches beyond the smallest and largest value

Pictured = Sequence[tuple[WorstHogel, ShownHogel]]  # the worst hogels with their pictures


def write_survey(found: Survey, pictured: Pictured, out: Path) -> tuple[Path, ...]:
    """Write the page, the JSON object and the inspection page, all or nothing."""
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(found, pictured))
        staging.write(DATA, found.record)
        settings, maps = found.settings[found.best], found.tallies[found.best].maps
        name = next((one for one in (P99, SURFACE, FRACTION) if one in maps), None)
        drawn = "images" if settings is None else f"near {digits(settings.near)}, {settings.depth_label}"
        inspected = inspection.Inspection(
            command="survey",
            scene=found.scene,
            told=(f"The worst of the {found.extent.judged:,} hogels that were judged: {drawn}.",),
            hogels=[one.inspected for _, one in pictured if one.inspected is not None],
            plate_map=PlateMap(words=words_of(name).capitalize(), cells=maps[name])
            if name
            else PlateMap.of(found.scene.plate, "", ()),
        )
        inspection.write_inspection(staging.folder, inspected)
        with inspection.replacing_inspection(out):
            return staging.commit()


def render_page(found: Survey, pictured: Pictured) -> str:
    """Return one HTML document that needs nothing else; of the same rows, always the same."""
    scene, settings, command = found.scene, found.settings[found.best], None
    maps = {f"map-{number}": figure for number, figure in enumerate(map_figures(found))}
    drawn = {**maps, "distribution": distribution_figure(found), "depth": depth_figure(found)}
    if settings is not None and pictured:
        command = raster_command(scene, scene.plate.aperture(*pictured[0][0].aperture), settings)
    values = {
        "found": found,
        "pictured": pictured,
        "maps": list(maps),
        "figures": {name: figure for name, figure in drawn.items() if figure is not None},
        "command": command,
        "versions": versions(),
    }
    return html_page("survey.html.j2", values)


def map_figures(found: Survey) -> list[Figure]:
    """Draw each measure of the best setting that is not zero everywhere over the plate."""
    tally = found.tallies[found.best]
    figures = []
    for name, values in tally.maps.items():
        if np.nanmax(values, initial=0.0) > 0:
            words = words_of(name) + (f", {found.scene.units}" if name == "height_rms" else "")
            figure = plate_map(found.scene.plate, values, words, logarithmic=name == P99)
            if name == P99:
                worst = [(one.aperture, "one of the worst") for one in tally.worst[:MARKED_HOGELS]]
                mark(figure, found.scene.plate, worst, labels=1)
            figures.append(figure)
    return figures


def words_of(column: str) -> str:
    """Return a column in words: those of causes by their names."""
    if column in MAP_COLUMNS:
        return MAP_COLUMNS[column]
    cause = column.removeprefix("cause_").removesuffix("_surface").replace("_", " ")
    return f"wrong surfaces by {cause}, pixels"


def distribution_figure(found: Survey) -> Figure:
    """Draw the share of hogels that are displaced by more than each tolerance, a curve for each setting."""
    shown, lines = [found.tolerance_px], []
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        tolerances, shares = tally.share_beyond()
        shown += [*tolerances[:1], *tolerances[-1:]]
        line = {"color": look(number)[0], "shape": "hv"}
        name = "image" if settings is None else f"near {digits(settings.near)}"
        lines.append({"x": tolerances, "y": shares, "mode": "lines", "line": line, "name": name})
    low, high = min(shown) / DISTRIBUTION_MARGIN, max(shown) * DISTRIBUTION_MARGIN
    tolerance = {"type": "line", "x0": found.tolerance_px, "x1": found.tolerance_px, "yref": "y domain"}
    layout = {
        "height": 380,
        "xaxis": {
            "title": "displacement (p99), px",
            "range": [np.log10(low), np.log10(high)],
            **log_axis([low, high]),
        },
        "yaxis": {"title": "share of judged hogels beyond", "tickformat": ".0%", "rangemode": "tozero"},
        "shapes": [{**tolerance, "y0": 0, "y1": 1, "line": {"color": MARK, "dash": "dot"}}],
    }
    return styled(lines, layout)


def depth_figure(found: Survey) -> Figure | None:
    """Draw displacement by depth of content, rms and largest; None where nothing was measured by depth."""
    if not any(tally.depth_pixels.any() for tally in found.tallies):
        return None
    reach, lines, drawn = found.scene.frustum.longest_reach, [], list[float]()
    names = [f"{digits(low * reach)}-{digits(high * reach)}" for low, high in pairwise(DEPTH_ENDS)]
    for number, (settings, tally) in enumerate(zip(found.settings, found.tallies, strict=True)):
        color, marker = look(number)
        label = "" if settings is None or len(found.settings) == 1 else f"near {digits(settings.near)}: "
        with np.errstate(invalid="ignore", divide="ignore"):
            rms = np.sqrt(tally.depth_squares_px2 / tally.depth_pixels)
        curves = ("rms", rms, "solid"), ("largest", tally.depth_max_px, "dot")
        for word, values, dash in curves:
            shown = zip(values.tolist(), tally.depth_pixels > 0, strict=True)
            heights = [value if is_shown and value > 0 else None for value, is_shown in shown]
            drawn += [height for height in heights if height is not None]
            lines.append(
                {
                    "x": names,
                    "y": heights,
                    "mode": "lines+markers",
                    "marker": {"symbol": marker},
                    "line": {"color": color, "dash": dash},
                    "name": f"{label}{word}",
                }
            )
    layout = {
        "height": 380,
        "xaxis": {"title": f"|z| of the content, {found.scene.units}", "type": "category"},
        "yaxis": {"title": "displacement, px", **log_axis(drawn)},
    }
    return styled(lines, layout)
