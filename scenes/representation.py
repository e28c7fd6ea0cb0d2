"""Numbers as short texts, and representations of records without the values of their arrays."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import fields, is_dataclass

import numpy as np


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474`; thousands in full: `7,470`."""
    written = f"{value:.3g}"
    return f"{float(written):,.0f}" if 1e3 <= abs(value) < 1e9 else plain(written)


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def percent_up(share: float) -> str:
    """Write an upper bound in percent, rounded up to two digits."""
    if share <= 0 or share >= 1:
        return f"{100 * share:.0f} %"
    step = 10.0 ** (math.floor(math.log10(100 * share)) - 1)
    # The margin keeps a share of two digits unchanged in spite of rounding.
    return f"{min(math.ceil(100 * share / step - 1e-9) * step, 100.0):.3g} %"


def sides(lengths: Iterable[float]) -> str:
    """Write lengths or counts of sides, such as `60 x 40`."""
    return " x ".join(f"{length:,.6g}" for length in lengths)


def counted(number: int, name: str) -> str:
    """Write how many there are of something, such as `1 object` or `2,000 triangles`."""
    return f"{number:,} {name if number == 1 else name + 's'}"


def plain(text: str) -> str:
    """Drop the zero that Python puts into small exponents."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")


LONGEST_PART = 100  #: largest number of characters of a nested record in a representation


class ShortRepr:
    """A dataclass whose `repr` has its fields, of arrays and large parts the type alone."""

    def __repr__(self) -> str:
        names = [part.name for part in fields(self)]  # type: ignore[arg-type]
        named = (f"{name}={_kind(getattr(self, name))}" for name in names)
        return f"{type(self).__name__}({', '.join(named)})"


def _kind(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple | list) and len(value) > 0:
        return f"{len(value)} of {type(value[0]).__name__}"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    if is_dataclass(value) and len(text := repr(value)) <= LONGEST_PART:
        return text
    return f"<{type(value).__name__}>"
