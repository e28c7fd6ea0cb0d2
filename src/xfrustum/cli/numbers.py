"""Types of numbers on the command line; their errors name the option."""

from __future__ import annotations

import math
import re
from typing import Any

import click


class Positive(click.ParamType[float]):
    """A number above zero and, where there is a limit, below it."""

    name = "float"

    def __init__(self, below: float = math.inf) -> None:
        self._below = below

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not 0 < number < self._below:
            bounded = f"a number between 0 and {self._below:g}, without both"
            self.fail(
                f"{value!r} is not {'a positive, finite number' if math.isinf(self._below) else bounded}",
                param,
                ctx,
            )
        return number


class Length(click.ParamType["tuple[float, str | None]"]):
    """A positive length, in scene units or with a unit of its own, such as 600 or 600mm."""

    name = "LENGTH"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, str | None]:
        """Return the number and its unit, None for the scene's own."""
        match = re.fullmatch(r"\s*([-+.\d]+(?:e[-+]?\d+)?)\s*([^\W\d]*)\s*", str(value))
        if match is None:
            self.fail(f"{value!r} is not a length such as 600 or 600mm", param, ctx)
        return Positive().convert(match[1], param, ctx), match[2] or None


class Samples(click.ParamType[int]):
    """A count of samples."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the count."""
        from xfrustum.scenes.appearance.sampling import MAX_SAMPLES

        count: int = click.IntRange(1, MAX_SAMPLES).convert(value, param, ctx)
        return count


class SubApertures(click.ParamType[int | str]):
    """A count of sub-apertures, or the word `auto`."""

    name = "integer|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | str:
        """Return the count or the word."""
        if str(value).strip().lower() == AUTO:
            return AUTO
        return Samples().convert(value, param, ctx)


AUTO = "auto"
"""Word for what the program is to choose: as many sub-apertures as a scene needs, or the worst apertures."""

_UNITS = {"": 1, "k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40}
"""Bytes of each unit of size, by its letter."""


class Size(click.ParamType[int]):
    """Bytes such as 800M or 4GiB, in units of 1024."""

    name = "SIZE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number of bytes."""
        match = re.fullmatch(r"(\d{1,15}(?:\.\d{1,15})?)\s*([kmgt]?)(?:i?b)?", str(value).strip().lower())
        size = 0 if match is None else int(float(match[1]) * _UNITS[match[2]])
        if size < 1:
            self.fail(f"{value!r} is not a size such as 800M or 4G", param, ctx)
        return size
