"""Ctrl-C and SIGTERM: an exception in the main thread, and exit status 130 or 143.

Where a library swallows the exception, as trimesh does while it imports its own dependencies, a
timer raises it again. Code that makes something and notes it for removal does both within
`delayed`.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: Message by signal; its exit status is 128 plus its number, as shells report it.
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

#: words after the message of a command that continues where it was ended; "" for other commands
advice = ""
CONTINUES = "; the same command continues"

#: time until the exception is raised again if a library swallowed it
RETRY_S = 0.02

_DEFAULTS: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGALRM: signal.SIG_DFL,
}

#: the first signal that came since `obeyed` was entered
received: signal.Signals | None = None

_taken: set[signal.Signals] = set()
_raised = False
_delays = 0


class Interrupted(KeyboardInterrupt):
    """Exception of a signal that ends the process; code that cleans up after Ctrl-C does so too."""


@contextmanager
def obeyed(*, ignored_afterwards: bool = False) -> Iterator[None]:
    """Raise `Interrupted` in the main thread at a signal that ends this process.

    Signals that the parent process ignores, as shells do for jobs in the background, or that the
    program around this handles itself, are left alone; outside of the main thread all are. A
    process that is about to end ignores them from the end of the block on.
    """
    global received, _raised, advice
    if threading.current_thread() is not threading.main_thread() or _taken:
        yield
        return
    received, _raised, advice = None, False, ""
    hooks = sys.unraisablehook, threading.excepthook
    for number, default in _DEFAULTS.items():
        if signal.getsignal(number) is default:
            _taken.add(number)
            signal.signal(number, _handle)
    if signal.SIGALRM in _taken:
        signal.siginterrupt(
            signal.SIGALRM, False
        )  # the timer must not make system calls of libraries fail
    try:
        yield
    finally:
        if signal.SIGALRM in _taken:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number in _taken:
            signal.signal(number, signal.SIG_IGN if ignored_afterwards else _DEFAULTS[number])
        _taken.clear()
        if not ignored_afterwards:
            sys.unraisablehook, threading.excepthook = hooks


@contextmanager
def delayed() -> Iterator[None]:
    """Let a short block run to its end before a signal is obeyed; not for anything that waits."""
    global _delays
    if (
        threading.current_thread() is not threading.main_thread()
    ):  # only there signals are obeyed and counted
        yield
        return
    _delays += 1
    try:
        yield
    finally:
        _delays -= 1
    if received is not None:
        _raise()


def _handle(number: int, _: object) -> None:
    global received
    if number in WORDS and received is None:
        received = signal.Signals(number)
        # The end of the command causes later failures in callbacks and in other threads.
        sys.unraisablehook, threading.excepthook = lambda _: None, lambda _: None
    if received is not None:
        if signal.SIGALRM in _taken:
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        _raise()


def _raise() -> None:
    """Raise `Interrupted`, unless it was raised before and blocks are cleaning up."""
    global _raised
    if not _delays and not (_raised and sys.exception() is not None):
        _raised = True
        raise Interrupted
