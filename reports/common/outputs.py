"""Outputs of a command: atomically written files, JSON and its schemas, progress, provenance.

Output paths are tested before the work; files are written under temporary names and renamed at the
end. Provenance is versions, machine, and the commands that repeat a result.
"""

from __future__ import annotations

import json
import math
import os
import platform
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import StrEnum
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from tqdm import tqdm

from xfrustum.process import delayed
from xfrustum.reference.llvm import array_device
from xfrustum.scenes import DoubleFrustum, InputError, disk

if TYPE_CHECKING:
    from xfrustum.scenes import Aperture, Scene

#: folder with the JSON schema of each record that a command prints or writes
_SCHEMAS = files("xfrustum.reports") / "schemas"


def json_ready(value: Any) -> Any:
    """Return the value in JSON's own types: dataclasses are objects, NaN and infinity None."""
    # Convert NumPy's scalars without loading NumPy, which the command line avoids to print errors.
    if hasattr(value, "tolist"):
        value = value.tolist()
    elif isinstance(value, Path | StrEnum):
        value = str(value)
    if value is None or isinstance(value, int | str):
        return value
    if isinstance(value, float):
        # JSON has no NaN and no infinity; null stands for an undefined number.
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    # Test for dataclasses first: a test for Mapping visits all its subclasses once for each class.
    named = (is_dataclass(value) and not isinstance(value, type)) or isinstance(value, Mapping)
    return json_object(value) if named else value


def json_object(record: Any) -> dict[str, Any]:
    """Return a mapping, or a dataclass, as a JSON object; see `json_ready`."""
    if is_dataclass(record):
        record = {field.name: getattr(record, field.name) for field in fields(record)}
    return {str(name): json_ready(value) for name, value in record.items()}


def progress_bar(total: int | None, what: str, unit: str, *, shown: bool) -> tqdm[Any]:
    """Return a bar of `total` units, None if unknown; the caller updates it."""
    # A log keeps every line that a terminal would overwrite: update the bar rarely in logs.
    shown = shown and sys.stderr is not None
    seconds = 0.1 if shown and sys.stderr.isatty() else 5.0
    return tqdm(total=total, disable=not shown, desc=what, unit=unit, mininterval=seconds)


class Staging:
    """A temporary folder that is renamed to its final name in one step; a context manager.

    Entering it tests, before any work, that the target can be written, and removes leftovers of
    killed processes. `commit` moves the files to `out` when they are on the disk; leaving without
    `commit` removes them.

    The folder `out` may exist: then files of the same name are replaced one by one, each
    atomically, and other files stay. If a name is a symbolic link, its target is replaced. `names`
    are the names of the files to come, if known. InputError is raised on entering if `out` is not a
    folder, has the name of a file or cannot be written, and by `commit` if the disk is full.
    """

    #: temporary folder, to which the files are written
    folder: Path

    def __init__(self, out: Path, names: Sequence[str] = ()) -> None:
        self.out, self.names = out, names
        self._place = Path(os.path.realpath(out))
        self._aside: disk.TempPath | None = None

    def __enter__(self) -> Self:
        # Create the folder next to the target, on the same file system, because otherwise renaming
        # would copy.
        host = self.out
        if not host.exists():
            place = self._place if self.out.is_symlink() else self.out.absolute()
            host = next(parent for parent in place.parents if parent.exists())
        if not host.is_dir():
            raise InputError(f"--out {self.out}: {host} is not a folder; choose another place")
        if host != self.out and self.out.suffix in {Path(name).suffix for name in self.names} - {
            ""
        }:
            raise InputError(
                f"--out {self.out}: give a folder, such as {self.out.with_suffix('')}, "
                f"in which {', '.join(self.names)} will lie"
            )
        with refused(f"--out {self.out}: cannot write in {host}", "choose another place"):
            for name in self.names:
                _check_kind(self._place / name, f"--out {self.out}", f"{name} in it")
            # If the folder did not exist, a killed run left its files in the parent folder.
            disk.remove_abandoned(self._place.parent)
            self._aside = disk.TempPath(host, folder=True)
            # A folder inside has the permissions of new folders; the temporary folder is private.
            self.folder = self._aside.path / "out"
            self.folder.mkdir()
        return self

    def write(self, name: str, content: object) -> None:
        """Write a file for `commit`: text, bytes, or a record as JSON without NaN or infinity."""
        if not isinstance(content, str | bytes):
            content = json.dumps(json_ready(content), allow_nan=False, indent=1) + "\n"
        (self.folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    def commit(self) -> tuple[Path, ...]:
        """Move the staged files to `out` and return their paths, sorted by name."""
        with (
            refused(f"--out {self.out}: cannot put files there", "choose another place"),
            delayed(),
        ):
            files = sorted(self.folder.iterdir())
            if not disk.put_folder(self.folder, self._place):
                for file in files:
                    # An existing folder may contain other files: it is never replaced as a whole.
                    disk.put(file, self._place / file.name)
                disk.sync_folder(self._place)
        return tuple(self.out / file.name for file in files)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._aside is not None:
            self._aside.remove()
        if isinstance(error, OSError):
            with refused(f"--out {self.out}: cannot write"):
                raise error


def write_files(out: Path, files: Mapping[str, object]) -> tuple[Path, ...]:
    """Put files into a folder, all or nothing; see `Staging.write`."""
    with Staging(out, tuple(files)) as staging:
        for name, content in files.items():
            staging.write(name, content)
        return staging.commit()


def check_writable_folder(path: Path, names: Sequence[str] = ()) -> None:
    """Raise InputError if files of these names cannot be written here; leave nothing behind."""
    with Staging(path, names):
        pass


def check_writable_image(path: Path) -> None:
    """Raise InputError unless an OpenEXR image can be written here; its name must end in .exr."""
    if path.suffix.lower() != ".exr" and not path.is_dir():
        named = f"such as {path.with_suffix('.exr')}"
        raise InputError(
            f"--out {path}: images are OpenEXR files; give a name that ends in .exr, {named}"
        )
    check_writable_file(path)


def check_writable_file(path: Path, option: str = "--out") -> None:
    """Raise InputError unless a file can be written here; leaves nothing behind."""
    folder = Path(os.path.realpath(path)).parent
    with refused(f"{option} {path}: cannot write in {folder}", "choose another place"):
        _check_kind(path, f"{option} {path}")
        with disk.TempPath(disk.scratch_folder() if disk.written_into(path) else folder):
            pass


def write_output(path: Path, content: bytes, option: str = "--out") -> None:
    """Write the file that an option names, whole or not at all; InputError on failure."""
    with refused(f"{option} {path}: cannot write"):
        disk.write_file(path, content)


@contextmanager
def refused(what: str, advice: str = "free some space or choose another place") -> Iterator[None]:
    """Convert errors of the operating system to InputError, with failure, reason and advice."""
    try:
        yield
    except OSError as error:
        # Errors raised by libraries have no reason from the operating system.
        reason = error.strerror or " ".join(str(error).split())
        raise InputError(f"{what} ({reason}); {advice}") from error


def _check_kind(path: Path, where: str, which: str = "") -> None:
    """Raise InputError if the name belongs to a folder or to a file that is not writable."""
    try:
        disk.written_into(path)
    except InputError as error:
        what = str(error).removeprefix(f"{path}: ")
        raise InputError(f"{where}: {which + ' ' if which else ''}{what}") from error


_LIBRARIES = ("xfrustum", "numpy", "scipy", "trimesh", "embreex", "moderngl", "PyOpenGL")
_JUDGING = ("scikit-image", "flip-evaluator")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that compute the results."""
    libraries = {name: metadata.version(name) for name in (*_LIBRARIES, *_JUDGING)}
    return {"python": platform.python_version(), **libraries}


def machine() -> dict[str, str]:
    """Return processor, usable cores, system, and the device of Dr.Jit arrays."""
    # platform.processor() is empty on most Linux systems; the kernel has the name.
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8", errors="replace") if cpuinfo.exists() else ""
    named = re.search(r"^model name\s*:\s*(.*\S)", text, re.MULTILINE)
    return {
        "processor": named[1] if named else platform.processor() or platform.machine(),
        # Containers and job schedulers grant fewer cores than the machine has.
        "cores": str(len(os.sched_getaffinity(0))),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "arrays": array_device(),
    }


def scene_command(verb: str, scene: Scene, *words: str) -> str:
    """Return a command about a scene, quoted for a shell."""
    return shlex.join(["xfrustum", verb, scene.source or scene.name, *words])


def raster_command(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> str:
    """Return the command that draws an aperture with these settings, quoted for a shell."""
    words = [*aperture_option(scene, aperture), *settings_words(settings)]
    return scene_command("raster", scene, *words, "--out", "raster.exr")


def aperture_option(scene: Scene, aperture: Aperture) -> list[str]:
    """Return the option that names an aperture; nothing for the middle one."""
    return (
        []
        if aperture == scene.plate.middle
        else ["--aperture", f"{aperture.column},{aperture.row}"]
    )


def plate_command(scene: Scene, settings: DoubleFrustum) -> str:
    """Return the command that draws the whole plate with these settings, quoted for a shell."""
    out = f"{Path(scene.source or scene.name).stem}.zarr"
    return scene_command("plate", scene, *settings_words(settings), "--out", out)


def settings_words(settings: DoubleFrustum) -> list[str]:
    """Return the options that state settings to the last digit, without default values."""
    words = ["--near", _number(settings.near), "--depth", str(settings.depth)]
    words += ["--mapping", str(settings.mapping)]
    usual = DoubleFrustum(near=settings.near)
    for name in ("pivot", "fit", "offset", "slabs", "camera", "cull"):
        value = getattr(settings, name)
        # Options that are left out have their default values.
        if value != getattr(usual, name):
            every = value if isinstance(value, tuple) else (value,)
            texts = (_number(part) if isinstance(part, float) else str(part) for part in every)
            words += [f"--{name}", ",".join(texts)]
    return words


def _number(value: float) -> str:
    """Write a number with up to six digits if these are exact, else with all its digits."""
    short = f"{value:g}"
    # A printed command must give the same settings, bit for bit.
    return short if float(short) == value else repr(value)


def unexamined_truth(tracer: str) -> str:
    """Return the note on a truth by an uncertified tracer, such as `embree`."""
    return f"truth: {tracer.capitalize()} alone, not examined"


def schema_names() -> list[str]:
    """Return the names of all records, sorted."""
    return sorted(
        path.name.removesuffix(".json")
        for path in _SCHEMAS.iterdir()
        if path.name.endswith(".json")
    )


def schema_text(name: str) -> str:
    """Return the JSON schema of a record as text.

    Raises
    ------
    InputError
        If there is no record of the name.
    """
    if name not in schema_names():
        raise InputError(f"schema {name}: no such record; name one of {', '.join(schema_names())}")
    return (_SCHEMAS / f"{name}.json").read_text(encoding="utf-8")
