"""Cells and rows of the study of splitting, whether one pair of frusta is enough in them, and what rows say.

All lengths are shares of the reach.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from itertools import dropwhile, product, takewhile
from typing import Any

import numpy as np
from scipy.optimize import brentq

from xfrustum.compare.prediction.depth import (
    EXPRESSION_ROUNDINGS,
    MAX_MISORDERED_FRACTION,
    smallest_separation,
)
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.templates_environment import plain_text, svg_picture
from xfrustum.reports.studies.sweep import Origin, StudyFiles
from xfrustum.scenes.library.depth_family import REACH
from xfrustum.scenes.plate.double_frustum import (
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

DepthBuffer = tuple[DepthFormat, DepthMapping]
Drawing = tuple[Pivot, Fit | None, Offset]

SIDES = (Camera.C, Camera.C_STAR)

ASKED_SEPARATION = 1e-3
"""Distance of two surfaces at the far end that a depth buffer must order, as a share of the reach."""

AS_IN_THE_PAPER: Drawing = (Pivot.APERTURE, None, Offset.PLATE)


class Family(StrEnum):
    """Kinds of scenes; each but the first changes one thing of the first.

    `ONE_SIDE` has cars on one side of the plate, seen from the middle aperture of a centered frustum.
    `BOTH_SIDES` has cars on both sides at once. `OFF_MIDDLE` is the first as an aperture off the middle sees
    it, and `IN_MIDDLE` the same scene as the middle aperture sees it. `RECENTERED` shows the picture of the
    first through a sheared frustum. `THROUGH` is a car that runs through the plate.
    """

    ONE_SIDE = "one side"
    BOTH_SIDES = "both sides"
    OFF_MIDDLE = "off the middle"
    IN_MIDDLE = "in the middle"
    RECENTERED = "recentered"
    THROUGH = "through the plate"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene, an image and a depth buffer: what a person has before choosing near and slabs."""

    family: Family
    side: Camera
    """The side of the plate with content, by the one camera that sees it, or `BOTH`."""
    ratio: float
    """Depth of the scene: farthest to nearest |z| of its surfaces. In the family `THROUGH` it is the reach
    over the aperture's distance from where the surface crosses the plate."""
    resolution: int
    depth: DepthFormat
    mapping: DepthMapping
    pivot: Pivot = Pivot.APERTURE
    fit: Fit | None = None
    offset: Offset = Offset.PLATE

    @classmethod
    def of(cls, row: Case) -> Case:
        """Return the case that a cell belongs to."""
        return Case(**{one.name: getattr(row, one.name) for one in fields(Case)})

    @property
    def buffer(self) -> DepthBuffer:
        """Format and mapping."""
        return self.depth, self.mapping

    @property
    def picture(self) -> tuple[Family, Camera, float, int]:
        """The picture alone, without what draws it."""
        return self.family, self.side, self.ratio, self.resolution

    @property
    def drawing(self) -> Drawing:
        """Pivot, fit and offset."""
        return self.pivot, self.fit, self.offset


@dataclass(frozen=True, kw_only=True)
class Cell(Case):
    """One picture of the study: a case with a near and the heights of slabs."""

    near: float
    slabs: tuple[float, ...] = ()

    @property
    def settings(self) -> DoubleFrustum:
        """Settings of the rasterizer, in scene units."""
        return DoubleFrustum(
            near=self.near * REACH,
            depth=self.depth,
            mapping=self.mapping,
            camera=self.side,
            pivot=self.pivot,
            fit=self.fit,
            offset=self.offset,
            slabs=tuple(cut * REACH for cut in self.slabs),
        )


@dataclass(frozen=True, kw_only=True)
class Row(Cell):
    """A cell, its picture judged, and the sheets at the far end of its side.

    CONVENTIONS.md, "The study of splitting", says what each field is.
    """

    judged: int
    covered: int
    nearest: float
    farthest: float
    surface_wrong: int
    outside: int
    depth_wrong: int
    lost: int
    displacement_rms: float | None
    displacement_p99: float | None
    displacement_max: float | None
    displaced: int
    predicted_rms: float | None
    predicted_p99: float | None
    misordered: float
    ordered_separation: float | None
    predicted_separation: float

    @property
    def depth_fraction(self) -> float:
        """Share of the judged pixels whose wrong surface is charged to depth."""
        return self.depth_wrong / self.judged


Rows = Sequence[Row]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Every combination of these, with each of some nears, is one cell of one family."""

    family: Family
    sides: tuple[Camera, ...]
    ratios: tuple[float, ...]
    buffers: tuple[DepthBuffer, ...]
    resolutions: tuple[int, ...] = (256,)
    drawings: tuple[Drawing, ...] = (AS_IN_THE_PAPER,)

    def blocks(self, nears: Sequence[float]) -> Iterator[tuple[Cell, ...]]:
        """Yield the cells of each picture, those of one drawing and near together: they share a control."""
        for side, ratio, resolution in product(self.sides, self.ratios, self.resolutions):
            picture: dict[str, Any] = {"side": side, "ratio": ratio, "resolution": resolution}
            picture["family"] = self.family
            yield tuple(
                Cell(**picture, near=near, depth=depth, mapping=mapping, pivot=pivot, fit=fit, offset=offset)
                for (pivot, fit, offset), near, (depth, mapping) in product(
                    self.drawings, nears, self.buffers
                )
            )


Study = tuple[tuple[float, ...], tuple[Grid, ...]]
"""The nears of a study, from the largest down, and its grids."""

_DEPTHS = (1.5, 10.0, 100.0, 1000.0)
_BUFFERS: tuple[DepthBuffer, ...] = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D32F, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
)
"""Depth buffers of the other families: those that devices store without a fragment's help, and one that a
fragment writes. Depth is that of the first family, for the same |z| and near."""

_FIRST = Grid(
    family=Family.ONE_SIDE,
    sides=SIDES,
    ratios=_DEPTHS,
    buffers=tuple(product(DepthFormat, DepthMapping)),
    resolutions=(128, 256, 512),
)
_OTHERS = (
    Grid(family=Family.BOTH_SIDES, sides=(Camera.BOTH,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(family=Family.IN_MIDDLE, sides=(Camera.C,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(family=Family.OFF_MIDDLE, sides=(Camera.C,), ratios=_DEPTHS, buffers=_BUFFERS),
    Grid(
        family=Family.RECENTERED,
        sides=(Camera.C,),
        ratios=_DEPTHS,
        buffers=_BUFFERS,
        drawings=tuple((pivot, fit, Offset.PLATE) for pivot in Pivot for fit in (None, Fit.SCREEN)),
    ),
    Grid(
        family=Family.THROUGH,
        sides=(Camera.BOTH,),
        ratios=(1e1, 1e2, 1e3, 1e4, 1e5, 1e6),
        buffers=_BUFFERS,
        drawings=tuple((Pivot.APERTURE, None, offset) for offset in Offset),
    ),
)
_NEARS = tuple(float(near) for near in np.geomspace(1e-1, 1e-8, 15))

FULL: Study = (_NEARS, (_FIRST, *_OTHERS))
QUICK: Study = (
    _NEARS[::2],
    (
        replace(_FIRST, ratios=(1.5, 100.0), buffers=(*_BUFFERS[:2], _BUFFERS[3]), resolutions=(128,)),
        *(replace(grid, ratios=grid.ratios[2:3], buffers=_BUFFERS[::3]) for grid in _OTHERS),
    ),
)


# Whether one pair of frusta is enough


class Suitability(StrEnum):
    """Whether one setting is enough, and if it is not, why."""

    ENOUGH = "enough"
    BENT = "bent"
    STARVED = "starved"
    BOTH = "both"


def suitability(row: Row, *, predicted: bool = False) -> Suitability:
    """Judge one cell by what was measured, or by the closed forms alone.

    It is bent where displacement exceeds `TOLERANCE_PX`: that of what was drawn, as measured, or that of what
    should have been drawn, in closed form, for what is bent out of the film or behind something else is not
    drawn. What the near plane clips, without an offset, counts as displaced. It is starved of depth where
    more than `MAX_DEPTH_WRONG` of the pixels show a wrong surface because of it, or where sheets
    `ASKED_SEPARATION` apart at the far end are not ordered: in closed form, where this is not the smallest
    ordered separation or larger.
    """
    bent = row.predicted_p99 is not None and row.predicted_p99 > TOLERANCE_PX
    # The nearest |z| of a row is that of its nearest hundredth.
    bent = bent or (row.offset is Offset.NONE and row.nearest < row.near)
    if predicted:
        starved = row.predicted_separation > ASKED_SEPARATION
    else:
        # A picture in which nothing is left to be displaced has lost everything to depth.
        bent = bent or (row.displacement_p99 is not None and row.displacement_p99 > TOLERANCE_PX)
        starved = row.depth_fraction > MAX_DEPTH_WRONG or row.misordered > MAX_MISORDERED_FRACTION
    if bent:
        return Suitability.BOTH if starved else Suitability.BENT
    return Suitability.STARVED if starved else Suitability.ENOUGH


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What is enough in a case."""

    case: Case
    nears: tuple[float, ...]  # with which one pair of frusta is enough, largest first
    slabs: tuple[float, ...] | None
    """Heights of the fewest slabs that were enough where no near is; None where no number that was tried
    was."""

    @property
    def one_pair(self) -> bool:
        """Whether one pair of frusta is enough."""
        return bool(self.nears)


def outcomes(rows: Iterable[Row]) -> dict[Case, Outcome]:
    """Return what is enough in each case, in the order in which cases first appear."""
    grouped: dict[Case, list[Row]] = {}
    for row in rows:
        grouped.setdefault(Case.of(row), []).append(row)
    found = {}
    for case, own in grouped.items():
        good = [row for row in own if suitability(row) is Suitability.ENOUGH]
        nears = tuple(sorted((row.near for row in good if not row.slabs), reverse=True))
        slabs = min((row.slabs for row in good if row.slabs), key=len, default=None)
        found[case] = Outcome(case=case, nears=nears, slabs=slabs)
    return found


def straight_nears(rows: Iterable[Row]) -> set[float]:
    """Return the nears of some rows at which no picture is bent; no depth buffer moves the picture."""
    rows = list(rows)
    bent = {row.near for row in rows if suitability(row) in {Suitability.BENT, Suitability.BOTH}}
    return {row.near for row in rows} - bent


# What the rows say

_LEAST_NEAR, _LARGEST_NEAR = 1e-12, 0.5
"""Nears between which the smallest that orders a separation is looked for, shares of the reach."""


def record(files: StudyFiles) -> dict[str, Any]:
    """Return the study as `xfrustum study splitting --json` prints it."""
    rows = files.rows
    criteria = {
        "displacement_p99_px": TOLERANCE_PX,
        "depth_wrong": MAX_DEPTH_WRONG,
        "separation": ASKED_SEPARATION,
    }
    cases = [
        {**asdict(one.case), "one_pair": one.one_pair, "nears": one.nears, "slabs": one.slabs}
        for one in outcomes(rows).values()
    ]
    said = {**files.record, "sentence": sentence(rows), "criteria": criteria}
    said |= {"agreement": agreement(of_family(rows, Family.ONE_SIDE)), "helps": helps(rows), "cases": cases}
    return dict(json_ready(said))


def document(rows: Rows, origin: Origin) -> str:
    """Return the study as Markdown."""
    columns, lines = advice(of_family(rows, Family.ONE_SIDE))
    values = {
        "sentence": sentence(rows),
        "tolerance_px": TOLERANCE_PX,
        "max_depth_wrong": f"{100 * MAX_DEPTH_WRONG:g} %",
        "separation": f"{ASKED_SEPARATION:g}",
        "helps": helps(rows),
        "columns": columns,
        "advice": lines,
        "figures": {name: drawn["title"] for name, drawn in maps(rows).items()},
        "devices": origin.devices,
    }
    return plain_text("when-to-split.md.j2", {}, values)


def sentence(rows: Rows) -> str:
    """Say the result of scenes on one side of the plate in one sentence."""
    first = of_family(rows, Family.ONE_SIDE)
    found, measured = outcomes(first), {row.near for row in first if not row.slabs}
    best: tuple[Any, ...] = ()
    for buffer in dict.fromkeys(row.buffer for row in first):
        own = [one for case, one in found.items() if case.buffer == buffer]
        always = unbroken(set.intersection(*(set(one.nears) for one in own)), measured)
        enough = sum(one.one_pair for one in own)
        # Among equally good ones the last counts that costs no early depth test.
        rank = (enough, len(always), buffer[1] not in EXPRESSION_ROUNDINGS)
        if not best or rank > best[0]:
            best = (rank, buffer, always, enough, len(own))
    _, buffer, always, enough, cases = best
    nears = ""
    if always:
        nears = f", at any near from {near_words(always[0])} to {near_words(always[-1])} of the reach"
    return (
        f"With content on one side of the plate, one pair of frusta is enough in "
        f"{sum(one.one_pair for one in found.values())} of {len(found)} cases; "
        f"with {buffer_name(buffer)} depth in {enough} of {cases}{nears}."
    )


def of_family(rows: Iterable[Row], family: Family) -> list[Row]:
    """Return the rows of one family."""
    return [row for row in rows if row.family is family]


def unbroken(nears: Iterable[float], measured: Iterable[float]) -> tuple[float, ...]:
    """Return the largest of some of the measured nears and those below it without a gap, largest first."""
    chosen = set(nears)
    from_largest = dropwhile(lambda near: near not in chosen, sorted(measured, reverse=True))
    return tuple(takewhile(lambda near: near in chosen, from_largest))


def least_near(buffer: DepthBuffer) -> float | None:
    """Return the smallest near, as a share of the reach, that orders `ASKED_SEPARATION` at the reach.

    By the closed form; None where even a trillionth of the reach does. In units in which the reach is one,
    where 32-bit numbers are coarsest for their size: in other units it may be up to half as large.
    """

    def excess(logarithm: float) -> float:
        near = math.exp(logarithm)
        far = near + 1.0
        return float(smallest_separation(np.array(far), near, far, *buffer)) - ASKED_SEPARATION

    low, high = math.log(_LEAST_NEAR), math.log(_LARGEST_NEAR)
    return None if excess(low) <= 0 else math.exp(brentq(excess, low, high, xtol=1e-3))


def agreement(rows: Rows) -> dict[str, float]:
    """Set closed forms beside all rows of one pair of frusta.

    Returns the number of settings (`cells`), of those in which closed forms say what was measured (`same`),
    and of the others whose near is not enough between two that are (`in_gaps`); number of cases, and of those
    in which the rule of thumb says what was measured; and the ends of measured over predicted 99th percentile
    of displacement, where a tenth to ten times the tolerance is predicted and depth does no harm. The rule:
    one pair is enough up to a product of image width and depth of the scene. Displacement is largest in the
    film's corner, W / 2 sqrt(2) n / (|z| + n), and stays under the tolerance for n up to about
    sqrt(2) TOLERANCE_PX |z| / W, which must not be less than `least_near`.
    """
    single, found = [row for row in rows if not row.slabs], outcomes(rows)
    least = {buffer: least_near(buffer) for buffer in dict.fromkeys(row.buffer for row in rows)}
    gap_nears, gap_buffers = set[float](), set[DepthBuffer]()
    for case, one in found.items():
        inside = {r.near for r in single if one.nears and one.nears[-1] < r.near < one.nears[0]}
        if inside := inside - set(one.nears):
            gap_nears |= inside
            gap_buffers.add(case.buffer)

    def by_rule(case: Case) -> bool:
        near = least[case.buffer]
        return near is None or case.resolution * case.ratio <= math.sqrt(2) * TOLERANCE_PX / near

    ratios = [
        row.displacement_p99 / row.predicted_p99
        for row in single
        if row.displacement_p99 is not None
        and row.predicted_p99 is not None
        and TOLERANCE_PX / 10 <= row.predicted_p99 <= 10 * TOLERANCE_PX
        and row.depth_fraction <= MAX_DEPTH_WRONG
    ]
    others = [row for row in single if suitability(row) is not suitability(row, predicted=True)]
    return {
        "cells": len(single),
        "same": len(single) - len(others),
        "in_gaps": sum(row.near in gap_nears and row.buffer in gap_buffers for row in others),
        "cases": len(found),
        "same_by_rule": sum(one.one_pair == by_rule(case) for case, one in found.items()),
        "lowest": min(ratios, default=math.nan),
        "highest": max(ratios, default=math.nan),
    }


def helps(rows: Rows) -> list[dict[str, Any]]:
    """Return what helps in each family, in the order of the rows.

    Of the cases drawn as in the paper, each entry says in how many one pair is enough (`one_pair`), and of
    the others in how many another of the depth buffers is, a fit at the screen, no offset (None where that
    was not drawn), and slabs, with the largest number of cuts that one needed.
    """
    found, entries = outcomes(rows), []

    def served(ways: Iterable[Case]) -> int | None:
        drawn = [found[way] for way in ways if way in found]
        return sum(way.one_pair for way in drawn) if drawn else None

    for family in dict.fromkeys(row.family for row in rows):
        own = [one for case, one in found.items() if case.family is family]
        paper = [one for one in own if one.case.drawing == AS_IN_THE_PAPER]
        failed = [one for one in paper if not one.one_pair]
        easy = {one.case.picture for one in paper if one.one_pair}
        cuts = [one.slabs for one in failed if one.slabs]
        entries.append(
            {
                "family": family,
                "cases": len(paper),
                "one_pair": len(paper) - len(failed),
                "other_buffer": sum(one.case.picture in easy for one in failed),
                "fit": served(replace(one.case, fit=Fit.SCREEN) for one in failed),
                "no_offset": served(replace(one.case, offset=Offset.NONE) for one in failed),
                "slabs": len(cuts),
                "most_slabs": max(map(len, cuts), default=0),
            }
        )
    return entries


def advice(rows: Rows) -> tuple[list[list[str]], list[tuple[int, float, tuple[str, ...]]]]:
    """Return the study's table: columns of depth buffers that share it; resolutions, depths and advice.

    An outcome serves both sides of the plate: nears that are enough on each, else the cuts of the side that
    needs more.
    """
    found = outcomes(rows)
    kinds = sorted({(case.resolution, case.ratio) for case in found})
    measured = {row.near for row in rows if not row.slabs}

    def advised(kind: tuple[int, float], buffer: DepthBuffer) -> str:
        asked = (*kind, buffer)
        sides = [one for case, one in found.items() if (case.resolution, case.ratio, case.buffer) == asked]
        if common := set.intersection(*(set(one.nears) for one in sides)):
            nears = unbroken(common, measured)
            first, last = near_words(nears[0]), near_words(nears[-1])
            return first if first == last else f"{first} to {last}"
        cuts = [one.slabs for one in sides if not one.one_pair]
        if not cuts or None in cuts:
            return "**no**"
        return "**split** at " + ", ".join(f"{cut:.2g}" for cut in max((c for c in cuts if c), key=len))

    columns: dict[tuple[str, ...], list[str]] = {}
    for buffer in dict.fromkeys(row.buffer for row in rows):
        columns.setdefault(tuple(advised(kind, buffer) for kind in kinds), []).append(buffer_name(buffer))
    lines = [(*kind, tuple(cells[line] for cells in columns)) for line, kind in enumerate(kinds)]
    return list(columns.values()), lines


COLORS = {
    Suitability.ENOUGH: ("#009E73", "one pair is enough"),
    Suitability.BENT: ("#E69F00", "bent by the near plane"),
    Suitability.STARVED: ("#56B4E9", "starved of depth"),
    Suitability.BOTH: ("#5b5b5b", "both"),
}
"""Colors of the maps, of Okabe and Ito's palette, which color-blind readers tell apart; and meanings."""


def maps(rows: Rows) -> dict[str, dict[str, Any]]:
    """Return where one pair of frusta is enough, by figure: one for each side, one for the rest.

    A map has rows of panels, and what these share: nears, which run across, and names of lines. A panel is a
    picture and a way of drawing it; its lines are depth buffers, each with the colors of its squares.
    """
    single = [row for row in rows if not row.slabs]
    first, rest = of_family(single, Family.ONE_SIDE), [r for r in single if r.family is not Family.ONE_SIDE]
    found = {}
    for side in dict.fromkeys(row.side for row in first):
        own = [row for row in first if row.side is side]
        found[f"when-to-split-{side}"] = _map(f"{side}: where one pair of frusta is enough", own)
    if rest:
        title = "Other scenes: where one pair of frusta is enough"
        found["when-to-split-families"] = _map(title, rest)
    return found


def _map(title: str, rows: Rows) -> dict[str, Any]:
    buffers = list(dict.fromkeys(row.buffer for row in rows))
    pictures: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        pictures.setdefault((row.family, *row.drawing, row.ratio, row.resolution), []).append(row)
    panels: dict[tuple[object, ...], list[dict[str, Any]]] = {}
    for (family, *drawing, ratio, resolution), own in pictures.items():
        own.sort(key=lambda row: -row.near)
        colors = [(row.buffer, COLORS[suitability(row)][0]) for row in own]
        lines = [tuple(color for one, color in colors if one == buffer) for buffer in buffers]
        words = [str(word) for word in (family, *drawing) if word not in (*AS_IN_THE_PAPER, Family.ONE_SIDE)]
        name = ", ".join((*words, f"depth {ratio:g}, {resolution} px"))
        line = (family, *drawing, ratio if family is Family.ONE_SIDE else None)
        panels.setdefault(line, []).append({"title": name, "lines": lines})
    return {
        "title": title,
        "panels": list(panels.values()),
        "names": list(map(buffer_name, buffers)),
        "nears": sorted({row.near for row in rows}, reverse=True),
        "legend": list(COLORS.values()),
        "across": "near plane / reach",
        "gutter": 132,  # width of the lines' names, pixels
    }


def svg(drawn: dict[str, Any]) -> str:
    """Return a map as an SVG document."""

    def power(near: float) -> str:
        """Return a whole power of ten as people write it, nothing for what lies between."""
        exponent = math.log10(near)
        if abs(exponent - round(exponent)) > 1e-6:
            return ""
        return f"10{str(round(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"

    return svg_picture("study-map.svg.j2", {"power": power}, {"map": drawn})


def buffer_name(buffer: DepthBuffer) -> str:
    """Write format and mapping as people do, such as `D24 standard`."""
    return f"{buffer[0].upper()} {buffer[1]}"


def near_words(near: float) -> str:
    """Write a share of the reach in half decades in one digit, such as `3e-4` for 3.16e-4."""
    return re.sub(r"e-0", "e-", f"{near:.0e}")
