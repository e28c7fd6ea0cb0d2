"""The study's maps, as SVG that needs nothing else: near across, depth buffers down."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from xfrustum.compare.prediction.chain import EXACT_DEPTH
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.templates_environment import svg_picture
from xfrustum.reports.splitting_study.grid import SIDES, DepthBuffer, Family
from xfrustum.reports.splitting_study.measure import SEPARATIONS
from xfrustum.reports.splitting_study.rows import StudyRow
from xfrustum.reports.splitting_study.suitability import Suitability, suitability
from xfrustum.scenes.plate.double_frustum import Camera, Fit, Offset, Pivot

SIDE_WORDS = {Camera.C: "C, behind the plate", Camera.C_STAR: "C*, before the plate"}

# Okabe and Ito's palette: told apart by color-blind readers.
_SUITABILITY_COLORS = {
    Suitability.ENOUGH: "#009E73",
    Suitability.BENT: "#E69F00",
    Suitability.STARVED: "#56B4E9",
    Suitability.BOTH: "#5b5b5b",
}
_SUITABILITY_WORDS = {
    Suitability.ENOUGH: "one pair is enough",
    Suitability.BENT: "bent by the near plane",
    Suitability.STARVED: "starved of depth",
    Suitability.BOTH: "both",
}

# From light to dark, in steps that print in gray too.
_STEPS = ("#f3f6f8", "#cfe1ec", "#9cc4dc", "#5d9fc4", "#2a6f9e", "#123a5c")

SHARES = (0.0, 1e-4, 1e-3, 1e-2, 1e-1)
DISPLACEMENTS_PX = (0.05, 0.5, 5.0, 50.0)
"""Upper ends of the steps of color; the last step has none."""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One map: a title, and the colors of its squares by line."""

    title: str
    lines: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Map:
    """Panels in rows that share their lines' names and nears.

    Attributes
    ----------
    title
        Title of the whole figure.
    panels
        Row by row.
    names
        Names of the lines in each panel.
    nears
        Nears of the squares in each line, shares of the reach.
    legend
        Color and meaning.
    across
        What runs across.
    gutter
        Width of the lines' names, pixels.
    """

    title: str
    panels: tuple[tuple[Panel, ...], ...]
    names: tuple[str, ...]
    nears: tuple[float, ...]
    legend: tuple[tuple[str, str], ...]
    across: str = "near plane / reach"
    gutter: int = 132


Rows = Sequence[StudyRow]


def maps(rows: Rows) -> dict[str, Map]:
    """Return the maps of one pair of frusta by name; rows with slabs play no part."""
    single = [row for row in rows if not row.slabs]
    whole = [row for row in single if row.family is Family.ONE_SIDE]
    others = [row for row in single if row.family is not Family.ONE_SIDE]
    sides = [side for side in SIDES if any(row.side is side for row in whole)]
    named = {f"when-to-split-{side}": _verdicts([r for r in whole if r.side is side], side) for side in sides}
    return {
        **named,
        "when-to-split-depth": _depth_shares(whole, sides),
        "when-to-split-separation": _separations(whole, sides),
        "when-to-split-displacement": _displacements(whole, sides),
        **({"when-to-split-families": _families(others)} if others else {}),
    }


def svg(drawn: Map) -> str:
    """Return a map as an SVG document."""
    return svg_picture("study-map.svg.j2", {"power": _power}, {"map": drawn})


def _verdicts(rows: Rows, side: Camera) -> Map:
    ratios, resolutions = _ratios(rows), sorted({row.resolution for row in rows})

    def color(row: StudyRow) -> str:
        return _SUITABILITY_COLORS[suitability(row)]

    def panel(ratio: float, resolution: int) -> Panel:
        chosen = [row for row in rows if row.ratio == ratio and row.resolution == resolution]
        return Panel(
            title=f"depth of scene {ratio:g}, {resolution} px", lines=_by_buffer(chosen, rows, color)
        )

    return Map(
        title=f"{SIDE_WORDS[side]}: where one pair of frusta is enough",
        panels=tuple(tuple(panel(ratio, size) for size in resolutions) for ratio in ratios),
        names=_buffer_names(rows),
        nears=_nears(rows),
        legend=tuple((_SUITABILITY_COLORS[kind], _SUITABILITY_WORDS[kind]) for kind in Suitability),
    )


def _families(rows: Rows) -> Map:
    """Map where one pair is enough in the other families: one row of panels for each way of drawing."""
    drawings = dict.fromkeys((row.family, row.pivot, row.fit, row.offset) for row in rows)
    columns = max(len({row.ratio for row in rows if row.family is family}) for family, *_ in drawings)

    def color(row: StudyRow) -> str:
        return _SUITABILITY_COLORS[suitability(row)]

    def panels(drawing: tuple[Family, Pivot, Fit | None, Offset]) -> tuple[Panel, ...]:
        own = [row for row in rows if (row.family, row.pivot, row.fit, row.offset) == drawing]
        found = []
        for ratio in _ratios(own):
            lines = _by_buffer([row for row in own if row.ratio == ratio], rows, color)
            found.append(Panel(title=_drawing_words(drawing, ratio), lines=lines))
        return tuple(found[:columns])

    return Map(
        title=f"Other scenes, {rows[0].resolution} px: where one pair of frusta is enough",
        panels=tuple(map(panels, drawings)),
        names=_buffer_names(rows),
        nears=_nears(rows),
        legend=tuple((_SUITABILITY_COLORS[kind], _SUITABILITY_WORDS[kind]) for kind in Suitability),
    )


def _drawing_words(drawing: tuple[Family, Pivot, Fit | None, Offset], ratio: float) -> str:
    family, pivot, fit, offset = drawing
    if family is Family.THROUGH:
        return (
            f"{'no offset' if offset is Offset.NONE else 'through the plate'}, {near_words(1 / ratio)} aside"
        )
    if family is Family.RECENTERED:
        return f"{pivot}, fit {fit or 'angle'}, depth {ratio:g}"
    return f"{family}, depth {ratio:g}"


def _depth_shares(rows: Rows, sides: Sequence[Camera]) -> Map:
    finest = max(row.resolution for row in rows)

    def color(row: StudyRow) -> str:
        return _STEPS[bisect_left(SHARES, row.depth_fraction)]

    def panel(side: Camera, ratio: float) -> Panel:
        chosen = [r for r in rows if r.side is side and r.ratio == ratio and r.resolution == finest]
        return Panel(title=f"{_short(side)}, depth {ratio:g}", lines=_by_buffer(chosen, rows, color))

    words = ["none", *(f"up to {percent(share)}" for share in SHARES[1:]), "more"]
    return Map(
        title=f"Pixels whose wrong surface is charged to depth, {finest} px",
        panels=tuple(tuple(panel(side, ratio) for ratio in _ratios(rows)) for side in sides),
        names=_buffer_names(rows),
        nears=_nears(rows),
        legend=tuple(zip(_STEPS, words, strict=True)),
    )


def _separations(rows: Rows, sides: Sequence[Camera]) -> Map:
    """Map the smallest separation that a depth buffer orders; it depends on neither scene nor image."""
    steps = (*SEPARATIONS[::-1], None)

    def color(row: StudyRow) -> str:
        return _STEPS[steps.index(row.ordered_separation)]

    def panel(side: Camera) -> Panel:
        return Panel(
            title=SIDE_WORDS[side], lines=_by_buffer([r for r in rows if r.side is side], rows, color)
        )

    words = ["none of these" if step is None else near_words(step) for step in steps]
    return Map(
        title="Smallest separation, in reaches, that is ordered at the far end",
        panels=(tuple(panel(side) for side in sides),),
        names=_buffer_names(rows),
        nears=_nears(rows),
        legend=tuple(zip(_STEPS, words, strict=True)),
    )


def _displacements(rows: Rows, sides: Sequence[Camera]) -> Map:
    """Map displacement, which depends on no depth buffer: that of the control, or of whichever was drawn."""
    buffers = _buffers(rows)
    shown = EXACT_DEPTH if EXACT_DEPTH in buffers else buffers[-1]
    kinds = [(ratio, size) for ratio in _ratios(rows) for size in sorted({row.resolution for row in rows})]

    def color(row: StudyRow) -> str:
        return _STEPS[bisect_left(DISPLACEMENTS_PX, row.displacement_p99 or 0.0)]

    def panel(side: Camera) -> Panel:
        chosen = [r for r in rows if r.side is side and r.buffer == shown]
        lines = [[row for row in chosen if (row.ratio, row.resolution) == kind] for kind in kinds]
        return Panel(title=SIDE_WORDS[side], lines=tuple(tuple(map(color, _sorted(line))) for line in lines))

    words = [*(f"up to {digits(limit)} px" for limit in DISPLACEMENTS_PX), "more"]
    return Map(
        title="99th percentile of displacement",
        panels=(tuple(panel(side) for side in sides),),
        names=tuple(f"depth {ratio:g}, {size} px" for ratio, size in kinds),
        nears=_nears(rows),
        legend=tuple(zip(_STEPS, words, strict=False)),
    )


def _by_buffer(chosen: Rows, rows: Rows, color: Callable[[StudyRow], str]) -> tuple[tuple[str, ...], ...]:
    """Return one line per depth buffer; of several rows at one near the first."""
    found: Mapping[DepthBuffer, dict[float, StudyRow]] = {buffer: {} for buffer in _buffers(rows)}
    for row in chosen:
        found[row.buffer].setdefault(row.near, row)
    return tuple(tuple(color(line[near]) for near in sorted(line, reverse=True)) for line in found.values())


def _sorted(rows: Rows) -> list[StudyRow]:
    return sorted(rows, key=lambda row: -row.near)


def _buffers(rows: Rows) -> tuple[DepthBuffer, ...]:
    return tuple(dict.fromkeys(row.buffer for row in rows))


def _buffer_names(rows: Rows) -> tuple[str, ...]:
    return tuple(f"{depth.upper()} {mapping}" for depth, mapping in _buffers(rows))


def _nears(rows: Rows) -> tuple[float, ...]:
    return tuple(sorted({row.near for row in rows}, reverse=True))


def _ratios(rows: Rows) -> list[float]:
    return sorted({row.ratio for row in rows})


def _short(side: Camera) -> str:
    return SIDE_WORDS[side].split(",")[0]


def near_words(near: float) -> str:
    """Write a share of the reach in half decades in one digit, such as `3e-4` for 3.16e-4."""
    return re.sub(r"e-0", "e-", f"{near:.0e}")


def _power(near: float) -> str:
    """Return a whole power of ten as people write it, nothing for what lies between."""
    exponent = math.log10(near)
    if abs(exponent - round(exponent)) > 1e-6:
        return ""
    return f"10{str(round(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
