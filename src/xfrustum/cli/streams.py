"""Standard output and standard error, also where they are closed, full or broken.

Output of commands is escaped here, in one place. For the process as a whole, this module also keeps the text
that libraries print on standard error apart from the program's own messages of one line.
"""

from __future__ import annotations

import errno
import io
import logging
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, TextIO, cast

from xfrustum.terminal import messages, one_line, printable, send_messages_to

STDIN, STDOUT, STDERR = 0, 1, 2
"""Numbers of the standard file descriptors."""

MAX_KEPT_BYTES = 1 << 16
"""Largest part of the libraries' text on standard error that is shown with a traceback."""


def say(message: str) -> None:
    """Write one message of the program to standard error; errors of that stream are ignored."""
    try:
        messages().write(f"xfrustum: {one_line(message)}\n")
        messages().flush()
    except (OSError, ValueError, AttributeError):
        pass


class _Printable:
    """A text stream whose text is made printable before it is written."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        self._stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def printable_output() -> Iterator[None]:
    """Escape control characters in all that is written to `sys.stdout` within a block."""
    stream = sys.stdout
    if stream is None:  # the program around this has closed it
        yield
        return
    sys.stdout = cast("TextIO", _Printable(stream))
    try:
        yield
    finally:
        sys.stdout = stream


class _Outlet(io.RawIOBase):
    """A file descriptor that accepts all data, drops what it cannot write, and keeps the first error.

    A reader that stops reading, as `| head` does, is no error.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._gone = False
        self.failure: OSError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, data: Any) -> int:
        if not self._gone:
            try:
                return os.write(self._descriptor, data)
            except OSError as error:
                self._gone = True
                if error.errno != errno.EPIPE:
                    self.failure = error
        return len(data)


class Streams:
    """The standard streams of this process, from its first moment to its last.

    Attributes
    ----------
    library_words
        File that takes the place of file descriptor 2, where libraries in C write; None where their text
        is shown.
    """

    def __init__(self, *, words_of_libraries: bool) -> None:
        _open_closed_descriptors()
        self._output = _Outlet(STDOUT)
        sys.stdout = _text(self._output)
        self.library_words: IO[bytes] | None = None
        if not words_of_libraries:
            self.library_words = _file_for_words()
            own = os.dup(STDERR)
            os.dup2(self.library_words.fileno(), STDERR)
            _silence_python_libraries()
            # Libraries in Python write to `sys.stderr`.
            sys.stderr = _text(_Outlet(STDERR), line_buffering=True)
            send_messages_to(_text(_Outlet(own), line_buffering=True))
        else:
            sys.stderr = _text(_Outlet(STDERR), line_buffering=True)

    def failure_of_output(self) -> str | None:
        """Flush standard output, and return the reason why it could not be written; None where it could."""
        sys.stdout.flush()
        failure = self._output.failure
        return None if failure is None else failure.strerror or "I/O error"

    def words_of_libraries(self) -> str:
        """Return the last part of the text that libraries have written to standard error."""
        if self.library_words is None:
            return ""
        try:
            end = os.fstat(self.library_words.fileno()).st_size
            data = os.pread(self.library_words.fileno(), MAX_KEPT_BYTES, max(0, end - MAX_KEPT_BYTES))
        except OSError:  # there is no such file where there is no folder for temporary ones
            return ""
        return data.decode(errors="replace")


_of_process: Streams | None = None


def of_process(*, words_of_libraries: bool) -> Streams:
    """Return the streams of this process, made at the first call, which is that of `__main__`."""
    global _of_process
    if _of_process is None:
        _of_process = Streams(words_of_libraries=words_of_libraries)
    return _of_process


def words_of_libraries() -> str:
    """Return the text that libraries wrote to standard error, as far as it was kept."""
    return "" if _of_process is None else _of_process.words_of_libraries()


def _open_closed_descriptors() -> None:
    """Open those of 0, 1 and 2 that are closed: libraries would write to a file that got such a number."""
    for descriptor in (STDIN, STDOUT, STDERR):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _file_for_words() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile(buffering=0)
    except OSError:
        return open(os.devnull, "r+b", buffering=0)  # noqa: PTH123 - for the whole life of the process


def _silence_python_libraries() -> None:
    """Drop warnings and log lines of libraries, unless the user asked Python for warnings."""
    logging.getLogger().addHandler(logging.NullHandler())
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    # Python itself prints exceptions that cannot be caught, in a callback or a thread.
    sys.unraisablehook = lambda _: None
    threading.excepthook = lambda _: None


def _text(outlet: _Outlet, *, line_buffering: bool = False) -> IO[str]:
    return io.TextIOWrapper(
        io.BufferedWriter(outlet),
        encoding="utf-8",
        errors="backslashreplace",
        line_buffering=line_buffering,
        write_through=False,
    )
