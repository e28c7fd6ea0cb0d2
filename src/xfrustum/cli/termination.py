"""Ctrl-C and SIGTERM end a command cleanly, whatever it is doing when they come.

A signal is remembered first. Then `Terminated` is raised in the main thread, so that every `with` block
cleans up, but only where that is safe: not while a module is imported, a file put in its place, or a process
started. Where it is not safe now, or where a library swallowed the exception, a timer tries again. `main`
exits by the remembered signal, whatever exception came out in the end.

This module imports nothing heavy: `__main__` installs the handlers before it imports anything else.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import CodeType, FrameType
from typing import Any, TypeVar

Result = TypeVar("Result")

STATUS_OF_SIGNAL = {signal.SIGINT: 130, signal.SIGTERM: 143}
"""Exit status by signal, 128 plus its number, which shells report for a program that a signal ended."""

WORD_OF_SIGNAL = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""Message by signal, in one word."""

RETRY_S = 0.02
"""Time until the exception is raised again, where it could not be raised or did not arrive."""

UNINTERRUPTED_MODULES = frozenset(
    {
        "_frozen_importlib",
        "importlib._bootstrap",
        "shutil",
        "tempfile",
        "xfrustum.cli.termination",
        "xfrustum.reports.common.outputs",
        "xfrustum.scenes.disk.durable",
        "xfrustum.scenes.files.openexr.writer",
    }
)
"""Modules whose functions run to their end: they make, move or remove files, or import. An interrupted import
leaves half a module, which causes exceptions of other kinds later."""

UNINTERRUPTED_FUNCTIONS = frozenset(
    {
        ("contextlib", "__enter__"),
        ("contextlib", "__exit__"),
        ("concurrent.futures.thread", "submit"),
        ("subprocess", "__init__"),
        ("xfrustum.reports.verification.commands", "_end"),
        ("xfrustum.reports.verification.commands", "_start"),
    }
)
"""Functions of other modules that run to their end: a block is entered and left as a whole, and a process or
a thread that was started but not yet noted would never be ended."""

WAITING_FUNCTIONS = frozenset({("xfrustum.scenes.disk.durable", "_copy")})
"""Functions of the modules above that are interrupted all the same: they wait for the reader of a pipe."""


class Terminated(KeyboardInterrupt):
    """Raised when the process is asked to end. Code that cleans up after Ctrl-C cleans up after it too."""


class Termination:
    """The signals of this process that ask a command to end.

    Attributes
    ----------
    received
        The first signal that came, None before.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._raised = False
        self._process = os.getpid()
        self._interruptible: CodeType | None = None
        self._former: dict[signal.Signals, Any] = {}

    @property
    def status(self) -> int:
        """Exit status by the signal that was received."""
        assert self.received is not None
        return STATUS_OF_SIGNAL[self.received]

    @property
    def word(self) -> str:
        """Message about the signal that was received, in one word."""
        assert self.received is not None
        return WORD_OF_SIGNAL[self.received]

    def install(self) -> None:
        """Take over the signals that do what they do by default.

        Signals are left alone that the parent process ignores, as shells do for jobs in the background, or
        that the program around this handles itself. Outside of the main thread all are left alone.
        """
        if threading.current_thread() is not threading.main_thread():
            return
        for number, default in (
            (signal.SIGINT, signal.default_int_handler),
            (signal.SIGTERM, signal.SIG_DFL),
            (signal.SIGALRM, signal.SIG_DFL),
        ):
            former = signal.getsignal(number)
            if former is default:
                self._former[number] = former
                signal.signal(number, self._handle)
        if signal.SIGALRM in self._former:
            # The timer must not make system calls of libraries fail.
            signal.siginterrupt(signal.SIGALRM, False)

    def restore(self) -> None:
        """Give the signals back, as they were found."""
        self._stop_timer()
        for number, former in self._former.items():
            signal.signal(number, former)
        self._former.clear()

    def ignore(self) -> None:
        """Ignore the signals from here to the end of the process: the work is done, and the rest is short."""
        self._stop_timer()
        for number in self._former:
            signal.signal(number, signal.SIG_IGN)

    def call(self, function: Callable[[], Result]) -> Result:
        """Call a function; exceptions for signals are raised in what it calls and nowhere else."""
        self._interruptible = function.__code__
        return function()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if os.getpid() != self._process:
            os._exit(128 + number)  # a child that was forked from this process has nothing to clean up
        if number in STATUS_OF_SIGNAL and self.received is None:
            self.received = signal.Signals(number)
        if self.received is None:
            return
        if signal.SIGALRM in self._former:
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        # The exception may be on its way already: then the blocks that it leaves are cleaning up.
        if self._may_raise(frame) and not (self._raised and sys.exception() is not None):
            self._raised = True
            raise Terminated

    def _may_raise(self, frame: FrameType | None) -> bool:
        """Return whether the code that runs is within the function called, and may be interrupted."""
        waits = uninterrupted = False
        while frame is not None:
            if frame.f_code is self._interruptible:
                return waits or not uninterrupted
            module = frame.f_globals.get("__name__")
            function = (module, frame.f_code.co_name)
            waits |= function in WAITING_FUNCTIONS
            uninterrupted |= module in UNINTERRUPTED_MODULES or function in UNINTERRUPTED_FUNCTIONS
            frame = frame.f_back
        return False

    def _stop_timer(self) -> None:
        if signal.SIGALRM in self._former:
            signal.setitimer(signal.ITIMER_REAL, 0.0)


_of_process: Termination | None = None


def of_process() -> Termination:
    """Return the termination of this process, installed by `__main__` before anything else is imported."""
    global _of_process
    if _of_process is None:
        _of_process = Termination()
        _of_process.install()
    return _of_process


@contextmanager
def current() -> Iterator[Termination]:
    """Provide the termination of the process where there is one, else one for this block."""
    if _of_process is not None:
        yield _of_process
        return
    own = Termination()
    own.install()
    try:
        yield own
    finally:
        own.restore()
