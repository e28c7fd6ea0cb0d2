"""Child processes with default signal handling, and numbers of kernel threads."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


def signals_by_default() -> None:
    """Undo inherited signal settings: signals ignored by background jobs or blocked by parents."""
    stops = (signal.SIGINT, signal.SIGTERM)
    for stop in stops:
        signal.signal(stop, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, stops)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Run kernels on a number of threads; tests otherwise use one."""
    drjit = import_module("drjit")
    before = drjit.thread_count()
    drjit.set_thread_count(count)
    try:
        yield
    finally:
        drjit.set_thread_count(before)
