"""Rows of the hogels of a sample: a table with their figures as found and corrected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa

from xfrustum.compare.judging.judged import HogelNumbers
from xfrustum.compare.judging.verdict import Hogel
from xfrustum.reports.common.records import named_columns, table_of


@dataclass(frozen=True, kw_only=True)
class RoundingCauses:
    """Wrong pixels by the kind of rounding that explains them."""

    edge: int
    order: int
    lost: int
    unexplained: int


@dataclass(frozen=True, kw_only=True)
class RowNumbers(HogelNumbers):
    """Figures of one image with a column for each cause, whether there are any or not."""

    causes: RoundingCauses | None  # type: ignore[assignment]

    @classmethod
    def from_numbers(cls, numbers: HogelNumbers | None) -> RowNumbers | None:
        """Return the figures with their causes as columns."""
        if numbers is None:
            return None
        causes = None if numbers.causes is None else RoundingCauses(**numbers.causes)
        values: dict[str, Any] = {**vars(numbers), "causes": causes}
        return cls(**values)


@dataclass(frozen=True, kw_only=True)
class HogelRow:
    """One hogel of another renderer, as found and as corrected for the diagnosis."""

    column: int
    row: int
    #: whether it is missing, for the reason `problem`, or does not pass
    beyond: bool
    verdict: str
    problem: str | None
    as_found: RowNumbers | None = field(metadata=named_columns("{}"))
    corrected: RowNumbers | None


def rows_of(hogels: Sequence[Hogel]) -> pa.Table:
    """Return a table of judged hogels, a row each."""
    rows = [
        HogelRow(
            column=hogel.aperture.column,
            row=hogel.aperture.row,
            beyond=not hogel.passed,
            verdict=hogel.verdict,
            problem=hogel.problem,
            as_found=RowNumbers.from_numbers(hogel.as_found),
            corrected=RowNumbers.from_numbers(hogel.corrected),
        )
        for hogel in hogels
    ]
    return table_of(HogelRow, rows)
