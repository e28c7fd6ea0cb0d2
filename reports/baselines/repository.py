"""The commit of the repository that a renderer is in."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

MAX_SECONDS = 20.0
"""Longest time that git may take, seconds: a repository on a network may be slow, and none may hang."""


@dataclass(frozen=True, kw_only=True)
class Commit:
    """A commit that is checked out.

    Attributes
    ----------
    hash, subject
        Its full name, and the first line of its message.
    modified
        Whether files that git knows differ from it.
    """

    hash: str
    subject: str
    modified: bool


def commit_of(folder: Path) -> Commit | None:
    """Return the commit that a folder is at; None where it is in no repository, or git is not there."""
    told = _git(folder, "log", "-1", "--format=%H%n%s")
    if told is None:
        return None
    commit, _, subject = told.partition("\n")
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return Commit(hash=commit, subject=subject.strip(), modified=bool(changed))


def _git(folder: Path, *arguments: str) -> str | None:
    """Return what git prints; None where it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=MAX_SECONDS,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.rstrip("\n")
