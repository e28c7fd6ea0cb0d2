"""`xfrustum report`: writes index.html, report.json and measurements.parquet, all or none."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from xfrustum.compare.extent import require_seen
from xfrustum.compare.scout import AutoApertures
from xfrustum.reference.plain import CERTIFIED, Decision
from xfrustum.reports.common.geometry import CameraGeometry, geometry_grid
from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.error_report.best import Recommendation
from xfrustum.reports.error_report.light import LightReport, measure_light
from xfrustum.reports.error_report.page import render_page
from xfrustum.reports.error_report.record import headline, recommended_command, report_content, write_parquet
from xfrustum.reports.error_report.sweep import (
    DEFAULT_DEPTHS,
    DepthBuffer,
    How,
    Sweep,
    default_nears,
    settings_grid,
    sweep,
)
from xfrustum.reports.inspection.page import (
    PAGE,
    Inspection,
    PlateMap,
    replacing_inspection,
    write_inspection,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.notebook import digits
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum, Fit, Offset, Pivot
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """The files of a report, and what it found.

    Attributes
    ----------
    best, sentence, command
        The best setting with its numbers at the worst aperture; the recommendation in words; and the command
        that draws with it.
    content
        The object in report.json.
    notes
        Further sentences: how much of the plate was measured, and what is left out.
    cost
        Time that the sweep took, in words.
    """

    html: Path
    json: Path
    parquet: Path
    inspection: Path
    best: Recommendation
    sentence: str
    content: dict[str, Any]
    notes: tuple[str, ...]
    cost: str
    command: str

    @property
    def places(self) -> dict[str, Path]:
        """Paths of all files by their kind."""
        return {"html": self.html, "json": self.json, "parquet": self.parquet, "inspection": self.inspection}


FILES = ("index.html", "report.json", "measurements.parquet", PAGE)
"""Names of the files that a report writes; what is too large for its inspection page has files of its own."""


def default_folder(scene: Scene) -> Path:
    """Return where a report goes unless told otherwise: `report/NAME` in the current folder."""
    name = re.sub(r"[^\w.-]+", "-", scene.name).strip("-.") or "scene"
    return Path("report") / name


def make_report(  # noqa: PLR0913 - one parameter per option of the command
    scene: Scene,
    out: Path | str | None = None,
    *,
    nears: Sequence[float] | None = None,
    apertures: Sequence[Aperture] | AutoApertures | None = None,
    depths: Sequence[DepthBuffer] | None = None,
    pivots: Sequence[Pivot] | None = None,
    fits: Sequence[Fit | float] | None = None,
    offsets: Sequence[Offset] | None = None,
    slabs: Sequence[tuple[float, ...]] | None = None,
    tracer: str = "embree",
    effects: str = "auto",
    cull: Cull = Cull.NONE,
    decided_by: str = CERTIFIED,
    causes: bool = True,
    progress: bool = False,
) -> ReportFiles:
    """Measure the error of a scene over settings and write index.html, report.json, measurements.parquet.

    Parameters
    ----------
    out
        Folder for the files; `default_folder` where None. No file appears in it before all are complete.
    nears, depths
        Near planes in scene units, each between 0 and the reach, and depth formats with mappings; where None
        25 logarithmic ones and `DEFAULT_DEPTHS`.
    apertures
        Apertures to measure; where None the middle one and, if the frustum is recentered, two corners. With
        those that `auto_apertures` chooses, the page has a map of the plate.
    pivots, fits, offsets, slabs
        Camera geometries, every combination of which is measured; see `geometry_grid`.
    tracer, effects
        Reference that traces the truth, and effects that are simulated, as `--effects` takes them: `auto`,
        `all`, or names between commas.
    cull
        Faces that all settings leave out.
    decided_by
        What decides the truths: `certified`, or a tracer alone, of which nothing is examined.
    causes, progress
        Whether wrong pixels are charged to causes, and errors predicted; whether there is a progress bar.

    Raises
    ------
    InputError
        A setting that makes no sense, nothing to measure or to see, an unwritable folder, no OpenGL.
    """
    chosen = _apertures(scene, apertures)
    settings = _settings(scene, nears, depths, geometry_grid(scene.frustum, pivots, fits, offsets, slabs))
    settings = tuple(replace(one, cull=cull) for one in settings)
    if not settings or not chosen:
        raise InputError("nothing to measure: give at least one near, one depth format and one aperture")
    require_seen(scene, chosen)
    with Staging(default_folder(scene) if out is None else Path(out), FILES) as staging:
        by = Decision(by=decided_by, tracer=tracer)
        how = How(decision=by, effects=effects, causes=causes, progress=progress)
        # The page shows a map of what a scout has chosen.
        auto = apertures if isinstance(apertures, AutoApertures) else None
        measured = replace(sweep(scene, chosen, settings, how), auto=auto)
        begun = time.perf_counter()
        light = measure_light(scene, chosen, settings, effects=effects, progress=progress)
        if light is not None:
            measured = measured.with_stage("light", time.perf_counter() - begun)
        content = _write(staging.folder, measured, light)
        with replacing_inspection(staging.out):
            staging.commit()
    notes = [measured.coverage_sentence, measured.left_out_sentence, *(light.sentences() if light else ())]
    return ReportFiles(
        html=staging.out / FILES[0],
        json=staging.out / FILES[1],
        parquet=staging.out / FILES[2],
        inspection=staging.out / PAGE,
        best=measured.best,
        sentence=headline(measured),
        content=content,
        notes=tuple(filter(None, notes)),
        cost=measured.cost_sentence,
        command=recommended_command(measured),
    )


def _apertures(scene: Scene, given: Sequence[Aperture] | AutoApertures | None) -> tuple[Aperture, ...]:
    """Return the apertures to measure, each once."""
    if given is None:
        given = scene.default_apertures()
    return tuple(dict.fromkeys(given.apertures if isinstance(given, AutoApertures) else given))


def _settings(
    scene: Scene,
    nears: Sequence[float] | None,
    depths: Sequence[DepthBuffer] | None,
    geometries: Sequence[CameraGeometry],
) -> tuple[DoubleFrustum, ...]:
    """Return every near with every depth buffer and geometry, each once, checked against the scene.

    Without an offset the near plane clips, so that it must lie before the first cut: larger nears are left
    out where they are none that anybody asked for.
    """
    chosen = tuple(dict.fromkeys(default_nears(scene.frustum) if nears is None else nears))
    buffers = tuple(dict.fromkeys(DEFAULT_DEPTHS if depths is None else depths))
    settings: list[DoubleFrustum] = []
    for geometry in geometries:
        usable = [near for near in chosen if nears is not None or geometry.admits(near, scene.frustum)]
        settings += settings_grid(usable, buffers, [geometry])
    for setting in settings:
        setting.check_against(scene.frustum)
    return tuple(settings)


def _write(folder: Path, measured: Sweep, light: LightReport | None) -> dict[str, Any]:
    """Write the files; return what report.json holds."""
    (folder / "index.html").write_text(render_page(measured, light), encoding="utf-8")
    content = report_content(measured, light)
    write_inspection(folder, _inspection(measured))
    write_json(folder / "report.json", content)
    write_parquet(measured, folder / "measurements.parquet")
    return content


def _inspection(sweep: Sweep) -> Inspection:
    """Return what the inspection page of a sweep shows."""
    best = sweep.best.settings
    shares = [(*row.aperture.index, row.surface_fraction) for row in sweep.rows if row.settings == best]
    drawn = f"near {digits(best.near)}, {best.depth_label}"
    return Inspection(
        command="report",
        scene=sweep.scene,
        told=(f"The apertures of the report, drawn with its best setting: {drawn}.",),
        hogels=sweep.inspected,
        plate_map=PlateMap.of(sweep.scene.plate, "Share of wrong surfaces", shares),
    )
