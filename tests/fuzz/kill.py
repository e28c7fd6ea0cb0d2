"""`make kill`: send signals to commands at random moments; check their end, files and resumption.

Run as `python -m tests.fuzz.kill [--count N] [--jobs J] [--command NAME]`. Moments cover the whole
life of the process. Moments before the program's first line, while Python starts, are counted
separately: the program cannot handle signals yet.
"""

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from tests.fuzz.inputs import SCENE, SHAPE
from tests.support.processes import signals_by_default
from xfrustum.process import CONTINUES

#: Exit status and message by signal; a command that finishes earlier ends normally
ENDS = {
    signal.SIGINT: (130, b"xfrustum: interrupted\n"),
    signal.SIGTERM: (143, b"xfrustum: terminated\n"),
    signal.SIGKILL: (-9, b""),
}
PATIENCE_S = 60.0  #: time limit of a command after a signal, seconds
RENDERER_S = 10.0  #: time limit of workers and renderers after the command was killed, seconds
TEMPORARY, OUT = "temporary", "out"  #: folders for temporary files and for output
PICTURES = {f"{i}x{j}.png": (0, 0, 20 + i + j) for i in range(3) for j in range(2)}


@dataclass(frozen=True, kw_only=True)
class Victim:
    """Command that is killed; its folder is complete or absent, unless the command resumes."""

    name: str
    arguments: tuple[str, ...]  #: arguments of Python
    status: int = 0  #: exit status without a signal
    resumes: bool = False  #: whether a second run continues with part of the output

    def start(self, folder: Path) -> subprocess.Popen[bytes]:
        """Start the command like a foreground job: background jobs ignore Ctrl-C."""
        return subprocess.Popen(
            [sys.executable, *self.arguments],
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder / TEMPORARY)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=signals_by_default,  # noqa: PLW1509 - it takes no lock
        )


def victims(fuzz: Path) -> list[Victim]:
    """Return commands on a small scene that take long enough to be killed."""
    renderer = f"{sys.executable} {fuzz / 'renderer.py'} {{i}} {{j}} {{out}}"
    xfrustum, outputs = ("-m", "xfrustum"), ("--quiet", "--out", OUT)
    verify = ["verify", "scene.toml", "--encoding", "triangle-id", "--apertures", "0,0;1,0;2,1"]
    lines: dict[str, tuple[list[str], int, bool]] = {
        "report": (["report", "scene.toml", "--near", "1,0.1", "--depth", "d24"], 0, False),
        "plate": (["plate", "scene.toml", "--near", "0.1", "--ids", "--block", "1x1"], 0, True),
        "survey": (["survey", "scene.toml", "--near", "0.1", "--all", "--workers", "2"], 0, True),
        "verify": ([*verify, "{i}x{j}.png"], 1, False),
        "verify-command": ([*verify, "--command", renderer], 1, False),
    }
    result = [
        Victim(name=name, arguments=(*xfrustum, *line, *outputs), status=status, resumes=resumes)
        for name, (line, status, resumes) in lines.items()
    ]
    study = (str(fuzz / "small_study.py"), "study", "small", OUT)
    return [*result, Victim(name="study", arguments=study, resumes=True)]


@contextmanager
def workplace() -> Iterator[Path]:
    """Yield a folder with a scene, some pictures, and a folder for temporary files."""
    with tempfile.TemporaryDirectory(prefix="kill-") as name:
        folder = Path(name).resolve()
        (folder / "scene.toml").write_text(SCENE + SHAPE)
        (folder / TEMPORARY).mkdir()
        for picture, color in PICTURES.items():
            Image.new("RGB", (16, 12), color).save(folder / picture)
        yield folder


@dataclass(frozen=True, kw_only=True)
class Run:
    """Outcome of a run without a signal."""

    length_s: float
    errors: bytes  #: text on standard error
    files: Mapping[str, str]  #: hash of each output by its name

    @classmethod
    def from_victim(cls, victim: Victim) -> "Run":
        """Run a victim to completion."""
        with workplace() as folder:
            begun = time.monotonic()
            process = victim.start(folder)
            _, errors = process.communicate()
            if process.returncode != victim.status:
                raise RuntimeError(f"{victim.name}: {process.returncode}, {errors.decode()[-500:]}")
            return cls(length_s=time.monotonic() - begun, errors=errors, files=left_files(folder))


def left_files(folder: Path) -> dict[str, str]:
    """Return the hash of every file of a command's output, by name."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / OUT).rglob("*"))
        if path.is_file()
    }


def undisturbed(runs: list[Run]) -> Run:
    """Return the common outcome of some runs, without hashes of files that contain times."""
    files = {
        name: digest if all(run.files.get(name) == digest for run in runs) else ""
        for name, digest in runs[0].files.items()
    }
    return Run(length_s=max(run.length_s for run in runs), errors=runs[0].errors, files=files)


def answers(pid: int) -> bool:
    """Return whether a process has started the program, whose first line handles SIGTERM.

    Before, the system ends the process at SIGTERM, without a message.
    """
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
    masks = dict(line.split(":", 1) for line in status.splitlines() if line.startswith("Sig"))
    term = 1 << (signal.SIGTERM - 1)
    return any(int(masks.get(name, "0"), 16) & term for name in ("SigBlk", "SigIgn", "SigCgt"))


def killed(victim: Victim, number: signal.Signals, seed: int, whole: Run) -> tuple[str, list[str]]:
    """Kill a victim at a moment from the seed; return its exit status and problems."""
    wait_s = random.Random(f"{victim.name} {number} {seed}").uniform(0.0, whole.length_s)
    with workplace() as folder:
        process = victim.start(folder)
        time.sleep(wait_s)
        early = process.poll() is None and not answers(process.pid)
        if process.poll() is None:
            process.send_signal(number)
        try:
            _, errors = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            _, errors = process.communicate()
        status, problems = process.returncode, []
        expected, word = ENDS[number]
        if early:
            # Python ends with the signal, or with status 1 if Ctrl-C comes during its own startup.
            if status not in {-number, expected, victim.status, 1}:
                problems.append(f"status {status} before the first line")
        elif status == expected:
            shown = errors.removeprefix(whole.errors).replace(CONTINUES.encode(), b"")
            if word and shown != word:
                problems.append(f"said {errors[-300:]!r}")
        elif status != victim.status:
            problems.append(f"status {status}, said {errors[-300:]!r}")
        problems += [f"lives on: {orphan}" for orphan in orphans(folder)]
        problems += [f"left {name}" for name in leftovers(victim, number, folder, whole)]
        process = victim.start(folder)
        _, errors = process.communicate()
        if process.returncode != victim.status:
            problems.append(f"second run: status {process.returncode}, said {errors[-300:]!r}")
        else:
            files = left_files(folder)
            # Files that contain times have no hash in `whole`.
            same = {name: whole.files.get(name) and digest for name, digest in files.items()}
            names = {name for name, _ in same.items() ^ whole.files.items()}
            problems += [f"second run: other file {name}" for name in names]
            problems += [f"second run: left {name}" for name in hidden(folder)]
        return f"{status}{' before the first line' if early else ''}", problems


def leftovers(victim: Victim, number: signal.Signals, folder: Path, whole: Run) -> list[str]:
    """Return the files that a killed command left by mistake."""
    known = {OUT, TEMPORARY, "scene.toml", *PICTURES}
    names = [name for name in os.listdir(folder) if name not in known and name[0] != "."]
    if number is not signal.SIGKILL:  # the next command removes files that SIGKILL leaves
        names += hidden(folder)
    files = left_files(folder)
    if not victim.resumes and files and files.keys() != whole.files.keys():
        names.append(f"a part of {OUT}")
    return names


def hidden(folder: Path) -> list[str]:
    """Return the names of unfinished and of temporary files."""
    paths = [*folder.rglob(".*"), *(folder / TEMPORARY).iterdir()]
    return sorted({path.relative_to(folder).as_posix() for path in paths})


def orphans(folder: Path) -> list[str]:
    """Return the command lines of processes that still run in a folder."""
    until = time.monotonic() + RENDERER_S
    while True:
        alive = []
        for process in Path("/proc").iterdir():
            try:
                if process.name.isdecimal() and (process / "cwd").readlink() == folder:
                    alive.append((process / "cmdline").read_text(errors="replace"))
            except OSError:  # the process belongs to another user, or is gone
                continue
        if not alive or time.monotonic() > until:
            return alive
        time.sleep(0.05)


def main(arguments: list[str] | None = None) -> int:
    """Kill commands, print the table, and return 1 if there are any problems."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kill", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="of each signal, for each command")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--command", action="append", help="name of a victim, such as plate")
    chosen = parser.parse_args(arguments)
    total = 0
    for victim in victims(Path(__file__).resolve().parent):
        if chosen.command is not None and victim.name not in chosen.command:
            continue
        with ThreadPoolExecutor(chosen.jobs) as pool:
            runs = list(pool.map(Run.from_victim, [victim] * max(2, chosen.jobs)))
            whole = undisturbed(runs)
            print(f"{victim.name}: undisturbed {whole.length_s:.1f} s", flush=True)
            for number in ENDS:
                seeds = range(chosen.count)
                tries = [pool.submit(killed, victim, number, seed, whole) for seed in seeds]
                endings = [trial.result() for trial in tries]
                statuses = Counter(status for status, _ in endings)
                problems = Counter(problem for _, some in endings for problem in some)
                counted = ", ".join(f"{status}: {n}" for status, n in sorted(statuses.items()))
                line = f"  {number.name} {len(endings)}: {counted}; problems {dict(problems)}"
                print(line, flush=True)
                total += problems.total()
    print(f"{total} problems")
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
