"""What a worker does with a block: the session of its process, and blocks that somebody else makes.

OpenGL contexts belong to the thread that made them, and ray tracers keep what they have built. So a process
has one desk with one session at a time, and one thread that opens and uses it, however many threads the
worker has that run tasks.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import ClassVar, Self, TypeVar

from xfrustum.reports.cluster.blocks import Blocks
from xfrustum.reports.cluster.claims import Claims
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

Answer = TypeVar("Answer")


class Session(ABC):
    """Everything that a process needs for the blocks of one job: the scene, and its renderers."""

    @abstractmethod
    def make(self, number: int) -> None:
        """Make a block; afterwards it is finished."""


class Job(ABC):
    """Work in blocks, as it travels to workers: small, hashable, and equal where the work is the same.

    Attributes
    ----------
    draws
        Whether its sessions draw with OpenGL: then there is one process for each GPU, where there are any.
    unit
        Word for one of the things that a block consists of, for bars.
    """

    draws: ClassVar[bool] = True
    unit: ClassVar[str] = "hogel"

    @property
    @abstractmethod
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""

    @abstractmethod
    def finished(self, number: int) -> bool:
        """Return whether a block is finished, by looking at the store alone."""

    @abstractmethod
    def claims(self) -> Claims:
        """Return what tells the workers of all clients who does which block."""

    @abstractmethod
    def size(self, number: int) -> int:
        """Return the number of things that a block consists of."""

    @abstractmethod
    def words(self, number: int) -> str:
        """Return a block in words, for messages."""

    @abstractmethod
    def open(self, scene: Scene | None = None) -> AbstractContextManager[Session]:
        """Open a session.

        Parameters
        ----------
        scene
            The scene, where the process has it; None to open it by its path.

        Raises
        ------
        InputError
            The scene is not to be had, or is another one.
        """


class HogelJob(Job):
    """Work in blocks of hogels.

    Attributes
    ----------
    blocks
        The blocks.
    """

    blocks: Blocks

    def size(self, number: int) -> int:
        """Return the number of hogels of a block."""
        return len(self.blocks.apertures(number))

    def words(self, number: int) -> str:
        """Return the number of a block, and its first aperture."""
        column, row = self.blocks.apertures(number)[0].index
        return f"block {number} (from aperture {column},{row})"


class Desk:
    """The one session that a process has open; a context manager that closes it.

    Parameters
    ----------
    scene
        Scene of the jobs that come here, where the process has it.
    """

    def __init__(self, scene: Scene | None = None) -> None:
        self._scene = scene
        self._job: Job | None = None
        self._session: Session | None = None
        self._stack = ExitStack()

    def do(self, job: Job, number: int) -> None:
        """Make a block unless it is finished, or somebody else is making it.

        Raises
        ------
        InputError
            The scene is not to be had, or the store is not there or cannot be written.
        """
        if job.finished(number):
            return
        session = self.session(job)
        with _claims(job) as claims:
            # Somebody else that claimed it before may have finished it since.
            if claims.take(number) and not job.finished(number):
                session.make(number)

    def session(self, job: Job) -> Session:
        """Return the session of a job; that of another job is closed."""
        if self._session is None or self._job != job:
            self.close()
            self._session = self._stack.enter_context(job.open(self._scene))
            self._job = job
        return self._session

    def close(self) -> None:
        """Close the session."""
        self._job = self._session = None
        self._stack.close()

    def __del__(self) -> None:
        # A worker ends when its cluster does, and its thread takes the desk with it.
        self.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _claims(job: Job) -> Claims:
    """Return the claims of a job, whose store the command has made before it asks for blocks."""
    try:
        return job.claims()
    except FileNotFoundError as error:
        raise InputError(
            f"--out: there is no {error.filename}; give a folder on a file system that the command and all "
            "workers share"
        ) from error


class _Desks(threading.local):
    """The desk of each thread, which is closed in this thread when the thread ends."""

    def __init__(self) -> None:
        self.desk = Desk()


_desks = _Desks()


def desk_of_thread() -> Desk:
    """Return the desk of this thread."""
    return _desks.desk
