"""A folder of Parquet parts, one for each block, each there whole or not at all.

A part is written aside and renamed when it is on the disk: a part that is there is a block that is finished,
whatever happened to the process that wrote it. A part carries a digest of its bytes: one that does not agree
was damaged from outside, and counts as missing. The folder says what its rows were made from, and refuses to
be continued with anything else.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from xfrustum.reports.cluster.claims import Claims
from xfrustum.scenes.disk.durable import write_file
from xfrustum.scenes.errors import InputError

DESCRIPTION, CLAIMS = "_description.json", "_claims"
"""Files beside the parts; readers of Parquet leave out names that begin like these."""

_DIGEST = re.compile(rb"xfrustum:sha256[^0-9a-f]{1,8}([0-9a-f]{64})")
"""Digest of a part in the part itself, among the key-value pairs of Parquet's footer: the SHA-256 of the file
with zeros in place of the digest."""

_NO_DIGEST = b"0" * 64

MAX_NAMED_VALUES = 3
"""Values of one part of a description that are told with what they were and what they are now."""

MAX_VALUE_CHARACTERS = 40
"""Longest text of a value that is told; hashes and longer texts tell a reader nothing."""

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
            found = json.loads(_regular(path) or b"")
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
        """Return whether a block's part is there, and is as it was written."""
        return self._content(number) is not None

    def damaged(self, number: int) -> bool:
        """Return whether there is something in the place of a block's part that is none."""
        return os.path.lexists(self.path(number)) and not self.finished(number)

    def write(self, number: int, table: pa.Table) -> None:
        """Write the part of a block; afterwards it is finished, and on the disk.

        Raises
        ------
        InputError
            The disk is full or cannot be written.
        """
        buffer = io.BytesIO()
        with pq.ParquetWriter(buffer, table.schema) as writer:
            writer.write_table(table)
            writer.add_key_value_metadata({"xfrustum:sha256": _NO_DIGEST.decode()})
        content = buffer.getvalue()
        digest = hashlib.sha256(content).hexdigest().encode()
        before, _, after = content.rpartition(_NO_DIGEST)
        path = self.path(number)
        with self._writable():
            if os.path.lexists(path) and not path.is_file():
                path.unlink()  # such as a pipe, which a file would be written into
            write_file(path, before + digest + after, host=self.out)

    def read(self, number: int, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of a finished block; all columns, or some.

        Raises
        ------
        InputError
            The part is missing, or was damaged since it was found to be finished.
        """
        content = self._content(number)
        if content is None:
            raise InputError(
                f"{self.path(number)}: is missing or damaged; repeat the command to make it again"
            )
        return pq.read_table(io.BytesIO(content), columns=columns)

    def _content(self, number: int) -> bytes | None:
        """Return the bytes of a block's part; None where it is missing, no file, or damaged."""
        content = _regular(self.path(number))
        found = list(_DIGEST.finditer(content or b""))
        if content is None or not found:
            return None
        begin, end = found[-1].span(1)
        without = hashlib.sha256(content[:begin] + _NO_DIGEST + content[end:])
        return content if without.hexdigest().encode() == found[-1][1] else None

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
        return _regular(self.folder / name)

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


def _regular(path: Path) -> bytes | None:
    """Return the content of a regular file; None of anything else, such as a pipe, on which reading waits."""
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            return file.read() if stat.S_ISREG(os.fstat(file.fileno()).st_mode) else None
    except OSError:
        return None


def differences_words(found: object, wanted: object) -> str:
    """Return what differs, such as "other settings (near was 0.1, now 0.2) and another scene".

    Parameters
    ----------
    found, wanted
        Description that a folder has, and the one that is asked for, both as JSON has them.
    """
    if not (isinstance(found, dict) and isinstance(wanted, dict)):
        return "another description"
    parts = []
    for key in dict.fromkeys((*wanted, *found)):
        if found.get(key) == wanted.get(key):
            continue
        values = list(islice(_changed_values(found.get(key), wanted.get(key), key), MAX_NAMED_VALUES))
        told = "; ".join(f"{name} was {was}, now {now}" for name, was, now in values)
        # "Content" has no plural.
        article = "other" if key.split()[0].endswith("s") or key == "content" else "another"
        parts.append(f"{article} {key}" + (f" ({told})" if told else ""))
    *first, last = parts or ["another description"]
    return f"{', '.join(first)} and {last}" if first else last


def _changed_values(found: object, wanted: object, name: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, former and present text of the short values that differ, however deep they lie."""
    if found == wanted:
        return
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in dict.fromkeys((*wanted, *found)):
            yield from _changed_values(found.get(key), wanted.get(key), key)
    elif isinstance(found, list) and isinstance(wanted, list) and len(found) == len(wanted):
        for one, other in zip(found, wanted, strict=True):
            yield from _changed_values(one, other, name)
    else:
        was, now = (json.dumps(value, ensure_ascii=False, default=str) for value in (found, wanted))
        if max(len(was), len(now)) <= MAX_VALUE_CHARACTERS:
            yield name, was, now
