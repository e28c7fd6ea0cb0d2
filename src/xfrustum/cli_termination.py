"""SIGTERM, as `kill` and `timeout` send it: a command ends as by Ctrl-C, and cleans up what it has begun."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn


class Terminated(KeyboardInterrupt):
    """The process was asked to end. Whatever cleans up after Ctrl-C does so after this."""


@contextmanager
def terminated_like_interrupted() -> Iterator[None]:
    """Raise `Terminated` in the main thread on SIGTERM; a program around this that handles it goes on to."""
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _raise(_number: int, _frame: FrameType | None) -> NoReturn:
    # `timeout` sends it twice, to the process and to its group: the second must not stop the cleaning up.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise Terminated
