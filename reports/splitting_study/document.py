"""The study as a document: text from a template, every number from the rows."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.prediction.chain import EXACT_DEPTH
from xfrustum.compare.prediction.depth import EXPRESSION_ROUNDINGS, MAX_MISORDERED_FRACTION
from xfrustum.reports.common.formatting import digits, percent
from xfrustum.reports.common.templates_environment import Filters, plain_text
from xfrustum.reports.measurements.best import pixels
from xfrustum.reports.splitting_study import facts, families
from xfrustum.reports.splitting_study.advice import Advice, advice_table, buffer_name, span
from xfrustum.reports.splitting_study.figures import SIDE_WORDS, maps, near_words
from xfrustum.reports.splitting_study.grid import Family
from xfrustum.reports.splitting_study.measure import NEAREST_PERCENTILE
from xfrustum.reports.splitting_study.rows import ASKED_SEPARATION, StudyRow
from xfrustum.reports.splitting_study.suitability import (
    Suitability,
    outcomes,
    suitability,
)
from xfrustum.reports.studies.origin import Origin
from xfrustum.scenes.library.depth_family import CAR_RATIO, CARS, FARTHEST, REACH
from xfrustum.tolerances import MAX_DEPTH_WRONG, TOLERANCE_PX

Rows = Sequence[StudyRow]

EXAMPLE_NEAR = 1e-2
"""Share of the reach: what one might choose without thinking."""


def sentence(rows: Rows) -> str:
    """Say the result of scenes on one side of the plate in one sentence."""
    found = facts.buffer_facts(families.of_family(rows, Family.ONE_SIDE))
    # Among equally good ones the last counts that costs no early depth test.
    best = max(found, key=lambda f: (f.one_pair, len(f.always), f.buffer[1] not in EXPRESSION_ROUNDINGS))
    nears = (
        f", at any near from {near_words(best.always[0])} to {near_words(best.always[-1])} of the reach"
        if best.always
        else ""
    )
    enough, cases = sum(f.one_pair for f in found), sum(f.cases for f in found)
    return (
        f"With content on one side of the plate, one pair of frusta is enough in {enough} of {cases} cases; "
        f"with {best.name} depth in {best.one_pair} of {best.cases}{nears}."
    )


@dataclass(frozen=True, kw_only=True)
class WorstShares:
    """Largest shares of a side's pixels that are wrong by depth and that are lost, at any near.

    `covered` is the share that surfaces cover, at the near where most are wrong.
    """

    wrong: float
    lost: float
    covered: float


@dataclass(frozen=True, kw_only=True)
class DocumentNumbers:
    """Everything that the template says of the first family, by the names that it uses.

    Attributes
    ----------
    cells, pictures_with_slabs
        Number of pictures of one pair of frusta, and number of those with slabs.
    nears, spacing, resolutions, ratios, sides
        What was varied; spacing says in words how far apart the nears are.
    buffers, example, columns, advice, agreement
        Facts of each depth buffer, pictures at `EXAMPLE_NEAR`, the table at the end, and how well closed
        forms do.
    too_careful, too_hopeful
        Number of cases in which the rule of thumb is wrong, by depth buffer.
    side_differences, gap_nears, gap_buffers
        Cases that C and C* answer differently, in words; nears and buffers of windows with gaps.
    wrong_at_best, slab_displacement, slab_wrong, slab_counts
        Largest figures of settings that are enough, and how many cases needed how many slabs.
    starved, starved_by_sheets, starved_by_picture
        Number of starved settings, and of those that only the sheets or only the picture call so.
    worst
        Worst shares by side.
    suitable
        Number of settings by `Suitability`.
    """

    cells: int
    pictures_with_slabs: int
    nears: list[float]
    spacing: str
    resolutions: list[int]
    ratios: list[float]
    sides: list[str]
    buffers: list[facts.BufferFacts]
    example: list[StudyRow]
    columns: list[list[str]]
    advice: list[Advice]
    agreement: facts.Agreement
    too_careful: dict[str, int]
    too_hopeful: dict[str, int]
    side_differences: list[str]
    gap_nears: list[float]
    gap_buffers: list[str]
    wrong_at_best: float
    slab_displacement: float
    slab_wrong: float
    slab_counts: dict[int | None, int]
    starved: int
    starved_by_sheets: int
    starved_by_picture: int
    worst: dict[str, WorstShares]
    suitable: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class FamilyNumbers:
    """Everything that the template says of the other families; None or empty where one was not measured.

    Attributes
    ----------
    family_pictures, family_slab_pictures, family_resolutions, family_buffers
        Number of pictures of one pair, and of those with slabs, in the other families; their resolutions; and
        the names of their depth buffers.
    helps
        What helps in each family.
    alike, agreed
        By family: how far it has the windows of the first one, and how well closed forms do.
    off_middle, shear, through
        The facts of single families.
    outside
        Points from outside the film, over all families.
    """

    family_pictures: int
    family_slab_pictures: int
    family_resolutions: list[int]
    family_buffers: list[str]
    helps: list[families.Help]
    alike: dict[str, families.Likeness]
    agreed: dict[str, families.Agreed]
    off_middle: families.OffMiddle | None
    shear: families.Shear | None
    through: families.Through | None
    outside: families.OutsideShares


def document(rows: Rows, origin: Origin) -> str:
    """Return the document as Markdown."""
    first = families.of_family(rows, Family.ONE_SIDE)
    filters: Filters = {
        "percent": percent,
        "pixels": pixels,
        "digits": digits,
        "near": near_words,
        "span": span,
        "plain": "{:g}".format,
        "rounded": _rounded,
        "near_or_none": families.near_or_none,
    }
    values = {
        "tolerance_px": TOLERANCE_PX,
        "max_depth_wrong": MAX_DEPTH_WRONG,
        "separation": ASKED_SEPARATION,
        "misordered": MAX_MISORDERED_FRACTION,
        "control": buffer_name(EXACT_DEPTH),
        "cars": CARS,
        "car_ratio": CAR_RATIO,
        "farthest": FARTHEST / REACH,
        "percentile": NEAREST_PERCENTILE,
        "product": math.sqrt(2) * TOLERANCE_PX,
        "origin": origin,
        "figures": {name: drawn.title for name, drawn in maps(rows).items()},
        **vars(_numbers(first)),
        "minutes": sum(row.seconds for row in rows) / 60,
        **vars(_family_numbers(rows)),
    }
    text = plain_text("when-to-split.md.j2", filters, values)
    return re.sub(r"\n{3,}", "\n\n", text)


def _numbers(rows: Rows) -> DocumentNumbers:
    """Return everything that the template says of the first family's rows."""
    single = facts.whole(rows)
    buffers = facts.buffer_facts(rows)
    columns, advice = advice_table(rows)
    gap_nears, gap_buffers = facts.gaps(rows)
    good = [row for row in rows if suitability(row) is Suitability.ENOUGH]
    split = [row for row in good if row.slabs]
    starved = [row for row in single if suitability(row) in {Suitability.STARVED, Suitability.BOTH}]
    return DocumentNumbers(
        cells=len(single),
        pictures_with_slabs=len(rows) - len(single),
        nears=sorted({row.near for row in single}, reverse=True),
        spacing=_spacing(single),
        resolutions=sorted({row.resolution for row in single}),
        ratios=sorted({row.ratio for row in single}),
        sides=[SIDE_WORDS[side] for side in dict.fromkeys(row.side for row in single)],
        buffers=buffers,
        example=_example(single),
        columns=columns,
        advice=advice,
        agreement=facts.agreement(rows, buffers),
        too_careful=facts.rule_exceptions(rows, buffers, one_pair=True),
        too_hopeful=facts.rule_exceptions(rows, buffers, one_pair=False),
        side_differences=[
            f"{buffer_name(case.buffer)} at depth {case.ratio:g} and {case.resolution} px"
            for case in facts.side_differences(rows)
        ],
        gap_nears=gap_nears,
        gap_buffers=[buffer_name(buffer) for buffer in gap_buffers],
        wrong_at_best=max((row.surface_wrong / row.judged for row in good if not row.slabs), default=0.0),
        slab_displacement=max((row.displacement_p99 or 0.0 for row in split), default=0.0),
        slab_wrong=max((row.surface_wrong / row.judged for row in split), default=0.0),
        slab_counts=_slab_counts(rows),
        starved=len(starved),
        starved_by_sheets=sum(row.depth_fraction <= MAX_DEPTH_WRONG for row in starved),
        starved_by_picture=sum(row.misordered <= MAX_MISORDERED_FRACTION for row in starved),
        worst=_worst(single),
        suitable={str(kind): sum(suitability(row) is kind for row in single) for kind in Suitability},
    )


def _family_numbers(rows: Rows) -> FamilyNumbers:
    """Return everything that the template says of the other families."""
    others = [row for row in rows if row.family is not Family.ONE_SIDE]
    kinds = list(dict.fromkeys(row.family for row in others))
    alike = {kind: families.likeness(rows, kind) for kind in kinds}
    return FamilyNumbers(
        family_pictures=sum(not row.slabs for row in others),
        family_slab_pictures=sum(bool(row.slabs) for row in others),
        family_resolutions=sorted({row.resolution for row in others}),
        family_buffers=[buffer_name(buffer) for buffer in dict.fromkeys(row.buffer for row in others)],
        helps=families.helps(rows),
        alike={str(kind): found for kind, found in alike.items() if found is not None},
        agreed={str(kind): families.agreed(rows, kind) for kind in kinds},
        off_middle=families.off_middle(rows),
        shear=families.shear(rows),
        through=families.through(rows),
        outside=families.outside_shares(rows),
    )


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
    split = [a for a in outcomes(rows).values() if not a.one_pair]
    counts = [None if a.slabs is None else len(a.slabs) for a in split]
    return {count: counts.count(count) for count in sorted(set(counts), key=lambda c: c or 99)}


def _worst(single: Rows) -> dict[str, WorstShares]:
    """Return the worst shares of each side."""
    worst = {}
    for side in dict.fromkeys(row.side for row in single):
        own = [row for row in single if row.side is side]
        wrong = max(own, key=lambda row: row.depth_fraction)
        worst[SIDE_WORDS[side].split(",")[0]] = WorstShares(
            wrong=wrong.depth_fraction,
            lost=max(row.lost / row.judged for row in own),
            covered=wrong.covered / wrong.judged,
        )
    return worst
