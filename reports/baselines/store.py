"""The folder of a baseline: a file for each run, which nobody writes again.

    DIR/accepted/RUN.parquet    runs that were accepted
    DIR/history/RUN.parquet     every run, accepted or not
    DIR/history.html            the history page, made anew from these files

A run's name begins with its time and ends with a random number. No file is ever changed, so that processes
which write at once lose nothing, and branches of a repository that hold accepted runs merge without conflict.
"""

from __future__ import annotations

import secrets
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from xfrustum.reports.baselines.records import (
    AcceptedRun,
    Run,
    StoredRun,
    ToldRun,
    check_file,
    parquet_bytes,
    read_accepted,
    read_head,
    read_told,
)
from xfrustum.reports.common.outputs import check_writable_folder, write_output
from xfrustum.scenes.errors import InputError

ACCEPTED, HISTORY, PAGE = "accepted", "history", "history.html"

OPTION = "--baseline"

MAX_RUNS = 400
"""Largest number of runs that the history page shows: the newest; the files have all."""

MAX_CHANGES = 4
"""Largest number of changes of one run that the page names."""


@dataclass(frozen=True, kw_only=True)
class Store:
    """The folder of a baseline.

    Attributes
    ----------
    folder
        The folder; it is made when the first run is kept.
    """

    folder: Path
    _heads: dict[Path, Run] = field(default_factory=dict, repr=False, compare=False)
    _told: dict[Path, ToldRun] = field(default_factory=dict, repr=False, compare=False)

    def check(self) -> None:
        """See, before any work is spent, that runs can be kept here and that files have a run's columns.

        Raises
        ------
        InputError
            The folder cannot be written, or holds what is no run.
        """
        try:
            check_writable_folder(self.folder, (PAGE,))
            for name in (ACCEPTED, HISTORY):
                check_writable_folder(self.folder / name)
        except InputError as error:
            raise InputError(str(error).replace("--out", OPTION, 1)) from error
        for path in (*self._files(ACCEPTED), *self._files(HISTORY)[-MAX_RUNS:]):
            check_file(path)

    @property
    def page(self) -> Path:
        """Path of the history page."""
        return self.folder / PAGE

    def accepted(self) -> tuple[Run, ...]:
        """Return which runs are accepted, the oldest first; no file is read twice, for none changes."""
        paths = self._files(ACCEPTED)
        self._heads.update({path: read_head(path) for path in paths if path not in self._heads})
        return tuple(self._heads[path] for path in paths)

    def measures(self, runs: Collection[Run]) -> tuple[AcceptedRun, ...]:
        """Return what some accepted runs measured."""
        return tuple(read_accepted(self._path(ACCEPTED, run), run) for run in runs)

    def history(self) -> tuple[ToldRun, ...]:
        """Return the newest runs, at most `MAX_RUNS`, the oldest first; no file is read twice."""
        for path in self._files(HISTORY)[-MAX_RUNS:]:
            if path not in self._told:
                self._told[path] = read_told(path, MAX_CHANGES)
        return tuple(self._told[path] for path in sorted(self._told)[-MAX_RUNS:])

    def older(self) -> int:
        """Return the number of runs that are older than those of the history page."""
        return max(0, len(self._files(HISTORY)) - MAX_RUNS)

    def names(self) -> frozenset[str]:
        """Return the names of the files of all runs."""
        return frozenset(str(path) for name in (ACCEPTED, HISTORY) for path in self._files(name))

    def keep(self, stored: StoredRun) -> None:
        """Add a run to the history, and to the accepted ones if it was approved.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        # What is accepted decides; the history only tells of it, and comes second.
        for name in (ACCEPTED, HISTORY) if stored.run.approved else (HISTORY,):
            folder = self.folder / name
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{OPTION} {folder}: cannot be made ({error.strerror})") from error
            write_output(self._path(name, stored.run), parquet_bytes(stored), OPTION)

    def _files(self, name: str) -> list[Path]:
        folder = self.folder / name
        return sorted(folder.glob("*.parquet")) if folder.is_dir() else []

    def _path(self, name: str, run: Run) -> Path:
        return self.folder / name / f"{run.run}.parquet"


def name_of_run(time: datetime) -> str:
    """Return a name for a run that no other run has, and that sorts by time."""
    return f"{time:%Y%m%dT%H%M%S.%fZ}-{secrets.token_hex(4)}"
