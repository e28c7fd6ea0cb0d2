"""Arguments of the public dataclasses, taken as numbers, names and programs.

A value that is no number becomes NaN, and a value that is no count a number below all counts, so
that the test of the class refuses both with a message that shows the value.
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

from xfrustum.scenes.errors import InputError

Choice = TypeVar("Choice", bound=StrEnum)
NO_COUNT = -1  # takes the place of a value that is no whole number; it is below every allowed count


def real(value: object) -> float:
    """Return a number as float; NaN if it is not a number, as booleans and strings are not."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def reals(values: object, length: int | None = None) -> tuple[float, ...]:
    """Return numbers as floats; one NaN for no sequence, or for another length."""
    items = _items(values, length)
    return (math.nan,) if items is None else tuple(map(real, items))


def whole(value: object) -> int:
    """Return a whole number as int; `NO_COUNT` if it is not a whole number."""
    return NO_COUNT if isinstance(value, bool) or not isinstance(value, Integral) else int(value)


def wholes(values: object, length: int) -> tuple[int, ...]:
    """Return whole numbers as ints; one `NO_COUNT` where they are not as many as are needed."""
    items = _items(values, length)
    return (NO_COUNT,) if items is None else tuple(map(whole, items))


def check_program(command: str, folder: Path | None = None) -> None:
    """Raise InputError where the program of a command that runs in a folder is not there."""
    try:
        name = (shlex.split(command) or [""])[0].replace("{{", "{").replace("}}", "}")
    except ValueError as error:
        raise InputError(f"--command {command!r}: {error}; mind the quotes") from error
    # A name with a folder in it is not looked for in PATH.
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
    """Return the member of an enumeration, by itself or by its value; else InputError."""
    try:
        return kind(value)  # type: ignore[arg-type]  # an enumeration refuses other values
    except ValueError as error:
        raise InputError(f"{name} must be one of {', '.join(kind)}, not {value!r}") from error


def switch(value: object, name: str) -> bool:
    """Return a truth value; InputError at other values."""
    if value is True or value is False:
        return value
    raise InputError(f"{name} must be True or False, not {value!r}")


def one_of(value: object, kind: type, name: str) -> None:
    """Raise InputError unless a value is of some class."""
    if not isinstance(value, kind):
        raise InputError(f"{name} must be a {kind.__name__}, not {value!r:.100}")


def settle(owner: object, **values: object) -> None:
    """Set attributes of a frozen dataclass from within its `__post_init__`."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)
