"""Jobs with tickets and claims on the workers of `reports.blocks`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from xfrustum.reports import blocks
from xfrustum.reports.blocks import Engine, Part, Workers, open_workers
from xfrustum.reports.cluster.job import Job, Session
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

__all__ = ["Engine", "Part", "Team", "open_team", "run_blocks"]

Answer = TypeVar("Answer")


@dataclass(frozen=True, kw_only=True)
class _WithScene(blocks.Job):
    """A job, and the scene where it is made by the process that has it."""

    job: Job
    scene: Scene | None

    @property
    def unit(self) -> str:  # type: ignore[override]  # that of the job
        return self.job.unit

    @property
    def name(self) -> str:
        return self.job.name

    def finished(self, block: int) -> bool:
        return self.job.finished(block)

    def size(self, block: int) -> int:
        return self.job.size(block)

    def words(self, block: int) -> str:
        return self.job.words(block)

    def open(self) -> AbstractContextManager[Session]:
        return self.job.open(self.scene)


class Team:
    """The processes that make the blocks of jobs."""

    def __init__(self, workers: Workers, scene: Scene | None) -> None:
        self._workers, self._scene = workers, scene
        self._last: _WithScene | None = None

    @property
    def workers(self) -> int:
        """Number of processes."""
        return self._workers.count

    def ask(self, job: Job, question: Callable[..., Answer], *arguments: Any) -> Answer:
        """Return what a session of the job answers to a question."""
        return self._workers.ask(self._with_scene(job), question, *arguments)

    def run(self, job: Job, numbers: Iterable[int], total: int, *, progress: bool) -> None:
        """Make blocks that are not finished."""
        self._workers.run(self._with_scene(job), numbers, total, progress=progress)

    def _with_scene(self, job: Job) -> _WithScene:
        if self._last is None or self._last.job != job:
            self._last = _WithScene(job=job, scene=self._scene)
        return self._last


@contextmanager
def open_team(
    engine: Engine,
    blocks: int,
    scene: Scene | None,
    told: Callable[[str], object] = lambda line: None,
    *,
    draws: bool = True,
) -> Iterator[Team]:
    """Open the workers that make the blocks, until the end of a `with` block.

    Parameters
    ----------
    engine, blocks, draws
        As for `open_workers`.
    scene
        Scene of the jobs, for this process; None for jobs that have scenes of their own.
    told
        Called with notes.

    Raises
    ------
    InputError
        No scheduler answers, or the scene is one that other processes cannot open.
    """
    with open_workers(engine, blocks, draws=draws) as workers:
        alone = workers.count == 1 and engine.scheduler is None
        if not alone and scene is not None and not scene.source:
            raise InputError(
                f"{scene.name}: has no file or name by which workers could open it; "
                "take one process (--workers 1)"
            )
        yield Team(workers, scene if alone else None)


def run_blocks(
    job: Job, numbers: Iterable[int], team: Team, total: int, what: str, *, progress: bool = False
) -> None:
    """Have all blocks made that are not finished."""
    del what  # the name of the job says it
    team.run(job, numbers, total, progress=progress)
