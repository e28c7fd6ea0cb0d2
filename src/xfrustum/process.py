"""The process: Ctrl-C and SIGTERM, messages on standard error, text made safe for a terminal.

A signal raises an exception in the main thread, and leads to exit status 130 or 143. Where a
library swallows the exception, as trimesh does while it imports its own dependencies, a timer
raises it again. Code that makes something and notes it for removal does both within `delayed`.
"""

import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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


_UNPRINTABLE = re.compile(
    "["
    r"\x00-\x08\x0b-\x1f\x7f-\x9f"  # control characters except tab and line feed
    # Characters that are invisible, or that change the direction of writing:
    r"\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    r"\U000e0000-\U000e0fff"
    r"\ud800-\udfff"  # surrogates, among them bytes of names that are not UTF-8
    "]"
)

#: Code points with which Python replaces the bytes 0x80 to 0xff of a file name that is not UTF-8.
_ESCAPED_BYTES = range(0xDC80, 0xDD00)


#: Largest number of characters of a message; a longer message loses the middles of long words
#: first, then its own middle.
MAX_MESSAGE = 500


def say(message: str) -> None:
    """Write one line of the program to standard error; errors of that stream are ignored."""
    line = one_line(f"xfrustum: {message}")
    if len(line) > MAX_MESSAGE:
        line = re.sub(
            r"\S{101,}", lambda long: f"{long[0][:48]}..{long[0][-48:]}", line
        )  # mostly file names
        half = (MAX_MESSAGE - len(" .. ")) // 2
        line = line if len(line) <= MAX_MESSAGE else f"{line[:half]} .. {line[-half:]}"
    # sys.stderr may be None.
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def printable(text: str) -> str:
    r"""Return text whose control characters are escaped, such as `\x1b`; tabs and line feeds stay.

    Characters that are invisible or that change the direction of writing are escaped as well, and
    bytes of file names that are not UTF-8, as `\xff`.
    """
    return _UNPRINTABLE.sub(_escaped, text)


def one_line(text: str) -> str:
    """Return printable text on one line: line feeds and runs of spaces become one space."""
    return printable(" ".join(text.split()))


def _escaped(match: re.Match[str]) -> str:
    code = ord(match[0])
    if code in _ESCAPED_BYTES:
        code -= _ESCAPED_BYTES.start - 0x80
    return (
        f"\\x{code:02x}"
        if code < 0x100
        else f"\\u{code:04x}"
        if code < 0x10000
        else f"\\U{code:08x}"
    )
