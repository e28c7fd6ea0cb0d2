"""One look for every progress bar."""

from __future__ import annotations

from typing import Any

from tqdm import tqdm

from xfrustum.terminal import messages


def progress_bar(total: int, what: str, unit: str, *, shown: bool) -> tqdm[Any]:
    """Return a bar on standard error, to be updated; a log gets few lines of it.

    Parameters
    ----------
    total
        Number of units.
    what, unit
        Name of the work and of its unit, in words.
    shown
        Whether to draw it at all.
    """
    # A log keeps every line that a terminal would overwrite.
    seconds = 0.1 if messages().isatty() else 5.0
    return tqdm(file=messages(), total=total, disable=not shown, desc=what, unit=unit, mininterval=seconds)
