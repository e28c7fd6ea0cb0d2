"""Outputs that are whole or absent: probed before the work, written aside, renamed at the end."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from xfrustum.interrupts import delayed
from xfrustum.scenes.disk.durable import (
    Aside,
    put,
    put_folder,
    remove_abandoned,
    scratch_folder,
    sync_folder,
    write_file,
    written_into,
)
from xfrustum.scenes.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Staged:
    """A folder that is being filled out of sight.

    Attributes
    ----------
    out, place
        Folder that the files are for, as it was asked for and where it lies.
    folder
        Folder aside that they are written to.
    names
        Names of the files, where they are known beforehand.
    """

    out: Path
    place: Path
    folder: Path
    names: Sequence[str]

    def commit(self) -> tuple[Path, ...]:
        """Move the staged files to `out` and return their paths, sorted by name."""
        try:
            with delayed():
                files = sorted(self.folder.iterdir())
                if not put_folder(self.folder, self.place):
                    for file in files:
                        put(file, self.place / file.name)
                    sync_folder(self.place)
        except OSError as error:
            raise InputError(
                f"--out {self.out}: cannot put files there ({_reason(error)}); choose another place"
            ) from error
        return tuple(self.out / file.name for file in files)


class Staging:
    """A folder that fills up out of sight and takes its place in one step.

    Entering it proves that the place can be written, before any work is spent, and removes what
    processes that were killed have left there. `Staged.commit` moves the files to `out` when they are on the
    disk; leaving without it removes every trace.

    Parameters
    ----------
    out
        Folder to be filled. It may exist: then files of the same name are replaced one by one,
        each atomically, and others stay. What links of the same name point to is replaced.
    names
        The files that will be put there, where they are known beforehand.

    Raises
    ------
    InputError
        On entering, when `out` is not a folder or cannot be written.
    """

    def __init__(self, out: Path, names: Sequence[str] = ()) -> None:
        self.out = out
        self.names = names
        self._place = Path(os.path.realpath(out))
        self._aside: Aside | None = None

    def __enter__(self) -> Staged:
        # Beside its place and on the same file system, else the rename would be a copy.
        host = self.out if self.out.exists() else self._nearest_folder()
        if not host.is_dir():
            raise InputError(f"--out {self.out}: {host} is not a folder; choose another place")
        try:
            for name in self.names:
                _check_kind(self._place / name, f"--out {self.out}", f"{name} in it")
            # Where a run has put them that found no folder.
            remove_abandoned(self._place.parent)
            self._aside = Aside(host, folder=True)
            # With the permissions that new folders get; the one aside is for nobody else.
            folder = self._aside.path / "out"
            folder.mkdir()
        except OSError as error:
            raise InputError(
                f"--out {self.out}: cannot write in {host} ({_reason(error)}); choose another place"
            ) from error
        return Staged(out=self.out, place=self._place, folder=folder, names=self.names)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._aside is not None:
            self._aside.remove()
        if isinstance(error, OSError):
            raise InputError(
                f"--out {self.out}: cannot write ({_reason(error)}); free some space or choose another place"
            ) from error

    def _nearest_folder(self) -> Path:
        place = (self._place if self.out.is_symlink() else self.out.absolute()).parent
        while not place.exists():
            place = place.parent
        return place


def check_writable_folder(path: Path, names: Sequence[str] = ()) -> None:
    """Raise InputError unless files of these names can be put here; leaves nothing behind.

    Raises
    ------
    InputError
        See `Staging`.
    """
    with Staging(path, names):
        pass


IMAGE_SUFFIX = ".exr"


def check_writable_image(path: Path) -> None:
    """Raise InputError unless an image can be written here; see `check_writable_file`.

    Raises
    ------
    InputError
        Likewise, or the name promises another format than OpenEXR.
    """
    if path.suffix.lower() != IMAGE_SUFFIX and not path.is_dir():
        raise InputError(
            f"--out {path}: images are OpenEXR files; give a name that ends in {IMAGE_SUFFIX}, "
            f"such as {path.with_suffix(IMAGE_SUFFIX)}"
        )
    check_writable_file(path)


def check_writable_file(path: Path, option: str = "--out") -> None:
    """Raise InputError unless a file can be written here; leaves nothing behind.

    Raises
    ------
    InputError
        The folder is missing or cannot be written, or the path is a folder, a block device or a socket.
    """
    try:
        _check_kind(path, f"{option} {path}")
        host = scratch_folder() if written_into(path) else Path(os.path.realpath(path)).parent
        with Aside(host):
            pass
    except OSError as error:
        folder = Path(os.path.realpath(path)).parent
        raise InputError(
            f"{option} {path}: cannot write in {folder} ({_reason(error)}); choose another place"
        ) from error


def write_output(path: Path, content: bytes, option: str = "--out") -> None:
    """Write the file that an option names, whole or not at all; see `durable.NewFile`.

    Raises
    ------
    InputError
        The disk is full or cannot be written, or the path is none of a file.
    """
    try:
        write_file(path, content)
    except OSError as error:
        raise InputError(
            f"{option} {path}: cannot write ({_reason(error)}); free some space or choose another place"
        ) from error


def _check_kind(path: Path, where: str, which: str = "") -> None:
    """Raise InputError where a name belongs to what is no file and cannot be written into."""
    try:
        written_into(path)
    except InputError as error:
        what = str(error).removeprefix(f"{path}: ")
        raise InputError(f"{where}: {which + ' ' if which else ''}{what}") from error


def _reason(error: OSError) -> str:
    """Return why the system refused; libraries that raise its errors leave out its own words."""
    return error.strerror or " ".join(str(error).split())
