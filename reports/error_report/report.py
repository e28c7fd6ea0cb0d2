"""`xfrustum report`: writes index.html, report.json and measurements.parquet, all or none."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from xfrustum.compare.extent import require_seen
from xfrustum.compare.metrics.error_maps import CONFIDENCE
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.json_ready import json_object, json_ready, write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.provenance import plan_command, raster_command, unexamined_truth
from xfrustum.reports.common.records import table_of
from xfrustum.reports.error_report.best import Recommendation, best_per_depth, best_per_geometry, sentence
from xfrustum.reports.error_report.measurement import TableRow
from xfrustum.reports.error_report.page import render_page
from xfrustum.reports.error_report.settings import ReportOptions, settings_of
from xfrustum.reports.error_report.sweep import LEFT_OUT, Sweep, sweep
from xfrustum.reports.inspection.page import (
    PAGE,
    Inspection,
    PlateMap,
    replacing_inspection,
    write_inspection,
)
from xfrustum.reports.scout import scout_record
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits

FILES = ("index.html", "report.json", "measurements.parquet", PAGE)
"""Names of the files that a report writes; what is too large for its inspection page has files of its own."""


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """The files of a report, and what it found."""

    html: Path
    json: Path
    parquet: Path
    inspection: Path
    #: The best setting with its numbers at the worst aperture, in words, and the command that draws with it.
    best: Recommendation
    sentence: str
    command: str
    #: The object in report.json.
    content: dict[str, Any]
    #: Further sentences: how much of the plate was measured, and what is left out; and the time that it took.
    notes: tuple[str, ...]
    cost: str

    @property
    def places(self) -> dict[str, Path]:
        """Paths of all files by their kind."""
        return {"html": self.html, "json": self.json, "parquet": self.parquet, "inspection": self.inspection}


def default_folder(scene: Scene) -> Path:
    """Return where a report goes unless told otherwise: `report/NAME` in the current folder."""
    name = re.sub(r"[^\w.-]+", "-", scene.name).strip("-.") or "scene"
    return Path("report") / name


def make_report(
    scene: Scene, out: Path | str | None = None, options: ReportOptions | None = None
) -> ReportFiles:
    """Measure the error of a scene over settings and write index.html, report.json, measurements.parquet.

    They go into the folder `out`, by default `default_folder`, where no file appears before all are complete.

    Raises
    ------
    InputError
        A setting that makes no sense, nothing to measure or to see, an unwritable folder, no OpenGL.
    """
    options = options or ReportOptions()
    given = scene.default_apertures() if options.apertures is None else options.apertures
    apertures = tuple(dict.fromkeys(given.apertures if isinstance(given, AutoApertures) else given))
    settings = settings_of(scene.frustum, options)
    if not settings or not apertures:
        raise InputError("nothing to measure: give at least one near, one depth format and one aperture")
    require_seen(scene, apertures)
    with Staging(default_folder(scene) if out is None else Path(out), FILES) as staging:
        measured = sweep(scene, apertures, settings, options)
        said = headline(measured)
        command = raster_command(scene, measured.best.aperture, measured.best.settings)
        (staging.folder / FILES[0]).write_text(render_page(measured, said, command), encoding="utf-8")
        write_inspection(staging.folder, _inspection(measured))
        content = report_content(measured, said, command)
        write_json(staging.folder / FILES[1], content)
        write_parquet(measured, staging.folder / FILES[2])
        with replacing_inspection(staging.out):
            staging.commit()
    notes = [measured.coverage_sentence, measured.left_out_sentence]
    notes += measured.light.sentences() if measured.light else ()
    return ReportFiles(
        html=staging.out / FILES[0],
        json=staging.out / FILES[1],
        parquet=staging.out / FILES[2],
        inspection=staging.out / PAGE,
        best=measured.best,
        sentence=said,
        command=command,
        content=content,
        notes=tuple(filter(None, notes)),
        cost=measured.cost_sentence,
    )


def headline(measured: Sweep) -> str:
    """Return the recommendation of a sweep in words; it says so where a tracer alone made the truths."""
    frustum = measured.scene.frustum
    said = sentence(measured.rows, measured.scene.units, frustum.longest_reach, recentered=frustum.recentered)
    if measured.decided_by == CERTIFIED:
        return said
    return f"{said.removesuffix('.')} ({unexamined_truth(measured.decided_by)})."


def _inspection(measured: Sweep) -> Inspection:
    """Return what the inspection page of a sweep shows."""
    best = measured.best.settings
    shares = [(*row.aperture.index, row.surface_fraction) for row in measured.rows if row.settings == best]
    drawn = f"near {digits(best.near)}, {best.depth_label}"
    return Inspection(
        command="report",
        scene=measured.scene,
        told=(f"The apertures of the report, drawn with its best setting: {drawn}.",),
        hogels=measured.inspected,
        plate_map=PlateMap.of(measured.scene.plate, "Share of wrong surfaces", shares),
    )


def write_parquet(measured: Sweep, path: Path) -> None:
    """Write one row per aperture and setting, whose columns follow from `TableRow`."""
    scene = measured.scene
    made_by = {"scene_name": scene.name, "scene_source": scene.source, "scene_hash": scene.content_hash}
    made_by |= {"units": scene.units, "decided_by": measured.decided_by}
    made_by |= {f"version_{name}": version for name, version in measured.versions.items()}
    made_by |= {f"device_{name}": value for name, value in measured.devices.items()}
    rows = [row.table_row(scene.frustum.longest_reach, made_by) for row in measured.rows]
    pq.write_table(table_of(TableRow, rows), path.absolute())


def report_content(measured: Sweep, said: str, command: str) -> dict[str, Any]:
    """Return the object in report.json; the headline and the command to be copied are made already."""
    scene, reach = measured.scene, measured.scene.frustum.longest_reach

    def recommended(best: Recommendation) -> dict[str, Any]:
        return {
            **json_object(best.settings),
            "near_per_reach": best.settings.near / reach,
            "surface_fraction": best.surface_fraction,
            "displacement_p99_px": best.displacement_p99_px,
            "radiance_fraction": best.radiance_fraction,
            "window": best.window,
            # The one with most wrong surfaces.
            "aperture": best.aperture.index,
        }

    content: dict[str, Any] = json_ready(
        {
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
                "sentence": said,
                **recommended(measured.best),
                "command": command,
                "plan_command": plan_command(scene),
                "confidence": CONFIDENCE,
            },
            "best_per_depth": [recommended(best) for best in best_per_depth(measured.rows)],
            "best_per_geometry": [recommended(best) for best in best_per_geometry(measured.rows)],
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
    )
    return content
