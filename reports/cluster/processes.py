"""Worker processes of this machine: started, started again when they die, and ended with the command.

Each is a new interpreter and no fork, for a process that was forked from one with an OpenGL context hangs.
Its environment says how many threads its libraries may use, and which device draws.
"""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from xfrustum.scenes.errors import InputError

THREAD_VARIABLES = ("XFRUSTUM_THREADS", "LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that bound the threads of a process: the reference's, those of Mesa's software
renderer, and those of linear algebra."""

DEVICE_VARIABLE = "GLCONTEXT_DEVICE_INDEX"
"""Environment variable that chooses the EGL device of a process; CUDA_VISIBLE_DEVICES does not."""

WORKER_MODULE = "xfrustum.reports.cluster.worker"
"""Program of a worker process."""

MAX_STARTS = 25
"""Number of processes that may be started for each worker until a block is finished: more that die are no
accident."""


def device_index() -> int:
    """Return the index of the EGL device that this process draws on."""
    chosen = os.environ.get(DEVICE_VARIABLE, "")
    return int(chosen) if chosen.isdecimal() else 0


def default_devices() -> tuple[int, ...]:
    """Return the EGL devices that processes draw on unless told otherwise: the GPUs of this machine.

    The one GPU that the environment names, if it does; none where software draws, which any number of
    processes can do.
    """
    # OpenGL is loaded where something is drawn, and nowhere else.
    from xfrustum.raster.device.devices import gpu_indices  # noqa: PLC0415

    gpus = gpu_indices()
    return gpus if DEVICE_VARIABLE not in os.environ else tuple(one for one in gpus if one == device_index())


@contextmanager
def first_device(devices: tuple[int, ...]) -> Iterator[None]:
    """Let this process draw on the first of some EGL devices, as a worker process would.

    Parameters
    ----------
    devices
        Indices of EGL devices; none for the device that the environment names. OpenGL contexts that exist
        already stay where they are.
    """
    before = os.environ.get(DEVICE_VARIABLE)
    if devices:
        os.environ[DEVICE_VARIABLE] = str(devices[0])
    try:
        yield
    finally:
        if before is not None:
            os.environ[DEVICE_VARIABLE] = before
        elif devices:
            os.environ.pop(DEVICE_VARIABLE, None)


class WorkerProcesses:
    """The worker processes of one scheduler.

    Parameters
    ----------
    address
        Address of the scheduler.
    count
        Number of processes.
    threads
        Number of threads that the libraries of each may use.
    devices
        Indices of EGL devices, which processes take in turn; the first device for all where there are none.
    """

    def __init__(self, address: str, count: int, threads: int, devices: tuple[int, ...] = ()) -> None:
        self._address, self._threads, self._devices = address, threads, devices
        self._running: list[subprocess.Popen[bytes] | None] = [None] * count
        self._serial = itertools.count()
        self._starts = 0

    def tend(self) -> None:
        """Start each process that has not been started, or has died.

        Raises
        ------
        InputError
            They die again and again.
        """
        for place, process in enumerate(self._running):
            if process is None or process.poll() is not None:
                self._start(place)

    def progressed(self) -> None:
        """Count starts anew: a block is finished, so that processes which died did so by accident."""
        self._starts = 0

    def kill(self) -> None:
        """End all processes at once, whatever they are doing: what is not finished leaves no trace."""
        for process in self._running:
            if process is not None:
                process.kill()
        for process in self._running:
            if process is not None:
                process.wait()

    def _start(self, place: int) -> None:
        if self._starts >= MAX_STARTS * len(self._running):
            raise InputError(
                f"{self._starts} worker processes have died one after the other, and no block was finished; "
                "try --workers 1, which tells why"
            )
        self._starts += 1
        serial = next(self._serial)
        environment = {**os.environ, **{variable: str(self._threads) for variable in THREAD_VARIABLES}}
        if self._devices:
            environment[DEVICE_VARIABLE] = str(self._devices[place % len(self._devices)])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        self._running[place] = subprocess.Popen(
            [sys.executable, "-m", WORKER_MODULE, self._address, f"{place}-{serial}"],
            stdin=subprocess.DEVNULL,
            # Standard output belongs to the command.
            stdout=subprocess.DEVNULL,
            env=environment,
        )
