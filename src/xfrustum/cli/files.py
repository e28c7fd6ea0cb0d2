"""Errors of the file system in words: impossible names, and places without room."""

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
"""What the user can do about an error of the operating system."""

MAX_SHOWN = 100
"""Most characters of a name that a message repeats."""


def in_words(error: OSError) -> str:
    """Return what is wrong, where, and what to do about an error that is in `ADVICE`."""
    assert error.errno is not None
    reason = f"{os.strerror(error.errno)}; {ADVICE[error.errno]}"
    if error.filename is None:
        return reason
    name = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else str(error.filename)
    return f"{shortened(name)}: {reason}"


def shortened(name: str) -> str:
    """Return a name, or the beginning and the end of one that is too long to be shown."""
    half = MAX_SHOWN // 2
    return name if len(name) <= MAX_SHOWN else f"{name[:half]}..{name[-half:]}"


def check_encoding(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no UTF-8: image files and JSON have no way to hold such names.

    Raises
    ------
    click.UsageError
        One of them has bytes that are no UTF-8.
    """
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise click.UsageError(f"{shortened(argument)} is not UTF-8; use another name") from error
