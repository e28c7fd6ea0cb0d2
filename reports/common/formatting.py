"""Numbers as people read them, and words that pages share."""

from __future__ import annotations

from xfrustum.scenes.notebook.numbers import digits, percent, plain

__all__ = ["digits", "percent", "plain", "unexamined_truth"]


def unexamined_truth(tracer: str) -> str:
    """Say that a truth is what one tracer shows alone; `tracer` is its name, such as `embree`."""
    return f"truth: {tracer.capitalize()} alone, not examined"
