"""Silence for libraries that print on standard error the errors that they also raise."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STDERR = 2
"""File descriptor that libraries in C and C++ write to, whatever `sys.stderr` is."""

_SWAPPING = threading.Lock()
"""Lock for swapping the descriptor: two threads at once would restore each other's file."""


@contextmanager
def without_messages_of_failure() -> Iterator[None]:
    """Drop all text written to standard error within a block that raises.

    If the block does not raise, the text is written after it. The descriptor belongs to the whole process:
    text of other threads is held back too, and one thread at a time can enter such a block.
    """
    if sys.__stderr__ is None:  # closed from the start: its number may be that of any file
        yield
        return
    sys.stderr.flush()
    with _SWAPPING, os.fdopen(os.dup(STDERR), "wb") as shown, tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), STDERR)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(shown.fileno(), STDERR)
        held.seek(0)
        shutil.copyfileobj(held, shown)
