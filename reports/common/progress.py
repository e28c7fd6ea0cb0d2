"""One look for every progress bar."""

from __future__ import annotations

import sys
from typing import Any

from tqdm import tqdm


def progress_bar(total: int | None, what: str, unit: str, *, shown: bool) -> tqdm[Any]:
    """Return a bar of `total` units, None where unknown, on standard error; its caller updates it."""
    # A log keeps every line that a terminal would overwrite, so it gets few of them.
    shown = shown and sys.stderr is not None
    seconds = 0.1 if shown and sys.stderr.isatty() else 5.0
    return tqdm(total=total, disable=not shown, desc=what, unit=unit, mininterval=seconds)
