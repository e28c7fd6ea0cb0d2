"""Runs and their rows, as Parquet files hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from xfrustum.reports.baselines.changes import Change, Changes, MeasureChange
from xfrustum.reports.baselines.measures import NAMES, HogelMeasures, Measures, Place, total
from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.scenes.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Key:
    """What measures are comparable: the scene, the renderer, the device, and how images are judged.

    Attributes
    ----------
    scene_hash
        SHA-256 of plate, frustum and triangles.
    renderer, device
        Names of the renderer and of the machine that it runs on.
    judged
        Options that change the measures of the same images, in words.
    """

    scene_hash: str
    renderer: str
    device: str
    judged: str


@dataclass(frozen=True, kw_only=True)
class Run:
    """One verification that was held to a baseline.

    Attributes
    ----------
    run
        Name of the run, which sorts by time.
    time
        Time of the run, ISO 8601, UTC.
    scene, key
        Name of the scene, and what the measures are comparable with.
    commit, subject, modified
        Commit of the user's repository, the first line of its message, and whether files differed from it;
        None where there is no repository.
    xfrustum
        Version that judged.
    verdict
        Verdict of the verification: pass or fail.
    change
        Worst change from what was accepted before.
    approved
        Whether the run was accepted.
    edition
        Number of the accepted state that the run belongs to; None where it was not accepted. Runs of one
        edition are repetitions, whose differences are noise.
    faults
        Diagnosis in words.
    """

    run: str
    time: str
    scene: str
    key: Key = field(metadata=INLINED)
    commit: str | None
    subject: str | None
    modified: bool | None
    xfrustum: str
    verdict: str
    change: Change
    approved: bool
    edition: int | None
    faults: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One hogel of a run, or its whole plate, as a row of the Parquet file.

    Attributes
    ----------
    run
        The run; the same in all rows of a file.
    column, row
        Place of the hogel; None for the plate.
    by
        Property by which pixels are wrong; see `verify`.
    now, accepted, limit
        Present measures, the mean of the accepted runs, and the largest value that is not worse.
    worse, better
        Names of the measures that got worse, or better, beyond the tolerance.
    """

    run: Run = field(metadata=named_columns("{}"))
    column: int | None
    row: int | None
    by: str | None
    now: Measures = field(metadata=named_columns("{}"))
    accepted: Measures = field(metadata=named_columns("accepted_{}"))
    limit: Measures = field(metadata=named_columns("limit_{}"))
    worse: tuple[str, ...]
    better: tuple[str, ...]

    @property
    def place(self) -> Place | None:
        """Column and row of the hogel; None for the plate."""
        return None if self.column is None or self.row is None else (self.column, self.row)

    @property
    def changes(self) -> tuple[MeasureChange, ...]:
        """The measures that changed beyond the tolerance."""
        named = [(name, Change.WORSE) for name in self.worse] + [(n, Change.BETTER) for n in self.better]
        return tuple(
            MeasureChange(
                measure=name,
                aperture=self.place,
                accepted=self.accepted.value(name),
                limit=self.limit.value(name),
                now=self.now.value(name),
                change=change,
            )
            for name, change in named
        )


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """A run with its rows: the plate first, then the hogels."""

    run: Run
    rows: tuple[Row, ...]

    @property
    def plate(self) -> Row:
        """The row of the plate."""
        return self.rows[0]

    @property
    def hogels(self) -> tuple[HogelMeasures, ...]:
        """The measures of the hogels."""
        return tuple(
            HogelMeasures(place=row.place, by=row.by, measures=row.now)
            for row in self.rows
            if row.place is not None
        )


def stored_run(run: Run, hogels: Sequence[HogelMeasures], changes: Changes) -> StoredRun:
    """Return a run with the rows of its plate and hogels, each with what it was compared with."""
    # Where only some hogels can be compared, the plate's measures are those that were.
    plate = total([one.measures for one in hogels])
    plate = replace(plate, **{one.measure: one.now for one in changes.plate})
    of_place: dict[Place | None, list[MeasureChange]] = {None: []}
    for one in (*changes.plate, *changes.hogels):
        of_place.setdefault(one.aperture, []).append(one)
    rows = [_row(run, None, None, plate, of_place[None])]
    rows += [_row(run, one.place, one.by, one.measures, of_place.get(one.place, [])) for one in hogels]
    return StoredRun(run=run, rows=tuple(rows))


def _row(
    run: Run, place: Place | None, by: str | None, now: Measures, changes: Sequence[MeasureChange]
) -> Row:
    def names(change: Change) -> tuple[str, ...]:
        return tuple(one.measure for one in changes if one.change is change)

    return Row(
        run=run,
        column=None if place is None else place[0],
        row=None if place is None else place[1],
        by=by,
        now=now,
        accepted=Measures(**{one.measure: one.accepted for one in changes}),
        limit=Measures(**{one.measure: one.limit for one in changes}),
        worse=names(Change.WORSE),
        better=names(Change.BETTER),
    )


def parquet_bytes(stored: StoredRun) -> pa.Buffer:
    """Return the Parquet file of a run."""
    sink = pa.BufferOutputStream()
    pq.write_table(table_of(Row, stored.rows), sink, compression="zstd")
    return sink.getvalue()


def read_run(path: Path, *, changed_only: bool = False) -> StoredRun:
    """Read the Parquet file of a run.

    Parameters
    ----------
    path
        Path of the file.
    changed_only
        Whether to leave out hogels of which no measure got worse or better.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    try:
        table = pq.read_table(path)
        expected = table_of(Row, []).schema
        for column in expected:
            if column.name not in table.schema.names:  # Earlier versions did not measure it.
                table = table.append_column(column, pa.nulls(table.num_rows, column.type))
            elif table.schema.field(column.name).type != column.type:
                raise TypeError(f"column {column.name} is {table.schema.field(column.name).type}")
        if changed_only:
            table = table.filter(_changed(table))
        rows = tuple(_read_row(one) for one in table.select(expected.names).to_pylist())
        if not rows or rows[0].place is not None or any(one.place is None for one in rows[1:]):
            raise ValueError("the first row is not that of a plate")
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"--baseline {path}: is no file of measures ({reason:.200}); remove it, or restore it"
        ) from error
    return StoredRun(run=rows[0].run, rows=rows)


def _changed(table: pa.Table) -> pa.ChunkedArray:
    """Return which rows are of a plate, or have a measure that got worse or better."""
    worse, better = (pc.greater(pc.list_value_length(table[name]), 0) for name in ("worse", "better"))
    changed = pc.fill_null(pc.or_kleene(worse, better), False)
    return pc.or_(pc.is_null(table["column"]), changed)


def _read_row(values: Mapping[str, Any]) -> Row:
    key = Key(**{one.name: values[one.name] for one in fields(Key)})
    of_run = {one.name: values[one.name] for one in fields(Run) if one.name != "key"}
    said = {**vars(key), **{name: of_run[name] for name in ("run", "time", "scene", "change", "approved")}}
    if None in said.values():
        raise ValueError("a row does not say which run it is of")
    of_run |= {"change": Change(of_run["change"]), "faults": tuple(of_run["faults"] or ())}
    run = Run(**of_run, key=key)
    groups = {
        group: Measures(**{name: values[pattern.format(name)] for name in NAMES})
        for group, pattern in (("now", "{}"), ("accepted", "accepted_{}"), ("limit", "limit_{}"))
    }
    return Row(
        run=run,
        column=values["column"],
        row=values["row"],
        by=values["by"],
        worse=tuple(values["worse"] or ()),
        better=tuple(values["better"] or ()),
        **groups,
    )
