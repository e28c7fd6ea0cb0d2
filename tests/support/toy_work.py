"""Work in blocks without a renderer: blocks of a few rows; a log lists their processes."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from xfrustum.reports.blocks import Job
from xfrustum.reports.common.records import table_of
from xfrustum.reports.parts import ParquetParts
from xfrustum.scenes import InputError

LOG = "made.log"
NUMBERS = range(12)


@dataclass(frozen=True, kw_only=True)
class ToyRow:
    number: int
    value: float


@dataclass(frozen=True, kw_only=True)
class ToyJob(Job):
    """Blocks of a row each; `deadly` counts process deaths by block; block `bad` raises."""

    parts: ParquetParts
    seconds: float = 0.0
    deadly: Mapping[int, float] = field(default_factory=dict)
    bad: int | None = None
    draws = False

    @classmethod
    def at(cls, out: Path, **behavior: Any) -> ToyJob:
        """Return a job, and create its folder."""
        job = cls(parts=ParquetParts(out=out, name="toy"), **behavior)
        job.parts.open({"numbers": len(NUMBERS)})
        return job

    @property
    def name(self) -> str:
        return "toy"

    def finished(self, block: int) -> bool:
        return self.parts.finished(block)

    def size(self, block: int) -> int:
        return 1

    def words(self, block: int) -> str:
        return f"block {block}"

    @contextmanager
    def open(self) -> Iterator[ToySession]:
        yield ToySession(self)


class ToySession:
    def __init__(self, job: ToyJob) -> None:
        self._job = job

    def make(self, block: int) -> None:
        time.sleep(self._job.seconds)
        deaths = self._job.parts.out / f"deaths-{block}"
        before = deaths.stat().st_size if deaths.exists() else 0
        if before < self._job.deadly.get(block, 0):
            deaths.write_text("x" * (before + 1))
            os.kill(os.getpid(), signal.SIGKILL)
        if block == self._job.bad:
            raise InputError("a bad block; mend it")
        self._job.parts.write(block, table_of(ToyRow, [ToyRow(number=block, value=block**0.5)]))
        with (self._job.parts.out / LOG).open("a") as log:
            log.write(f"{block} {os.getpid()}\n")


def process_of(session: ToySession) -> int:
    """Return the process of an open session."""
    return os.getpid()


def made(out: Path) -> list[tuple[int, int]]:
    """Return number and process of every finished block, in order."""
    log = out / LOG
    lines = log.read_text().splitlines() if log.exists() else []
    return [(int(number), int(process)) for number, process in map(str.split, lines)]


def parts_of(out: Path) -> dict[str, bytes]:
    """Return the bytes of all parts."""
    return {path.name: path.read_bytes() for path in sorted((out / "toy").glob("part-*"))}
