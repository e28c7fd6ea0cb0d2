"""Arguments of the public dataclasses: conversion, checks, and the error for the user.

A value that is not a number becomes NaN. A value that is not a count becomes `NO_COUNT`, which is
below all counts. The range test of the class then refuses both, with a message that shows the
value.
"""

import math
import os
import shlex
import shutil
from collections.abc import Iterable
from enum import StrEnum
from numbers import Integral, Real
from pathlib import Path
from typing import TypeVar


class InputError(Exception):
    """Bad input, in one line: the error, the value, the advice. Commands exit with status 2."""


Choice = TypeVar("Choice", bound=StrEnum)
NO_COUNT = -1  # substitute for a value that is not a whole number, below every allowed count


def real(value: object) -> float:
    """Return a number as float; NaN for other values, including booleans and strings."""
    if type(value) is float:  # a fast path: tests of abstract classes take microseconds
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def reals(values: object, length: int | None = None) -> tuple[float, ...]:
    """Return numbers as floats; a single NaN if they are not a sequence of the right length."""
    items = _items(values, length)
    return (math.nan,) if items is None else tuple(map(real, items))


def whole(value: object) -> int:
    """Return a whole number as int; `NO_COUNT` if it is not a whole number."""
    if type(value) is int:
        return value
    return NO_COUNT if isinstance(value, bool) or not isinstance(value, Integral) else int(value)


def wholes(values: object, length: int) -> tuple[int, ...]:
    """Return whole numbers as ints; a single `NO_COUNT` if there are too few or too many."""
    items = _items(values, length)
    return (NO_COUNT,) if items is None else tuple(map(whole, items))


def check_program(command: str, folder: Path | None = None) -> None:
    """Raise InputError if the program of a command does not exist; `folder` is where it runs."""
    try:
        name = (shlex.split(command) or [""])[0].replace("{{", "{").replace("}}", "}")
    except ValueError as error:
        raise InputError(f"--command {command!r}: {error}; mind the quotes") from error
    # A name that contains a folder is not searched in PATH.
    if shutil.which((folder or Path()).resolve() / name if os.sep in name else name) is None:
        raise InputError(
            f"--command {command!r}: {name} is no program that can be run; name one in this "
            "folder with ./"
        )


def _items(values: object, length: int | None) -> tuple[object, ...] | None:
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        return None
    items = tuple(values)
    return items if length in (None, len(items)) else None


def choice(kind: type[Choice], value: object, name: str) -> Choice:
    """Return a member of an enumeration by member or value; InputError for other values."""
    try:
        return kind(value)  # type: ignore[arg-type]  # an enumeration refuses other values
    except ValueError as error:
        raise InputError(f"{name} must be one of {', '.join(kind)}, not {value!r}") from error


def switch(value: object, name: str) -> bool:
    """Return a boolean; InputError for other values."""
    if value is True or value is False:
        return value
    raise InputError(f"{name} must be True or False, not {value!r}")


def one_of(value: object, kind: type, name: str) -> None:
    """Raise InputError unless a value is an instance of a class."""
    if not isinstance(value, kind):
        raise InputError(f"{name} must be a {kind.__name__}, not {value!r:.100}")


def settle(owner: object, **values: object) -> None:
    """Set attributes of a frozen dataclass from within its `__post_init__`."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)
