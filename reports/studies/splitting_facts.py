"""What the rows of the study of splitting say: its sentence, its tables, its maps, and its JSON."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import dropwhile, takewhile
from typing import Any

import numpy as np
from scipy.optimize import brentq

from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, smallest_separation
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.templates_environment import plain_text, svg_picture
from xfrustum.reports.studies.splitting_cells import (
    AS_IN_THE_PAPER,
    ASKED_SEPARATION,
    Case,
    DepthBuffer,
    Family,
    Outcome,
    Row,
    Suitability,
    outcomes,
    predicted_suitability,
    suitability,
)
from xfrustum.reports.studies.sweep import Origin, StudyFiles
from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping, Fit, Offset
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[Row]

_LEAST_NEAR, _LARGEST_NEAR = 1e-12, 0.5
"""Nears between which the smallest that orders a separation is looked for, shares of the reach."""

_COLORS = {
    Suitability.ENOUGH: ("#009E73", "one pair is enough"),
    Suitability.BENT: ("#E69F00", "bent by the near plane"),
    Suitability.STARVED: ("#56B4E9", "starved of depth"),
    Suitability.BOTH: ("#5b5b5b", "both"),
}
"""Colors of the maps, of Okabe and Ito's palette, which color-blind readers tell apart; and meanings."""


def record(files: StudyFiles) -> dict[str, Any]:
    """Return the study as `xfrustum study splitting --json` prints it."""
    rows = files.rows
    first = of_family(rows, Family.ONE_SIDE)
    return dict(
        json_ready(
            {
                **files.record,
                "sentence": sentence(rows),
                "criteria": {
                    "displacement_p99_px": TOLERANCE_PX,
                    "depth_wrong": MAX_DEPTH_WRONG,
                    "separation": ASKED_SEPARATION,
                },
                "agreement": agreement(first),
                "helps": helps(rows),
                "cases": [
                    {**asdict(one.case), "one_pair": one.one_pair, "nears": one.nears, "slabs": one.slabs}
                    for one in outcomes(rows).values()
                ],
            }
        )
    )


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
        "figures": {name: drawn.title for name, drawn in maps(rows).items()},
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
    nears = (
        f", at any near from {near_words(always[0])} to {near_words(always[-1])} of the reach"
        if always
        else ""
    )
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

    Returns
    -------
    dict
        Number of settings (`cells`), of those in which closed forms say what was measured (`same`), and of
        the others whose near is not enough between two that are (`in_gaps`); number of cases, and of those in
        which the rule of thumb says what was measured; and the ends of measured over predicted 99th
        percentile of displacement, where a tenth to ten times the tolerance is predicted and depth does no
        harm. The rule: one pair is enough up to a product of image width and depth of the scene. Displacement
        is largest in the film's corner, W / 2 sqrt(2) n / (|z| + n), and stays under the tolerance for n up
        to about sqrt(2) TOLERANCE_PX |z| / W, which must not be less than `least_near`.
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
    others = [row for row in single if suitability(row) is not predicted_suitability(row)]
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
    found = outcomes(rows)
    return [_help(found, family) for family in dict.fromkeys(row.family for row in rows)]


def _help(found: Mapping[Case, Outcome], family: Family) -> dict[str, Any]:
    paper = [
        one
        for case, one in found.items()
        if case.family is family and (case.pivot, case.fit, case.offset) == AS_IN_THE_PAPER
    ]
    failed = [one for one in paper if not one.one_pair]
    easy = {(one.case.side, one.case.ratio, one.case.resolution) for one in paper if one.one_pair}
    cuts = [one.slabs for one in failed if one.slabs]

    def served(ways: Iterable[Case]) -> int | None:
        drawn = [found[way] for way in ways if way in found]
        return sum(way.one_pair for way in drawn) if drawn else None

    return {
        "family": family,
        "cases": len(paper),
        "one_pair": len(paper) - len(failed),
        "other_buffer": sum((one.case.side, one.case.ratio, one.case.resolution) in easy for one in failed),
        "fit": served(replace(one.case, fit=Fit.SCREEN) for one in failed),
        "no_offset": served(replace(one.case, offset=Offset.NONE) for one in failed),
        "slabs": len(cuts),
        "most_slabs": max(map(len, cuts), default=0),
    }


def advice(rows: Rows) -> tuple[list[list[str]], list[tuple[int, float, tuple[str, ...]]]]:
    """Return the study's table: columns of depth buffers that share it; resolutions, depths and advice.

    An outcome serves both sides of the plate: nears that are enough on each, else the cuts of the side that
    needs more.
    """
    found = outcomes(rows)
    kinds = sorted({(case.resolution, case.ratio) for case in found})
    measured = {row.near for row in rows if not row.slabs}
    columns: dict[tuple[str, ...], list[str]] = {}
    for buffer in dict.fromkeys(row.buffer for row in rows):
        cells = []
        for kind in kinds:
            own = [
                one
                for case, one in found.items()
                if (case.resolution, case.ratio) == kind and case.buffer == buffer
            ]
            cells.append(_advice(own, measured))
        columns.setdefault(tuple(cells), []).append(buffer_name(buffer))
    lines = [(*kind, tuple(cells[line] for cells in columns)) for line, kind in enumerate(kinds)]
    return list(columns.values()), lines


def _advice(sides: Sequence[Outcome], measured: Iterable[float]) -> str:
    if common := set.intersection(*(set(one.nears) for one in sides)):
        nears = unbroken(common, measured)
        first, last = near_words(nears[0]), near_words(nears[-1])
        return first if first == last else f"{first} to {last}"
    cuts = [one.slabs for one in sides if not one.one_pair]
    if not cuts or None in cuts:
        return "**no**"
    return "**split** at " + ", ".join(f"{cut:.2g}" for cut in max((c for c in cuts if c), key=len))


# Maps: near across, depth buffers down


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One map: a title, and the colors of its squares by line."""

    title: str
    lines: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Map:
    """Panels in rows that share their lines' names and nears.

    The legend has colors with their meanings; the gutter is the width of the lines' names, pixels.
    """

    title: str
    panels: tuple[tuple[Panel, ...], ...]
    names: tuple[str, ...]
    nears: tuple[float, ...]
    legend: tuple[tuple[str, str], ...]
    across: str = "near plane / reach"
    gutter: int = 132


def maps(rows: Rows) -> dict[str, Map]:
    """Return where one pair of frusta is enough, by figure: one for each side, one for the rest.

    A panel is a picture and a way of drawing it; its lines are depth buffers, and nears run across.
    """
    single = [row for row in rows if not row.slabs]
    first, rest = of_family(single, Family.ONE_SIDE), [r for r in single if r.family is not Family.ONE_SIDE]
    sides = dict.fromkeys(row.side for row in first)
    named = {f"when-to-split-{side}": [row for row in first if row.side is side] for side in sides}
    titles = {name: f"{own[0].side}: where one pair of frusta is enough" for name, own in named.items()}
    if rest:
        named["when-to-split-families"] = rest
        titles["when-to-split-families"] = "Other scenes: where one pair of frusta is enough"
    return {name: _map(titles[name], own) for name, own in named.items()}


def _map(title: str, rows: Rows) -> Map:
    buffers = list(dict.fromkeys(row.buffer for row in rows))
    panels: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        panels.setdefault((row.family, *row.drawing, row.ratio, row.resolution), []).append(row)
    by_row: dict[tuple[object, ...], list[Panel]] = {}
    for (family, *drawing, ratio, resolution), own in panels.items():
        lines = tuple(
            tuple(
                _COLORS[suitability(row)][0]
                for row in sorted(own, key=lambda row: -row.near)
                if row.buffer == buffer
            )
            for buffer in buffers
        )
        words = [str(word) for word in (family, *drawing) if word not in (*AS_IN_THE_PAPER, Family.ONE_SIDE)]
        name = ", ".join((*words, f"depth {ratio:g}, {resolution} px"))
        line = (family, *drawing, ratio if family is Family.ONE_SIDE else None)
        by_row.setdefault(line, []).append(Panel(title=name, lines=lines))
    return Map(
        title=title,
        panels=tuple(map(tuple, by_row.values())),
        names=tuple(map(buffer_name, buffers)),
        nears=tuple(sorted({row.near for row in rows}, reverse=True)),
        legend=tuple(_COLORS.values()),
    )


def svg(drawn: Map) -> str:
    """Return a map as an SVG document."""
    return svg_picture("study-map.svg.j2", {"power": _power}, {"map": drawn})


def buffer_name(buffer: tuple[DepthFormat, DepthMapping]) -> str:
    """Write format and mapping as people do, such as `D24 standard`."""
    return f"{buffer[0].upper()} {buffer[1]}"


def near_words(near: float) -> str:
    """Write a share of the reach in half decades in one digit, such as `3e-4` for 3.16e-4."""
    return re.sub(r"e-0", "e-", f"{near:.0e}")


def _power(near: float) -> str:
    """Return a whole power of ten as people write it, nothing for what lies between."""
    exponent = math.log10(near)
    if abs(exponent - round(exponent)) > 1e-6:
        return ""
    return f"10{str(round(exponent)).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
