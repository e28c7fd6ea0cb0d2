"""Simulated workers of a Dask cluster, many in one process: a program of its own.

`python -m xfrustum.reports.benchmarks.cluster.sleepers ADDRESS COUNT` runs that many workers until it is
killed. They are workers to the scheduler in everything but their work: a task sleeps, and takes no processor.
"""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Sequence

import dask
from distributed import Worker

QUIET_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
    "distributed.worker.memory.monitor-interval": "1h",
    "distributed.admin.system-monitor.interval": "10s",
}
"""What a worker of its own machine does beside its tasks, and many in one process would each do again."""


async def run_sleepers(address: str, count: int) -> None:
    """Run simulated workers until the process ends."""
    workers = [
        Worker(address, nthreads=1, memory_limit=0, dashboard=False, name=f"sleeper-{number}-{id(object)}")
        for number in range(count)
    ]
    await asyncio.gather(*workers)
    await asyncio.gather(*(worker.finished() for worker in workers))


def main(arguments: Sequence[str]) -> None:
    """Run as many workers as the arguments say."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    address, count = arguments
    with dask.config.set(QUIET_SETTINGS):
        asyncio.run(run_sleepers(address, int(count)))


if __name__ == "__main__":
    main(sys.argv[1:])
