"""Errors of file systems in words: impossible names, and places without room."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence

import click

ADVICE = {
    errno.ENAMETOOLONG: "give a shorter name",
    errno.ENOSPC: "free some space or choose another place",
    errno.EDQUOT: "free some space or choose another place",
    errno.EFBIG: "choose a place where files may be larger",
    errno.EROFS: "choose another place",
    errno.EACCES: "choose another place, or ask for permission",
    errno.EPERM: "choose another place, or ask for permission",
    errno.ELOOP: "mend the symbolic links",
    errno.EMFILE: "raise the limit on open files (ulimit -n)",
}
"""Advice to the user about errors of the operating system, by their numbers."""

MAX_SHOWN = 100
"""Largest number of characters of a name that a message repeats."""


def in_words(error: OSError) -> str:
    """Return the message for an error that is in `ADVICE`: the place, the reason and the advice."""
    assert error.errno is not None
    reason = f"{os.strerror(error.errno)}; {ADVICE[error.errno]}"
    if error.filename is None:
        return reason
    name = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else str(error.filename)
    return f"{shortened(name)}: {reason}"


def shortened(name: str) -> str:
    """Return a name, or its beginning and end if it is longer than `MAX_SHOWN`."""
    half = MAX_SHOWN // 2
    return name if len(name) <= MAX_SHOWN else f"{name[:half]}..{name[-half:]}"


def check_encoding(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no UTF-8, because image files and JSON cannot hold such names.

    Raises
    ------
    click.UsageError
        An argument has bytes that are no UTF-8.
    """
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise click.UsageError(f"{shortened(argument)} is not UTF-8; use another name") from error
