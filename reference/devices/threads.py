"""The number of threads that the reference uses."""

from __future__ import annotations

import os


def worker_count() -> int:
    """Return the number of CPUs that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
