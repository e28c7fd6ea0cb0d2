"""Results on disk as they come: what is written survives whatever ends the process."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from xfrustum.scenes.errors import InputError

_WAIT_S = 30.0
"""Longest wait for another process that is writing to the same file."""

_SCHEMA = """
    CREATE TABLE IF NOT EXISTS results (
        origin TEXT NOT NULL, kind TEXT NOT NULL, key TEXT NOT NULL, result TEXT NOT NULL,
        PRIMARY KEY (origin, kind, key)
    ) WITHOUT ROWID
"""


class Store:
    """Results of one origin in a SQLite file, by kind and key.

    A context manager. Each result is a transaction of its own: once `put` has returned, it is on disk.

    Parameters
    ----------
    path
        The file; made where there is none.
    origin
        Hash of what measures, see `origin.origin_hash`.

    Raises
    ------
    InputError
        The file cannot be written, or is no such store.
    """

    def __init__(self, path: Path, origin: str) -> None:
        self._path = path
        self._origin = origin
        with self._explained():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._connection = sqlite3.connect(path, timeout=_WAIT_S)
            with self._connection:
                self._connection.execute(_SCHEMA)

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def put(self, kind: str, key: str, result: Mapping[str, Any]) -> None:
        """Keep a result; one that is already there under the same key stays as it was."""
        row = (self._origin, kind, key, json.dumps(result))
        with self._explained(), self._connection:
            self._connection.execute("INSERT OR IGNORE INTO results VALUES (?, ?, ?, ?)", row)

    def keys(self, kind: str) -> set[str]:
        """Return the keys of all results of a kind."""
        with self._explained():
            rows = self._connection.execute(
                "SELECT key FROM results WHERE origin = ? AND kind = ?", (self._origin, kind)
            )
            return {key for (key,) in rows}

    def get(self, kind: str) -> dict[str, dict[str, Any]]:
        """Return all results of a kind by their key."""
        with self._explained():
            rows = self._connection.execute(
                "SELECT key, result FROM results WHERE origin = ? AND kind = ?", (self._origin, kind)
            )
            return {key: json.loads(result) for key, result in rows}

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Turn what the user can mend into an InputError."""
        try:
            yield
        except (sqlite3.DatabaseError, OSError) as error:
            raise InputError(
                f"{self._path}: cannot keep results there ({error}); "
                "choose another --out, or move the file away"
            ) from error
