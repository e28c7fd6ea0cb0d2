"""Work in blocks: in this process, in worker processes, on a Dask cluster, or as a job array.

The store is the only coordinator. Results are written under temporary names, and renamed when they
are complete: a block is finished if its result has the final name. Any process may die at any time;
the same command then continues with the missing blocks.

Processes of this machine are spawned, never forked: a fork of a process with an OpenGL context
hangs. These processes communicate by pipes, so that no port is open. The user starts a Dask
cluster, and chooses its ports (docs/clusters.md).
"""

from __future__ import annotations

import itertools
import os
import pickle
import signal
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, ClassVar, Protocol, TypeVar

from tqdm import tqdm

from xfrustum.process import delayed
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.parts import ParquetParts
from xfrustum.scenes import Aperture, InputError

Item = TypeVar("Item")
Answer = TypeVar("Answer")

THREAD_VARIABLES = ("XFRUSTUM_THREADS", "LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that bound the threads of the reference, of Mesa's software renderer, and
of linear algebra."""

DEVICE_VARIABLE, CUDA_VARIABLE = "GLCONTEXT_DEVICE_INDEX", "CUDA_VISIBLE_DEVICES"
"""Environment variables with the devices of a process: the index of the EGL device, and the CUDA
devices."""

#: time limit for the response of a scheduler, seconds
CONNECT_S = 10

#: Time limit and polling interval, seconds, for a finished block of a cluster to appear in the
#: store. NFS caches the entries of a folder for at most 60 s.
SEEN_S, SEEN_POLL_S = 60.0, 0.2


class Session(Protocol):
    """Open resources of one process for the blocks of one job: the scene and its renderers."""

    def make(self, block: Any) -> object:
        """Make a block and store it."""


class Job(ABC):
    """A job, divided into blocks; job, scene and blocks are pickled for workers."""

    #: whether sessions use OpenGL; by default each GPU then has one process
    draws: ClassVar[bool] = True
    #: name of the parts of a block in progress bars
    unit: ClassVar[str] = "hogel"

    @property
    @abstractmethod
    def name(self) -> str:
        """Noun for the work in progress bars and on Dask's dashboard."""

    @abstractmethod
    def finished(self, block: Any) -> bool:
        """Return whether the store has a block."""

    @abstractmethod
    def size(self, block: Any) -> int:
        """Return the number of parts of a block, such as hogels."""

    @abstractmethod
    def words(self, block: Any) -> str:
        """Return the name of a block in messages."""

    @abstractmethod
    def open(self) -> AbstractContextManager[Session]:
        """Open a session in the process and the thread that will use it."""


@dataclass(frozen=True, kw_only=True)
class HogelBlock:
    """Some hogels of a plate, judged together."""

    #: number of the block's Parquet part
    number: int
    apertures: Sequence[Aperture]


def blocks_of(apertures: Sequence[Aperture], size: int, first: int) -> list[HogelBlock]:
    """Divide apertures into blocks, numbered from `first`; the last block may be smaller."""
    begins = range(0, len(apertures), size)
    return [
        HogelBlock(number=number, apertures=apertures[begin : begin + size])
        for number, begin in enumerate(begins, first)
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class HogelJob(Job):
    """Job on hogels; each block writes a Parquet part of rows."""

    parts: ParquetParts

    def finished(self, block: HogelBlock) -> bool:
        """Return whether a block has its part."""
        return self.parts.finished(block.number)

    def size(self, block: HogelBlock) -> int:
        """Return the number of hogels of a block."""
        return len(block.apertures)

    def words(self, block: HogelBlock) -> str:
        """Return the number of a block and its first aperture."""
        column, row = block.apertures[0].index
        return f"block {block.number} (from aperture {column},{row})"


@dataclass(frozen=True, kw_only=True)
class Part:
    """One of several equal parts of the work, numbered from 1, for job arrays."""

    number: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise InputError(f"part {self.number}/{self.count}: parts run from 1/{self.count}")

    @property
    def everything(self) -> bool:
        """True if the part is the whole work."""
        return self.count == 1

    def of(self, blocks: Iterable[Item]) -> Iterator[Item]:
        """Yield every count-th block, so that parts take about the same time."""
        return itertools.islice(blocks, self.number - 1, None, self.count)


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Processes that do the work: on this machine, or the workers of a Dask scheduler."""

    #: address of a Dask scheduler
    scheduler: str | None = None
    #: Number of processes; 1 uses the command's own process. None: one per device if sessions draw
    #: on GPUs or on `devices`, else one per available processor.
    workers: int | None = None
    #: EGL device indices, used in turn; empty for all GPUs
    devices: tuple[int, ...] = ()
    #: share of the blocks for this command
    part: Part = field(default_factory=Part)

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers must be at least 1, not {self.workers}")
        if self.scheduler is not None and self.workers is not None:
            raise InputError("--scheduler has workers of its own: leave out --workers")
        if self.scheduler is not None and self.devices:
            raise InputError(
                "--devices are for processes of this machine: leave them out, and start each "
                f"worker of --scheduler with {DEVICE_VARIABLE}"
            )
        if not self.part.everything and (self.scheduler or (self.workers or 1) > 1):
            raise InputError("--part is done by one process: leave out --scheduler and --workers")

    def process_count(self, blocks: int, devices: int = 0) -> int:
        """Return the number of processes of this machine for some blocks and GPUs.

        Two processes on one GPU are not faster than one, so that each GPU has one by default.
        """
        if not self.part.everything:
            return 1
        usual = min(_processors(), devices) if devices else _processors()
        return max(1, min(usual if self.workers is None else self.workers, blocks))


#: this process alone
HERE = Engine(workers=1)


class WorkerLostError(InputError):
    """Error: processes that worked on the same block died repeatedly."""

    def __init__(self, message: str, item: object = None) -> None:
        super().__init__(message)
        self.item = item


class Workers(ABC):
    """Processes that compute blocks: this process, worker processes, or workers of a cluster."""

    count: int = 1
    #: whether files of the workers may appear here with a delay
    elsewhere: ClassVar[bool] = False

    @abstractmethod
    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield each item with function(session, item), in any order.

        Raises the exceptions of the function, and WorkerLostError if workers died.
        """

    def ask(self, job: Job, function: Callable[..., Answer], *arguments: Any) -> Answer:
        """Return function(session, *arguments), called in one worker."""
        ((_, answer),) = self.map(job, _answer, [(function, arguments)])
        return answer

    def run(self, job: Job, blocks: Iterable[Any], total: int, *, progress: bool = False) -> None:
        """Make the unfinished blocks, with a progress bar of `total` units."""
        with progress_bar(total, job.name, job.unit, shown=progress) as bar:
            self.make(job, blocks, bar)

    def make(self, job: Job, blocks: Iterable[Any], bar: tqdm[Any]) -> None:
        """Make the unfinished blocks and update a progress bar."""

        def unfinished() -> Iterator[Any]:
            for block in blocks:
                if job.finished(block):
                    bar.update(job.size(block))
                else:
                    yield block

        try:
            for block, _ in self.map(job, _make, unfinished()):
                end = time.monotonic() + SEEN_S
                while self.elsewhere and not job.finished(block):
                    if time.monotonic() > end:
                        raise InputError(
                            f"--out: workers report {job.words(block)} as finished, and it is not "
                            "there; give a folder on a file system that the command and all "
                            "workers share"
                        )
                    time.sleep(SEEN_POLL_S)
                bar.update(job.size(block))
        except WorkerLostError as error:
            raise InputError(f"{job.words(error.item)}: {error}") from error


def _make(session: Session, block: Any) -> None:
    session.make(block)


def _answer(session: Session, call: tuple[Callable[..., Answer], tuple[Any, ...]]) -> Answer:
    function, arguments = call
    return function(session, *arguments)


@contextmanager
def open_workers(engine: Engine, blocks: int, *, draws: bool = True) -> Iterator[Workers]:
    """Open workers for a number of blocks, with or without OpenGL; close them on exit."""
    if engine.scheduler is not None:
        client = _connect(engine.scheduler)
        try:
            yield _Cluster(client, engine.scheduler)
        finally:
            client.close(timeout=CONNECT_S)
        return
    devices = engine.devices or (_gpus() if draws else ())
    count = engine.process_count(blocks, len(devices) if draws else 0)
    if count > 1:
        pool = _Pool(count, devices)
        try:
            yield pool
        finally:
            pool.end()
        return
    before = os.environ.get(DEVICE_VARIABLE)
    # OpenGL reads the device from the environment, in this process and in workers.
    if devices:
        os.environ[DEVICE_VARIABLE] = str(devices[0])
    try:
        with _OpenSession() as opened:
            yield _ThisProcess(opened)
    finally:
        os.environ.pop(DEVICE_VARIABLE, None)
        os.environ.update({} if before is None else {DEVICE_VARIABLE: before})


class _OpenSession(ExitStack):
    """Session of a process's latest job; leaving this context closes the session.

    A process has one session at a time, because OpenGL contexts belong to a thread and tracers keep
    their acceleration structures.
    """

    _key: object = None
    _session: Any = None

    def get(self, key: object, job: Callable[[], Job]) -> Any:
        """Return the session of the job named by `key`; a new key closes the previous session."""
        if self._key is not key:
            self._key = self._session = None
            self.close()
            self._session, self._key = self.enter_context(job().open()), key
        return self._session


class _ThisProcess(Workers):
    """The command itself, one block after the other."""

    def __init__(self, opened: _OpenSession) -> None:
        self._opened = opened

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        for item in items:
            yield item, function(self._opened.get(job, lambda: job), item)


class _Process(SpawnProcess):
    """Spawned process that does not run the main module of the command once more.

    A user's script then needs no `if __name__ == "__main__"` around a survey.
    """

    def start(self) -> None:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            super().start()
        finally:
            sys.modules["__main__"] = main


class _Spawning(SpawnContext):
    Process = _Process


class _Pool(Workers):
    """Worker processes on this machine; blocks of dead workers are repeated."""

    def __init__(self, count: int, devices: tuple[int, ...]) -> None:
        self.count = count
        threads = dict.fromkeys(THREAD_VARIABLES, str(max(1, _processors() // count)))
        self._environments = [
            {**threads, **({} if device is None else _on_device(device))}
            for device in itertools.islice(itertools.cycle(devices or (None,)), count)
        ]
        self._job: Job | None = None
        self._open: ExitStack | None = None
        self._executor: ProcessPoolExecutor | None = None

    def end(self) -> None:
        """End all processes at once; unfinished blocks leave no files."""
        if self._open is not None:
            self._open.close()
        self._open = self._executor = None

    def _start(self, job: Job) -> ProcessPoolExecutor:
        context, self._open, self._job = _Spawning(), ExitStack(), job
        environments = context.SimpleQueue()
        for environment in self._environments:
            environments.put(environment)
        theirs, ours = context.Pipe(duplex=False)
        starting = (theirs, environments, pickle.dumps(job))
        self._executor = ProcessPoolExecutor(self.count, context, _begin, starting)
        # Release in reverse order: processes end when the pipe closes, then the executor joins
        # them.
        self._open.callback(self._executor.shutdown, cancel_futures=True)
        self._open.callback(environments.close)
        self._open.callback(theirs.close)
        self._open.callback(ours.close)
        return self._executor

    def _submit(
        self, job: Job, function: Callable[[Any, Item], Answer], item: Item
    ) -> Future[Answer]:
        if self._job is not job:
            self.end()
        # The first submission starts the processes. An interrupt during that start would leave a
        # process that is never joined, and that loses its semaphores when this process ends.
        with delayed():
            try:
                return (self._executor or self._start(job)).submit(_in_process, function, item)
            except BrokenProcessPool:  # an idle process was killed
                self.end()
                return self._start(job).submit(_in_process, function, item)

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        # Each item is stored with the number of workers that died while they worked on it.
        waiting, again = iter(items), deque[tuple[Item, int]]()
        running: dict[Future[Answer], tuple[Item, int]] = {}
        try:
            while True:
                # The death of a process breaks the whole pool, and all running blocks are repeated:
                # once together, and after a second death one at a time, which reveals the cause.
                alone = bool(again) and again[0][1] > 1
                free = max(0, (1 if alone else self.count) - len(running))
                repeated = [again.popleft() for _ in range(min(free, len(again)))]
                fresh = ((item, 0) for item in itertools.islice(waiting, free - len(repeated)))
                for item, deaths in itertools.chain(repeated, fresh):
                    running[self._submit(job, function, item)] = item, deaths
                if not running:
                    return
                try:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        answer = future.result()
                        yield running.pop(future)[0], answer
                except BrokenProcessPool as error:
                    (item, deaths), *others = running.values()
                    if deaths > 1 and not others:
                        raise WorkerLostError(
                            f"{deaths + 1} worker processes died of it; --workers 1 shows why", item
                        ) from error
                    again.extend((item, deaths + 1) for item, deaths in running.values())
                    running.clear()
                    self.end()
        finally:
            if running:
                self.end()


#: session of a worker process
_session = _OpenSession()
#: job of a worker process of this machine
_pickled_job = b""


def _begin(stopped: Connection[Any, Any], environments: Any, job: bytes) -> None:
    """Prepare a worker process: its signals, its environment, and its end with the command."""
    global _pickled_job  # noqa: PLW0603 - a process has one job
    # Ctrl-C goes to all processes of a terminal; the command ends its workers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    # Only the command itself may write to standard output.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.environ.update(environments.get())
    _pickled_job = job

    def end() -> None:
        # The pipe is closed at the end of the work, and by the system if the command was killed.
        stopped.poll(None)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=end, daemon=True).start()


def _in_process(function: Callable[[Any, Item], Answer], item: Item) -> Answer:
    return function(_session.get(_pickled_job, lambda: pickle.loads(_pickled_job)), item)


def _connect(address: str) -> Any:
    """Return a client of a running Dask scheduler."""
    try:
        from distributed import Client  # noqa: PLC0415 - takes a second to load

        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except ImportError as error:
        raise InputError(
            "--scheduler needs Dask: pip install '.[cluster]' in the checkout of xfrustum"
        ) from error
    except (OSError, ValueError, TimeoutError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"--scheduler {address}: no scheduler answers there ({reason}); start one with "
            "`dask scheduler`, and give its address, such as tls://host:8786"
        ) from error


class _Cluster(Workers):
    """Workers of a Dask scheduler, which repeats lost tasks itself."""

    elsewhere = True

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address

    @property
    def count(self) -> int:  # type: ignore[override]  # it changes
        """Number of threads that run tasks; each worker process has one thread."""
        return sum(self._client.nthreads().values()) or 1

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        from distributed import CancelledError, KilledWorker, as_completed  # noqa: PLC0415 - slow
        from distributed.comm.core import CommClosedError  # noqa: PLC0415 - as above

        listed = list(items)
        if not listed:
            return
        try:
            pickled = self._client.scatter([pickle.dumps(job)], hash=False)[0]
            futures = self._client.map(
                _in_cluster, listed, key=f"{job.name}-{os.getpid()}", pure=False, pickled=pickled,
                function=function, version=metadata.version("xfrustum"),
            )  # fmt: skip
            items_by_key = {future.key: item for future, item in zip(futures, listed, strict=True)}
            completed = as_completed(futures, loop=self._client.loop)
            # The scheduler keeps the results of referenced futures.
            del futures
            for future in completed:
                item = items_by_key.pop(future.key)
                try:
                    answer = future.result()
                except KilledWorker as error:
                    raise WorkerLostError(
                        "its workers died; look at their memory and logs", item
                    ) from error
                yield item, answer
        except (CancelledError, CommClosedError) as error:  # CommClosedError during a transfer
            raise InputError(
                f"--scheduler {self._address}: is gone; start it again and repeat the command, "
                "which goes on where it was"
            ) from error


@cache
def _drawing_thread() -> ThreadPoolExecutor:
    """Return the thread that owns a Dask worker's session; tasks arrive in other threads."""
    return ThreadPoolExecutor(1, thread_name_prefix="renderer")


def _in_cluster(
    item: Item, *, pickled: bytes, function: Callable[[Any, Item], Answer], version: str
) -> Answer:
    """Run one task on a worker of a cluster."""

    def run() -> Answer:
        return function(_session.get(pickled, lambda: pickle.loads(pickled)), item)

    try:
        here = metadata.version("xfrustum")
        if here != version:
            raise InputError(
                f"has xfrustum {here}, the command {version}: install one version everywhere"
            )
        return _drawing_thread().submit(run).result()
    except InputError as error:
        raise InputError(f"{error} (worker on {socket.gethostname()})") from error


def device_index() -> int:
    """Return the index of the EGL device on which this process draws."""
    chosen = os.environ.get(DEVICE_VARIABLE, "")
    return int(chosen) if chosen.isdecimal() else 0


def _on_device(device: int) -> dict[str, str]:
    """Return the environment of a process that draws and traces on one EGL device."""
    from xfrustum.raster.device.context import cuda_index  # noqa: PLC0415 - loads OpenGL

    number = None if CUDA_VARIABLE in os.environ else cuda_index(device)
    return {
        DEVICE_VARIABLE: str(device),
        **({} if number is None else {CUDA_VARIABLE: str(number)}),
    }


def _gpus() -> tuple[int, ...]:
    """Return the EGL indices of this machine's GPUs, or the GPU that the environment names."""
    from xfrustum.raster.device.context import gpu_indices  # noqa: PLC0415 - loads OpenGL

    gpus = gpu_indices()
    if DEVICE_VARIABLE not in os.environ:
        return gpus
    return tuple(gpu for gpu in gpus if gpu == device_index())


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
