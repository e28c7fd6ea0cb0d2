"""Atomic writing of files and folders: written under a temporary name, then renamed.

A temporary name is `.xfrustum-HOST-PID-..`, in the same folder. A killed process leaves such files
behind. The next process that writes to the folder removes them, unless a running process has the
same PID by then.
"""

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from xfrustum.interrupts import delayed
from xfrustum.scenes.errors import InputError

_ASIDE = re.compile(r"\.xfrustum-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}")


def _host() -> str:
    """Return eight letters that identify the machine or container, within which PIDs are unique."""
    names = [os.uname().nodename]
    with suppress(OSError):
        names.append(str(Path("/proc/self/ns/pid").readlink()))
    return f"{zlib.crc32(' '.join(names).encode()):08x}"


class TempPath:
    """Temporary file or folder, at `path` in the folder `host`: rename it to keep it.

    It is a context manager. On entry it removes leftovers of killed processes; on exit it removes
    the file or folder if it was not renamed.
    """

    def __init__(self, host: Path, *, folder: bool = False) -> None:
        remove_abandoned(host)
        self.path = host / f".xfrustum-{_host()}-{os.getpid()}-{secrets.token_hex(4)}"
        with delayed():  # a signal waits until the path is recorded for removal
            self._made = False
            if folder:
                self.path.mkdir(mode=0o700)
            else:
                self.path.touch(exist_ok=False)
            self._made = True

    def remove(self) -> None:
        """Remove the file or folder if it was not renamed."""
        with delayed():
            if self._made:
                self._made = False
                clear(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()

    def __del__(self) -> None:
        # A signal may arrive between the creation and the block that would remove it.
        self.remove()


def remove_abandoned(host: Path) -> None:
    """Remove temporary files of ended processes from a folder, where possible."""
    with suppress(OSError):
        for name in os.listdir(host):  # noqa: PTH208 - faster, where a folder has millions of files
            match = _ASIDE.fullmatch(name)
            if match and match[1] == _host() and not Path("/proc", match[2]).exists():
                clear(host / name)


@contextmanager
def new_file(path: Path, *, host: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path, and rename it to the disk when the block ends without error.

    Links are followed and stay: their target is replaced and keeps its permissions. Devices, pipes
    and the process's own open files, such as `/dev/stdout`, are written to in place. `host` is the
    folder of the temporary file, on the same file system; None selects the folder of `path`.

    Raises InputError as from `written_into`, OSError where the disk is full or has lost data.
    """
    into, target = written_into(path), Path(os.path.realpath(path))
    # The temporary file of a copy may be in any folder.
    with TempPath(host or (scratch_folder() if into else target.parent)) as aside:
        yield aside.path
        if into:
            number = _descriptor(path)
            opened = os.open(path, os.O_WRONLY | os.O_NOCTTY) if number is None else os.dup(number)
            with aside.path.open("rb") as file, os.fdopen(opened, "wb") as stream:
                shutil.copyfileobj(file, stream)
            return
        with suppress(OSError):  # There is no old file, or the file system has no permissions.
            aside.path.chmod(stat.S_IMODE(target.stat().st_mode))
        _sync(aside.path)
        aside.path.replace(target)
        sync_folder(target.parent)


def write_file(path: Path, content: bytes | memoryview, *, host: Path | None = None) -> None:
    """Write a file, whole or not at all; see `new_file`."""
    with new_file(path, host=host) as aside:
        aside.write_bytes(content)


def written_into(path: Path) -> bool:
    """Return whether a path is written in place: a device, a pipe, or an open file of this process.

    Raises InputError if it is a folder, a block device or a socket.
    """
    if _descriptor(path) is not None:
        return True
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    refused = {stat.S_IFDIR: "folder", stat.S_IFBLK: "block device", stat.S_IFSOCK: "socket"}
    if kind := refused.get(stat.S_IFMT(mode)):
        raise InputError(f"{path}: is a {kind}, which is not written to; give the name of a file")
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)


def _descriptor(path: Path) -> int | None:
    """Return the file descriptor to which a name or a link leads, else None."""
    name = os.path.abspath(path)  # noqa: PTH100 - links are followed one at a time
    for _ in range(40):  # Linux reports a loop after 40 links
        if match := re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", name):
            return int(match[1])
        if not os.path.islink(name):  # noqa: PTH114
            break
        name = os.path.normpath(Path(name).parent / Path(name).readlink())
    return None


def put(made: Path, path: Path) -> None:
    """Rename a temporary file on the same file system to its final name; see `new_file`."""
    if path.is_symlink() or written_into(path):
        # The target of a link may be on another file system.
        with new_file(path) as aside:
            shutil.copyfile(made, aside)
        return
    _sync(made)
    made.replace(path)


def put_folder(made: Path, path: Path) -> bool:
    """Rename a temporary folder, with all its files, to its final name in one step.

    Returns False, without any change, if the name is taken: `put` can then place the files one by
    one.
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
        if path.exists():  # created by another process since the test above
            return False
        raise
    sync_folder(path.parent)
    return True


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on disk, if the file system supports this."""
    try:
        _sync(folder)
    except OSError as error:
        # Some network file systems cannot flush folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise


def clear(path: Path) -> None:
    """Remove a path: a folder with all its content, or anything else."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def scratch_folder() -> Path:
    """Return the folder for temporary files."""
    return Path(tempfile.gettempdir())
