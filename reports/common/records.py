"""Records as JSON and as tables, whose columns follow from the fields of a dataclass."""

import io
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import reduce
from operator import or_
from types import NoneType, UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import pyarrow as pa
import pyarrow.json

from xfrustum.reports.common.outputs import json_ready

_SCALARS = ((bool, pa.bool_()), (int, pa.int64()), (float, pa.float64()), (str, pa.string()))
"""Types of single values and of their columns; the first match counts: a bool is an int."""

#: both types that Python uses for unions
_UNIONS = (Union, UnionType)


def named_columns(pattern: str) -> Mapping[str, str]:
    """Return field metadata with a pattern for the column names of a group, such as `time_{}_s`.

    `{}` stands for the name of a part. Without such metadata the columns of a group are called
    after the group and the part, `height_rms`.
    """
    return {"columns": pattern}


class Column(NamedTuple):
    """One column of a table: a JSON value for each row, None if the row has none."""

    name: str
    type: pa.DataType
    values: Sequence[Any]


def columns_of(kind: type, rows: Sequence[Any]) -> list[Column]:
    """Return the columns of some records of one dataclass, in the order of its fields.

    A field that is a dataclass itself is a group, which has a column for each of its fields; these
    columns also exist, with nulls, for rows without the group. A mapping has a column or a group
    for each of its keys. Any other field has one column: enumerations and texts are strings, tuples
    and lists are lists, and values of union types are written as text. TypeError if no column can
    have the field's type.
    """
    hints = get_type_hints(kind)
    columns: list[Column] = []
    for field in fields(kind):
        pattern = field.metadata.get("columns", f"{field.name}_{{}}")
        values = [None if row is None else getattr(row, field.name) for row in rows]
        columns += _columns(field.name, pattern, hints[field.name], values)
    return columns


def _columns(name: str, pattern: str, hint: Any, values: Sequence[Any]) -> Iterator[Column]:
    """Yield the columns of one field; `pattern` names the columns of a group."""
    hint = _without_none(hint)
    if is_dataclass(hint):
        assert isinstance(hint, type), "hints name classes, not instances"
        yield from (
            column._replace(name=pattern.format(column.name)) for column in columns_of(hint, values)
        )
    elif get_origin(hint) in (dict, Mapping):
        for key in dict.fromkeys(key for value in values if value for key in value):
            part = re.sub(r"\W+", "_", key.lower())
            parts = [value.get(key) if value else None for value in values]
            group = pattern.format(f"{part}_{{}}")
            yield from _columns(pattern.format(part), group, get_args(hint)[1], parts)
    elif get_origin(hint) in _UNIONS:
        yield Column(name, pa.string(), [None if value is None else str(value) for value in values])
    else:
        yield Column(name, _arrow_type(hint), [json_ready(value) for value in values])


def table_of(kind: type, rows: Sequence[Any]) -> pa.Table:
    """Return some records of one dataclass as a table; see `columns_of`."""
    columns = columns_of(kind, rows)
    schema = pa.schema([(column.name, column.type) for column in columns])
    if not rows:
        return schema.empty_table()
    names, records = schema.names, zip(*(column.values for column in columns), strict=True)
    # Convert through JSON, because pa.array imports all of pandas at its first list.
    lines = "\n".join(json.dumps(dict(zip(names, record, strict=True))) for record in records)
    options = pyarrow.json.ParseOptions(explicit_schema=schema)
    return pyarrow.json.read_json(io.BytesIO(lines.encode()), parse_options=options)


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
    return reduce(or_, (part for part in get_args(hint) if part is not NoneType))
