"""Clusters of Dask workers: one of this machine, started and stopped here, or one that exists.

Nothing is gathered: a task returns nothing, and the client looks for the block in the store. Few tasks more
than there are workers are submitted at a time, so that neither the client nor the scheduler holds more the
larger a plate is. Where a scheduler dies its tasks are lost and nothing else: those of unfinished blocks are
submitted again to the next one at its address.
"""

from __future__ import annotations

import itertools
import logging
import queue
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster
from distributed.client import ClosedClientError

from xfrustum.reports.cluster.job import Job, ask_session, do_block
from xfrustum.reports.cluster.processes import WorkerProcesses
from xfrustum.scenes.errors import InputError
from xfrustum.terminal import say

Answer = TypeVar("Answer")

Submitted = tuple[int, Future[Any]]
"""Number of a block, and its task."""

TASKS_PER_THREAD = 2
"""Tasks under way for each thread of the workers: one that runs, and one that waits at the worker."""

MIN_TASKS = 4
"""Tasks under way where there are few workers, or none yet."""

POLL_S = 0.25
"""Longest time in seconds until the client looks after a signal, or after the connection."""

ASK_POLL_S = 0.02
"""Seconds between two looks at whether a question is answered."""

COUNT_S = 5.0
"""Seconds after which workers are counted again: they may come and go."""

CONNECT_S = 10
"""Seconds in which a scheduler must answer."""

RECONNECT_S = 600.0
"""Seconds that a scheduler may take to come back, such as a job that is queued again."""

RECONNECT_POLL_S = 1.0
"""Seconds between two attempts to connect to a scheduler that is gone."""

MAX_ATTEMPTS = 20
"""Times that a block is given out again after the workers that had it died: more are no accident."""

CLOSE_S = 10.0
"""Seconds that a scheduler has to end."""


@contextmanager
def machine_cluster(workers: int, threads: int, devices: tuple[int, ...] = ()) -> Iterator[Workers]:
    """Start a scheduler and worker processes on this machine, and stop them in the end.

    Parameters
    ----------
    workers
        Number of processes.
    threads
        Number of threads that the libraries of each may use.
    devices
        Indices of EGL devices, which workers take in turn; the first device for all where there are none.
    """
    with dask.config.set({"distributed.scheduler.allowed-failures": MAX_ATTEMPTS}):
        # Dask's own worker processes are not started again where they die while they start.
        cluster = LocalCluster(
            n_workers=0, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL, processes=True
        )
        processes = WorkerProcesses(cluster.scheduler_address, workers, threads, devices)
        try:
            processes.tend()
            with _connected(cluster) as client:
                yield Workers(
                    client=client,
                    address=None,
                    count=workers,
                    dashboard=cluster.dashboard_link,
                    tend=processes.tend,
                    progressed=processes.progressed,
                )
        finally:
            processes.kill()
            cluster.close(timeout=CLOSE_S)


@contextmanager
def foreign_cluster(address: str) -> Iterator[Workers]:
    """Connect to a scheduler that exists; its workers are left as they are.

    Raises
    ------
    InputError
        No scheduler answers there.
    """
    client = _client(address)
    workers = Workers(client=client, address=address, count=None, dashboard=client.dashboard_link)
    try:
        yield workers
    finally:
        workers.client.close(timeout=CONNECT_S)


@contextmanager
def _connected(cluster: LocalCluster) -> Iterator[Client]:
    client = Client(cluster, timeout=CONNECT_S, set_as_default=False)
    try:
        yield client
    finally:
        client.close(timeout=CONNECT_S)


def _client(address: str) -> Client:
    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"--scheduler {address}: no scheduler answers there ({reason}); start one with `dask scheduler`, "
            "and give its address, such as tcp://host:8786"
        ) from error


def _client_in_time(address: str) -> Client:
    """Connect to a scheduler that is gone, as soon as there is one at its address again."""
    end = time.monotonic() + RECONNECT_S
    while time.monotonic() < end:
        with suppress(InputError):
            return _client(address)
        time.sleep(RECONNECT_POLL_S)
    raise InputError(
        f"--scheduler {address}: is gone and has not come back; start it again and repeat the command, "
        "which goes on where it was"
    )


@dataclass(kw_only=True)
class Workers:
    """The workers of a cluster, as a client sees them.

    Attributes
    ----------
    client
        Connection to their scheduler.
    address
        Address of the scheduler; None of one that this process has started.
    count
        Number of workers that were asked for; None where nobody knows beforehand.
    dashboard
        Address of the page on which to watch them.
    tend
        Called now and then; starts workers again that have died.
    progressed
        Called where a block is finished.
    """

    client: Client
    address: str | None
    count: int | None
    dashboard: str
    tend: Callable[[], object] = lambda: None
    progressed: Callable[[], object] = lambda: None
    _threads: int = 0
    _counted_at: float = field(default=float("-inf"))

    @property
    def workers(self) -> int:
        """Number of worker processes."""
        return self.count or self._threads or 1

    def finished(
        self, job: Job, numbers: Iterator[int], work: Callable[[Any, int], Any] = do_block
    ) -> Iterator[int]:
        """Have blocks done, and yield the number of each whose task has come to an end, in any order.

        A block whose task has ended may be in the hands of somebody else: the store tells.

        Parameters
        ----------
        job
            Job that the blocks belong to.
        numbers
            Numbers of the blocks; they are asked for as they are submitted.
        work
            Function that a worker calls with the job and a number.
        """
        run = secrets.token_hex(4)
        again: deque[int] = deque()
        attempts: dict[int, int] = {}
        under_way: dict[str, Submitted] = {}
        ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        serial = itertools.count()
        try:
            while True:
                while len(under_way) < self._window():
                    number = again.popleft() if again else next(numbers, None)
                    if number is None:
                        break
                    key = f"{job.name}-{run}-{number}-{next(serial)}"
                    try:
                        future = self.client.submit(work, job, number, key=key, pure=False)
                    except ClosedClientError:
                        again.append(number)
                        break
                    under_way[key] = (number, future)
                    future.add_done_callback(lambda one: ended.put(one.key))
                if not under_way and not again:
                    return
                try:
                    found = under_way.pop(ended.get(timeout=POLL_S), None)
                except queue.Empty:
                    self._look_after_connection(under_way, again)
                    continue
                # Tasks that were lost with their scheduler end too, after their blocks were taken back.
                if found is None:
                    continue
                number, future = found
                if _succeeded(future):
                    attempts.pop(number, None)
                    yield number
                else:
                    attempts[number] = attempts.get(number, 0) + 1
                    if attempts[number] > MAX_ATTEMPTS:
                        _give_up(job, number)
                    again.append(number)
        finally:
            if under_way and self.client.status == "running":
                with suppress(Exception):  # the scheduler may be gone, and then nothing is to be cancelled
                    self.client.cancel([future for _, future in under_way.values()], force=True)

    def ask(self, job: Job, question: Callable[..., Answer], *arguments: Any) -> Answer:
        """Return what a worker answers to a question about a job; see `ask_session`."""
        for _ in range(MAX_ATTEMPTS):
            client = self.client
            try:
                future = client.submit(ask_session, job, question, *arguments, pure=False)
                while future.status == "pending" and self.client is client:
                    time.sleep(ASK_POLL_S)
                    self._look_after_connection({}, deque())
                if self.client is client:
                    answer: Answer = future.result()
                    return answer
            except (ClosedClientError, KilledWorker, CancelledError):
                self._look_after_connection({}, deque())
        raise InputError(
            f"{self._where}: {MAX_ATTEMPTS} workers died one after the other; look at their logs"
        )

    @property
    def _where(self) -> str:
        """The workers in words, for messages."""
        return "the workers of this machine" if self.address is None else f"--scheduler {self.address}"

    def _window(self) -> int:
        """Return how many tasks are under way at a time."""
        if time.monotonic() - self._counted_at > COUNT_S and self.client.status == "running":
            with suppress(OSError, TimeoutError, CancelledError, ClosedClientError):
                self._threads = sum(self.client.nthreads().values())
            self._counted_at = time.monotonic()
        return max(MIN_TASKS, TASKS_PER_THREAD * max(self._threads, self.count or 0))

    def _look_after_connection(
        self, under_way: dict[str, tuple[int, Future[Any]]], again: deque[int]
    ) -> None:
        """Connect anew where the client has given up; its tasks are lost, and their blocks come again.

        The client itself tries for `CONNECT_S` to connect again before it gives up.

        Raises
        ------
        InputError
            The scheduler has not come back in `RECONNECT_S`.
        """
        self.tend()
        if self.client.status not in ("closed", "closing"):
            return
        again.extend(number for number, _ in under_way.values())
        under_way.clear()
        if self.address is None:
            raise InputError(
                f"{self._where}: their scheduler is gone; repeat the command, which goes on where it was"
            )
        say(f"note: the scheduler {self.address} is gone; waiting for it")
        self.client = _client_in_time(self.address)


def _succeeded(future: Future[Any]) -> bool:
    """Return whether a task ended well; False where it was lost with its worker or its scheduler.

    Raises whatever the task raised.
    """
    status = future.status
    if status == "finished":
        future.release()
        return True
    if status == "error":
        error = future.exception()
        future.release()
        if not isinstance(error, KilledWorker):
            assert error is not None
            raise error
    return False


def _give_up(job: Job, number: int) -> None:
    raise InputError(
        f"{job.words(number)}: its workers died {MAX_ATTEMPTS} times; look at their memory and logs"
    )
