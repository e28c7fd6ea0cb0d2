"""The number of threads that the reference uses."""

from __future__ import annotations

import os

THREADS_VARIABLE = "XFRUSTUM_THREADS"
"""Environment variable that bounds the number of threads of a process: of several workers on one machine,
each takes its share. Ray tracers' own pools ignore the CPUs that a process may run on, and must be told."""


def worker_count() -> int:
    """Return the number of CPUs that this process may run on, or fewer where the environment says so."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    named = thread_limit()
    return available if named is None else min(named, available)


def thread_limit() -> int | None:
    """Return the largest number of threads that the environment allows; None where it says nothing."""
    named = os.environ.get(THREADS_VARIABLE, "")
    return max(1, int(named)) if named.isdecimal() else None
