"""The page: one HTML file with its pictures, its plots and plotly.js inside."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from typing import Any

import plotly.graph_objects as go

from xfrustum.compare.metrics.paired import CONFIDENCE
from xfrustum.compare.scout import FILM_PIXELS
from xfrustum.reference.plain import CERTIFIED
from xfrustum.reports.common.geometry import CameraGeometry, geometry_names
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.error_report import best, causes, figures, geometries, images
from xfrustum.reports.error_report.light import LightReport
from xfrustum.reports.error_report.measurement import Measurement, SettingPictures
from xfrustum.reports.error_report.record import headline, recommended_command
from xfrustum.reports.error_report.sweep import Sweep
from xfrustum.reports.scene_check.drawing import scene_fit
from xfrustum.reports.scout import map_figures
from xfrustum.scenes.model.hogel_image import Certainty
from xfrustum.scenes.notebook import digits, percent
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


def render_page(sweep: Sweep, light: LightReport | None = None) -> str:
    """Return the report as one HTML document that needs nothing else, online or offline."""
    scene, reach = sweep.scene, sweep.scene.frustum.longest_reach
    values = {
        "scene": scene,
        "fit": scene_fit(scene),
        "frustum": _frustum_words(sweep),
        "reach": reach,
        "sentence": headline(sweep),
        "coverage": sweep.coverage_sentence,
        "can_be_judged": best.can_be_judged(sweep.rows),
        "best": sweep.best,
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
        "height_range": images.height_range(scene, reach),
        "surface_color": images.SURFACE_COLOR,
        "triangle_color": images.TRIANGLE_COLOR,
        "shading": light,
        "equally_good": best.equally_good_sentence(sweep.rows),
        "cost": sweep.cost_sentence,
        "geometries": geometries.context(sweep),
        "dominant": _dominant(sweep),
        "unexplained": sum(row.unexplained or 0 for row in sweep.rows),
        "charged": sweep.charged,
        "left_out": sweep.left_out_sentence,
        "page_data": _page_data(sweep, light),
    }
    filters = {"percent": percent, "pixels": best.pixels, "digits": digits}
    return html_page("report.html.j2", filters, values)


def _page_data(sweep: Sweep, light: LightReport | None) -> dict[str, Any]:
    """Return what the page's script reads; each picture is there once, however many settings share it."""
    pictures: dict[str, str] = {}
    names, chosen = geometry_names(sweep.geometries), sweep.best
    keys = [(row.settings, row.aperture) for row in sweep.rows]
    return {
        "rows": [
            _row_data(row, own, pictures, sweep.geometries.index(CameraGeometry.of(row.settings)))
            for row, own in zip(sweep.rows, sweep.pictures, strict=True)
        ],
        "cause_colors": causes.CAUSE_COLORS,
        "geometries": [names[one] for one in sweep.geometries],
        "apertures": [aperture.index for aperture in sweep.apertures],
        "truths": [_keep(encoded, pictures) for encoded in sweep.truths],
        "start": keys.index((chosen.settings, chosen.aperture)),
        "units": sweep.scene.units,
        "reach": sweep.scene.frustum.longest_reach,
        "pictures": pictures,
        "curves": [
            [_curves(sweep, light, aperture, one) for one in sweep.geometries] for aperture in sweep.apertures
        ],
        "eye": light and light.eye_figure,
        "scout": map_figures(sweep.auto) if sweep.auto else (),
    }


def _dominant(sweep: Sweep) -> list[tuple[str, list[str]]]:
    """Return which causes dominate, under a heading for each aperture and geometry.

    Those of the best setting, at the aperture at which it is worst, come first.
    """
    if not sweep.charged:
        return []
    names, chosen = geometry_names(sweep.geometries), sweep.best
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
    sweep: Sweep, light: LightReport | None, aperture: Aperture, geometry: CameraGeometry
) -> dict[str, go.Figure | None]:
    """Return the figures of an aperture and geometry by name; None for those without a point."""
    reach, rows = sweep.scene.frustum.longest_reach, sweep.numbered(aperture, geometry)
    drawn = figures.curves(rows, reach) | (light.curves(rows) if light else {})
    drawn |= geometries.comparison_figures(sweep, aperture)
    curves = {name: None if figures.is_blank(figure) else figure for name, figure in drawn.items()}
    return curves | ({"causes": causes.cause_figure(rows, reach)} if sweep.charged else {})


def _row_data(
    row: Measurement, own: SettingPictures, pictures: dict[str, str], geometry: int
) -> dict[str, Any]:
    encoded = {one.name: getattr(own, one.name) for one in fields(own)}
    return {
        "aperture": row.aperture.index,
        "geometry": geometry,
        "depth": row.settings.depth_label,
        "near": row.settings.near,
        "comparison": row.comparison,
        "predicted": row.predicted,
        "predicted_surface": row.predicted.surface_fraction if row.predicted else None,
        "ratio": row.measured_over_predicted,
        "times_s": row.times_s,
        "parts_s": row.parts_s,
        "pictures": {name: _keep(one, pictures) for name, one in encoded.items() if one is not None},
        "causes": {cause.name: cause.surface for cause in row.causes},
    }


def _keep(encoded: bytes, pictures: dict[str, str]) -> str:
    """Store a picture once, however many settings share it, and return its key."""
    key = hashlib.sha256(encoded).hexdigest()[:16]
    if key not in pictures:
        pictures[key] = images.address(encoded)
    return key


def _certainty_table(sweep: Sweep) -> list[tuple[str, list[int]]]:
    """Return one line per class of certainty and per tracer: words, and a number for each aperture."""
    first = {row.aperture: row.comparison.certainty for row in reversed(sweep.rows)}
    found = [
        (words, [first[aperture].get(kind.name.lower(), 0) for aperture in sweep.apertures])
        for kind, words in _CERTAINTY_WORDS.items()
    ]
    for name in images.ALONE_COLORS if sweep.alone else ():
        wrong = [getattr(alone.numbers, name) for alone in sweep.alone]
        found.append((f"would have been wrong by {name.capitalize()} alone", wrong))
    return found


def _alone_figures(sweep: Sweep) -> list[dict[str, Any]]:
    """Return a figure for each aperture and tracer that would have got pixels wrong alone."""
    return [
        {
            "title": f"{name.capitalize()} alone, aperture {aperture.column},{aperture.row}",
            "color": images.ALONE_COLORS[name],
            "wrong": (wrong := getattr(alone.numbers, name)),
            "judged": alone.numbers.judged,
            "sparse": wrong < SPARSE_FRACTION * alone.numbers.judged,
            "truth": images.address(alone.pictures["truth"]),
            "marks": images.address(alone.pictures[name]),
        }
        for aperture, alone in zip(sweep.apertures, sweep.alone, strict=False)
        for name in images.ALONE_COLORS
        if name in alone.pictures
    ]


def _frustum_words(sweep: Sweep) -> str:
    frustum, units = sweep.scene.frustum, sweep.scene.units
    (width, height), (toward, behind) = frustum.resolution, frustum.reach
    kind = "recentered" if frustum.recentered else "centered"
    culled = "" if sweep.rows[0].settings.cull is Cull.NONE else ", faces turned away from the viewer culled"
    return (
        f"{kind} frustum, {width} x {height} pixels, "
        f"reaching {toward:g} {units} toward the viewer and {behind:g} {units} behind the plate{culled}"
    )
