"""An unexpected error: one line, exit status 70, and a traceback that can be sent in."""

from __future__ import annotations

import contextlib
import os
import tempfile
import traceback
from pathlib import Path

from xfrustum.cli.streams import say, words_of_libraries
from xfrustum.terminal import messages

UNEXPECTED_ERROR = 70
"""Exit status after an error of the program itself: EX_SOFTWARE of sysexits.h."""

PREFIX, SUFFIX = "xfrustum-traceback-", ".txt"
"""Beginning and end of the names of files with tracebacks."""

MAX_TRACEBACKS = 20
"""Largest number of tracebacks kept in the folder for temporary files; the oldest are removed."""

MAX_FRAMES = 200
"""Largest number of frames of a traceback that are written, from its end; endless recursion has thousands."""


def report_unexpected(error: BaseException, *, shown: bool) -> int:
    """Print in one line that the program failed, and return the exit status.

    Parameters
    ----------
    error
        Exception that is no input error.
    shown
        Whether to print its traceback instead of writing it to a file.
    """
    text = "".join(traceback.format_exception(error, limit=-MAX_FRAMES))
    what = f"unexpected error: {_in_words(error)}"
    if shown:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            messages().write(text)
        say(what)
        return UNEXPECTED_ERROR
    where = _write(text + words_of_libraries())
    if where is None:
        say(f"{what}; its traceback could not be written: run `xfrustum --traceback ..` to see it")
    else:
        say(f"{what}; its traceback is in {where}")
    return UNEXPECTED_ERROR


def _in_words(error: BaseException) -> str:
    kind = type(error).__name__
    if isinstance(error, MemoryError) and not str(error):
        return f"{kind}: out of memory"
    reason = str(error)[:200]
    return f"{kind}: {reason}" if reason else kind


def _write(text: str) -> Path | None:
    """Write a traceback to a new file that only its owner can read, and return its path, or None."""
    try:
        descriptor, name = tempfile.mkstemp(prefix=PREFIX, suffix=SUFFIX)
        with open(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:  # noqa: PTH123
            file.write(text)
    except OSError:
        return None
    _remove_old(Path(name).parent)
    return Path(name)


def _remove_old(folder: Path) -> None:
    """Remove the user's oldest tracebacks until `MAX_TRACEBACKS` are left."""
    own: list[tuple[float, Path]] = []
    for path in folder.glob(f"{PREFIX}*{SUFFIX}"):
        with contextlib.suppress(OSError):
            found = path.lstat()
            if found.st_uid == os.getuid():
                own.append((found.st_mtime_ns, path))
    for _, path in sorted(own)[:-MAX_TRACEBACKS]:
        path.unlink(missing_ok=True)
