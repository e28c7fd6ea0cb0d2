"""A worker process of this machine: the program that a command starts, once for each worker.

`python -m xfrustum.reports.cluster.worker ADDRESS NAME` works for a scheduler until that, or the command,
ends.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence

import dask
from distributed import Worker

PARENT_POLL_S = 0.5
"""Seconds between two looks at whether the command is still there."""

SETTINGS = {"distributed.worker.profile.enabled": False}
"""Settings of Dask: profiles of Python's stack are of no use here, and take time."""


def main(arguments: Sequence[str]) -> None:
    """Work for the scheduler that the arguments name."""
    address, name = arguments
    # A process inherits the signals that the command holds back while it is loaded. Ctrl-C goes to all
    # processes of a terminal; the command ends its workers itself.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    with dask.config.set(SETTINGS):
        asyncio.run(_work(address, name))


async def _work(address: str, name: str) -> None:
    # A worker holds one block at a time and no results; libraries in C take the memory that they need.
    async with Worker(address, nthreads=1, name=name, memory_limit=0, dashboard=False) as worker:
        await worker.finished()


def _end_with(parent: int) -> None:
    """End this process when its parent has, even in the middle of a block."""
    while os.getppid() == parent:
        time.sleep(PARENT_POLL_S)
    os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    main(sys.argv[1:])
