"""Child processes of tests, which answer signals however the tests were started, and threads of kernels."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module


def signals_by_default() -> None:
    """Undo what a shell does to jobs in the background, which ignore Ctrl-C, and what a parent holds back."""
    stops = (signal.SIGINT, signal.SIGTERM)
    for stop in stops:
        signal.signal(stop, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, stops)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let kernels run on so many threads: tests otherwise use one."""
    drjit = import_module("drjit")
    before = drjit.thread_count()
    drjit.set_thread_count(count)
    try:
        yield
    finally:
        drjit.set_thread_count(before)
