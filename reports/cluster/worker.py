"""The set-up of worker processes, which Dask calls: the module that `dask worker --preload` names.

Standard output belongs to the command: what libraries print in a worker goes to standard error.
"""

from __future__ import annotations

import os
import signal
from typing import Any

from xfrustum.reports.cluster.job import close_desk

STDOUT, STDERR = 1, 2
"""Numbers of the standard file descriptors."""


def dask_setup(worker: Any) -> None:
    """Prepare a worker process before its first task; its main thread calls this."""
    del worker
    os.dup2(STDERR, STDOUT)
    # A process that a command starts inherits the signals that the command holds back while it is loaded.
    # Ctrl-C is for the command, which ends its workers itself.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def dask_teardown(worker: Any) -> None:
    """Free what a worker holds before its process ends."""
    del worker
    close_desk()
