"""Files and folders that are whole or absent, whatever ends the process or fills the disk.

All of them are made aside: under a name of their own, in the folder where they belong. A lock shows that the
process that makes one is alive; the system releases it when the process ends, however that happens. A file
without a lock was left by a process that was killed, and the next process removes it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
import shutil
import stat
import tempfile
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from xfrustum.interrupts import delayed
from xfrustum.scenes.errors import InputError

_PREFIX = ".xfrustum-"
_MADE_BY_US = re.compile(re.escape(_PREFIX) + r"[a-z0-9_]{8}")

_DESCRIPTOR = re.compile(r"/(?:dev|proc/self|proc/thread-self)/fd/(\d+)")
"""Names of the process's own open files; /dev/stdout and /dev/stderr are links to such names."""

_MAX_LINKS = 40
"""Largest number of links that are followed; Linux calls more of them a loop."""

_COPIED_BYTES = 1 << 20
"""Bytes copied at a time into what cannot be renamed."""


class Aside:
    """A file or folder in the making, locked by this process; a context manager that removes it.

    Parameters
    ----------
    host
        Folder in which it is made. Files that killed processes left there are removed first.
    folder
        Whether to make a folder instead of a file.

    Attributes
    ----------
    path
        Path of the file or folder. Rename it, or its content, to keep it.

    Raises
    ------
    OSError
        Nothing can be made in the host.
    """

    def __init__(self, host: Path, *, folder: bool = False) -> None:
        self.descriptor = -1
        remove_abandoned(host)
        self._folder = folder
        while True:
            self.path, self.descriptor = host / f"{_PREFIX}{secrets.token_hex(4)}", -1
            try:
                with delayed():  # what was made is noted before a signal is obeyed
                    self.descriptor = self._made()
                # Before it was locked, another process may have removed it as abandoned: then try again.
                if _locked(self.descriptor) is not False and _is(self.path, self.descriptor):
                    return
            except FileExistsError:
                continue
            except BaseException:
                self.remove()
                raise
            os.close(self.descriptor)

    def _made(self) -> int:
        if not self._folder:
            return os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self.path.mkdir(mode=0o700)
        try:
            return os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except FileNotFoundError as error:
            raise FileExistsError(self.path) from error

    def remove(self) -> None:
        """Remove what still has this name, and release the lock."""
        if self.descriptor < 0:
            return
        with delayed():
            try:
                clear(self.path)
            finally:
                descriptor, self.descriptor = self.descriptor, -1
                os.close(descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.remove()

    def __del__(self) -> None:
        # A signal may come after this was made and before the block that removes it is entered.
        self.remove()


class AllOrNothing(ABC):
    """Work that a `with` block does as a whole: committed at its end, discarded where it raises."""

    @abstractmethod
    def commit(self) -> None:
        """Keep what was made."""

    @abstractmethod
    def discard(self) -> None:
        """Leave no trace."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.commit()
        else:
            self.discard()


class NewFile(AllOrNothing):
    """A file that is written aside and takes its name when it is whole.

    A context manager: leaving the block puts it in its place, an exception leaves no trace of it. Links
    are followed: their target is replaced, and they stay. Devices and pipes are written into.

    Parameters
    ----------
    path
        Path of the file. A file that exists is replaced at the end and keeps its permissions.
    host
        Folder in which it is made, on the same file system; None for the folder that it belongs in.

    Attributes
    ----------
    aside
        Path of the file to write to, which is empty at first.
    open_name
        Another name of this file, in ASCII whatever the folders are called, for libraries that need it.

    Raises
    ------
    InputError
        The path is a folder, or anything else that a file cannot be written into.
    OSError
        Nothing can be made in the host; from `commit`, the disk is full or has lost data.
    """

    def __init__(self, path: Path, *, host: Path | None = None) -> None:
        self._path = path
        self._into = written_into(path)
        self._target = Path(os.path.realpath(path))
        if host is None:
            # A file that is copied in the end can be made anywhere.
            host = scratch_folder() if self._into else self._target.parent
        self._held = Aside(host)
        self.aside = self._held.path
        self.open_name = f"/proc/self/fd/{self._held.descriptor}"

    def commit(self) -> None:
        """Put the file in its place; afterwards it is on the disk."""
        try:
            descriptor = self._held.descriptor
            os.fsync(descriptor)
            if self._into:
                _copy(descriptor, self._path)
                return
            with suppress(OSError):  # There is none, or the file system knows no permissions.
                os.fchmod(descriptor, stat.S_IMODE(self._target.stat().st_mode))
            self.aside.replace(self._target)
            sync_folder(self._target.parent)
        finally:
            self._held.remove()

    def discard(self) -> None:
        """Leave no trace."""
        self._held.remove()


def write_file(path: Path, content: bytes | memoryview, *, host: Path | None = None) -> None:
    """Write a file, whole or not at all; see `NewFile`."""
    with NewFile(path, host=host) as new:
        with new.aside.open("wb", buffering=0) as file:
            _write(file.fileno(), memoryview(content).cast("B"))
        if new.aside.stat().st_size != memoryview(content).nbytes:
            raise OSError(errno.EIO, os.strerror(errno.EIO))


def written_into(path: Path) -> bool:
    """Return whether a path is written into and not replaced, as character devices and pipes are.

    The process's own open files, such as `/dev/stdout`, are written into too, whatever they are.

    Raises
    ------
    InputError
        The path is a folder, a block device or a socket.
    OSError
        The path cannot be examined.
    """
    if _descriptor(path) is not None:
        return True
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):
        return True
    if stat.S_ISDIR(mode):
        raise InputError(f"{path}: is a folder; give the name of a file")
    if not stat.S_ISREG(mode):
        kind = "block device" if stat.S_ISBLK(mode) else "socket"
        raise InputError(f"{path}: is a {kind}, which is not written to; give the name of a file")
    return False


def put(made: Path, path: Path) -> None:
    """Give a file that was made aside, on the same file system, its name; links are followed.

    Raises
    ------
    InputError, OSError
        See `NewFile`.
    """
    if path.is_symlink() or written_into(path):
        # The target of a link may be on another file system.
        with NewFile(path) as new, made.open("rb") as source, new.aside.open("wb") as copy:
            shutil.copyfileobj(source, copy)
        return
    _sync(made)
    made.replace(path)


def put_folder(made: Path, path: Path) -> bool:
    """Give a folder that was made aside its name in one step, with all its files.

    Returns
    -------
    done
        False where the name is taken: nothing has been done, and `put` can place the files one by one.

    Raises
    ------
    OSError
        See `NewFile`.
    """
    if path.exists() or path.is_symlink():
        return False
    for file in made.iterdir():
        _sync(file)
    sync_folder(made)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        made.rename(path)
    except OSError:
        if path.exists():  # since a moment ago
            return False
        raise
    sync_folder(path.parent)
    return True


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where its file system can do that."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems have no such thing for folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise
    finally:
        os.close(descriptor)


def remove_abandoned(host: Path) -> None:
    """Remove files that processes which have ended left in a folder; those that cannot be removed stay."""
    try:
        with os.scandir(host) as entries:
            names = [entry.name for entry in entries if _MADE_BY_US.fullmatch(entry.name)]
    except OSError:
        return
    for name in names:
        path = host / name
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError:
            continue
        try:
            ours = os.fstat(descriptor).st_uid == os.geteuid()
            if ours and _locked(descriptor) and _is(path, descriptor):
                clear(path)
        finally:
            os.close(descriptor)


def clear(path: Path) -> None:
    """Remove a path: a folder with all its content, or anything else."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def scratch_folder() -> Path:
    """Return the folder for temporary files."""
    return Path(tempfile.gettempdir())


def _locked(descriptor: int) -> bool | None:
    """Lock a file or folder; False where another process has locked it, None where locks do not work."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _is(path: Path, descriptor: int) -> bool:
    """Return whether a name still belongs to an open file."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _descriptor(path: Path) -> int | None:
    """Return the number of the open file that a name or a link stands for; None for any other."""
    # Links are followed one at a time: the last name on the way is the one that is looked for.
    name = os.path.abspath(path)  # noqa: PTH100
    for _ in range(_MAX_LINKS):
        found = _DESCRIPTOR.fullmatch(name)
        if found:
            return int(found.group(1))
        link = Path(name)
        if not link.is_symlink():
            return None
        name = os.path.normpath(link.parent / link.readlink())
    return None


def _copy(source: int, path: Path) -> None:
    """Write an open file into a device, a pipe or an open file of this process."""
    number = _descriptor(path)
    # The process's own open files are written where they stand, between what is printed before and after.
    into = os.open(path, os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC) if number is None else os.dup(number)
    try:
        os.lseek(source, 0, os.SEEK_SET)
        while block := os.read(source, _COPIED_BYTES):
            _write(into, memoryview(block))
    finally:
        os.close(into)


def _write(descriptor: int, content: memoryview) -> None:
    while content:
        content = content[os.write(descriptor, content) :]
