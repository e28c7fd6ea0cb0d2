"""The commands that `make kill` kills, on a scene that makes them short, and what they leave undisturbed."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tests.fuzz.inputs import SCENE, SHAPE

TEMPORARY = "temporary"
"""Name of the folder for temporary files, which commands must empty as well."""

OUT, JUNIT = "out", "out.xml"
"""Names of what commands write: a folder, and a JUnit file."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """The outcome of a victim that was not killed."""

    #: length_s, silent_s: Seconds that it took, and seconds of these until the program's first line was run
    length_s: float
    silent_s: float
    told: bytes  #: Text that it wrote to standard error
    files: Mapping[str, str]  #: Hash of every file that it left, by the file's name


@dataclass(frozen=True, kw_only=True)
class Victim:
    """A command that is killed."""

    name: str  #: Name of the victim
    arguments: tuple[str, ...]  #: Arguments of Python, run in a folder with the scene
    status: int = 0  #: Exit status of a run that is not killed
    #: Whether what a killed run leaves in its folder is kept, and a second run goes on with it; else the
    #: folder is whole or absent
    resumes: bool = False

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Start the command as in a terminal's foreground: a shell's background job would ignore Ctrl-C."""
        return subprocess.Popen(
            [sys.executable, *self.arguments],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder / TEMPORARY)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=_signals_by_default,  # noqa: PLW1509 - it takes no lock
        )

    def run(self) -> Run:
        """Run the command to its end without killing it."""
        with workplace() as folder:
            begun = time.monotonic()
            process = self.start(folder)
            while process.poll() is None and not answers(process.pid):
                time.sleep(0.002)
            silent_s = time.monotonic() - begun
            _, told = process.communicate()
            if process.returncode != self.status:
                raise RuntimeError(f"{self.name} ended with {process.returncode}: {told.decode()[-500:]}")
            return Run(
                length_s=time.monotonic() - begun, silent_s=silent_s, told=told, files=left_files(folder)
            )


def victims(checkout: Path) -> list[Victim]:
    """Return the commands that take long enough to be killed."""
    fuzz = checkout / "tests" / "fuzz"
    renderer = f"{sys.executable} {fuzz / 'renderer.py'} {{i}} {{j}} {{out}}"
    report = ("report", "scene.toml", "--near", "1,0.1", "--depth", "d24")
    plate = ("plate", "scene.toml", "--near", "0.1", "--ids", "--block", "1x1", "--json")
    verify = ("verify", "scene.toml", "--encoding", "triangle-id", "--apertures", "0,0;1,0;2,1")
    outputs = ("--quiet", "--out", OUT)
    program = ("-m", "xfrustum")
    return [
        Victim(name="report", arguments=(*program, *report, *outputs)),
        Victim(name="plate", arguments=(*program, *plate, *outputs), resumes=True),
        Victim(
            name="verify", arguments=(*program, *verify, "{i}x{j}.png", *outputs, "--junit", JUNIT), status=1
        ),
        Victim(
            name="verify-command",
            arguments=(*program, *verify, "--command", renderer, *outputs, "--junit", JUNIT),
            status=1,
        ),
        Victim(name="study", arguments=(str(fuzz / "small_study.py"), "study", "small", OUT), resumes=True),
    ]


@contextmanager
def workplace() -> Iterator[Path]:
    """Give a folder with the scene, some pictures, and an empty folder for temporary files."""
    with tempfile.TemporaryDirectory(prefix="kill-") as name:
        folder = Path(name).resolve()
        (folder / "scene.toml").write_text(SCENE + SHAPE)
        (folder / TEMPORARY).mkdir()
        for j in range(2):
            for i in range(3):
                Image.new("RGB", (16, 12), (0, 0, 20 + i + j)).save(folder / f"{i}x{j}.png")
        yield folder


def undisturbed(runs: Sequence[Run]) -> Run:
    """Return the common outcome of some runs that were not killed."""
    first = runs[0]
    if any(run.files.keys() != first.files.keys() or run.told != first.told for run in runs):
        raise RuntimeError("two undisturbed runs leave other files, or say something else")
    same = {
        name: content if all(run.files[name] == content for run in runs) else ""
        for name, content in first.files.items()
    }
    return Run(
        length_s=max(run.length_s for run in runs),
        silent_s=max(run.silent_s for run in runs),
        told=first.told,
        files=same,
    )


def left_files(folder: Path) -> dict[str, str]:
    """Return the hash of every file of a command's output, by name."""
    found = [path for path in (folder / OUT).rglob("*") if path.is_file()]
    found += [path for path in (folder / JUNIT,) if path.is_file()]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(found)
    }


def answers(pid: int) -> bool:
    """Return whether a process has run the first line of the program, which holds SIGTERM back.

    Python itself leaves SIGTERM to the system, which ends the process without a word.
    """
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
    masks = dict(line.split(":", 1) for line in status.splitlines() if line.startswith("Sig"))
    term = 1 << (signal.SIGTERM - 1)
    return any(int(masks.get(name, "0"), 16) & term for name in ("SigBlk", "SigIgn", "SigCgt"))


def plate_counts(stdout: bytes) -> tuple[int, int]:
    """Return how many hogels a plate command says that it has drawn and found."""
    content = json.loads(stdout)
    return content["drawn"], content["found"]


def _signals_by_default() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
