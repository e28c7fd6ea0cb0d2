"""Cells of a study in blocks that any process may measure; what is measured is kept.

A cell is one question of a study, and a block the cells that share what takes longest to make.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import Job, Session
from xfrustum.reports.cluster.run import Engine, Part, Team, open_team, run_blocks
from xfrustum.reports.studies.origin import Origin, measured_by, origin_hash
from xfrustum.reports.studies.store import Store
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Cell = TypeVar("Cell")

CLAIMS = "measurements.claims"
"""File beside the results by which processes that measure at once tell who does what; it stays empty."""


@dataclass(frozen=True, kw_only=True)
class CellsJob(Job, Generic[Cell]):
    """Cells that are measured, and results that are kept in a `Store`.

    Attributes
    ----------
    kind
        Kind of the results in the store.
    path
        File of the results.
    origin
        Hash of what measures, see `hashed`; a process that would measure with something else refuses. Empty
        for a job that only asks what that is.
    """

    kind: str
    path: Path
    origin: str = ""

    @property
    @abstractmethod
    def blocks(self) -> Sequence[Sequence[Cell]]:
        """The cells of each block."""

    @property
    @abstractmethod
    def modules(self) -> Sequence[str]:
        """Modules of `reports` whose sources decide what is measured."""

    @property
    def first_claim(self) -> int:
        """Claim of block 0: jobs that share a file of claims have claims of their own."""
        return 0

    @abstractmethod
    def key(self, cell: Cell) -> str:
        """Return the key of a cell's result."""

    @abstractmethod
    def measured(self, cells: Sequence[Cell]) -> Generator[DataclassInstance]:
        """Yield what is measured of some cells of one block, in their order."""

    def hashed(self, origin: Origin) -> str:
        """Return a hash of everything but the cells that results depend on."""
        return origin_hash(origin, self.modules)

    def size(self, number: int) -> int:
        """Return the number of cells of a block."""
        return len(self.blocks[number])

    def words(self, number: int) -> str:
        """Return a block by its first cell."""
        return f"block {number} of {self.kind} ({self.key(self.blocks[number][0])})"

    def finished(self, number: int) -> bool:
        """Return whether all results of a block are kept."""
        if not self.path.exists():
            return False
        with Store(self.path, self.origin) as store:
            return not self.missing(number, store)

    def missing(self, number: int, store: Store) -> list[Cell]:
        """Return the cells of a block that have no result."""
        known = store.keys(self.kind)
        return [cell for cell in self.blocks[number] if self.key(cell) not in known]

    def claims(self) -> Claims:
        """Return the claims to blocks of this job."""
        return Claims(self.path.with_name(CLAIMS), self.first_claim)

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[CellsSession]:
        """Provide what measures blocks; scenes are made from the cells.

        Raises
        ------
        InputError
            This process would measure with other sources, libraries or another device; or it has no usable
            OpenGL.
        """
        del scene
        origin = measured_by()
        if self.origin and self.hashed(origin) != self.origin:
            raise InputError(
                f"a worker measures with other sources, libraries or another device than the study was begun "
                f"with ({origin.devices.get('OpenGL renderer')}); give all workers the same"
            )
        yield CellsSession(self, origin)

    def measured_with(self, origin: Origin) -> Self:
        """Return the job of processes that measure with this."""
        return replace(self, origin=self.hashed(origin))


class CellsSession(Session):
    """What measures the blocks of one job.

    Attributes
    ----------
    origin
        What this process measures with.
    """

    def __init__(self, job: CellsJob[Any], origin: Origin) -> None:
        self._job, self.origin = job, origin

    def make(self, number: int) -> None:
        """Measure what is missing of a block; each result is kept as soon as it is there."""
        job = self._job
        with Store(job.path, job.origin) as store:
            missing = job.missing(number, store)
            if not missing:
                return
            # What measures is closed here and now, whatever ends the block.
            with closing(job.measured(missing)) as results:
                for cell, result in zip(missing, results, strict=True):
                    store.put(job.kind, job.key(cell), asdict(result))


def origin_of(session: CellsSession) -> Origin:
    """Return what a process measures with; the question that a team of workers is asked."""
    return session.origin


@contextmanager
def study_team(
    engine: Engine, asking: CellsJob[Any], told: Callable[[str], object]
) -> Iterator[tuple[Team, Origin]]:
    """Open the processes that measure a study, and the file of its results.

    Parameters
    ----------
    engine
        Where cells are measured.
    asking
        Job of the study, which asks what the processes measure with; it has as many blocks as there is work.
    told
        Called with notes in words, such as the address of the dashboard.

    Raises
    ------
    InputError
        See `open_team`; no usable OpenGL context, or no results can be kept there.
    """
    with open_team(engine, len(asking.blocks), None, told) as team:
        origin = team.ask(asking, origin_of)
        Store(asking.path, asking.hashed(origin)).close()
        asking.path.with_name(CLAIMS).touch()
        yield team, origin


def measure_part(job: CellsJob[Any], team: Team, part: Part, words: str, *, progress: bool) -> None:
    """Measure what is missing of one part of a job's cells, with a bar that is called by some words."""
    numbers = [n for n in part.of(range(len(job.blocks))) if not job.finished(n)]
    total = sum(map(job.size, numbers))
    run_blocks(job, numbers, team, total, words, progress=progress and bool(numbers))


def all_measured(job: CellsJob[Any]) -> bool:
    """Return whether every cell of a job has its result."""
    return all(map(job.finished, range(len(job.blocks))))
