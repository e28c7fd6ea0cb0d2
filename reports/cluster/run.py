"""Blocks done by a cluster or in this process, those that are not finished yet, with one bar for all."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from xfrustum.reports.cluster.job import Desk, Job
from xfrustum.reports.cluster.processes import DEVICE_VARIABLE, default_devices, first_device
from xfrustum.reports.common.progress import progress_bar
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

Answer = TypeVar("Answer")

ELSEWHERE_POLL_S = 0.2
"""Seconds between two looks at blocks that somebody else is making."""

MAX_UNSEEN_S = 60.0
"""Seconds until a block that workers call finished must be seen in the store: NFS looks at a folder anew
after 60 s at the latest."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """One of several equal parts of the work, for job arrays.

    Attributes
    ----------
    number, count
        Number of the part, from 1, and number of all parts.

    Raises
    ------
    InputError
        There is no such part.
    """

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise InputError(f"part {self.number}/{self.count}: parts run from 1/{self.count}")

    @property
    def everything(self) -> bool:
        """Whether it is the whole work."""
        return self.count == 1

    def of(self, numbers: range) -> range:
        """Return every count-th block: neighbors take equally long, so parts do too."""
        return numbers[self.number - 1 :: self.count]


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Where blocks are done.

    Attributes
    ----------
    scheduler
        Address of a scheduler that exists; None for processes of this machine.
    workers
        Number of these processes, 1 for this process itself; None for one per device where something is drawn
        on GPUs or on `devices`, and else for as many as this process may use processors.
    devices
        Indices of EGL devices, which these processes take in turn; one process takes the first. None of them
        stands for the GPUs of this machine.
    part
        Part of the blocks that are done here, without any engine.

    Raises
    ------
    InputError
        A number is not positive, or what is asked for does not go together.
    """

    scheduler: str | None = None
    workers: int | None = None
    devices: tuple[int, ...] = ()
    part: Part = field(default_factory=Part)

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers must be at least 1, not {self.workers}")
        if self.scheduler is not None and self.workers is not None:
            raise InputError("--scheduler has workers of its own: leave out --workers")
        if self.scheduler is not None and self.devices:
            raise InputError(
                "--devices are for processes of this machine: leave them out, and start each worker of "
                f"--scheduler with {DEVICE_VARIABLE}"
            )
        if not self.part.everything and (self.scheduler or (self.workers or 1) > 1):
            raise InputError("--part is done by one process: leave out --scheduler and --workers")

    def process_count(self, blocks: int, devices: int = 0) -> int:
        """Return how many processes of this machine do so many blocks.

        Parameters
        ----------
        blocks
            Number of blocks.
        devices
            Number of devices that they draw on; 0 where they draw on none, or in software. Several processes
            on one GPU take turns at best, so that each device has one unless more are asked for.
        """
        if not self.part.everything:
            return 1
        usual = min(_processors(), devices) if devices else _processors()
        return max(1, min(usual if self.workers is None else self.workers, blocks))


class Team(Protocol):
    """The workers of a cluster, or this process: all that blocks are given to."""

    @property
    def workers(self) -> int:
        """Number of processes that do blocks."""

    def finished(self, job: Job, numbers: Iterator[int]) -> Iterator[int]:
        """Have blocks done, and yield each as its turn has come to an end."""

    def progressed(self) -> object:
        """Take note that a block is finished which was not before."""

    def ask(self, job: Job, question: Callable[..., Answer], *arguments: Any) -> Answer:
        """Return what a session of the job answers to a question."""


class _Alone:
    """The process itself, which does one block after the other."""

    workers = 1

    def __init__(self, desk: Desk) -> None:
        self._desk = desk

    def finished(self, job: Job, numbers: Iterator[int]) -> Iterator[int]:
        for number in numbers:
            self._desk.do(job, number)
            yield number

    def progressed(self) -> None:
        """One process has nothing to count."""

    def ask(self, job: Job, question: Callable[..., Answer], *arguments: Any) -> Answer:
        return question(self._desk.session(job), *arguments)


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
    engine
        Where blocks are done.
    blocks
        Number of blocks to be done at first, which bounds the number of processes.
    scene
        Scene of the jobs, for this process; None for jobs that have scenes of their own.
    told
        Called with the address of the dashboard, in words.
    draws
        Whether the jobs draw with OpenGL.

    Raises
    ------
    InputError
        No scheduler answers, or the scene is one that other processes cannot open.
    """
    devices = engine.devices
    if draws and engine.scheduler is None and not devices:
        devices = default_devices()
    processes = engine.process_count(blocks, len(devices) if draws else 0)
    if engine.scheduler is None and processes == 1:
        with first_device(devices), Desk(scene) as desk:
            yield _Alone(desk)
        return
    if scene is not None and not scene.source:
        raise InputError(
            f"{scene.name}: has no file or name by which workers could open it; "
            "take one process (--workers 1)"
        )
    # Dask takes a second to load, which no other command may pay for.
    from xfrustum.reports.cluster.cluster import foreign_cluster, machine_cluster  # noqa: PLC0415

    if engine.scheduler is not None:
        cluster = foreign_cluster(engine.scheduler)
    else:
        cluster = machine_cluster(processes, max(1, _processors() // processes), devices)
    with cluster as workers:
        told(f"dashboard: {workers.dashboard}")
        yield workers


def run_blocks(
    job: Job, numbers: Iterable[int], team: Team, total: int, what: str, *, progress: bool = False
) -> None:
    """Have all blocks done that are not finished, and wait for those that somebody else is making.

    Parameters
    ----------
    job, numbers
        Job, and numbers of its blocks.
    team
        Workers that do them.
    total
        Number of hogels, or of what else blocks consist of, for the bar.
    what
        Name of the work, for the bar.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        See `Job.open`, and `Team`; or finished blocks are not seen, as in a folder that is not shared.
    """
    with progress_bar(total, what, job.unit, shown=progress) as bar:

        def count(number: int) -> None:
            bar.update(job.size(number) if progress else 1)

        def unfinished(some: Iterable[int]) -> Iterator[int]:
            for number in some:
                if job.finished(number):
                    count(number)
                else:
                    yield number

        waiting: Iterable[int] = numbers
        left, unseen_s = math.inf, 0.0
        while True:
            elsewhere = []
            for number in team.finished(job, unfinished(waiting)):
                if job.finished(number):
                    team.progressed()
                    count(number)
                else:
                    elsewhere.append(number)
            if not elsewhere:
                return
            others_had_all = _wait_for_free(job, elsewhere)
            unseen_s = 0.0 if others_had_all or len(elsewhere) < left else unseen_s + ELSEWHERE_POLL_S
            if unseen_s > MAX_UNSEEN_S:
                raise InputError(
                    f"--out: workers call block {elsewhere[0]} finished, and it is not there; give a folder "
                    "on a file system that the command and all workers share"
                )
            waiting, left = elsewhere, len(elsewhere)


def _wait_for_free(job: Job, elsewhere: list[int]) -> bool:
    """Wait, at least a moment, until some blocks that others were making are finished, or given up.

    Return whether others were making all of them at first.
    """
    others_had_all = False
    while True:
        time.sleep(ELSEWHERE_POLL_S)
        with job.claims() as claims:
            for number in elsewhere:
                if job.finished(number):
                    return others_had_all
                if claims.take(number):
                    claims.release(number)
                    return others_had_all
        others_had_all = True


def _processors() -> int:
    """Return the number of processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
