"""The study's table: a resolution, a depth of scene and a depth buffer in, a near or cuts out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.splitting_study.figures import near_words
from xfrustum.reports.splitting_study.grid import DepthBuffer
from xfrustum.reports.splitting_study.rows import StudyRow
from xfrustum.reports.splitting_study.suitability import Outcome, outcomes, unbroken


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One line of the table at the end: a resolution, a depth of scene, and what each column says."""

    resolution: int
    ratio: float
    cells: tuple[str, ...]


def advice_table(rows: Sequence[StudyRow]) -> tuple[list[list[str]], list[Advice]]:
    """Return the columns, each the names of depth buffers that share it, and the lines.

    An outcome serves both sides of the plate: nears that are enough on each, else the cuts of the side
    that needs more.
    """
    found = list(outcomes(rows).values())
    kinds = sorted({(a.case.resolution, a.case.ratio) for a in found})
    measured = sorted({row.near for row in rows if not row.slabs}, reverse=True)
    columns: dict[tuple[str, ...], list[str]] = {}
    for buffer in dict.fromkeys(row.buffer for row in rows):
        cells = []
        for kind in kinds:
            own = [a for a in found if (a.case.resolution, a.case.ratio) == kind and a.case.buffer == buffer]
            cells.append(_advice(own, measured))
        columns.setdefault(tuple(cells), []).append(buffer_name(buffer))
    lines = [
        Advice(resolution=size, ratio=ratio, cells=tuple(cells[line] for cells in columns))
        for line, (size, ratio) in enumerate(kinds)
    ]
    return list(columns.values()), lines


def _advice(sides: Sequence[Outcome], measured: Sequence[float]) -> str:
    common = set.intersection(*(set(a.nears) for a in sides))
    if common:
        return span(unbroken(common, measured))
    cuts = [a.slabs for a in sides if not a.one_pair]
    if not cuts or None in cuts:
        return "**no**"
    return "**split** at " + ", ".join(f"{cut:.2g}" for cut in max((c for c in cuts if c), key=len))


def span(nears: Sequence[float]) -> str:
    """Write a window of nears, such as `1e-3 to 1e-4`."""
    first, last = near_words(nears[0]), near_words(nears[-1])
    return first if first == last else f"{first} to {last}"


def buffer_name(buffer: DepthBuffer) -> str:
    """Write format and mapping as people do, such as `D24 standard`."""
    return f"{buffer[0].upper()} {buffer[1]}"
