"""Ctrl-C and SIGTERM: an exception in the main thread, and exit status 130 or 143.

If a library swallows the exception, as trimesh does while it imports its own dependencies, a timer
raises it again. Code that creates something and records it for removal does both within `delayed`.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: Message by signal; its exit status is 128 plus its number, as shells report it.
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}

#: end of the message for commands that can be continued after a signal; "" for other commands
advice = ""
CONTINUES = "; the same command continues"

#: time until the exception is raised again if a library swallowed it
RETRY_S = 0.02

_DEFAULTS: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGALRM: signal.SIG_DFL,
}

#: first signal received within `obeyed`
received: signal.Signals | None = None

_taken: set[signal.Signals] = set()
_raised = False
_delays = 0


class Interrupted(KeyboardInterrupt):
    """Exception for a signal that ends the process; caught by code that cleans up after Ctrl-C."""


@contextmanager
def obeyed(*, ignored_afterwards: bool = False) -> Iterator[None]:
    """Raise `Interrupted` in the main thread at a signal that ends this process.

    A signal is left alone if the parent process ignores it, as shells do for background jobs, or if
    the calling program handles it. Outside the main thread, all signals are left alone. With
    `ignored_afterwards`, for a process that is about to end, signals are ignored after the block.
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
    """Delay signals until a short block has ended; the block must not wait for anything."""
    global _delays
    if (
        threading.current_thread() is not threading.main_thread()
    ):  # signals are obeyed and counted only there
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
        # Hide later failures in callbacks and in other threads: the end of the command causes them.
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
