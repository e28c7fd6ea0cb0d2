"""Files on disk: bounded reading of the user's files, and atomic writing of files and folders.

**Reading.** A name may lead to a pipe, on which reading blocks forever, to an endless device, or to
a file of a few bytes that declares gigabytes. Every file is opened by `open_input` or read by
`read_input`; before a library opens a file by itself, `regular_size` checks it. `check_declared`
bounds the memory that a file declares. `damage_refused` converts errors of the library that reads
the file.

**Writing.** A file is written under a temporary name in its folder, `.xfrustum-HOST-PID-..`, and
then renamed. A killed process leaves such files behind. The next process that writes to the folder
removes them, unless a running process has the same PID by then.
"""

from __future__ import annotations

import errno
import io
import os
import re
import secrets
import shutil
import stat
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Self

from xfrustum.process import delayed
from xfrustum.scenes.arguments import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray


MEMORY_PER_BYTE = 64
"""Memory allowed for each byte of a file, bytes, if this is more than `_Bound.memory`.

Mesh readers need up to 30 times the file's size (for a text such as OFF: lines, words and numbers
as Python objects, then arrays). Twice this amount accepts every correct file, however large. A file
that needs more is compressed, or declares more than it contains.
"""

#: Bytes of memory that a pixel of a picture takes: four channels as read, and three copies.
MEMORY_PER_PIXEL = 16

BLOCK_BYTES = 512  #: unit of the disk space of a file, bytes

SCENE_FILE_SIZE = 1 << 24  # largest size of a scene file, bytes; typical files have some hundreds
RAISING_OPTION = "--max-input-memory"  # command-line option that raises the memory bound


class _Bound:
    """Bounds on inputs; they are global, because all readers share the memory of the process."""

    memory = 1 << 30
    """Bytes of memory that reading one input may take, for files of any size."""

    hogels = 20_000_000  # largest number of hogels; 60 x 80 cm at 0.25 mm has 7.7 million


@contextmanager
def _bound_within_block(name: str, value: int) -> Iterator[None]:
    before = getattr(_Bound, name)
    setattr(_Bound, name, value)
    try:
        yield
    finally:
        setattr(_Bound, name, before)


def input_memory(size: int) -> AbstractContextManager[None]:
    """Set the memory bound of one input, bytes, > 0, within a block."""
    if size <= 0:
        raise InputError(f"{RAISING_OPTION} must be a positive size, not {size}")
    return _bound_within_block("memory", size)


def largest_plate(hogels: int) -> AbstractContextManager[None]:
    """Set the largest number of hogels of a plate within a block."""
    return _bound_within_block("hogels", hogels)


def check_hogels(columns: int, rows: int) -> None:
    """Raise InputError for a plate with more hogels than the bound."""
    if columns * rows > _Bound.hogels:
        raise InputError(
            f"plate.hogels are {columns * rows:,}, more than {_Bound.hogels:,}; choose fewer, "
            "or raise the bound with --max-hogels"
        )


def regular_size(path: Path, what: str, advice: str = "") -> int:
    """Return the size in bytes of a regular file, named `what` in messages; links are followed.

    Raises InputError if it is missing (the message adds the advice), cannot be reached, is not a
    regular file, or is empty, as files in /proc are. Sparse files are refused too: they take memory
    on reading although they take no disk space.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"{path}: no such {what}{f'; {advice}' if advice else ''}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # the name contains a NUL
        raise InputError(f"{path}: no file has such a name ({error})") from error
    if stat.S_ISREG(status.st_mode):
        if status.st_size == 0:
            raise InputError(f"{path}: the {what} is empty; write it again")
        filled = BLOCK_BYTES * status.st_blocks
        if status.st_size > allowed_memory(filled):
            raise InputError(
                f"{path}: claims {in_words(status.st_size)} and fills {in_words(filled)} of the "
                f"disk; mend the file, or raise the bound with {RAISING_OPTION}"
            )
        return status.st_size
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: is a folder; give the name of {_article(what)}")
    kinds = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    kind = kinds.get(stat.S_IFMT(status.st_mode), "a device")
    raise InputError(f"{path}: is {kind}; {_article(what)} must be a regular file")


def check_mesh_file(path: Path) -> None:
    """Refuse a mesh or patch file that is missing or not a regular file; see `regular_size`."""
    what = "patch file" if path.name.lower().endswith(".bpt") else "mesh file"
    regular_size(path, what, "a mesh path is relative to its scene file")


def open_input(path: Path, what: str, advice: str = "") -> BinaryIO:
    """Open a file for reading; InputError if it is not a regular file or not readable."""
    regular_size(path, what, advice)
    try:
        # Nonblocking, because a pipe may have replaced the file since the check, and open must not
        # wait.
        return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def head_of(path: Path, what: str, size: int = 1024) -> bytes:
    """Return the first bytes of a file; InputError as from `open_input`, and for read errors."""
    try:
        with open_input(path, what) as file:
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except MemoryError as error:
        raise _too_much(path, "more memory than there is") from error


def read_input(path: Path, what: str, advice: str = "") -> bytes:
    """Return all bytes of a file; InputError as from `head_of`, with advice if it is missing."""
    return head_of(path, what, regular_size(path, what, advice))


def read_small(path: Path, what: str, largest: int, advice: str = "") -> bytes:
    """Return the bytes of a file; InputError as from `read_input`, or above `largest` bytes."""
    size = regular_size(path, what, advice)
    if size > largest:
        raise InputError(
            f"{path}: has {in_words(size)}, more than {_article(what)} has; give the right file"
        )
    return head_of(path, what, largest)


@contextmanager
def damage_refused(path: Path, what: str, advice: str) -> Iterator[None]:
    """Convert any exception of a library to InputError; the block must only call the library.

    All exceptions are converted: damaged archives make `zipfile` and NumPy raise fourteen classes.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{path}: is no {what} that can be read ({reason:.200}); {advice}"
        ) from error


def allowed_memory(size: int) -> int:
    """Return the memory bound, bytes, for reading a file of this size."""
    return max(_Bound.memory, MEMORY_PER_BYTE * size)


def check_declared(path: Path, declared: int, what: str) -> None:
    """Raise InputError if a file declares more bytes than its size and the bound allow."""
    if declared > allowed_memory(regular_size(path, "file")):
        raise _too_much(path, f"{what}, {in_words(declared)} of memory")


def check_allowed(path: Path, declared: int, what: str) -> None:
    """Raise InputError above the memory bound of one input, for files of any size."""
    if declared > _Bound.memory:
        raise InputError(
            f"{path}: {what} takes {in_words(declared)} of memory, more than "
            f"{in_words(_Bound.memory)}; mend it, or raise the bound with {RAISING_OPTION}"
        )


def check_picture_size(path: Path, width: int, height: int) -> None:
    """Raise InputError if a picture declares more pixels than memory allows."""
    check_declared(path, MEMORY_PER_PIXEL * width * height, f"{width} x {height} pixels")


def open_image(file: BinaryIO) -> Any:
    """Return Pillow's image of a file, undecoded, without Pillow's limit on pixels.

    `check_picture_size` bounds the number of pixels instead, and an option can raise this bound.
    `PIL.Image.open` would also test `Image.MAX_IMAGE_PIXELS`, which belongs to the host process.
    Raises UnidentifiedImageError for a file that is not a picture.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - a scene file needs no Pillow

    Image.init()
    prefix = file.read(16)  # as many bytes as Pillow passes to its format tests
    for name in Image.ID:
        factory, accepts = Image.OPEN[name]
        accepted = accepts is None or accepts(prefix)
        # a string is the reason why the format does not fit
        if accepted and not isinstance(accepted, str):
            file.seek(0)
            with suppress(SyntaxError, IndexError, TypeError, struct.error):
                return factory(file, "")
    raise UnidentifiedImageError("no known format of pictures")


@contextmanager
def bounded_memory(path: Path) -> Iterator[None]:
    """Convert MemoryError to InputError, for libraries that read a file of checked size."""
    try:
        yield
    except MemoryError as error:
        raise _too_much(path, "more memory than there is") from error


def _too_much(path: Path, what: str) -> InputError:
    size = regular_size(path, "file")
    return InputError(
        f"{path}: reading it takes {what}; a file of {in_words(size)} should take at most "
        f"{in_words(allowed_memory(size))}; mend the file, or raise the bound with {RAISING_OPTION}"
    )


def _article(what: str) -> str:
    return f"an {what}" if what[0] in "aeiou" else f"a {what}"


def in_words(size: float) -> str:
    """Return a size such as "3.2 MiB"."""
    if size < 1024:
        return f"{int(size)} bytes"
    power = 3 if size >= 1 << 30 else 2 if size >= 1 << 20 else 1
    size, unit = size / 1024**power, ("KiB", "MiB", "GiB")[power - 1]
    return f"{size:.0f} {unit}" if size >= 100 else f"{size:.3g} {unit}"


# Zip archives and .npz files from outside: no pickles, and memory bounded by the size of the file
# -------------------------------------------------------------------------------------------------


def read_member(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """Return a member of the archive in a file; InputError if it declares too much memory.

    `zipfile` raises various exceptions for damaged archives: call this function within
    `damage_refused`.
    """
    check_declared(path, archive.getinfo(name).file_size, f"unpacking {name}")
    return archive.read(name)  # `zipfile` reads no more than the member declares


def read_arrays(
    path: Path, what: str, advice: str, content: bytes | None = None
) -> dict[str, NDArray[Any]]:
    """Return the arrays of a .npz file, or of its `content`, by their names.

    InputError if it is damaged, declares too much memory, or has members other than plain arrays.
    """
    content = read_input(path, what, advice) if content is None else content
    import numpy as np  # noqa: PLC0415 - a scene file is checked without it

    arrays: dict[str, NDArray[Any]] = {}
    with damage_refused(path, what, advice), zipfile.ZipFile(io.BytesIO(content)) as archive:
        check_declared(
            path, sum(member.file_size for member in archive.infolist()), "unpacking its arrays"
        )
        for name in archive.namelist():
            # The header has at most 10,000 bytes and contains only literals.
            member = io.BytesIO(read_member(archive, name, path))
            arrays[name.removesuffix(".npy")] = np.lib.format.read_array(member, allow_pickle=False)
    return arrays


_ASIDE = re.compile(r"\.xfrustum-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}")


def _host() -> str:
    """Return eight hex digits that identify the machine or container; PIDs are unique within it."""
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
        # A signal may arrive between the creation and the `with` block that would remove the file.
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
    """Yield a temporary path, and rename it to `path` if the block ends without error.

    Links are followed and kept: the target of a link is replaced, with the same permissions.
    Devices, pipes and the process's own open files, such as `/dev/stdout`, are written to in place.
    `host` is the folder of the temporary file, on the same file system; None selects the folder of
    `path`.

    Raises InputError as from `written_into`, and OSError if the disk is full or has lost data.
    """
    into, target = written_into(path), Path(os.path.realpath(path))
    # If the content is copied into an open file, the temporary file may be in any folder.
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
