"""Runs and their rows, as Parquet files hold them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from sys import intern
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from xfrustum.reports.baselines.changes import Change, Changes, MeasureChange, ranked
from xfrustum.reports.baselines.measures import NAMES, HogelMeasures, Measures, Place, total
from xfrustum.reports.common.json_ready import INLINED
from xfrustum.reports.common.records import named_columns, table_of
from xfrustum.scenes.arrays import Floats
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
        Number of the accepted state that the run belongs to; None where it was not accepted. Branches may
        give the same number to two states.
    began, follows
        Name of that state, which is the first run of it, and the states that were newest before the run was
        accepted. Runs of one state are repetitions, whose differences are noise.
    new_hogels, new_beyond_limits, not_judged_hogels
        Numbers of hogels that were not accepted before, of those among them that exceed the limits, and of
        accepted ones that were not judged; None in runs of versions that did not count them.
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
    began: str | None
    follows: tuple[str, ...]
    new_hogels: int | None
    new_beyond_limits: int | None
    not_judged_hogels: int | None
    faults: tuple[str, ...]

    @property
    def hogels_words(self) -> str:
        """Which hogels were not compared, in words; empty where all were, or nothing was accepted."""
        told = []
        if self.new_hogels and (self.change is not Change.NEW or self.not_judged_hogels):
            told.append(f"{_hogels(self.new_hogels)} not accepted before")
            if self.new_beyond_limits:
                told[0] += f", {self.new_beyond_limits:,} of them beyond the limits"
        if self.not_judged_hogels:
            told.append(f"{_hogels(self.not_judged_hogels)} accepted, and not judged now")
        return "; ".join(told)

    @property
    def hogels_sentence(self) -> str:
        """The same as a sentence."""
        return f"Not compared: {self.hogels_words}." if self.hogels_words else ""


def _hogels(number: int) -> str:
    return f"{number:,} {'hogel' if number == 1 else 'hogels'}"


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


@dataclass(frozen=True, kw_only=True, eq=False)
class AcceptedRun:
    """Measures of the hogels of an accepted run, as arrays.

    Attributes
    ----------
    run
        The run.
    places
        Column and row of each hogel.
    by
        Property by which pixels of each hogel are wrong.
    numbers
        Values of the measures, shape (hogels, measures); NaN where one is not known.
    """

    run: Run
    places: tuple[Place, ...]
    by: tuple[str | None, ...]
    numbers: Floats

    def hogel(self, row: int) -> HogelMeasures:
        """Return the measures of one hogel."""
        numbers = [None if math.isnan(number) else number for number in self.numbers[row].tolist()]
        measures = Measures(**dict(zip(NAMES, numbers, strict=True)))
        return HogelMeasures(place=self.places[row], by=self.by[row], measures=measures)

    def of_places(self, places: Collection[Place]) -> AcceptedRun:
        """Return these measures of some hogels only."""
        rows = [row for row, place in enumerate(self.places) if place in places]
        return AcceptedRun(
            run=self.run,
            places=tuple(self.places[row] for row in rows),
            by=tuple(self.by[row] for row in rows),
            numbers=self.numbers[rows],
        )


@dataclass(frozen=True, kw_only=True)
class ToldRun:
    """A run as the history tells of it.

    Attributes
    ----------
    run, plate
        The run, and the row of its plate.
    worse
        Number of hogels in which a measure got worse, by name of the measure.
    changes, changed
        The largest of what got worse, or, where nothing did, of what got better, by `ranked`; and the number
        of all such changes.
    """

    run: Run
    plate: Row
    worse: Mapping[str, int]
    changes: tuple[MeasureChange, ...]
    changed: int


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


def check_file(path: Path) -> None:
    """See that a file has the columns of a run, without reading these.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    with _reading(path):
        _check_columns(pq.read_schema(path))


def read_head(path: Path) -> Run:
    """Read which run a file holds, from its first row.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    with _reading(path), pq.ParquetFile(path) as file:
        _check_columns(file.schema_arrow)
        there = [name for name in _RUN_COLUMNS if name in file.schema_arrow.names]
        batch = next(file.iter_batches(batch_size=1, columns=there), None)
        if batch is None:
            raise ValueError("it has no rows")
        return _read_run_of_row(dict.fromkeys(_RUN_COLUMNS) | batch.to_pylist()[0])


def read_run(path: Path) -> StoredRun:
    """Read the Parquet file of a run, with all rows.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    with _reading(path):
        rows = tuple(_read_row(one) for one in _table(path).to_pylist())
        return StoredRun(run=rows[0].run, rows=rows)


def read_accepted(path: Path, run: Run) -> AcceptedRun:
    """Read the measures of the hogels of a run, as columns.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    with _reading(path):
        table = _table(path, ["column", "row", "by", *NAMES]).slice(1)
        places = zip(table["column"].to_pylist(), table["row"].to_pylist(), strict=True)
        return AcceptedRun(
            run=run,
            places=tuple(places),
            by=tuple(None if one is None else intern(one) for one in table["by"].to_pylist()),
            numbers=np.stack([table[name].to_numpy().astype(np.float64) for name in NAMES], axis=-1),
        )


def read_told(path: Path, changes: int) -> ToldRun:
    """Read of a run what the history tells: its plate, and the largest changes.

    Parameters
    ----------
    path
        Path of the file.
    changes
        Largest number of changes that are read.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    with _reading(path):
        table = _table(path)
        plate = _read_row(table.slice(0, 1).to_pylist()[0])
        hogels, kind = table.slice(1), plate.run.change
        worse = {name: len(rows) for name, rows in _rows_that_changed(hogels, "worse").items()}
        found: list[MeasureChange] = []
        total_number = 0
        if kind in (Change.WORSE, Change.BETTER):
            for name, rows in _rows_that_changed(hogels, str(kind)).items():
                total_number += len(rows)
                told = _largest(hogels, name, rows, kind, changes - len(found))
                found += [
                    one
                    for row in hogels.take(pa.array(told)).to_pylist()
                    for one in _read_row(row).changes
                    if one.measure == name and one.change is kind
                ]
            of_plate = [one for one in plate.changes if one.change is kind]
            total_number += len(of_plate)
            found += ranked(of_plate)
        return ToldRun(
            run=plate.run, plate=plate, worse=worse, changes=tuple(found[:changes]), changed=total_number
        )


def _rows_that_changed(hogels: pa.Table, kind: str) -> dict[str, NDArray[np.int64]]:
    """Return for each measure the rows of the hogels in which it changed, in the order of the measures."""
    lists = hogels[kind].combine_chunks()
    rows = pc.list_parent_indices(lists).to_numpy(zero_copy_only=False).astype(np.int64)
    names = pc.list_flatten(lists)
    found = {name: rows[pc.equal(names, name).to_numpy(zero_copy_only=False).astype(bool)] for name in NAMES}
    return {name: those for name, those in found.items() if len(those)}


def _largest(
    hogels: pa.Table, name: str, rows: NDArray[np.int64], kind: Change, number: int
) -> NDArray[np.int64]:
    """Return the rows of the largest changes of a measure, the largest first; see `ranked`."""
    now, accepted = (
        hogels[column].to_numpy()[rows].astype(np.float64) for column in (name, f"accepted_{name}")
    )
    increase = np.where(np.isnan(now), np.inf, now - np.nan_to_num(accepted))
    order = np.argsort(-increase if kind is Change.WORSE else increase, kind="stable")
    return rows[order[: max(0, number)]]


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Say of what cannot be read which file it is in."""
    try:
        yield
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"--baseline {path}: is no file of measures ({reason:.200}); remove it, or restore it"
        ) from error


_SCHEMA: pa.Schema = table_of(Row, []).schema
"""Columns of the file of a run, and their types."""

_RUN_COLUMNS = tuple(field.name for field in (*fields(Run), *fields(Key)) if field.name != "key")
"""Names of the columns that say which run a row is of."""

_NEEDED_COLUMNS = {
    "run",
    "time",
    "scene",
    "change",
    "approved",
    "column",
    "row",
    *(one.name for one in fields(Key)),
}
"""Names of the columns without which a file is of no run."""


def _check_columns(schema: pa.Schema) -> None:
    """Raise ValueError where columns are those of something else; earlier versions measured less."""
    there = [column for column in _SCHEMA if column.name in schema.names]
    for column in there:
        if schema.field(column.name).type != column.type:
            raise ValueError(f"column {column.name} is {schema.field(column.name).type}")
    missing = _NEEDED_COLUMNS - set(schema.names)
    if missing:
        raise ValueError(f"it does not say which run it is of: it has no {', '.join(sorted(missing))}")


def _table(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Return the rows of a file, the plate's first; columns that it has not are null."""
    names = list(columns or _SCHEMA.names)
    with pq.ParquetFile(path) as file:
        _check_columns(file.schema_arrow)
        table = file.read(columns=[name for name in names if name in file.schema_arrow.names])
    for name in names:
        if name not in table.schema.names:  # Earlier versions did not measure it.
            column = _SCHEMA.field(name)
            table = table.append_column(column, pa.nulls(table.num_rows, column.type))
    places = [pc.is_null(table[name]).to_pylist() for name in ("column", "row")]
    if not table.num_rows or any(one[:1] != [True] or any(one[1:]) for one in places):
        raise ValueError("the first row is not that of a plate")
    return table.select(names)


def _read_run_of_row(values: Mapping[str, Any]) -> Run:
    key = Key(**{one.name: values[one.name] for one in fields(Key)})
    of_run = {one.name: values[one.name] for one in fields(Run) if one.name != "key"}
    said = {**vars(key), **{name: of_run[name] for name in ("run", "time", "scene", "change", "approved")}}
    if None in said.values():
        raise ValueError("a row does not say which run it is of")
    of_run |= {"change": Change(of_run["change"])}
    of_run |= {name: tuple(of_run[name] or ()) for name in ("faults", "follows")}
    return Run(**of_run, key=key)


def _read_row(values: Mapping[str, Any]) -> Row:
    groups = {
        group: Measures(**{name: values[pattern.format(name)] for name in NAMES})
        for group, pattern in (("now", "{}"), ("accepted", "accepted_{}"), ("limit", "limit_{}"))
    }
    return Row(
        run=_read_run_of_row(values),
        column=values["column"],
        row=values["row"],
        by=values["by"],
        worse=tuple(values["worse"] or ()),
        better=tuple(values["better"] or ()),
        **groups,
    )
