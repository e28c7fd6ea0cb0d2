"""Files of users: regular files only, with a bound on the memory for reading.

A name may lead to a pipe, on which reading blocks forever, to an endless device, or to a file of a
few bytes that declares gigabytes. Every file is opened by `open_input` or read by `read_input`;
before a library opens a file by itself, `regular_size` checks it. `check_declared` bounds the
memory that a file declares. `damage_refused` converts errors of the library that reads the file.
"""

from __future__ import annotations

import io
import os
import stat
import struct
import zipfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from xfrustum.scenes.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

MEMORY_PER_BYTE = 64
"""Memory for each byte of a file, bytes, where that is more than the bound.

Mesh readers need up to 30 times the file's size (for a text such as OFF: lines, words and numbers
as Python objects, then arrays). Twice this amount accepts every correct file, however large. A file
that needs more is compressed, or declares more than it contains.
"""

#: Bytes of memory that a pixel of a picture takes: four channels as read, and three copies.
MEMORY_PER_PIXEL = 16

BLOCK_BYTES = 512  #: unit of the disk space of a file, bytes

SCENE_FILE_SIZE = (
    1 << 24
)  # largest size of a scene file, sixteen million bytes; people write some hundreds
RAISING_OPTION = "--max-input-memory"  # command-line option that raises the memory bound


class _Bound:
    """The bounds of this process, global because its memory is shared."""

    memory = 1 << 30
    """Bytes of memory that reading one input may take, for files of any size."""

    hogels = (
        20_000_000  # largest number of hogels of a plate: 60 x 80 cm at 0.25 mm have 7.7 million
    )


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
    """Convert any exception of a library to InputError; the block must contain only its calls.

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
    """Let a library read a file of checked size; InputError if memory runs out."""
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
