"""One look for every progress bar."""

from __future__ import annotations

import sys
from typing import Any

from tqdm import tqdm


def progress_bar(total: int | None, what: str, unit: str, *, shown: bool) -> tqdm[Any]:
    """Return a bar on standard error that its caller updates; a log gets few lines of it.

    Parameters
    ----------
    total
        Number of units; None where it is not known.
    what, unit
        Name of the task and of one unit.
    shown
        Whether to draw the bar.
    """
    # A log keeps every line that a terminal would overwrite.
    shown = shown and sys.stderr is not None
    seconds = 0.1 if shown and sys.stderr.isatty() else 5.0
    return tqdm(total=total, disable=not shown, desc=what, unit=unit, mininterval=seconds)
