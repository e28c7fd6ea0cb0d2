"""Records as tables: columns and their types follow from the fields of a dataclass, not from the data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import reduce
from operator import or_
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import pyarrow as pa

from xfrustum.reports.common.json_ready import json_ready

_SCALARS = ((bool, pa.bool_()), (int, pa.int64()), (float, pa.float64()), (str, pa.string()))
"""Types of single values and of their columns; the first that fits counts, for a bool is an int too."""

_UNIONS = (Union, UnionType)
"""Both forms in which Python names a type that may be one of several."""


def named_columns(pattern: str) -> Mapping[str, str]:
    """Return metadata of a field that says how its columns are named.

    Parameters
    ----------
    pattern
        Name of a column, with `{}` where the name of a part stands, such as `time_{}_s`. Without it the
        columns of a group are called after the group and the part, `height_rms`.
    """
    return {"columns": pattern}


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name, type
        Name and type, which follow from the dataclass of the rows.
    values
        One value for each row, None where the row has none.
    """

    name: str
    type: pa.DataType
    values: Sequence[Any]


def columns_of(kind: type, rows: Sequence[Any]) -> list[Column]:
    """Return the columns of some records of one dataclass, in the order of its fields.

    A field that is a dataclass itself is a group, which has a column for each of its fields; these columns
    exist, and are null, also where a row has no such group. A mapping has a column or a group for each of
    its keys. Any other field has one column: enumerations and texts are strings, tuples and lists are lists,
    and what may have several types is written as text.

    Parameters
    ----------
    kind
        Dataclass of the rows.
    rows
        Instances of it.

    Raises
    ------
    TypeError
        A field has a type that no column can have.
    """
    return list(_columns(kind, rows, "{}"))


def table_of(kind: type, rows: Sequence[Any]) -> pa.Table:
    """Return some records of one dataclass as a table; see `columns_of`."""
    columns = columns_of(kind, rows)
    schema = pa.schema([(column.name, column.type) for column in columns])
    arrays = [pa.array(column.values, column.type) for column in columns]
    return pa.Table.from_arrays(arrays, schema=schema)


def _columns(kind: type, rows: Sequence[Any], pattern: str) -> Iterator[Column]:
    hints = get_type_hints(kind)
    for field in fields(kind):
        hint = _without_none(hints[field.name])
        values = [None if row is None else getattr(row, field.name) for row in rows]
        group = pattern.format(field.metadata.get("columns", f"{field.name}_{{}}"))
        if is_dataclass(hint):
            assert isinstance(hint, type), "hints name classes, not instances"
            yield from _columns(hint, values, group)
        elif get_origin(hint) in (dict, Mapping):
            hint = _without_none(get_args(hint)[1])
            for key in dict.fromkeys(key for value in values if value for key in value):
                parts = [value.get(key) if value else None for value in values]
                if is_dataclass(hint):
                    assert isinstance(hint, type), "hints name classes, not instances"
                    yield from _columns(hint, parts, group.format(f"{_clean(key)}_{{}}"))
                else:
                    yield _column(group.format(_clean(key)), hint, parts)
        else:
            yield _column(pattern.format(field.name), hint, values)


def _column(name: str, hint: Any, values: Sequence[Any]) -> Column:
    ready = [json_ready(value) for value in values]
    if get_origin(hint) in _UNIONS:
        ready = [None if value is None else str(value) for value in ready]
    return Column(name=name, type=_arrow_type(hint), values=ready)


def _arrow_type(hint: Any) -> pa.DataType:
    """Return the type of the column that holds values of a type."""
    hint = _without_none(hint)
    if get_origin(hint) in _UNIONS:
        return pa.string()
    if get_origin(hint) in (tuple, list):
        return pa.list_(_arrow_type(get_args(hint)[0]))
    for kind, arrow in _SCALARS:
        if isinstance(hint, type) and issubclass(hint, kind):
            return arrow
    raise TypeError(f"a column cannot hold {hint}")


def _without_none(hint: Any) -> Any:
    """Return an optional type without its None: a single type, or a union of several."""
    if get_origin(hint) not in _UNIONS:
        return hint
    return reduce(or_, (one for one in get_args(hint) if one is not NoneType))


def _clean(key: str) -> str:
    return re.sub(r"\W+", "_", key.lower())
