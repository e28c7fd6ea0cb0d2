"""Outputs that are whole or absent: probed before the work, written aside, renamed at the end."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from xfrustum.scenes.errors import InputError


class Staging:
    """A folder that fills up out of sight and takes its place in one step.

    Entering it proves that the place can be written, before any work is spent. `commit`
    moves the files to `out`; leaving without it removes every trace.

    Parameters
    ----------
    out
        Folder to be filled. It may exist: files of the same name are replaced one by one,
        each atomically, and others stay.
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
        self.folder = Path()

    def __enter__(self) -> Staging:
        # Beside its place and on the same file system, else the rename would be a copy.
        blocked = [name for name in self.names if (self.out / name).is_dir()]
        if blocked:
            raise InputError(f"--out {self.out}: {blocked[0]} in it is a folder; choose another place")
        host = self.out if self.out.exists() else self._nearest_folder()
        if not host.is_dir():
            raise InputError(f"--out {self.out}: {host} is not a folder; choose another place")
        try:
            self.folder = Path(tempfile.mkdtemp(prefix=".xfrustum-", dir=host))
        except OSError as error:
            raise InputError(
                f"--out {self.out}: cannot write in {host} ({error.strerror}); choose another place"
            ) from error
        return self

    def commit(self) -> tuple[Path, ...]:
        """Move the staged files to `out` and return their paths, sorted by name."""
        moved = []
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            for file in sorted(self.folder.iterdir()):
                target = self.out / file.name
                file.replace(target)
                moved.append(target)
        except OSError as error:
            raise InputError(
                f"--out {self.out}: cannot put files there ({error.strerror}); choose another place"
            ) from error
        return tuple(moved)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        if isinstance(error, OSError):
            raise InputError(
                f"--out {self.out}: cannot write ({error.strerror}); free some space or choose another place"
            ) from error

    def _nearest_folder(self) -> Path:
        place = self.out.absolute().parent
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
        The folder is missing or cannot be written, or the path is a folder.
    """
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder; give the name of a file")
    try:
        with tempfile.TemporaryFile(dir=path.absolute().parent):
            pass
    except OSError as error:
        raise InputError(
            f"{option} {path}: cannot write in {path.absolute().parent} ({error.strerror}); "
            "choose another place"
        ) from error
