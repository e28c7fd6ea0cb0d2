"""Work in blocks: in this process, by processes of this machine, by a Dask cluster, or as part K of N.

The store is the only coordinator. A block is finished when its result is there under its name,
which it gets when it is whole: any process may die at any time, and the same command goes on with
what is missing.

Processes of this machine are joined to the command by socket pairs that they inherit. Nothing
listens, so that nobody else can reach them. They are new interpreters and no forks: a process that
was forked from one with an OpenGL context hangs. A Dask cluster is the user's own, with the doors
that the user gave it (docs/clusters.md).
"""

from __future__ import annotations

import copyreg
import itertools
import os
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from multiprocessing.connection import Connection, Pipe, wait
from types import MappingProxyType
from typing import Any, ClassVar, Protocol, TypeVar

from tqdm import tqdm

from xfrustum.reports.common.outputs import progress_bar
from xfrustum.scenes import InputError

Item = TypeVar("Item")
Answer = TypeVar("Answer")

ATTEMPTS = 2
"""Times that a block is given out: a worker that dies may have been killed by accident, two were not."""

THREAD_VARIABLES = ("XFRUSTUM_THREADS", "LP_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Environment variables that bound the threads of a process: the reference's, those of Mesa's software
renderer, and those of linear algebra."""

DEVICE_VARIABLE, CUDA_VARIABLE = "GLCONTEXT_DEVICE_INDEX", "CUDA_VISIBLE_DEVICES"
"""Environment variables that choose the devices of a process, EGL's by its index, and CUDA's."""

CONNECT_S = 10  #: seconds in which a scheduler must answer

SEEN_S, SEEN_POLL_S = 60.0, 0.2
"""Seconds until a block that a cluster has finished must be seen in the store, for NFS looks at a folder anew
after 60 s at the latest; and seconds between two looks."""


class Session(Protocol):
    """Everything that a process needs for the blocks of one job: the scene, and its renderers."""

    def make(self, block: Any) -> object:
        """Make a block; afterwards it is finished."""


class Job(ABC):
    """Work in blocks, as it travels to workers: whatever it holds is pickled, scenes and blocks included."""

    draws: ClassVar[bool] = (
        True  #: whether sessions draw with OpenGL: one process for each GPU, if any
    )
    unit: ClassVar[str] = (
        "hogel"  #: word for one of the things that a block consists of, for progress bars
    )

    @property
    @abstractmethod
    def name(self) -> str:
        """Word for the work, for progress bars and for Dask's dashboard."""

    @abstractmethod
    def finished(self, block: Any) -> bool:
        """Return whether a block is finished, by looking at the store alone."""

    @abstractmethod
    def size(self, block: Any) -> int:
        """Return the number of things that a block consists of."""

    @abstractmethod
    def words(self, block: Any) -> str:
        """Return a block in words, for messages."""

    @abstractmethod
    def open(self) -> AbstractContextManager[Session]:
        """Open a session, in the process and the thread that will use it."""


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
        """Whether it is the whole work."""
        return self.count == 1

    def of(self, blocks: Iterable[Item]) -> Iterator[Item]:
        """Yield every count-th block: neighbors take equally long, so parts do too."""
        return itertools.islice(blocks, self.number - 1, None, self.count)


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Where blocks are made: by processes of this machine, or by the workers of a Dask scheduler."""

    scheduler: str | None = None
    #: Number of processes, 1 for the command itself; None for one per device where something is
    #: drawn on GPUs or on `devices`, and else for as many as it may use processors
    workers: int | None = None
    devices: tuple[
        int, ...
    ] = ()  #: indices of EGL devices, taken in turn; empty for this machine's GPUs
    part: Part = field(
        default_factory=Part
    )  #: part of the blocks that the command itself makes here

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
        """Return how many processes of this machine make so many blocks on so many devices, if any.

        Several processes on one GPU take turns at best: each device has one unless more are asked
        for.
        """
        if not self.part.everything:
            return 1
        usual = min(_processors(), devices) if devices else _processors()
        return max(1, min(usual if self.workers is None else self.workers, blocks))


HERE = Engine(workers=1)  #: this process alone


class WorkerLostError(InputError):
    """The processes that had a block died, more than once."""

    def __init__(self, message: str, item: object = None) -> None:
        super().__init__(message)
        self.item = item


class Workers(ABC):
    """The processes that make blocks: this one, others of this machine, or those of a cluster."""

    count: int = 1
    elsewhere: ClassVar[bool] = False  #: whether their files may be seen here some time later

    @abstractmethod
    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        """Yield each item and what the function returns of it, given a session of the job, in any order.

        Whatever it raises is raised here; a WorkerLostError where workers died.
        """

    def ask(self, job: Job, function: Callable[..., Answer], *arguments: Any) -> Answer:
        """Return what a function returns that is given a session of the job, and the arguments."""
        ((_, answer),) = self.map(job, _answer, [(function, arguments)])
        return answer

    def run(self, job: Job, blocks: Iterable[Any], total: int, *, progress: bool = False) -> None:
        """Make all blocks that are not finished, with a bar for so many hogels or other units."""
        with progress_bar(total, job.name, job.unit, shown=progress) as bar:
            self.make(job, blocks, bar)

    def make(self, job: Job, blocks: Iterable[Any], bar: tqdm[Any]) -> None:
        """Make all blocks that are not finished, and tell a bar."""

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
                            f"--out: workers call {job.words(block)} finished, and it is not there; give a "
                            "folder on a file system that the command and all workers share"
                        )
                    time.sleep(SEEN_POLL_S)
                bar.update(job.size(block))
        except WorkerLostError as error:
            raise InputError(f"{job.words(error.item)}: {error}") from error


def _make(session: Session, block: Any) -> None:
    session.make(block)


def _answer(session: Session, question: tuple[Callable[..., Answer], tuple[Any, ...]]) -> Answer:
    function, arguments = question
    return function(session, *arguments)


@contextmanager
def open_workers(engine: Engine, blocks: int, *, draws: bool = True) -> Iterator[Workers]:
    """Open the workers that make so many blocks at first, with OpenGL or without, for a `with` block."""
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
        processes = _Processes(count, devices)
        try:
            yield processes
        finally:  # whatever they are doing
            processes.end()
        return
    before = os.environ.get(DEVICE_VARIABLE)
    if devices:  # as a worker process would
        os.environ[DEVICE_VARIABLE] = str(devices[0])
    try:
        with _OpenSession() as opened:
            yield _ThisProcess(opened)
    finally:
        os.environ.pop(DEVICE_VARIABLE, None)
        os.environ.update({} if before is None else {DEVICE_VARIABLE: before})


class _OpenSession(ExitStack):
    """The one session that a process has open, that of the last job; a context manager that closes it.

    OpenGL contexts belong to the thread that made them, and ray tracers keep what they have built.
    """

    _key: object = None
    _session: Any = None

    def of(self, key: object, job: Callable[[], Job]) -> Any:
        """Return the session of the job that is known by an object."""
        if self._key is not key:
            self._key = self._session = None
            self.close()
            self._session, self._key = self.enter_context(job().open()), key
        return self._session


class _ThisProcess(Workers):
    """The command itself, which makes one block after the other."""

    def __init__(self, opened: _OpenSession) -> None:
        self._opened = opened

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        for item in items:
            yield item, function(self._opened.of(job, lambda: job), item)


class _Processes(Workers):
    """Processes of this machine, begun as needed; a block whose process died is given out once more."""

    def __init__(self, count: int, devices: tuple[int, ...]) -> None:
        self.count = count
        threads = str(max(1, _processors() // count))
        usual = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, threads)}
        usual["PYTHONPATH"] = os.pathsep.join(map(os.path.abspath, sys.path))
        taken = itertools.islice(itertools.cycle(devices or (None,)), count)
        self._environments = [
            usual if device is None else {**usual, **_on_device(device)} for device in taken
        ]
        self._running: dict[int, tuple[subprocess.Popen[bytes], Connection[Any, Any]]] = {}
        self._job: Job | None = None

    def end(self, *places: int) -> None:
        """End some processes at once, or all: what is not finished leaves no trace."""
        for place in places or list(self._running):
            process, connection = self._running.pop(place)
            process.kill()
            process.wait()
            connection.close()

    def _give(self, place: int, job: bytes, request: object) -> Connection[Any, Any]:
        """Hand something over to a process, started if need be; return where the answer will come from."""
        for _ in range(ATTEMPTS + (place in self._running)):
            with suppress(BrokenPipeError, ConnectionResetError):  # it has died since
                if place not in self._running:
                    ours, theirs = Pipe()
                    with theirs:
                        serving = f"from {__name__} import serve; serve({theirs.fileno()})"
                        process = subprocess.Popen(
                            [sys.executable, "-P", "-c", serving],
                            stdin=subprocess.DEVNULL,
                            stdout=subprocess.DEVNULL,  # standard output belongs to the command
                            env=self._environments[place],
                            pass_fds=[theirs.fileno()],
                        )
                    self._running[place] = process, ours
                    ours.send_bytes(job)
                connection = self._running[place][1]
                connection.send(request)
                return connection
            self.end(place)
        raise InputError(f"{ATTEMPTS} worker processes died as they started; --workers 1 shows why")

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        if self._job is not job:
            self.end()
            self._job = job
        pickled = pickle.dumps(job)
        # Each item with the times that it has been given out.
        waiting, again = ((item, 1) for item in items), list[tuple[Item, int]]()
        idle, busy = list(range(self.count)), dict[Any, tuple[int, Item, int]]()
        try:
            while True:
                while idle and (following := again.pop() if again else next(waiting, None)):
                    place = idle.pop()
                    busy[self._give(place, pickled, (function, following[0]))] = (place, *following)
                if not busy:
                    return
                ready: Any
                for ready in wait(busy):
                    place, item, attempt = busy.pop(ready)
                    idle.append(place)
                    try:
                        well, answer = ready.recv()
                    except (EOFError, ConnectionResetError):
                        status = self._running[place][0].wait()
                        self.end(place)
                        if attempt == ATTEMPTS:
                            ended = (
                                f"by signal {-status}" if status < 0 else f"with status {status}"
                            )
                            raise WorkerLostError(
                                f"{ATTEMPTS} worker processes died of it, the last one {ended}; "
                                "--workers 1 shows why",
                                item,
                            ) from None
                        again.append((item, attempt + 1))
                        continue
                    if not well:
                        raise answer
                    yield item, answer
        finally:
            for place, _, _ in busy.values():
                self.end(place)


def serve(descriptor: int) -> None:
    """Do what the command asks for through a socket that this process has inherited, until the command ends.

    The program of a worker process. Ctrl-C goes to all processes of a terminal; the command ends
    its workers itself. A process inherits the signals that the command holds back while it is
    loaded.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    connection: Connection[Any, Any] = Connection(descriptor)
    asked: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def listen() -> None:
        """Take what is asked for, and end this process with the command, even in the middle of a block."""
        with suppress(EOFError, OSError):
            while True:
                asked.put(connection.recv_bytes())
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=listen, daemon=True).start()
    opened, job = _OpenSession(), asked.get()
    while True:
        request = asked.get()
        try:
            function, item = pickle.loads(request)
            answer = True, function(opened.of(job, lambda: pickle.loads(job)), item)
        except Exception as error:
            answer = False, _portable(error)
        connection.send(answer)


def _portable(error: Exception) -> Exception:
    """Return an error as it can be pickled, with its traceback unless it is the user's."""
    text = "".join(traceback.format_exception(error))
    if not isinstance(error, InputError):
        error.add_note(text)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(text)
    return error


def _connect(address: str) -> Any:
    """Return a client of a Dask scheduler that exists."""
    try:
        from distributed import Client  # noqa: PLC0415 - a second that no other work may pay for

        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except ImportError as error:
        raise InputError(
            "--scheduler needs Dask: pip install '.[cluster]' in the checkout of xfrustum"
        ) from error
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {address}: no scheduler answers there ({' '.join(str(error).split())[:200]}); "
            "start one with `dask scheduler`, and give its address, such as tls://host:8786"
        ) from error


class _Cluster(Workers):
    """The workers of a Dask scheduler, which retries and forgets."""

    elsewhere = True

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address

    @property
    def count(self) -> int:  # type: ignore[override]  # it changes
        """Number of threads that run tasks, one of each worker process."""
        return sum(self._client.nthreads().values()) or 1

    def map(
        self, job: Job, function: Callable[[Any, Item], Answer], items: Iterable[Item]
    ) -> Iterator[tuple[Item, Answer]]:
        from distributed import CancelledError, KilledWorker, as_completed  # noqa: PLC0415 - as above
        from distributed.comm.core import CommClosedError  # noqa: PLC0415 - as above

        listed = list(items)
        if not listed:
            return
        try:
            pickled = self._client.scatter([pickle.dumps(job)], hash=False)[0]
            futures = self._client.map(
                _do_in_cluster, listed, key=f"{job.name}-{os.getpid()}", pure=False, pickled=pickled,
                function=function, version=metadata.version("xfrustum"),
            )  # fmt: skip
            of_key = {future.key: item for future, item in zip(futures, listed, strict=True)}
            completed = as_completed(futures, loop=self._client.loop)
            del futures  # the scheduler forgets what nobody holds
            for future in completed:
                item = of_key.pop(future.key)
                try:
                    answer = future.result()
                except KilledWorker as error:
                    raise WorkerLostError(
                        "its workers died; look at their memory and logs", item
                    ) from error
                yield item, answer
        except (
            CancelledError,
            CommClosedError,
        ) as error:  # the latter while an answer is on its way
            raise InputError(
                f"--scheduler {self._address}: is gone; start it again and repeat the command, which goes "
                "on where it was"
            ) from error


@cache
def _renderer() -> tuple[ThreadPoolExecutor, _OpenSession]:
    """Return the one thread of a Dask worker that draws, and what it has open."""
    return ThreadPoolExecutor(1, thread_name_prefix="renderer"), _OpenSession()


def _do_in_cluster(
    item: Item, *, pickled: bytes, function: Callable[[Any, Item], Answer], version: str
) -> Answer:
    """Do what a task of a cluster stands for."""
    thread, opened = _renderer()
    try:
        here = metadata.version("xfrustum")
        if here != version:
            raise InputError(
                f"has xfrustum {here}, the command {version}: install one version everywhere"
            )
        done = thread.submit(
            lambda: function(opened.of(pickled, lambda: pickle.loads(pickled)), item)
        )
        return done.result()
    except InputError as error:
        raise InputError(f"{error} (worker on {socket.gethostname()})") from error


def _proxy(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


# Tables of a scene are proxies of dictionaries, which Python does not pickle by itself.
copyreg.pickle(MappingProxyType, lambda proxy: (_proxy, (dict(proxy),)))


def device_index() -> int:
    """Return the index of the EGL device that this process draws on."""
    chosen = os.environ.get(DEVICE_VARIABLE, "")
    return int(chosen) if chosen.isdecimal() else 0


def _on_device(device: int) -> dict[str, str]:
    """Return the environment of a process that draws, and has the truth computed, on one of EGL's devices."""
    from xfrustum.raster.device.context import cuda_index  # noqa: PLC0415

    number = None if CUDA_VARIABLE in os.environ else cuda_index(device)
    return {
        DEVICE_VARIABLE: str(device),
        **({} if number is None else {CUDA_VARIABLE: str(number)}),
    }


def _gpus() -> tuple[int, ...]:
    """Return the GPUs of this machine, or the one of them that the environment names."""
    # OpenGL is loaded where something is drawn, and nowhere else.
    from xfrustum.raster.device.context import gpu_indices  # noqa: PLC0415

    gpus = gpu_indices()
    return (
        gpus
        if DEVICE_VARIABLE not in os.environ
        else tuple(one for one in gpus if one == device_index())
    )


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
