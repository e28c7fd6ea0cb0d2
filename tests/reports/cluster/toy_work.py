"""Work in blocks that needs no renderer: each hogel is a row, and a log says who made each block."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from xfrustum.reports.cluster.blocks import Blocks, Tiles
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import HogelJob, Session
from xfrustum.reports.cluster.parts import Parts
from xfrustum.reports.common.records import table_of
from xfrustum.scenes import Plate
from xfrustum.scenes.model.scene import Scene

LOG = "made.log"


@dataclass(frozen=True, kw_only=True)
class ToyRow:
    """One hogel: where it is, and a number that depends on that alone."""

    column: int
    row: int
    value: float


@dataclass(frozen=True, kw_only=True)
class ToyJob(HogelJob):
    """Blocks that take a while; a hogel's row is computed from its place.

    Attributes
    ----------
    blocks
        Blocks of hogels.
    parts
        Folder of the rows.
    seconds
        Time that each block takes.
    """

    blocks: Blocks
    parts: Parts
    seconds: float = 0.0

    @classmethod
    def at(cls, out: Path, hogels: tuple[int, int] = (8, 6), side: int = 2, seconds: float = 0.0) -> ToyJob:
        """Return a job on a plate in squares, with its folder made."""
        plate = Plate(size=(8.0, 6.0), hogels=hogels)
        job = cls(
            blocks=Tiles(plate=plate, side=(side, side)), parts=Parts(out=out, name="toy"), seconds=seconds
        )
        job.parts.open({"hogels": hogels})
        return job

    @property
    def numbers(self) -> range:
        """Numbers of all blocks."""
        return self.blocks.numbers(0)

    @property
    def name(self) -> str:
        return "toy"

    def finished(self, number: int) -> bool:
        return self.parts.finished(number)

    def claims(self) -> Claims:
        return self.parts.claims()

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[ToySession]:
        yield ToySession(self)


class ToySession(Session):
    def __init__(self, job: ToyJob) -> None:
        self._job = job

    def make(self, number: int) -> None:
        time.sleep(self._job.seconds)
        rows = [
            ToyRow(column=aperture.column, row=aperture.row, value=aperture.x * aperture.y)
            for aperture in self._job.blocks.apertures(number)
        ]
        self._job.parts.write(number, table_of(ToyRow, rows))
        with (self._job.parts.out / LOG).open("a") as log:
            log.write(f"{number} {os.getpid()}\n")


def process_of(session: ToySession) -> int:
    """Answer in which process a session is open."""
    return os.getpid()


def made(out: Path) -> list[tuple[int, int]]:
    """Return number and process of every block that was made, in order."""
    log = out / LOG
    lines = log.read_text().splitlines() if log.exists() else []
    return [(int(number), int(process)) for number, process in map(str.split, lines)]


def parts_of(out: Path) -> dict[str, bytes]:
    """Return the bytes of all parts."""
    return {path.name: path.read_bytes() for path in sorted((out / "toy").glob("part-*"))}
