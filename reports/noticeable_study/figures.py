"""The figures of the study of viewers, as SVG that needs nothing else."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.compare.eye.limits import STEREO_ACUITY_ARCSEC
from xfrustum.reports.common.figure_style import COLORS
from xfrustum.reports.common.templates_environment import svg_picture
from xfrustum.reports.noticeable_study.facts import Rows
from xfrustum.reports.noticeable_study.rows import NoticedRow, starved_nears
from xfrustum.reports.splitting_study.advice import buffer_name
from xfrustum.reports.splitting_study.figures import Map, Panel, svg

MAP, CURVES = "noticeable-map", "noticeable-disparity"
"""Names of the figures."""

_NOTICED = (
    ("#009E73", "nothing is noticed"),
    ("#E69F00", "change of depth"),
    ("#D55E00", "depth and crack"),
    ("#56B4E9", "depth buffer"),
    ("#5b5b5b", "offset and buffer"),
)
"""Colors of what a viewer notices, out of Okabe and Ito's palette, and their meanings."""


def figures(rows: Rows) -> dict[str, str]:
    """Return SVG documents by their names."""
    return {
        MAP: svg(noticed_map(rows)),
        CURVES: svg_picture("noticeable-curves.svg.j2", {}, vars(curves(rows))),
    }


def case_name(row: NoticedRow) -> str:
    """Return scene and pivot in words."""
    return f"{row.scene}, {row.pivot}"


def noticed_map(rows: Rows) -> Map:
    """Map what a viewer notices over near and depth buffer, at the middle pitch."""
    pitches = sorted({row.pitch for row in rows})
    pitch = pitches[len(pitches) // 2]
    own = [row for row in rows if row.pitch == pitch]
    buffers = list(dict.fromkeys(row.buffer for row in own))
    cases, starved = list(dict.fromkeys(map(case_name, own))), starved_nears(own)

    def color(row: NoticedRow) -> str:
        return _color(row, by_depth=row.depth_seen or row.near <= starved.get(row.case, 0.0))

    def panel(distance: float) -> Panel:
        lines = []
        for case in cases:
            for buffer in buffers:
                line = [r for r in own if (r.distance, case_name(r), r.buffer) == (distance, case, buffer)]
                lines.append(tuple(color(row) for row in sorted(line, key=lambda row: -row.near)))
        return Panel(title=f"from {distance:g} mm", lines=tuple(lines))

    return Map(
        title=f"What eyes notice, hogels of {pitch:g} mm",
        panels=(tuple(panel(distance) for distance in sorted({row.distance for row in own})),),
        names=tuple(f"{case}, {buffer_name(buffer)}" for case in cases for buffer in buffers),
        nears=tuple(sorted({row.near for row in own}, reverse=True)),
        legend=_NOTICED,
        across="near, mm",
        gutter=250,
    )


def _color(row: NoticedRow, *, by_depth: bool) -> str:
    offset = 2 if row.crack_seen else 1 if row.stereo_seen else 0
    if by_depth:
        return _NOTICED[4 if offset else 3][0]
    return _NOTICED[offset][0]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One line of a chart, and its dots.

    Attributes
    ----------
    color, dash
        Color by scene and pivot, and dashes by distance, as SVG has them.
    path, dots
        Points in the picture, pixels.
    """

    color: str
    dash: str
    path: str
    dots: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True)
class Curves:
    """A chart on logarithmic axes.

    Attributes
    ----------
    curves
        Lines with their dots.
    across, up
        Places and labels of the ticks.
    legend
        Color, dashes and words of each kind of line.
    level
        Place of the line of stereo acuity, and its name.
    box
        Left, top, right and bottom of the axes, pixels.
    """

    title: str
    curves: tuple[Curve, ...]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]
    legend: tuple[tuple[str, str, str], ...]
    level: tuple[float, str]
    box: tuple[float, float, float, float]


_DASHES = ("", "7 3", "2 3")
"""Dashes of lines from the nearest distance to the farthest, as SVG has them."""

_BOX = (64.0, 46.0, 560.0, 330.0)


def curves(rows: Rows) -> Curves:
    """Chart change of disparity over near: closed form as lines, replays as dots."""
    left, top, right, bottom = _BOX
    known = [row for row in rows if math.isfinite(row.stereo_arcsec) and row.stereo_arcsec > 0]
    nears = [row.near for row in known]
    low, high = math.log10(min(nears)), math.log10(max(nears))
    least = math.floor(math.log10(min(row.stereo_arcsec for row in known)))
    most = math.ceil(math.log10(max(row.stereo_arcsec for row in known)))

    def x(near: float) -> float:
        return round(left + (right - left) * (math.log10(near) - low) / max(high - low, 1e-9), 2)

    def y(change: float) -> float:
        share = (math.log10(max(change, 10.0**least)) - least) / (most - least)
        return round(bottom - (bottom - top) * share, 2)

    drawn = []
    cases = list(dict.fromkeys(map(case_name, known)))
    distances = sorted({row.distance for row in known})
    for case, distance in itertools.product(cases, distances):
        own = [row for row in known if (case_name(row), row.distance) == (case, distance)]
        line = sorted({row.near: row for row in own}.values(), key=lambda row: row.near)
        dots = {(x(r.near), y(r.replayed_stereo_arcsec)) for r in own if r.replayed_stereo_arcsec}
        drawn.append(
            Curve(
                color=COLORS[cases.index(case) % len(COLORS)],
                dash=_DASHES[distances.index(distance) % len(_DASHES)],
                path=_path([(x(row.near), y(row.stereo_arcsec)) for row in line]),
                dots=tuple(sorted(dots)),
            )
        )
    legend = [(COLORS[number % len(COLORS)], "", case) for number, case in enumerate(cases)]
    legend += [("#24292f", _DASHES[k % len(_DASHES)], f"from {d:g} mm") for k, d in enumerate(distances)]
    powers = range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)
    return Curves(
        title="Change of disparity by the near offset",
        curves=tuple(drawn),
        legend=tuple(legend),
        across=tuple((x(10.0**k), f"{10.0**k:g}") for k in powers),
        up=tuple((y(10.0**k), f"{10.0**k:g}") for k in range(least, most + 1)),
        level=(y(STEREO_ACUITY_ARCSEC), f"stereo acuity, {STEREO_ACUITY_ARCSEC:g} arc seconds"),
        box=_BOX,
    )


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
