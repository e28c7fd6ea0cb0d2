"""Files from outside: regular files only, and a bound on the memory that reading one may take.

A scene names meshes, textures and maps, and people name scenes and pictures. A name may lead to a pipe, on
which reading waits for ever, to a device without end, or to a file of a few bytes that declares gigabytes.
Every file goes through `regular_size` before it is read, and the memory that it declares through
`check_declared`.
"""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from xfrustum.scenes.errors import InputError

DEFAULT_MEMORY = 1 << 30
"""Bytes of memory that one input may take while it is read, whatever the size of its file."""

MEMORY_PER_BYTE = 64
"""Bytes of memory that reading may take for each byte of the file, where that is more than `DEFAULT_MEMORY`.

The readers of meshes need up to 30 times the file's size (for a text such as OFF: lines, words and numbers as
Python objects, then arrays); twice that lets every honest file through, however large it is. A file that
takes more is compressed, or declares more than it holds.
"""

MEMORY_PER_PIXEL = 16
"""Bytes of memory that a pixel of a picture takes: four channels as read, and three copies."""

MAX_HOGELS = 20_000_000
"""Largest number of hogels of a plate: 60 x 80 cm at 0.25 mm have 7.7 million."""

SCENE_FILE_SIZE = 1 << 24
"""Largest size of a scene file, sixteen million bytes; people write some hundreds."""

RAISING_OPTION, HOGELS_OPTION = "--max-input-memory", "--max-hogels"
"""Options of the command line that raise the bounds on memory and on hogels."""

_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


class _Bound:
    """The bounds of this process: memory belongs to the process as a whole."""

    memory = DEFAULT_MEMORY
    hogels = MAX_HOGELS


@contextmanager
def _set_within_block(owner: object, name: str, value: object) -> Iterator[None]:
    """Give an attribute another value within a block."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


@contextmanager
def input_memory(size: int) -> Iterator[None]:
    """Let one input take up to this many bytes of memory within a block.

    Raises
    ------
    InputError
        The size is not positive.
    """
    if size <= 0:
        raise InputError(f"{RAISING_OPTION} must be a positive size, not {size}")
    with _set_within_block(_Bound, "memory", size):
        yield


def largest_plate(hogels: int) -> AbstractContextManager[None]:
    """Let plates have up to this many hogels within a block."""
    return _set_within_block(_Bound, "hogels", hogels)


def check_hogels(columns: int, rows: int) -> None:
    """Refuse a plate of more hogels than the bound.

    Raises
    ------
    InputError
        The plate has too many hogels.
    """
    if columns * rows > _Bound.hogels:
        raise InputError(
            f"plate.hogels are {columns * rows:,}, more than {_Bound.hogels:,}; choose fewer, or raise the "
            f"bound with {HOGELS_OPTION}"
        )


def regular_size(path: Path, what: str, advice: str = "") -> int:
    """Return the size in bytes of a regular file.

    Parameters
    ----------
    path
        Path of the file; symbolic links are followed.
    what
        Kind of file for the message, such as "mesh file".
    advice
        Advice for the message where there is no such file.

    Raises
    ------
    InputError
        The file is missing, cannot be reached, or is a folder, a pipe, a device or a socket.
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
        return status.st_size
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: is a folder; give the name of {_article(what)} {what}")
    kind = next((name for test, name in _KINDS if test(status.st_mode)), "no regular file")
    raise InputError(f"{path}: is {kind}; {_article(what)} {what} must be a regular file")


def check_mesh_file(path: Path) -> None:
    """Refuse a mesh or patch file that is missing or no regular file; see `regular_size`."""
    what = "patch file" if path.name.lower().endswith(".bpt") else "mesh file"
    regular_size(path, what, "a mesh path is relative to its scene file")


def check_image_file(path: Path) -> None:
    """Refuse an image file that is missing or no regular file; see `regular_size`."""
    regular_size(path, "image file")


def check_environment_file(path: Path) -> None:
    """Refuse an environment map that is missing or no regular file; see `regular_size`."""
    regular_size(path, "environment map", "its path is relative to the scene file")


def read_small(path: Path, what: str, largest: int) -> bytes:
    """Return the bytes of a small file.

    Raises
    ------
    InputError
        The file is none that `regular_size` takes, or is larger than `largest` bytes.
    """
    size = regular_size(path, what)
    if size > largest:
        raise InputError(
            f"{path}: has {in_words(size)}, more than {_article(what)} {what} has; give the right file"
        )
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def allowed_memory(size: int) -> int:
    """Return the bytes of memory that reading a file of some size may take."""
    return max(_Bound.memory, MEMORY_PER_BYTE * size)


def check_declared(path: Path, declared: int, what: str) -> None:
    """Refuse a file that declares more bytes than its size and the bound allow.

    Raises
    ------
    InputError
        The file declares too much; the message names the option that raises the bound.
    """
    if declared > allowed_memory(regular_size(path, "file")):
        raise _too_much(path, f"{what}, {in_words(declared)} of memory")


def check_allowed(path: Path, declared: int, what: str) -> None:
    """Refuse what takes more memory than one input may, however small its files are.

    Raises
    ------
    InputError
        It takes too much; the message names the option that raises the bound.
    """
    if declared > _Bound.memory:
        raise InputError(
            f"{path}: {what} takes {in_words(declared)} of memory, more than {in_words(_Bound.memory)}; "
            f"mend it, or raise the bound with {RAISING_OPTION}"
        )


def check_picture_size(path: Path, width: int, height: int) -> None:
    """Refuse a picture that declares more pixels than memory allows.

    Raises
    ------
    InputError
        See `check_declared`.
    """
    check_declared(path, MEMORY_PER_PIXEL * width * height, f"{width} x {height} pixels")


@contextmanager
def bounded_memory(path: Path) -> Iterator[None]:
    """Let a library read a file whose declared size was checked; running out of memory is the file's fault.

    Raises
    ------
    InputError
        There is not enough memory to read the file.
    """
    from PIL import Image  # noqa: PLC0415 - a scene file is checked without it

    Image.MAX_IMAGE_PIXELS = None  # `check_picture_size` bounds them, by a number that an option raises
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
    return "an" if what[0] in "aeiou" else "a"


def in_words(size: float) -> str:
    """Return a size such as "3.2 MiB"."""
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if size < 1024 or unit == "GiB":
            return f"{size:.3g} {unit}" if unit != "bytes" else f"{int(size)} bytes"
        size /= 1024
    raise AssertionError
