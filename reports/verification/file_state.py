"""Digests of the files that a verification depends on: they change when any of these files is written."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
from collections.abc import Iterable
from pathlib import Path

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.plate.plate import Aperture


def state_of_files(paths: Iterable[str]) -> str:
    """Return a digest of the names, sizes and times of some files; those that do not exist are left out."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            found = os.stat(path)  # noqa: PTH116 - a Path for each of millions of names takes as long again
        except (OSError, ValueError):
            continue
        digest.update(f"{path}\0{found.st_size}\0{found.st_mtime_ns}\n".encode(errors="surrogateescape"))
    return digest.hexdigest()


def state_of_images(pattern: str, apertures: Iterable[Aperture]) -> str:
    """Return a digest of the image files of some hogels, named by a pattern with {i} and {j}."""
    return state_of_files(pattern.format(i=one.column, j=one.row) for one in apertures)


def state_of_command(template: str, folder: Path) -> str:
    """Return a digest of the program of a command, and of every file that its words name.

    Parameters
    ----------
    template
        The command.
    folder
        Folder in which it runs, where files with relative names lie.

    Raises
    ------
    ValueError
        The command's quotes do not match.
    """
    words = shlex.split(template)
    # A word may be a whole script, longer than any name of a file: `isfile` takes it for none.
    named = [str(path) for word in words if os.path.isfile(path := folder / word)]  # noqa: PTH113
    program = shutil.which(words[0]) if words and os.sep not in words[0] else None
    return state_of_files(dict.fromkeys(([program] if program else []) + named))


def require_same_command(template: str, found: str, state: str) -> None:
    """Raise InputError where a process finds another program than the command did: by digests of both."""
    if found != state:
        raise InputError(
            f"--command {template!r}: a worker finds another program, or other files that its words name; "
            "give all the same files by the same paths, and leave them as they are while hogels are judged"
        )


def require_same_images(pattern: str, found: str, state: str) -> None:
    """Raise InputError where a process finds other images than the command did: by digests of both."""
    if found != state:
        raise InputError(
            f"{pattern}: a worker finds other image files than the command; give both the same files, and "
            "leave them as they are while they are judged"
        )
