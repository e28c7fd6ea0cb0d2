"""Numbers as people read them."""

from __future__ import annotations

import re
from collections.abc import Iterable


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474` or `2.87e-7`."""
    return plain(f"{value:.3g}")


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def sides(lengths: Iterable[float]) -> str:
    """Write lengths or counts of sides, such as `60 x 40`."""
    return " x ".join(f"{length:,.6g}" for length in lengths)


def counted(number: int, name: str) -> str:
    """Write how many there are of something, such as `1 object` or `2,000 triangles`."""
    return f"{number:,} {name if number == 1 else name + 's'}"


def plain(text: str) -> str:
    """Drop the zero that Python puts into small exponents."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")
