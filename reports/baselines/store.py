"""The folder of a baseline: a file for each run, which nobody writes again.

    DIR/accepted/RUN.parquet    runs that were accepted
    DIR/history/RUN.parquet     every run, accepted or not
    DIR/history.html            the history page, made anew from these files

A run's name begins with its time and ends with a random number. No file is ever changed, so that processes
which write at once lose nothing, and branches of a repository that hold accepted runs merge without conflict.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from xfrustum.reports.baselines.changes import Accepted, Edition
from xfrustum.reports.baselines.measures import HogelMeasures, Place
from xfrustum.reports.baselines.records import Key, Run, StoredRun, parquet_bytes, read_run
from xfrustum.reports.common.outputs import check_writable_folder, write_output
from xfrustum.scenes.errors import InputError

ACCEPTED, HISTORY, PAGE = "accepted", "history", "history.html"

OPTION = "--baseline"


@dataclass(frozen=True, kw_only=True)
class Store:
    """The folder of a baseline.

    Attributes
    ----------
    folder
        The folder; it is made when the first run is kept.
    """

    folder: Path
    _read: dict[Path, StoredRun] = field(default_factory=dict, repr=False, compare=False)

    def check(self) -> None:
        """See, before any work is spent, that runs can be kept here and that those kept can be read.

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
        self.accepted()
        self.history()

    @property
    def page(self) -> Path:
        """Path of the history page."""
        return self.folder / PAGE

    def accepted(self) -> tuple[StoredRun, ...]:
        """Return the accepted runs, the oldest first."""
        return self._runs(ACCEPTED)

    def history(self) -> tuple[StoredRun, ...]:
        """Return all runs, the oldest first."""
        return self._runs(HISTORY)

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
            write_output(folder / f"{stored.run.run}.parquet", parquet_bytes(stored), OPTION)

    def _files(self, name: str) -> list[Path]:
        folder = self.folder / name
        return sorted(folder.glob("*.parquet")) if folder.is_dir() else []

    def _runs(self, name: str) -> tuple[StoredRun, ...]:
        """Return the runs of a folder; no file is read twice, for none changes."""
        found = []
        for path in self._files(name):
            if path not in self._read:
                # The hogels in which nothing changed are not part of the story.
                self._read[path] = read_run(path, changed_only=name == HISTORY)
            found.append(self._read[path])
        return tuple(sorted(found, key=lambda one: one.run.run))


def name_of_run(time: datetime) -> str:
    """Return a name for a run that no other run has, and that sorts by time."""
    return f"{time:%Y%m%dT%H%M%S.%fZ}-{secrets.token_hex(4)}"


def with_key(runs: Iterable[StoredRun], key: Key) -> tuple[StoredRun, ...]:
    """Return the runs whose measures are comparable."""
    return tuple(one for one in runs if one.run.key == key)


def accepted_hogels(runs: Iterable[StoredRun]) -> Accepted:
    """Return the accepted runs of each hogel by edition, the newest first."""
    of_place: dict[Place, dict[int, list[tuple[str, HogelMeasures]]]] = {}
    for one in runs:
        for hogel in one.hogels:
            editions = of_place.setdefault(hogel.place, {})
            editions.setdefault(edition_of(one.run), []).append((one.run.run, hogel))
    return {
        place: [
            Edition(runs=tuple(name for name, _ in several), kept=tuple(hogel for _, hogel in several))
            for _, several in sorted(editions.items(), reverse=True)
        ]
        for place, editions in of_place.items()
    }


def edition_of(run: Run) -> int:
    """Return the edition of a run; 0 where it was not accepted."""
    return run.edition or 0
