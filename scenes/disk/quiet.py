"""Libraries that print on standard error what they also raise."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STDERR = 2
"""The file descriptor that libraries in C and C++ write to, whatever `sys.stderr` is."""

_ALONE = threading.Lock()
"""Two threads that swap the descriptor at once would put back what the other one put there."""


@contextmanager
def without_messages_of_failure() -> Iterator[None]:
    """Drop what is written to standard error within a block that raises.

    If it does not raise, all of it is written after the block. The descriptor belongs to the whole
    process: what other threads write meanwhile is held back too, and one thread at a time is in here.
    """
    if sys.__stderr__ is None:  # closed from the start: its number may be that of any file
        yield
        return
    sys.stderr.flush()
    with _ALONE, os.fdopen(os.dup(STDERR), "wb") as shown, tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), STDERR)
        try:
            yield
        finally:
            sys.stderr.flush()
            os.dup2(shown.fileno(), STDERR)
        held.seek(0)
        shutil.copyfileobj(held, shown)
