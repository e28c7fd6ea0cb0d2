"""Child processes of tests, which answer signals however tests started; threads of kernels."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


def signals_by_default() -> None:
    """Undo inherited signal settings: ignored by background jobs, blocked by parents."""
    stops = (signal.SIGINT, signal.SIGTERM)
    for stop in stops:
        signal.signal(stop, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, stops)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Limit kernels to a number of threads: tests otherwise use one."""
    drjit = import_module("drjit")
    before = drjit.thread_count()
    drjit.set_thread_count(count)
    try:
        yield
    finally:
        drjit.set_thread_count(before)
