"""A real scheduler with real messages, and workers that sleep as long as a block takes.

The scheduler is a process of its own. The simulated workers share few processes, for they do nothing but
answer; the client is this process, with the engine's own loop.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from xfrustum.reports.benchmarks.cluster.forecast import SimulatedRun
from xfrustum.reports.cluster.blocks import Blocks, Tiles
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.cluster import Workers, foreign_cluster
from xfrustum.reports.cluster.job import HogelJob, Session
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Plate

WORKERS_PER_PROCESS = 256
"""Simulated workers of one process: more of them would wait for each other's messages."""

START_S = 120.0
"""Seconds that scheduler and workers have to start, on a machine that does other things too."""

POLL_S = 0.1
"""Seconds between two looks at who has started."""

MIB = 1 << 20


@dataclass(frozen=True, kw_only=True)
class SleepingJob(HogelJob):
    """Blocks that sleep. Nothing is stored: a block is finished when its task is."""

    blocks: Blocks
    seconds: float

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "sleep"

    def finished(self, number: int) -> bool:
        """Return False: there is no store."""
        return False

    def claims(self) -> Claims:
        """Raise an error: nobody claims a block that is not stored."""
        raise NotImplementedError

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[Session]:
        """Raise an error: there is nothing to be opened."""
        raise NotImplementedError


async def sleep_block(job: SleepingJob, number: int) -> None:
    """Sleep as long as a block takes; the task of simulated workers, which run it in their loop."""
    del number
    await asyncio.sleep(job.seconds)


def simulate(workers: int, blocks: int, block_s: float) -> SimulatedRun:
    """Measure a scheduler with simulated workers.

    Parameters
    ----------
    workers, blocks
        Number of workers and of blocks.
    block_s
        Seconds that a block sleeps.

    Raises
    ------
    InputError
        Scheduler or workers do not start.
    """
    tiles = Tiles(plate=Plate(size=(1.0, 1.0), hogels=(blocks, 1)), side=(1, 1))
    job = SleepingJob(blocks=tiles, seconds=block_s)
    with _scheduler() as (process, address), _sleepers(address, workers), foreign_cluster(address) as team:
        _wait_for(team, workers)
        return _measured(team, job, workers, psutil.Process(process.pid))


def _measured(team: Workers, job: SleepingJob, workers: int, scheduler: psutil.Process) -> SimulatedRun:
    client, blocks = psutil.Process(), job.blocks.hogels(0)
    before = _processor_s(scheduler), _processor_s(client)
    memory = _mib(scheduler), _mib(client)
    begun = time.perf_counter()
    for done, _ in enumerate(team.finished(job, iter(job.blocks.numbers(0)), sleep_block)):
        if done == blocks // 10:
            memory = _mib(scheduler), _mib(client)
    wall_s, ideal_s = time.perf_counter() - begun, blocks * job.seconds / workers
    used = _processor_s(scheduler) - before[0], _processor_s(client) - before[1]
    return SimulatedRun(
        workers=workers,
        blocks=blocks,
        block_s=job.seconds,
        wall_s=wall_s,
        ideal_s=ideal_s,
        overhead=wall_s / ideal_s - 1 if ideal_s else None,
        tasks_per_s=blocks / wall_s,
        scheduler_ms=1e3 * used[0] / blocks,
        client_ms=1e3 * used[1] / blocks,
        scheduler_mib=_mib(scheduler),
        scheduler_growth_mib=_mib(scheduler) - memory[0],
        client_growth_mib=_mib(client) - memory[1],
    )


def _wait_for(team: Workers, workers: int) -> None:
    end = time.monotonic() + START_S
    while len(team.client.nthreads()) < workers:
        if time.monotonic() > end:
            raise InputError(f"{workers} simulated workers did not start in {START_S:g} s; try fewer")
        time.sleep(POLL_S)


@contextmanager
def _scheduler() -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Run a scheduler on loopback until the end of a `with` block, and give its address."""
    with Aside(scratch_folder(), folder=True) as aside:
        told = aside.path / "scheduler.json"
        words = ["dask", "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
        with _process([*words, "--scheduler-file", str(told)]) as process:
            yield process, _address(told)


def _address(told: Path) -> str:
    """Return the address that a scheduler writes into a file when it has started."""
    end = time.monotonic() + START_S
    while time.monotonic() < end:
        try:
            return str(json.loads(told.read_text())["address"])
        except (OSError, ValueError):
            time.sleep(POLL_S)
    raise InputError(f"a Dask scheduler did not start in {START_S:g} s; try `dask scheduler`")


@contextmanager
def _sleepers(address: str, workers: int) -> Iterator[None]:
    """Run simulated workers until the end of a `with` block."""
    module = "xfrustum.reports.benchmarks.cluster.sleepers"
    left = min(workers, WORKERS_PER_PROCESS)
    with _process([module, address, str(left)]):
        if workers > left:
            with _sleepers(address, workers - left):
                yield
        else:
            yield


@contextmanager
def _process(words: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a Python module as a process of its own, which is killed in the end."""
    process = subprocess.Popen(
        [sys.executable, "-m", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _processor_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _mib(process: psutil.Process) -> float:
    return float(process.memory_info().rss / MIB)
