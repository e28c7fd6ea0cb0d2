"""Worker processes are started again as often as they die by accident, and no more."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.reports.cluster.toy_work import ToyJob
from xfrustum.reports.cluster import processes
from xfrustum.reports.cluster.job import Job, do_block
from xfrustum.reports.cluster.processes import WorkerProcesses
from xfrustum.reports.cluster.run import run_blocks
from xfrustum.scenes import InputError

STARTS = 3


class Dead:
    """A process that has died at once."""

    started = 0

    def __init__(self, *arguments: Any, **options: Any) -> None:
        Dead.started += 1

    def poll(self) -> int:
        return 1


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> WorkerProcesses:
    """Two workers, each process of which dies at once."""
    monkeypatch.setattr(processes, "MAX_STARTS", STARTS)
    monkeypatch.setattr(subprocess, "Popen", Dead)
    monkeypatch.setattr(Dead, "started", 0)
    return WorkerProcesses("tcp://127.0.0.1:1", 2, 1)


def test_workers_that_die_and_finish_nothing_are_given_up(workers: WorkerProcesses) -> None:
    for _ in range(STARTS):
        workers.tend()
    with pytest.raises(InputError, match=r"6 worker processes have died .*, and no block was finished"):
        workers.tend()
    assert Dead.started == 2 * STARTS


def test_deaths_between_which_blocks_are_finished_end_nothing(workers: WorkerProcesses) -> None:
    rounds = 5 * STARTS
    for _ in range(rounds):
        workers.tend()
        workers.progressed()
    assert Dead.started == 2 * rounds
    for _ in range(STARTS):
        workers.tend()
    with pytest.raises(InputError, match="6 worker processes"):
        workers.tend()


def test_only_blocks_that_are_finished_by_their_workers_are_progress(tmp_path: Path) -> None:
    job = ToyJob.at(tmp_path)
    do_block(job, 0)
    progress: list[int] = []

    class Half:
        """A team in which every other task ends without its block, which is done in the next round."""

        workers = 1

        def __init__(self) -> None:
            self.left = {2, 4}

        def finished(self, job: Job, numbers: Iterator[int]) -> Iterator[int]:
            for number in numbers:
                if number in self.left:
                    self.left.remove(number)
                else:
                    do_block(job, number)
                yield number

        def progressed(self) -> None:
            progress.append(len(list(filter(job.finished, job.numbers))))

        def ask(self, job: Job, question: Callable[..., Any], *arguments: Any) -> Any:
            raise NotImplementedError

    run_blocks(job, job.numbers, Half(), job.blocks.hogels(0), "toy")
    # The one that was finished before is none, and each of the others is, once.
    assert progress == list(range(2, len(job.numbers) + 1))
