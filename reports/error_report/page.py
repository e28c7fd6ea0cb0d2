"""The page: one HTML file with its pictures, its plots and plotly.js inside."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass, fields

import plotly.graph_objects as go

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.paired import CONFIDENCE
from xfrustum.compare.prediction.predict import Prediction
from xfrustum.compare.run import StageTimes
from xfrustum.compare.scouting.scout import FILM_PIXELS
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common import formatting
from xfrustum.reports.common.geometry import CameraGeometry, geometry_names
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.error_report import causes, figures, geometries, images, shading_page
from xfrustum.reports.error_report.shading import ShadingReport, milliseconds
from xfrustum.reports.error_report.tables import headline, recommended_command
from xfrustum.reports.measurements import best
from xfrustum.reports.measurements.measurement import (
    Measurement,
    Ratios,
    SettingPictures,
    StageParts,
    Sweep,
)
from xfrustum.reports.scene_check.page_section import scene_fit
from xfrustum.reports.scouting.map import map_figures
from xfrustum.scenes.model.hogel_image import Certainty
from xfrustum.scenes.plate.double_frustum import Cull
from xfrustum.scenes.plate.plate import Aperture

SPARSE_FRACTION = 0.002
"""Share of judged pixels below which marks get halos, as in `report.js`: one pixel in 22 by 22."""

_CERTAINTY_WORDS = {
    Certainty.PROVEN: "proven in floating point",
    Certainty.EXACT: "decided in rational arithmetic",
    Certainty.TIE: "tie, not judged",
    Certainty.UNEXAMINED: "not examined",
}


@dataclass(frozen=True, kw_only=True)
class PageRow:
    """One row as the page's script reads it; pictures by the keys of `PageData.pictures`.

    `causes` are the numbers of pixels with the wrong surface that are charged to each link. Where causes were
    left out there are none, and no predictions.
    """

    aperture: tuple[int, int]
    geometry: int
    depth: str
    near: float
    comparison: ComparisonNumbers
    predicted: Prediction | None
    predicted_surface: float | None
    ratio: Ratios
    times_s: StageTimes
    parts_s: StageParts
    pictures: dict[str, str]
    causes: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class AloneFigure:
    """Pixels that a tracer alone would have got wrong at an aperture; pictures as data addresses."""

    title: str
    color: str
    wrong: int
    judged: int
    truth: str
    marks: str

    @property
    def sparse(self) -> bool:
        """Whether the marks need halos to be seen."""
        return self.wrong < SPARSE_FRACTION * self.judged


@dataclass(frozen=True, kw_only=True)
class PageData:
    """What the page's script reads.

    Attributes
    ----------
    rows
        One for each aperture and setting.
    geometries
        Names of the camera geometries, which the rows number.
    cause_colors
        Color of each cause in the pictures of causes.
    apertures
        Column and row of each aperture.
    truths
        Key of each aperture's true picture.
    start
        Number of the row that is shown first.
    units, reach
        Length unit of the scene, and its longest reach.
    pictures
        Data addresses by key; each picture once, however many settings share it.
    curves
        Figures of each aperture and geometry by name; None where a figure shows no point.
    eye
        Figure of the bent eye vector, where there is one.
    times
        Figure of the stages' times.
    scout
        The maps of the plate, where apertures were chosen by a scout.
    """

    rows: tuple[PageRow, ...]
    geometries: tuple[str, ...]
    cause_colors: dict[str, str]
    apertures: tuple[tuple[int, int], ...]
    truths: tuple[str, ...]
    start: int
    units: str
    reach: float
    pictures: dict[str, str]
    curves: tuple[tuple[dict[str, go.Figure | None], ...], ...]
    eye: go.Figure | None
    times: go.Figure
    scout: tuple[go.Figure, ...]


def render_page(sweep: Sweep, shading: ShadingReport | None = None) -> str:
    """Return the report as one HTML document that needs nothing else, online or offline."""
    reach = sweep.scene.frustum.longest_reach
    values = {
        "scene": sweep.scene,
        "fit": scene_fit(sweep.scene),
        "frustum": _frustum_words(sweep),
        "reach": reach,
        "sentence": headline(sweep),
        "coverage": sweep.coverage_sentence,
        "can_be_judged": best.can_be_judged(sweep.rows),
        "best": best.best_setting(sweep.rows),
        "command": recommended_command(sweep),
        "near_range": best.near_range,
        "unseen_px": best.UNSEEN_DISPLACEMENT_PX,
        "confidence": CONFIDENCE,
        "per_depth": best.best_per_depth(sweep.rows),
        "apertures": sweep.apertures,
        "auto": sweep.auto,
        "scouted_lines": FILM_PIXELS**2,
        "settings_count": len({row.settings for row in sweep.rows}),
        "rows": sweep.rows,
        "certainty": _certainty_table(sweep),
        "decided_by": sweep.decided_by,
        "certified": sweep.decided_by == CERTIFIED,
        "alone": _alone_figures(sweep),
        "versions": sweep.versions,
        "devices": sweep.devices,
        "reduction": sweep.reduction,
        "displacement_colors": images.displacement_scale(),
        "displacement_range": images.DISPLACEMENT_RANGE_PX,
        "height_colors": images.height_scale(),
        "height_range": images.height_range(sweep.scene, reach),
        "surface_color": images.SURFACE_COLOR,
        "triangle_color": images.TRIANGLE_COLOR,
        "shading": shading_page.context(shading),
        "equally_good": best.equally_good_sentence(sweep.rows),
        "total_s": sweep.wall_s,
        "cost": sweep.cost_sentence,
        "geometries": geometries.context(sweep),
        "dominant": _dominant(sweep),
        "unexplained": sum(row.unexplained or 0 for row in sweep.rows),
        "charged": sweep.charged,
        "left_out": sweep.left_out_sentence,
        "page_data": _page_data(sweep, shading),
    }
    filters = {
        "percent": formatting.percent,
        "pixels": best.pixels,
        "digits": formatting.digits,
        "milliseconds": milliseconds,
    }
    return html_page("report.html.j2", filters, values)


def _page_data(sweep: Sweep, shading: ShadingReport | None) -> PageData:
    """Return what the page's script reads."""
    pictures: dict[str, str] = {}
    rows = tuple(
        _row_data(row, own, pictures, sweep.geometries.index(CameraGeometry.of(row.settings)))
        for row, own in zip(sweep.rows, sweep.pictures, strict=True)
    )
    names = geometry_names(sweep.geometries)
    chosen = best.best_setting(sweep.rows)
    start = next(
        number
        for number, row in enumerate(sweep.rows)
        if row.settings == chosen.settings and row.aperture == chosen.aperture
    )
    return PageData(
        rows=rows,
        cause_colors=causes.CAUSE_COLORS,
        geometries=tuple(names[one] for one in sweep.geometries),
        apertures=tuple(aperture.index for aperture in sweep.apertures),
        truths=tuple(_keep(encoded, pictures) for encoded in sweep.truths),
        start=start,
        units=sweep.scene.units,
        reach=sweep.scene.frustum.longest_reach,
        pictures=pictures,
        curves=tuple(
            tuple(_curves(sweep, shading, aperture, one) for one in sweep.geometries)
            for aperture in sweep.apertures
        ),
        eye=shading_page.eye_figure(shading),
        times=figures.stage_times(sweep),
        scout=map_figures(sweep.auto) if sweep.auto else (),
    )


def _dominant(sweep: Sweep) -> list[tuple[str, list[str]]]:
    """Return which causes dominate, under a heading for each aperture and geometry.

    Those of the best setting, at the aperture at which it is worst, come first.
    """
    if not sweep.charged:
        return []
    names = geometry_names(sweep.geometries)
    chosen = best.best_setting(sweep.rows)
    first = CameraGeometry.of(chosen.settings)
    found = []
    for aperture in sorted(sweep.apertures, key=lambda one: one != chosen.aperture):
        for geometry in sorted(sweep.geometries, key=lambda one: one != first):
            name = names[geometry] if len(sweep.geometries) > 1 else ""
            heading = f"Aperture {aperture.column},{aperture.row}" + (f", {name}" if name else "")
            rows = [row for _, row in sweep.numbered(aperture, geometry)]
            found.append((heading, causes.sentences(rows, sweep.scene.units)))
    return found


def _curves(
    sweep: Sweep, shading: ShadingReport | None, aperture: Aperture, geometry: CameraGeometry
) -> dict[str, go.Figure | None]:
    """Return the figures of an aperture and geometry by name; None for those without a point."""
    reach, rows = sweep.scene.frustum.longest_reach, sweep.numbered(aperture, geometry)
    drawn = figures.curves(rows, reach) | shading_page.curves(shading, rows, reach)
    drawn |= geometries.comparison_figures(sweep, aperture)
    curves = {name: None if figures.is_blank(figure) else figure for name, figure in drawn.items()}
    return curves | ({"causes": causes.cause_figure(rows, reach)} if sweep.charged else {})


def _row_data(row: Measurement, own: SettingPictures, pictures: dict[str, str], geometry: int) -> PageRow:
    return PageRow(
        aperture=row.aperture.index,
        geometry=geometry,
        depth=row.settings.depth_label,
        near=row.settings.near,
        comparison=row.comparison,
        predicted=row.predicted,
        predicted_surface=row.predicted.surface_fraction if row.predicted else None,
        ratio=row.measured_over_predicted,
        times_s=row.times_s,
        parts_s=row.parts_s,
        pictures={
            f.name: _keep(encoded, pictures)
            for f in fields(own)
            if (encoded := getattr(own, f.name)) is not None
        },
        causes={cause.name: cause.surface for cause in row.causes},
    )


def _keep(encoded: bytes, pictures: dict[str, str]) -> str:
    """Store a picture once, however many settings share it, and return its key."""
    key = hashlib.sha256(encoded).hexdigest()[:16]
    if key not in pictures:
        pictures[key] = _address(encoded)
    return key


def _address(encoded: bytes) -> str:
    """Return a picture as a data address."""
    return f"data:{images.media_type(encoded)};base64,{base64.b64encode(encoded).decode()}"


def _certainty_table(sweep: Sweep) -> list[tuple[str, list[int]]]:
    """Return one line per class of certainty and per tracer: words, and a number for each aperture."""
    first = {row.aperture: row.comparison.certainty for row in reversed(sweep.rows)}
    return [
        *(
            (words, [first[aperture].get(kind.name.lower(), 0) for aperture in sweep.apertures])
            for kind, words in _CERTAINTY_WORDS.items()
        ),
        *_alone_table(sweep),
    ]


def _alone_table(sweep: Sweep) -> list[tuple[str, list[int]]]:
    """Return one line per tracer; none where the truths are not certified."""
    if not sweep.alone:
        return []
    return [
        ("would have been wrong by Embree alone", [alone.numbers.embree for alone in sweep.alone]),
        ("would have been wrong by Mitsuba alone", [alone.numbers.mitsuba for alone in sweep.alone]),
    ]


def _alone_figures(sweep: Sweep) -> list[AloneFigure]:
    """Return a figure for each aperture and tracer that would have got pixels wrong alone."""
    return [
        AloneFigure(
            title=f"{name.capitalize()} alone, aperture {aperture.column},{aperture.row}",
            color=images.ALONE_COLORS[name],
            wrong=getattr(alone.numbers, name),
            judged=alone.numbers.judged,
            truth=_address(alone.pictures["truth"]),
            marks=_address(alone.pictures[name]),
        )
        for aperture, alone in zip(sweep.apertures, sweep.alone, strict=False)
        for name in images.ALONE_COLORS
        if name in alone.pictures
    ]


def _frustum_words(sweep: Sweep) -> str:
    frustum = sweep.scene.frustum
    width, height = frustum.resolution
    toward, behind = frustum.reach
    kind = "recentered" if frustum.recentered else "centered"
    units = sweep.scene.units
    culled = "" if sweep.rows[0].settings.cull is Cull.NONE else ", faces turned away from the viewer culled"
    return (
        f"{kind} frustum, {width} x {height} pixels, "
        f"reaching {toward:g} {units} toward the viewer and {behind:g} {units} behind the plate{culled}"
    )
