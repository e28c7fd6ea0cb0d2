"""What a survey leaves behind: the page and survey.json, beside the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.provenance import versions
from xfrustum.reports.common.raster_command import raster_command
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.inspection import page as inspection
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.reports.inspection.plate_map import PlateMap
from xfrustum.reports.survey.answer import Survey, percent_up
from xfrustum.reports.survey.figures import depth_figure, distribution_figure, map_figures, words_of
from xfrustum.reports.survey.hogels import Pictures
from xfrustum.reports.survey.tally import FRACTION, P99, SURFACE, WorstHogel

FILES = PAGE, DATA, INSPECTION = "index.html", "survey.json", inspection.PAGE


@dataclass(frozen=True, kw_only=True)
class Pictured:
    """One of the worst hogels with its pictures, data URLs by what they show; none where it is missing.

    `inspected` has all its channels; None where it is missing.
    """

    worst: WorstHogel
    pictures: Pictures
    inspected: InspectedHogel | None = None


def _readable(value: float) -> str:
    """Write a number with three digits, and thousands in full: `7,470` and no `7.47e3`."""
    return f"{float(f'{value:.3g}'):,.0f}" if 1e3 <= abs(value) < 1e9 else digits(value)


def write_survey(found: Survey, pictured: Sequence[Pictured], out: Path) -> tuple[Path, ...]:
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


def _inspection(found: Survey, pictured: Sequence[Pictured]) -> inspection.Inspection:
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
        hogels=[one.inspected for one in pictured if one.inspected is not None],
        plate_map=plate_map,
    )


def render_page(found: Survey, pictured: Sequence[Pictured]) -> str:
    """Return one HTML document that needs nothing else; of the same rows, always the same."""
    scene = found.scene
    depth = depth_figure(found)
    maps = map_figures(found)
    places = {f"map-{number}": figure for number, figure in enumerate(maps)}
    figures = {**places, "distribution": distribution_figure(found)}
    if depth is not None:
        figures["depth"] = depth
    settings = found.settings[found.best]
    worst = pictured[0].worst.aperture if pictured else None
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
