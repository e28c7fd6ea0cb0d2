"""Errors in tables, described in one line: the key, and the values allowed there."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.scene_tables import ONE_OF, SceneTables

Location = tuple[int | str, ...]


def described(error: ValidationError) -> str:
    """Return the wrong key of a scene file and the values allowed there, in one line."""
    # An unknown key comes first: it is often the misspelling of a key that is reported missing.
    problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    return _described(problems[0])


@contextmanager
def named(path: Path, key: str) -> Iterator[None]:
    """Put the scene file and the key before the message of an error within a block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {key}: {error}") from error


def _described(problem: ErrorDetails) -> str:
    location = problem["loc"]
    key = _dotted(location)
    if problem["type"] == "extra_forbidden":
        *table, unknown = location
        valid = [field.alias or name for name, field in _table_at(tuple(table)).model_fields.items()]
        nearest = difflib.get_close_matches(str(unknown), valid, n=1, cutoff=0.0)
        return f"unknown key {key}; the nearest valid key is {_dotted((*table, *nearest))}"
    if problem["type"] == ONE_OF:
        return f"{key} {problem['msg']}"
    *_, field = _fields_along(location)
    allowed = field.description
    if problem["type"] == "missing" and isinstance(location[-1], str):
        return f"{key} is missing; it must be {allowed}"
    shown = "a table" if isinstance(problem["input"], dict) else repr(problem["input"])[:80]
    if not isinstance(location[-1], int):
        return f"{key} must be {allowed}, not {shown}"
    *whole, element = location
    found = "missing" if problem["type"] == "missing" else shown
    return f"{_dotted(tuple(whole))} must be {allowed}, but element {element} is {found}"


def _dotted(location: Location) -> str:
    """Return a location as people write it, such as `object[0].rotate_deg`."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            bare = part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else json.dumps(part)
            text += f".{bare}" if text else bare
    return text


def _table_at(location: Location) -> type[BaseModel]:
    """Return the model of the table at a location."""
    if not location:
        return SceneTables
    *_, field = _fields_along(location)
    return next(_models_in(field.annotation))


def _fields_along(location: Location) -> Iterator[FieldInfo]:
    """Yield the fields that a location passes through, from the outermost."""
    table: type[BaseModel] | None = SceneTables
    named = False
    for part in location:
        if isinstance(part, int) or table is None:
            continue
        if named:  # this part is the name of one table out of many, such as `paint` in `material.paint`
            named = False
            continue
        field = next(f for name, f in table.model_fields.items() if (f.alias or name) == part)
        yield field
        named = get_origin(field.annotation) is dict
        table = next(_models_in(field.annotation), None)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models inside an annotation such as `list[ObjectTable]` or `ScreenTable | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
