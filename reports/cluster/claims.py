"""Claims: which process does which piece of work, where several work on one store at once."""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from pathlib import Path
from types import TracebackType
from typing import Self

_FLOCK = "hhqqi4x"
"""struct flock of Linux with 64 bits: type, whence, start, length, process."""

_NO_LOCKS = (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""What a system says that cannot lock; EBADF of a file that is open for reading only."""


class Claims:
    """Locks on single bytes of one file, byte n for piece n; the system drops those of a dead process.

    A piece is a hogel, or a block of hogels. A context manager: leaving it lets go of all. Locks belong to
    this object and not to the process, so that nothing else that opens and closes the file disturbs them.
    Where a file system or a file that may not be written knows no locks, every claim is granted: pieces may
    be made twice, and are the same.

    Parameters
    ----------
    path
        A file that all who work on the store have in common, and that is never replaced.
    first
        Byte of piece 0: several kinds of pieces of one store have bytes of their own.

    Raises
    ------
    OSError
        The file cannot be opened.
    """

    def __init__(self, path: Path, first: int = 0) -> None:
        self._first = first
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
                raise
            self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def take(self, number: int) -> bool:
        """Claim a piece and return whether nobody else has."""
        try:
            self._lock(fcntl.F_OFD_SETLK, fcntl.F_WRLCK, number)
        except BlockingIOError:
            return False
        return True

    def wait(self, number: int) -> None:
        """Wait until nobody else claims a piece any more."""
        self._lock(fcntl.F_OFD_SETLKW, fcntl.F_WRLCK, number)
        self.release(number)

    def release(self, number: int) -> None:
        """Let go of a piece."""
        self._lock(fcntl.F_OFD_SETLK, fcntl.F_UNLCK, number)

    def _lock(self, command: int, kind: int, number: int) -> None:
        lock = struct.pack(_FLOCK, kind, os.SEEK_SET, self._first + number, 1, 0)
        try:
            fcntl.fcntl(self._descriptor, command, lock)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)
