"""The page: one HTML file with its pictures, its figures and plotly.js inside.

Every measured point of a figure carries its row number in the sweep as `customdata`, so that the
page can show the pictures of the point that was clicked.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from xfrustum.compare.metrics.comparison import Share
from xfrustum.compare.metrics.error_maps import CONFIDENCE
from xfrustum.compare.metrics.radiance import PIXELS_PER_DEGREE
from xfrustum.compare.scout import FILM_PIXELS
from xfrustum.reports.common.figure_style import COLORS, INK, Figure, log_axis, look, styled, titled
from xfrustum.reports.common.templates_environment import address, html_page
from xfrustum.reports.error_report import best, images, words
from xfrustum.reports.error_report.best import Measurement
from xfrustum.reports.error_report.images import CAUSE_COLORS
from xfrustum.reports.error_report.request import geometry_of
from xfrustum.reports.error_report.sweep import Sweep
from xfrustum.reports.error_report.words import geometry_names
from xfrustum.reports.heat_map import choices, map_figures
from xfrustum.reports.scene_check.checking import scene_fit
from xfrustum.reports.text import CERTAINTY_LABELS, SENTENCES, sentences
from xfrustum.scenes import Aperture, DoubleFrustum, Offset

Number = Callable[[Measurement], float | None]
Rows = Sequence[tuple[int, Measurement]]
"""Rows of one aperture and one camera geometry, with their numbers in the sweep."""

#: height of the panel of causes of one depth buffer on the page
PANEL_PIXELS = 170

SPARSE_FRACTION = 0.002
"""Share of judged pixels below which marks get halos, as in `report.js`: one pixel in 22 by 22."""

PERCENT = {"tickformat": "~%", "exponentformat": "none"}
"""Labels of an axis of shares in percent, as in sentences: 0.0001 as `0.01%`."""

_HOVER = "near %{x:.3g} of the reach<br>"
_CLOSED_FORM = {
    "name": "closed form",
    "mode": "lines",
    "line": {"color": INK, "dash": "dash", "width": 2},
}


def error_figures(rows: Rows, reach: float, *, shaded: bool) -> dict[str, Figure]:
    """Return the figures of one aperture and one camera geometry; `reach` in scene units."""
    triangles = _share_lines(rows, reach, lambda row: row.comparison.triangle)
    figures = {
        "surface": _surface_figure(rows, reach),
        "displacement_p99": _displacement_figure(
            rows, reach, "p99", "99th percentile of displacement, px"
        ),
        "displacement_rms": _displacement_figure(rows, reach, "rms", "rms displacement, px"),
        "triangle": _log_figure(triangles, "pixels with another triangle", PERCENT),
    }
    titles = {"rms": "rms radiance error, linear", "flip": "FLIP, mean over the picture"}
    for key, title in titles.items() if shaded else ():

        def error(row: Measurement, key: str = key) -> float | None:
            # A logarithmic axis has no zero: zeros are gaps.
            return getattr(row.comparison.radiance, key, None) or None

        # The script finds plots by these names.
        name = "radiance" if key == "rms" else key
        figures[name] = grouped_figure(_by_depth(rows), reach, error, title)
    return figures


def grouped_figure(
    groups: Mapping[str, Rows],
    reach: float,
    number: Number,
    title: str,
    axis: Mapping[str, Any] | None = None,
) -> Figure:
    """Draw a number of each row against near, a line for each named group; omit zeros."""
    return _log_figure(_lines(groups, reach, number, _HOVER + "%{y:.3g}"), title, axis)


def pair_figure(points: Sequence[tuple[float, float, float]], title: str) -> Figure:
    """Draw a measured number and its closed form, dashed, against near as a share of the reach."""
    marked = {"name": "measured", "mode": "lines+markers", "line": {"color": COLORS[1], "width": 2}}
    shared = {"x": [point[0] for point in points], "hovertemplate": _HOVER + "%{y:.3g}"}
    data: list[Figure] = [
        {**shared, "y": [point[place] or None for point in points], **drawn}
        for place, drawn in enumerate((marked, _CLOSED_FORM), start=1)
    ]
    return _log_figure(data, title)


def _share_lines(
    rows: Rows, reach: float, share: Callable[[Measurement], Share | None]
) -> list[Figure]:
    """Return lines of a share of pixels; zeros are hollow, at half a pixel on the log axis."""

    def known(row: Measurement) -> Share:
        counted = share(row)
        assert counted is not None, "a sweep has the scene and all triangles"
        return counted

    groups = _by_depth(rows)
    hover = _HOVER + "%{text} pixels wrong"
    lines = _lines(groups, reach, lambda row: known(row).fraction or _half_pixel(row), hover)
    for line, group in zip(lines, groups.values(), strict=True):
        symbol = line["marker"]["symbol"]
        line["marker"]["symbol"] = [
            # Hollow marks show that the true value, zero, lies below the axis.
            symbol + ("" if known(row).wrong else "-open")
            for _, row in group
        ]
        line["text"] = [f"{known(row).wrong:,} of {row.comparison.judged:,}" for _, row in group]
    return lines


def _half_pixel(row: Measurement) -> float:
    """Return half a pixel as a share of the judged pixels."""
    # Below the smallest measurable share, and still on the logarithmic axis.
    return 0.5 / max(row.comparison.judged, 1)


def _surface_figure(rows: Rows, reach: float) -> Figure:
    """Draw the share of wrong surfaces, with a dashed closed form for each depth buffer."""
    lines = _share_lines(rows, reach, lambda row: row.comparison.surface)
    if any(row.predicted for _, row in rows):
        for place, (label, group) in enumerate(_by_depth(rows).items()):
            predicted = [(row, row.predicted.surface_fraction) for _, row in group if row.predicted]
            lines.append(
                {
                    "x": [row.settings.near / reach for row, _ in predicted],
                    # Shares of less than half a pixel are drawn there too, where zeros are.
                    "y": [max(share, _half_pixel(row)) for row, share in predicted],
                    "name": f"{label}, closed form",
                    "mode": "lines",
                    "showlegend": False,
                    "line": {"color": look(place)[0], "dash": "dash", "width": 1.5},
                    "hovertemplate": _HOVER + "predicted %{y:.2~p}",
                }
            )
        # The legend has one entry for all closed forms.
        lines.append({"x": [None], "y": [None], **_CLOSED_FORM})
    return _log_figure(lines, "pixels with the wrong surface", PERCENT)


def _displacement_figure(rows: Rows, reach: float, statistic: str, title: str) -> Figure:
    """Draw a statistic of displacement with its closed form, dashed."""

    def measured(row: Measurement) -> float | None:
        return getattr(row.comparison.displacement_px, statistic, None) or None

    lines = _lines(_by_depth(rows), reach, measured, _HOVER + "%{y:.3g} px")
    forms = {
        row.settings.near / reach: row.predicted.displacement_px
        for _, row in sorted(rows, key=lambda item: item[1].settings.near)
        if row.predicted
    }
    if forms:
        heights = [getattr(spread, statistic, None) or None for spread in forms.values()]
        hover = _HOVER + "predicted %{y:.3g} px"
        lines.append({"x": list(forms), "y": heights, "hovertemplate": hover, **_CLOSED_FORM})
    return _log_figure(lines, title)


def _lines(groups: Mapping[str, Rows], reach: float, number: Number, hover: str) -> list[Figure]:
    """Return a line of plotly.js for each named group of rows."""
    lines = []
    for place, (label, group) in enumerate(groups.items()):
        color, symbol = look(place)
        # Curves that coincide stay visible: each lies thinner on the curve before it.
        below = len(groups) - 1 - place
        ascending = sorted(group, key=lambda item: item[1].settings.near)
        lines.append(
            {
                "x": [row.settings.near / reach for _, row in ascending],
                "y": [number(row) for _, row in ascending],
                "customdata": [index for index, _ in ascending],
                "name": label,
                "mode": "lines+markers",
                "line": {"color": color, "width": 1.6 + 0.8 * below},
                "marker": {"symbol": symbol, "size": 6 + below, "color": color},
                "hovertemplate": hover,
            }
        )
    return lines


def _by_depth(rows: Rows) -> dict[str, list[tuple[int, Measurement]]]:
    """Return the rows of each depth buffer, in the order of the sweep, nears ascending."""
    groups: dict[str, list[tuple[int, Measurement]]] = {
        row.settings.depth_label: [] for _, row in rows
    }
    for index, row in sorted(rows, key=lambda item: item[1].settings.near):
        groups[row.settings.depth_label].append((index, row))
    return groups


def _log_figure(lines: list[Figure], title: str, axis: Mapping[str, Any] | None = None) -> Figure:
    nears = [x for line in lines for x in line["x"] if x is not None and x > 0]
    # Labels side by side take more room than above each other, and turned labels run into the
    # legend.
    near = {"title": "near plane / reach", "tickangle": 0, **log_axis(nears, ratio=30, labels=3)}
    layout = {"title": titled(title), "height": 400, "xaxis": near}
    return styled(lines, {**layout, "yaxis": {**log_axis(_heights(lines)), **(axis or {})}})


def _heights(lines: Sequence[Figure]) -> list[float]:
    return [y for line in lines for y in line["y"] if y is not None and y > 0]


def cause_figure(rows: Rows, reach: float) -> Figure | None:
    """Draw the share of each cause in the wrong surfaces over near; None without wrong surfaces."""
    # By row number: the wrong surfaces of each cause, which add up to all wrong surfaces.
    counts = {number: {cause.name: cause.surface for cause in row.causes} for number, row in rows}
    panels = {
        label: wrong
        for label, group in _by_depth(rows).items()
        if (wrong := [item for item in group if sum(counts[item[0]].values())])
    }
    if not panels:
        return None
    areas: list[Figure] = []
    layout: Figure = {"annotations": []}
    axes = ["y", *(f"y{number}" for number in range(2, len(panels) + 1))]
    for axis, (label, group) in zip(axes, panels.items(), strict=True):
        for name, color in CAUSE_COLORS.items():
            # The legend lists causes that occur somewhere on the page only.
            if not any(causes.get(name) for causes in counts.values()):
                continue
            pairs = [
                (counts[number].get(name, 0), sum(counts[number].values())) for number, _ in group
            ]
            areas.append(
                {
                    "x": [row.settings.near / reach for _, row in group],
                    "y": [100 * count / wrong for count, wrong in pairs],
                    "yaxis": axis,
                    "customdata": [number for number, _ in group],
                    "text": [f"{count:,} of {wrong:,} wrong pixels" for count, wrong in pairs],
                    "hovertemplate": f"{name}, {_HOVER}%{{y:.3g}} %: %{{text}}<extra></extra>",
                    "name": name,
                    "legendgroup": name,
                    # One legend entry per cause, from the first panel.
                    "showlegend": axis == "y",
                    "mode": "lines",
                    "stackgroup": f"panel {axis}",
                    "line": {"width": 0.5, "color": color},
                    "fillcolor": color,
                }
            )
        layout[axis.replace("y", "yaxis")] = {"range": [0, 100], "ticksuffix": " %", "nticks": 3}
        above = {"yref": f"{axis} domain", "y": 1, "yanchor": "bottom", "showarrow": False}
        heading = {"text": label, "xref": "paper", "x": 0.5, "font": {"size": 16}}
        layout["annotations"].append(heading | above)
    subplots = [[f"x{axis}"] for axis in axes]
    layout["grid"] = {"columns": 1, "rows": len(panels), "subplots": subplots, "ygap": 0.3}
    nears = [row.settings.near / reach for group in panels.values() for _, row in group]
    layout["xaxis"] = {"title": "near, as a share of the reach", **log_axis(nears)}
    return styled(areas, {"height": 110 + PANEL_PIXELS * len(panels), **layout})


def render_page(sweep: Sweep, sentence: str, command: str) -> str:
    """Return the report as one HTML document that loads nothing else."""
    scene, names = sweep.scene, geometry_names(sweep.geometries)
    # The shear of each aperture and near, ascending; depth buffers, fits and cuts share it.
    shear_of = {
        (row.aperture, row.settings.near): row.shear for row in reversed(sweep.rows) if row.shear
    }
    # Row order follows the sweep: geometry first; readers expect apertures first.
    order = sorted(shear_of, key=lambda key: (sweep.apertures.index(key[0]), key[1]))
    values = {
        "sweep": sweep,
        "choosing": best,
        "words": words,
        "fit": scene_fit(scene),
        "sentence": sentence,
        "command": command,
        "confidence": CONFIDENCE,
        "scouted_lines": FILM_PIXELS**2,
        "chosen": choices(sweep.auto) if sweep.auto else (),
        "settings_count": len({row.settings for row in sweep.rows}),
        "certainty": {row.aperture: row.comparison.certainty for row in reversed(sweep.rows)},
        "certainty_labels": {kind.name.lower(): label for kind, label in CERTAINTY_LABELS.items()},
        "alone": [
            pair for pair in zip(sweep.apertures, sweep.truths, strict=True) if pair[1].marks
        ],
        "sparse_fraction": SPARSE_FRACTION,
        "images": images,
        "height_range": images.height_range(scene, scene.frustum.longest_reach),
        "pixels_per_degree": PIXELS_PER_DEGREE,
        "name_of": lambda settings: names[geometry_of(settings)],
        "shears": {key: shear_of[key] for key in order},
        "without_offset": any(geometry.offset is Offset.NONE for geometry in sweep.geometries),
        "dominant": _dominant(sweep),
        "unexplained": sum(row.unexplained or 0 for row in sweep.rows),
        "page_data": _page_data(sweep),
    }
    return html_page("report.html.j2", values, {"pixels": words.pixels, "sentence": SENTENCES.get})


def _page_data(sweep: Sweep) -> dict[str, Any]:
    """Return the data of the script; equal pictures of several settings are stored once."""
    pictures: dict[str, str] = {}

    def keep(encoded: bytes) -> str:
        # 64 bits: a collision among some thousand pictures has a chance of 1e-13.
        key = hashlib.sha256(encoded).hexdigest()[:16]
        if key not in pictures:
            pictures[key] = address(encoded)
        return key

    names, light = geometry_names(sweep.geometries), sweep.light
    reach = sweep.scene.frustum.longest_reach
    keys = [(row.settings, row.aperture) for row in sweep.rows]
    eye = None
    if light and light.eye:
        points = [(error.near / reach, error.measured, error.predicted) for error in light.eye]
        eye = pair_figure(points, "rms change of radiance at the same surface points")
    return {
        "rows": [
            {
                "aperture": row.aperture.index,
                "geometry": sweep.geometries.index(geometry_of(row.settings)),
                "depth": row.settings.depth_label,
                "near": row.settings.near,
                **{name: getattr(row, name) for name in ("comparison", "times_s")},
                "predicted": row.predicted
                and replace(row.predicted, reasons=sentences(row.predicted.reasons)),
                "predicted_surface": row.predicted.surface_fraction if row.predicted else None,
                "ratio": row.measured_over_predicted,
                "parts_s": {"raster": {"gpu": row.gpu_s}},
                "pictures": {name: keep(encoded) for name, encoded in row.pictures.items()},
                "causes": {cause.name: cause.surface for cause in row.causes},
            }
            for row in sweep.rows
        ],
        "cause_colors": images.CAUSE_COLORS,
        "geometries": [names[geometry] for geometry in sweep.geometries],
        "apertures": [aperture.index for aperture in sweep.apertures],
        "truths": [keep(truth.picture) for truth in sweep.truths],
        "start": keys.index((sweep.best.settings, sweep.best.aperture)),
        "units": sweep.scene.units,
        "reach": reach,
        "pictures": pictures,
        "curves": [
            [_curves(sweep, aperture, geometry) for geometry in sweep.geometries]
            for aperture in sweep.apertures
        ],
        "eye": eye,
        "scout": map_figures(sweep.auto) if sweep.auto else (),
    }


def _curves(sweep: Sweep, aperture: Aperture, geometry: DoubleFrustum) -> dict[str, Figure | None]:
    """Return the figures of an aperture and a geometry by name; None without a point."""
    reach, rows = sweep.scene.frustum.longest_reach, sweep.numbered(aperture, geometry)
    figures = error_figures(rows, reach, shaded=sweep.light is not None)
    if len(sweep.geometries) > 1:
        figures |= _geometry_figures(sweep, aperture)
    curves = {
        name: figure if _heights(figure["data"]) else None for name, figure in figures.items()
    }
    return curves | ({"causes": cause_figure(rows, reach)} if sweep.options.causes else {})


def _dominant(sweep: Sweep) -> list[tuple[str, list[str]]]:
    """Return the dominant causes by aperture and geometry, beginning with the best setting."""
    if not sweep.options.causes:
        return []
    names, chosen = geometry_names(sweep.geometries), sweep.best
    first, paragraphs = geometry_of(chosen.settings), []
    for aperture in sorted(sweep.apertures, key=lambda place: place != chosen.aperture):
        for geometry in sorted(sweep.geometries, key=lambda cameras: cameras != first):
            name = names[geometry] if len(sweep.geometries) > 1 else ""
            heading = f"Aperture {aperture.column},{aperture.row}" + (f", {name}" if name else "")
            rows = [row for _, row in sweep.numbered(aperture, geometry)]
            paragraphs.append((heading, words.cause_sentences(rows, sweep.scene.units)))
    return paragraphs


def _geometry_figures(sweep: Sweep, aperture: Aperture) -> dict[str, Figure]:
    """Return curves with a line for each geometry, with the depth buffer of the best setting."""
    label, reach = sweep.best.settings.depth_label, sweep.scene.frustum.longest_reach
    groups = {
        name: [
            item
            for item in sweep.numbered(aperture, geometry)
            if item[1].settings.depth_label == label
        ]
        for geometry, name in geometry_names(sweep.geometries).items()
    }
    shares, moved = "share of pixels with the wrong surface", "99th percentile of displacement, px"
    wrong = grouped_figure(groups, reach, lambda row: row.surface_fraction or None, shares, PERCENT)
    displaced = grouped_figure(groups, reach, lambda row: row.displacement_p99_px or None, moved)
    return {"geometry_surface": wrong, "geometry_displacement": displaced}
