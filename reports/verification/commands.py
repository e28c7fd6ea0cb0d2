"""A foreign renderer as a program that is run once for each aperture."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from xfrustum.interrupts import delayed
from xfrustum.reference import Reference
from xfrustum.reports.verification.sources import Problem, fields_of
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding, read_foreign
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.plate.plate import Aperture

MAX_TOLD_LINES = 5
"""Last lines of a failed command's standard error that are passed on."""

MAX_TOLD_BYTES = 1 << 16
"""Last bytes of its standard error that are looked at."""


@dataclass(kw_only=True)
class Command:
    """A program that is run once for each aperture, without a shell.

    Attributes
    ----------
    template
        Split as a shell would; {x} and {y} are the aperture's center in scene units, {i} and {j} its column
        and row, {out} the file to be written.
    reference, encoding
        The scene's truth, and what pictures mean; see `Files`.
    folder
        Folder that {out} lies in; it is emptied file by file.
    timeout_s
        A run that takes longer is ended, with all processes that it started.
    working
        Folder in which the program runs; None for that of this process.
    """

    template: str
    reference: Reference
    encoding: Encoding
    folder: Path
    timeout_s: float
    suffix: str = ".png"
    working: Path | None = None
    _arguments: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.template
        named = fields_of(self.template, ("x", "y", "i", "j", "out"), "--command")
        if "out" not in named:
            raise InputError(
                f"--command {self.template!r} has no {{out}}: tell the renderer which file to write"
            )
        try:
            self._arguments = shlex.split(self.template)
        except ValueError as error:
            raise InputError(f"--command {self.template!r}: {error}; mind the quotes") from error

    def check(self, apertures: Sequence[Aperture]) -> None:
        """Nothing is known before the first run."""

    def image(self, aperture: Aperture) -> HogelImage:
        """Run the program and read what it wrote."""
        out = self.folder / f"hogel_{aperture.column}x{aperture.row}{self.suffix}"
        values = {"x": float(aperture.x), "y": float(aperture.y), "i": aperture.column, "j": aperture.row}
        self._run([argument.format(**values, out=out) for argument in self._arguments])
        if not out.is_file():
            raise Problem("the command ended well, but wrote no file where {out} told it to")
        try:
            return read_foreign(out, self.reference.camera(aperture), self.encoding)
        except InputError as error:
            # The name of a file that nobody will find is no help.
            raise Problem(str(error).replace(str(out), "what the command wrote")) from error
        finally:
            out.unlink(missing_ok=True)

    def _run(self, arguments: list[str]) -> None:
        log = self.folder / "stderr"
        started: list[subprocess.Popen[bytes]] = []
        try:
            with delayed():  # a process that was started is noted before a signal is obeyed
                _start(arguments, self.working, log, started)
            status = started[0].wait(self.timeout_s)
        except subprocess.TimeoutExpired as error:
            raise Problem(
                f"the command ran longer than {self.timeout_s:g} s and was ended{_told(log)}"
            ) from error
        finally:
            with delayed():
                _end(started)
        if status:
            how = f"was ended by signal {-status}" if status < 0 else f"failed with exit status {status}"
            raise Problem(f"the command {how}{_told(log)}")


def _start(
    arguments: list[str], working: Path | None, log: Path, started: list[subprocess.Popen[bytes]]
) -> None:
    """Start a process and note it."""
    try:
        with log.open("wb") as told:
            # A session of its own, so that children of a hanging command end with it.
            process = subprocess.Popen(
                arguments,
                cwd=working,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=told,
                start_new_session=True,
            )
    except OSError as error:
        raise Problem(f"the command cannot be run: {arguments[0]}: {error.strerror}") from error
    started.append(process)


def _end(started: list[subprocess.Popen[bytes]]) -> None:
    """End processes and all that they started, if anything of it is left."""
    for process in started:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        finally:
            process.wait()


def _told(log: Path) -> str:
    """Return the last lines of a command's standard error, ready to be appended."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - MAX_TOLD_BYTES))
        lines = file.read().decode(errors="replace").strip().splitlines()[-MAX_TOLD_LINES:]
    return ": " + " | ".join(line.strip() for line in lines) if lines else ""
