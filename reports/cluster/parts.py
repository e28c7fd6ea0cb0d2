"""A folder of Parquet parts, one for each block, each there whole or not at all.

A part is written aside and renamed when it is on the disk: a part that is there is a block that is finished,
whatever happened to the process that wrote it. A part that is not whole was damaged from outside, and counts
as missing. The folder says what its rows were made from, and refuses to be continued with anything else.
"""

from __future__ import annotations

import io
import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.differences import differences_words
from xfrustum.scenes.disk.durable import write_file
from xfrustum.scenes.errors import InputError

DESCRIPTION, CLAIMS = "_description.json", "_claims"
"""Files beside the parts; readers of Parquet leave out names that begin like these."""

MAGIC = b"PAR1"
"""The first and the last four bytes of every Parquet file."""

DESCRIPTION_CLAIM = 1 << 48
"""Claim of whoever writes the description, far beyond the number of any block."""

POLL_S = 0.02
"""Seconds between two attempts to claim the description, which is written in a few milliseconds."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The parts of one result.

    Attributes
    ----------
    out
        Folder that the user named; files are made aside in it.
    name
        Name of the folder of parts in it.
    """

    out: Path
    name: str

    @property
    def folder(self) -> Path:
        """The folder of parts."""
        return self.out / self.name

    def path(self, number: int) -> Path:
        """Return the file of a block."""
        return self.folder / f"part-{number:07d}.parquet"

    def open(self, description: dict[str, Any]) -> None:
        """Make the folder, or see that it belongs to the same result; several processes may do so at once.

        Parameters
        ----------
        description
            Everything that decides the rows, in JSON's own types.

        Raises
        ------
        InputError
            The folder holds something else, or cannot be written.
        """
        with self._writable():
            # Another process may have made the folder and nothing in it yet; the first thing is the claims.
            begun = self.folder.exists() and any(self.folder.iterdir())
            if begun and not (self.folder / CLAIMS).exists():
                raise InputError(
                    f"--out {self.out}: {self.name} exists and was not begun by this command; "
                    "choose another place"
                )
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / CLAIMS).touch(exist_ok=True)
            with self.claims() as claims:
                while not claims.take(DESCRIPTION_CLAIM):
                    time.sleep(POLL_S)
                self._agree(json.loads(json.dumps(description)))

    def _agree(self, wanted: dict[str, Any]) -> None:
        path = self.folder / DESCRIPTION
        if not path.exists():
            write_file(path, json.dumps(wanted, indent=1).encode(), host=self.out)
            return
        try:
            found = json.loads(path.read_bytes())
        except ValueError:
            found = None
        if found == wanted:
            return
        raise InputError(
            f"--out {self.out}: was begun with {differences_words(found, wanted)}; "
            f"give what it was begun with, or another place, or delete {self.folder} to begin anew"
        )

    def claims(self) -> Claims:
        """Return what tells processes that work here at once who does which block."""
        return Claims(self.folder / CLAIMS)

    def finished(self, number: int) -> bool:
        """Return whether a block's part is there and, as far as its last bytes say, whole."""
        try:
            with self.path(number).open("rb") as file:
                end = file.seek(0, os.SEEK_END)
                file.seek(max(0, end - len(MAGIC)))
                return end > 2 * len(MAGIC) and file.read() == MAGIC
        except OSError:
            return False

    def write(self, number: int, table: pa.Table) -> None:
        """Write the part of a block; afterwards it is finished, and on the disk.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        buffer = io.BytesIO()
        pq.write_table(table, buffer)
        with self._writable():
            write_file(self.path(number), buffer.getbuffer(), host=self.out)

    def read(self, number: int, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of a finished block; all columns, or some."""
        return pq.read_table(self.path(number), columns=columns)

    def remove(self, number: int) -> None:
        """Remove the part of a block, which is unfinished afterwards.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        with self._writable():
            self.path(number).unlink(missing_ok=True)

    def write_beside(self, name: str, content: bytes) -> None:
        """Write a file beside the parts, whole or not at all.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        with self._writable():
            write_file(self.folder / name, content, host=self.out)

    def read_beside(self, name: str) -> bytes | None:
        """Return a file beside the parts; None where there is none."""
        try:
            return (self.folder / name).read_bytes()
        except FileNotFoundError:
            return None

    def remove_beside(self, name: str) -> None:
        """Remove a file beside the parts, if there is one.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        with self._writable():
            (self.folder / name).unlink(missing_ok=True)

    @contextmanager
    def _writable(self) -> Iterator[None]:
        """Turn what the file system refuses into an InputError."""
        try:
            yield
        except OSError as error:
            raise InputError(
                f"--out {self.out}: cannot write there ({error.strerror or error}); "
                "free some space or choose another place"
            ) from error
