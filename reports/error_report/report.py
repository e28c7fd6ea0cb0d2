"""`xfrustum report`: measures a scene over settings, and writes page, numbers and inspection.

Its index.html, report.json, measurements.parquet and inspect.html appear together or not at all.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from xfrustum.compare.metrics.error_maps import CONFIDENCE
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference import alone
from xfrustum.reports import inspection
from xfrustum.reports.common import provenance
from xfrustum.reports.common.outputs import Staging, json_object
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report import words
from xfrustum.reports.error_report.best import (
    Recommendation,
    TableRow,
    best_per_depth,
    best_per_geometry,
)
from xfrustum.reports.error_report.page import render_page
from xfrustum.reports.error_report.request import ReportOptions, settings_of
from xfrustum.reports.error_report.sweep import LEFT_OUT, Sweep, sweep
from xfrustum.reports.heat_map import scout_record
from xfrustum.reports.inspection import Inspection, PlateMap
from xfrustum.reports.scene_check.sight import require_seen
from xfrustum.scenes import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.representation import digits

FILES = ("index.html", "report.json", "measurements.parquet", inspection.PAGE)
"""Names of the files of a report."""


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """Files of a report, and its results."""

    html: Path
    json: Path
    parquet: Path
    inspection: Path
    #: The best setting with its numbers at the worst aperture, in words, and the command that draws
    #: with it.
    best: Recommendation
    sentence: str
    command: str
    #: The object in report.json.
    content: dict[str, Any]
    #: Further sentences: the measured share of the plate, omitted parts; and the times.
    notes: tuple[str, ...]
    cost: str

    @property
    def places(self) -> dict[str, Path]:
        """Paths of all files by their kind."""
        return {kind: getattr(self, kind) for kind in ("html", "json", "parquet", "inspection")}


def default_folder(scene: Scene) -> Path:
    """Return the default folder of a report: `report/NAME` in the current folder."""
    name = re.sub(r"[^\w.-]+", "-", scene.name).strip("-.") or "scene"
    return Path("report") / name


def make_report(
    scene: Scene, out: Path | str | None = None, options: ReportOptions | None = None
) -> ReportFiles:
    """Measure the error of a scene over settings and write page, numbers and inspection.

    They go into the folder `out`, by default `default_folder`, where no file appears before all are
    complete.

    InputError where a setting makes no sense, there is nothing to measure or to see, the folder
    cannot be written, or there is no OpenGL.
    """
    options = options or ReportOptions()
    places = scene.default_apertures() if options.apertures is None else options.apertures
    if isinstance(places, AutoApertures):
        places = places.apertures
    apertures = tuple(dict.fromkeys(places))
    settings = settings_of(scene.frustum, options)
    if not settings or not apertures:
        raise InputError(
            "nothing to measure: give at least one near, one depth format and one aperture"
        )
    require_seen(scene, apertures)
    with Staging(default_folder(scene) if out is None else Path(out), FILES) as staging:
        measured = sweep(scene, apertures, settings, options)
        chosen, frustum = measured.best, scene.frustum
        sentence = words.recommendation(
            measured.rows, scene.units, frustum.longest_reach, recentered=frustum.recentered
        )
        if measured.decided_by != alone.CERTIFIED:
            note = provenance.unexamined_truth(measured.decided_by)
            sentence = f"{sentence.removesuffix('.')} ({note})."
        command = provenance.raster_command(scene, chosen.aperture, chosen.settings)
        staging.write(FILES[0], render_page(measured, sentence, command))
        rows = [row for row in measured.rows if row.settings == chosen.settings]
        shares = [(*row.aperture.index, row.surface_fraction) for row in rows]
        drawn = f"near {digits(chosen.settings.near)}, {chosen.settings.depth_label}"
        inspected = Inspection(
            command="report",
            scene=scene,
            intro=f"The apertures of the report, drawn with its best setting: {drawn}.",
            hogels=measured.inspected,
            plate_map=PlateMap.from_values(scene.plate, "Share of wrong surfaces", shares),
        )
        inspection.write_inspection(staging.folder, inspected)
        content = report_content(measured, sentence, command)
        staging.write(FILES[1], content)
        write_parquet(measured, staging.folder / FILES[2])
        with inspection.replacing_inspection(staging.out):
            staging.commit()
    notes = [words.coverage(measured), words.left_out(measured)]
    notes += words.missed_light(measured.light) if measured.light else ()
    kinds = zip(("html", "json", "parquet", "inspection"), FILES, strict=True)
    return ReportFiles(
        **{kind: staging.out / name for kind, name in kinds},
        best=chosen,
        sentence=sentence,
        command=command,
        content=content,
        notes=tuple(filter(None, notes)),
        cost=words.cost(measured),
    )


def write_parquet(measured: Sweep, path: Path) -> None:
    """Write one row per aperture and setting, whose columns follow from `TableRow`."""
    scene = measured.scene
    made_by = {
        "scene_name": scene.name,
        "scene_source": scene.source,
        "scene_hash": scene.content_hash,
    }
    made_by |= {"units": scene.units, "decided_by": measured.decided_by}
    made_by |= {f"version_{name}": version for name, version in measured.versions.items()}
    made_by |= {f"device_{name}": value for name, value in measured.devices.items()}
    rows = [row.table_row(scene.frustum.longest_reach, made_by) for row in measured.rows]
    pq.write_table(table_of(TableRow, rows), path.absolute())


def report_content(measured: Sweep, sentence: str, command: str) -> dict[str, Any]:
    """Return the record of report.json, given the headline and the command to copy."""
    scene, reach = measured.scene, measured.scene.frustum.longest_reach

    def recommended(choice: Recommendation) -> dict[str, Any]:
        names = ("surface_fraction", "displacement_p99_px", "radiance_fraction", "window")
        return {
            **json_object(choice.settings),
            "near_per_reach": choice.settings.near / reach,
            **{name: getattr(choice, name) for name in names},
            # The aperture with most wrong surfaces.
            "aperture": choice.aperture.index,
        }

    record = {
        "scene": {
            "name": scene.name,
            "source": scene.source,
            "hash": scene.content_hash,
            "units": scene.units,
            "objects": len(scene.objects),
            "triangles": len(scene.faces),
            "plate": scene.plate,
            "frustum": scene.frustum,
        },
        "apertures": measured.apertures,
        "best": {
            "sentence": sentence,
            **recommended(measured.best),
            "command": command,
            "plan_command": provenance.scene_command("plan", scene),
            "confidence": CONFIDENCE,
        },
        "best_per_depth": list(map(recommended, best_per_depth(measured.rows))),
        "best_per_geometry": list(map(recommended, best_per_geometry(measured.rows))),
        "rows": [
            {
                "aperture": row.aperture.index,
                **json_object(row.numbers(reach)),
                "causes": row.causes,
            }
            for row in measured.rows
        ],
        # Where a tracer alone made the truths, there is nothing to compare it with.
        "tracers_alone": [
            {"aperture": aperture.index, **json_object(truth.alone)}
            for aperture, truth in zip(measured.apertures, measured.truths, strict=True)
            if truth.alone is not None
        ],
        "decided_by": measured.decided_by,
        "versions": measured.versions,
        "devices": measured.devices,
        "device_model": measured.device_model,
        "times_s": measured.times_s,
        "cost": {
            "wall_s": measured.wall_s,
            "frames_s": measured.times_s["raster"],
            "truths_s": measured.times_s["trace"],
            "pictures_s": measured.times_s["pictures"],
        },
        "shading": measured.light and measured.light.record,
        "scout": scout_record(measured.auto) if measured.auto else None,
        "left_out": () if measured.options.causes else LEFT_OUT,
    }
    return json_object(record)
