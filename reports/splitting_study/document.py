"""The study as a document: text from a template, every number from the rows."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, MISORDERED
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.templates_environment import Filters, plain_text
from xfrustum.reports.measurements.best import pixels
from xfrustum.reports.splitting_study import facts
from xfrustum.reports.splitting_study.advice import advice_table, buffer_name, span
from xfrustum.reports.splitting_study.figures import SIDE_WORDS, maps, near_words
from xfrustum.reports.splitting_study.grid import CONTROL
from xfrustum.reports.splitting_study.measure import NEAREST_PERCENTILE
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION, Origin, StudyRow
from xfrustum.reports.splitting_study.verdict import (
    Verdict,
    answers,
    verdict,
)
from xfrustum.scenes.library.depth_family import CAR_RATIO, CARS, FARTHEST, REACH
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[StudyRow]

EXAMPLE_NEAR = 1e-2
"""Share of the reach: what one might choose without thinking."""


def sentence(rows: Rows) -> str:
    """Say the result in one sentence."""
    found = facts.buffer_facts(rows)
    # Of equally good ones, one that costs no early depth test.
    best = max(found, key=lambda f: (f.one_pair, len(f.always), f.buffer[1] not in EXPRESSION_ROUNDINGS))
    nears = (
        f", at any near from {near_words(best.always[0])} to {near_words(best.always[-1])} of the reach"
        if best.always
        else ""
    )
    enough, cases = sum(f.one_pair for f in found), sum(f.cases for f in found)
    return (
        f"One pair of frusta is enough in {enough} of {cases} cases; "
        f"with {best.name} depth in {best.one_pair} of {best.cases}{nears}."
    )


def document(rows: Rows, origin: Origin) -> str:
    """Return the document as Markdown."""
    filters: Filters = {
        "percent": percent,
        "pixels": pixels,
        "digits": digits,
        "near": near_words,
        "span": span,
        "plain": "{:g}".format,
        "rounded": _rounded,
    }
    titles = {name: drawn.title for name, drawn in maps(rows).items()}
    text = plain_text(
        "when-to-split.md.j2", filters, {**_constants(), **_counts(rows), "origin": origin, "figures": titles}
    )
    return re.sub(r"\n{3,}", "\n\n", text)


def _constants() -> dict[str, Any]:
    return {
        "tolerance_px": TOLERANCE_PX,
        "max_depth_wrong": MAX_DEPTH_WRONG,
        "separation": ASKED_SEPARATION,
        "misordered": MISORDERED,
        "control": buffer_name(CONTROL),
        "cars": CARS,
        "car_ratio": CAR_RATIO,
        "farthest": FARTHEST / REACH,
        "percentile": NEAREST_PERCENTILE,
        "product": math.sqrt(2) * TOLERANCE_PX,
    }


def _counts(rows: Rows) -> dict[str, Any]:
    """Return everything that the template says of the rows."""
    single = facts.whole(rows)
    buffers = facts.buffer_facts(rows)
    columns, advice = advice_table(rows)
    gap_nears, gap_buffers = facts.gaps(rows)
    good = [row for row in rows if verdict(row) is Verdict.ENOUGH]
    split = [row for row in good if row.slabs]
    starved = [row for row in single if verdict(row) in {Verdict.STARVED, Verdict.BOTH}]
    return {
        "cells": len(single),
        "pictures_with_slabs": len(rows) - len(single),
        "minutes": sum(row.seconds for row in rows) / 60,
        "nears": sorted({row.near for row in single}, reverse=True),
        "spacing": _spacing(single),
        "resolutions": sorted({row.resolution for row in single}),
        "ratios": sorted({row.ratio for row in single}),
        "sides": [SIDE_WORDS[side] for side in dict.fromkeys(row.side for row in single)],
        "buffers": buffers,
        "example": _example(single),
        "columns": columns,
        "advice": advice,
        "agreement": facts.agreement(rows, buffers),
        "too_careful": facts.rule_exceptions(rows, buffers, one_pair=True),
        "too_hopeful": facts.rule_exceptions(rows, buffers, one_pair=False),
        "side_differences": [
            f"{buffer_name(case.buffer)} at depth {case.ratio:g} and {case.resolution} px"
            for case in facts.side_differences(rows)
        ],
        "gap_nears": gap_nears,
        "gap_buffers": [buffer_name(buffer) for buffer in gap_buffers],
        "wrong_at_best": max((row.surface_wrong / row.judged for row in good if not row.slabs), default=0.0),
        "slab_displacement": max((row.displacement_p99 or 0.0 for row in split), default=0.0),
        "slab_wrong": max((row.surface_wrong / row.judged for row in split), default=0.0),
        "slab_counts": _slab_counts(rows),
        "starved": len(starved),
        "starved_by_sheets": sum(row.depth_fraction <= MAX_DEPTH_WRONG for row in starved),
        "starved_by_picture": sum(row.misordered <= MISORDERED for row in starved),
        "worst": _worst(single),
        "verdicts": {str(v): sum(verdict(row) is v for row in single) for v in Verdict},
    }


def _spacing(single: Rows) -> str:
    """Return in words how far apart the nears are."""
    exponents = np.log10(sorted({row.near for row in single}))
    for step, words in ((0.5, "half a decade apart (3e-4 stands for 3.16e-4)"), (1.0, "a decade apart")):
        if len(exponents) > 1 and np.allclose(np.diff(exponents), step):
            return words
    return "unevenly spaced"


def _example(single: Rows) -> list[StudyRow]:
    """Return pictures of the finest images at `EXAMPLE_NEAR`, one for each depth of the scene."""
    finest = max(row.resolution for row in single)
    chosen = {
        row.ratio: row
        for row in single
        if row.resolution == finest
        and math.isclose(row.near, EXAMPLE_NEAR)
        and row.displacement_p99 is not None
    }
    return [chosen[ratio] for ratio in sorted(chosen)]


def _rounded(value: float) -> str:
    """Write a number with two digits, or with those before the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _slab_counts(rows: Rows) -> dict[int | None, int]:
    """Return how many cases needed how many slabs; None counts those that stayed open."""
    split = [a for a in answers(rows).values() if not a.one_pair]
    counts = [None if a.slabs is None else len(a.slabs) for a in split]
    return {count: counts.count(count) for count in sorted(set(counts), key=lambda c: c or 99)}


def _worst(single: Rows) -> dict[str, dict[str, float]]:
    """Return for each side the largest share of pixels wrong by depth, and of those lost, with both nears."""
    worst = {}
    for side in dict.fromkeys(row.side for row in single):
        own = [row for row in single if row.side is side]
        wrong = max(own, key=lambda row: row.depth_fraction)
        worst[SIDE_WORDS[side].split(",")[0]] = {
            "wrong": wrong.depth_fraction,
            "lost": max(row.lost / row.judged for row in own),
            "covered": wrong.covered / wrong.judged,
        }
    return worst


def content_object(rows: Rows, origin: Origin) -> dict[str, Any]:
    """Return the study as one JSON object: criteria, every case's answer, where it came from."""
    found = facts.buffer_facts(rows)
    same = facts.agreement(rows, found)
    content: dict[str, Any] = json_ready(
        {
            "sentence": sentence(rows),
            "criteria": {
                "displacement_p99_px": TOLERANCE_PX,
                "depth_wrong": MAX_DEPTH_WRONG,
                "separation": ASKED_SEPARATION,
            },
            "cells": len(rows),
            "agreement": same,
            "cases": [
                {
                    "side": a.case.side,
                    "ratio": a.case.ratio,
                    "resolution": a.case.resolution,
                    "depth": a.case.buffer[0],
                    "mapping": a.case.buffer[1],
                    "one_pair": a.one_pair,
                    "nears": a.nears,
                    "slabs": a.slabs,
                }
                for a in answers(rows).values()
            ],
            "versions": origin.versions,
            "devices": origin.devices,
        }
    )
    return content
