"""The study's measurements as rows, and as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.reports.splitting_study.grid import Cell, Setting
from xfrustum.reports.splitting_study.measure import SEPARATIONS, CellResult, SheetResult
from xfrustum.reports.studies.origin import Origin
from xfrustum.reports.studies.rows import read_rows, write_rows

ASKED_SEPARATION = 1e-3
"""Distance of two surfaces at the far end that a depth buffer must order, as a share of the reach."""


@dataclass(frozen=True, kw_only=True)
class StudyRow(Setting, CellResult):
    """A cell, its picture judged, and the sheets at the far end of its side.

    Attributes
    ----------
    misordered
        Share of pixels that do not show the right one of two sheets `ASKED_SEPARATION` apart.
    ordered_separation
        The smallest separation measured that is ordered, with all larger ones; None where none is.
    predicted_separation
        The smallest that is, by the closed form.
    """

    misordered: float
    ordered_separation: float | None
    predicted_separation: float

    @property
    def depth_fraction(self) -> float:
        """Share of the judged pixels whose wrong surface is charged to depth."""
        return self.depth_wrong / self.judged


def joined(cell: Cell, picture: CellResult, sheets: Sequence[SheetResult]) -> StudyRow:
    """Return a cell with what was measured for it; of the sheets of several cameras the worst count."""
    ordered = None
    misordered = [max(shares) for shares in zip(*(one.misordered for one in sheets), strict=True)]
    for separation, share in zip(SEPARATIONS, misordered, strict=True):
        if share > MAX_MISORDERED_FRACTION:
            break
        ordered = separation
    return StudyRow(
        **vars(cell),
        **vars(picture),
        misordered=misordered[SEPARATIONS.index(ASKED_SEPARATION)],
        ordered_separation=ordered,
        predicted_separation=max(one.predicted_separation for one in sheets),
    )


def write_parquet(rows: Sequence[StudyRow], origin: Origin, path: Path) -> None:
    """Write one row per cell; see `write_rows`."""
    write_rows(StudyRow, rows, origin, path)


def read_parquet(path: Path) -> tuple[tuple[StudyRow, ...], Origin]:
    """Return the rows of a file of `write_parquet`, and where they came from."""
    return read_rows(StudyRow, path)
