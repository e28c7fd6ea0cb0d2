"""Numbers as people read them."""

from __future__ import annotations

import re


def digits(value: float) -> str:
    """Write a number with three digits, such as `0.0474` or `2.87e-7`."""
    return _plain(f"{value:.3g}")


def percent(fraction: float) -> str:
    """Write a fraction as percent with two digits, such as `0.012 %`; `100 %` has three."""
    return _plain(f"{100 * fraction:.0f} %" if fraction >= 0.1 else f"{100 * fraction:.2g} %")


def unexamined_truth(tracer: str) -> str:
    """Say that a truth is what one tracer shows alone; `tracer` is its name, such as `embree`."""
    return f"truth: {tracer.capitalize()} alone, not examined"


def _plain(text: str) -> str:
    """Drop the zero that Python puts into small exponents."""
    return re.sub(r"e([+-])0(\d)", r"e\1\2", text).replace("e+", "e")
