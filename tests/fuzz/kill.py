"""`make kill`: signals at random moments of every command: how it ends, what it leaves, whether it goes on.

Run as `python -m tests.fuzz.kill [--count N] [--jobs J] [--command NAME]`. Moments are spread over
the whole life of the process. Those before the program's first line, while Python starts, are
counted apart: there nobody can answer a signal yet.
"""

import argparse
import hashlib
import json
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

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
#: Exit status by signal; a command that is done before the signal ends as if there had been none.
ENDS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
WORDS = {signal.SIGINT: b"xfrustum: interrupted\n", signal.SIGTERM: b"xfrustum: terminated\n"}

PATIENCE_S = 60.0  # seconds that a command may take to end after a signal
RENDERER_S = (
    10.0  # within which a renderer ends by itself if the program that should end it was killed
)

TEMPORARY = "temporary"  # name of the folder for temporary files, which commands must empty as well
OUT = "out"  # name of the folder that commands write
PICTURES = {f"{i}x{j}.png": (0, 0, 20 + i + j) for i in range(3) for j in range(2)}


@dataclass(frozen=True, kw_only=True)
class Run:
    """The outcome of runs of a victim that were not killed."""

    length_s: float  #: seconds of the longest
    told: bytes  #: text on standard error
    files: Mapping[
        str, str
    ]  #: hash of each by its name; empty for one that differs, because it has times


@dataclass(frozen=True, kw_only=True)
class Victim:
    """A command that is killed: arguments of Python, and the exit status of a run that is not killed.

    What a killed run leaves is kept and a second run goes on with it where it resumes; else the
    folder is whole or absent.
    """

    name: str
    arguments: tuple[str, ...]
    status: int = 0
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
            preexec_fn=signals_by_default,  # noqa: PLW1509 - it takes no lock
        )

    def run(self) -> Run:
        """Run the command to its end without killing it."""
        with workplace() as folder:
            begun = time.monotonic()
            process = self.start(folder)
            _, told = process.communicate()
            if process.returncode != self.status:
                raise RuntimeError(
                    f"{self.name} ended with {process.returncode}: {told.decode()[-500:]}"
                )
            return Run(length_s=time.monotonic() - begun, told=told, files=left_files(folder))


def victims(fuzz: Path) -> list[Victim]:
    """Return the commands that take long enough to be killed, on a scene that makes them short."""
    renderer = f"{sys.executable} {fuzz / 'renderer.py'} {{i}} {{j}} {{out}}"
    outputs = ("--quiet", "--out", OUT)
    xfrustum = ("-m", "xfrustum")
    report = (*xfrustum, "report", "scene.toml", "--near", "1,0.1", "--depth", "d24")
    plate = (*xfrustum, "plate", "scene.toml", "--near", "0.1", "--ids", "--block", "1x1", "--json")
    verify = (
        *xfrustum,
        "verify",
        "scene.toml",
        "--encoding",
        "triangle-id",
        "--apertures",
        "0,0;1,0;2,1",
    )
    return [
        Victim(name="report", arguments=(*report, *outputs)),
        Victim(name="plate", arguments=(*plate, *outputs), resumes=True),
        Victim(name="verify", arguments=(*verify, "{i}x{j}.png", *outputs), status=1),
        Victim(
            name="verify-command", arguments=(*verify, "--command", renderer, *outputs), status=1
        ),
        Victim(
            name="study",
            arguments=(str(fuzz / "small_study.py"), "study", "small", OUT),
            resumes=True,
        ),
    ]


@contextmanager
def workplace() -> Iterator[Path]:
    """Give a folder with the scene, some pictures, and an empty folder for temporary files."""
    with tempfile.TemporaryDirectory(prefix="kill-") as name:
        folder = Path(name).resolve()
        (folder / "scene.toml").write_text(SCENE + SHAPE)
        (folder / TEMPORARY).mkdir()
        for picture, color in PICTURES.items():
            Image.new("RGB", (16, 12), color).save(folder / picture)
        yield folder


def undisturbed(runs: list[Run]) -> Run:
    """Return the common outcome of some runs that were not killed."""
    first = runs[0]
    if any(run.files.keys() != first.files.keys() or run.told != first.told for run in runs):
        raise RuntimeError("two undisturbed runs leave other files, or say something else")
    same = {n: h if all(run.files[n] == h for run in runs) else "" for n, h in first.files.items()}
    return Run(length_s=max(run.length_s for run in runs), told=first.told, files=same)


def left_files(folder: Path) -> dict[str, str]:
    """Return the hash of every file of a command's output, by name."""
    found = [path for path in sorted((folder / OUT).rglob("*")) if path.is_file()]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in found
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


def killed(victim: Victim, number: signal.Signals, seed: int, whole: Run) -> tuple[str, list[str]]:
    """Kill a victim at a moment that the seed decides; return its exit status and what is wrong."""
    wanted_s = random.Random(f"{victim.name} {number} {seed}").uniform(0.0, whole.length_s)
    with workplace() as folder:
        process = victim.start(folder)
        time.sleep(wanted_s)
        early = process.poll() is None and not answers(process.pid)
        if process.poll() is None:
            process.send_signal(number)
        try:
            _, told = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            _, told = process.communicate()
        wrong, status = [], process.returncode
        if early:
            # Python itself ends by the signal, or with its own traceback after Ctrl-C; Ctrl-C while
            # it starts itself, before any line of ours, is a fatal error of Python with status 1.
            unborn = (
                number is signal.SIGINT
                and status == 1
                and told.startswith(b"Fatal Python error: init_")
            )
            if not unborn and status not in {-number, ENDS[number], victim.status}:
                wrong.append(f"status {status} before the first line")
        elif status == ENDS[number]:
            if number in WORDS and told.removeprefix(whole.told) != WORDS[number]:
                wrong.append(f"said {told[-300:]!r}")
        elif status != victim.status or told != whole.told:
            wrong.append(f"status {status}, said {told[-300:]!r}")
        wrong += [f"lives on: {one}" for one in _orphans(folder, number is signal.SIGKILL)]
        left, hidden = list(_left(victim, folder, whole)), _hidden(folder)
        wrong += [
            f"left {one}" for one in (*left, *(hidden if number is not signal.SIGKILL else ()))
        ]
        # A folder without any files is what a first run finds, too.
        if left or hidden or left_files(folder):
            wrong += [f"second run: {one}" for one in _again(victim, folder, whole)]
        return f"{status}{' before the first line' if early else ''}", wrong


def _left(victim: Victim, folder: Path, whole: Run) -> Iterator[str]:
    """Yield the names of files in sight that a killed command left neither whole nor absent."""
    expected = {OUT, TEMPORARY, "scene.toml", *PICTURES}
    yield from sorted(
        name for name in os.listdir(folder) if name not in expected and name[0] != "."
    )
    yield from (f"{TEMPORARY}/{name}" for name in os.listdir(folder / TEMPORARY) if name[0] != ".")
    if victim.resumes:
        return
    found = left_files(folder)
    for name, content in whole.files.items() if (folder / OUT).exists() else ():
        if not (name in found and content in ("", found[name]) and _is_whole(folder / name)):
            yield f"{OUT} without a whole {name}"


def _is_whole(path: Path) -> bool:
    """Return whether a file whose bytes differ from run to run has its end."""
    if not path.is_file():
        return False
    if path.suffix == ".json":
        return bool(json.loads(path.read_bytes()))
    ends = {".html": b"</html>", ".parquet": b"PAR1"}
    return path.stat().st_size > 0 and path.read_bytes().rstrip().endswith(
        ends.get(path.suffix, b"")
    )


def _hidden(folder: Path) -> list[str]:
    """Return the names of unfinished files, which begin with a dot."""
    return [path.relative_to(folder).as_posix() for path in sorted(folder.rglob(".*"))]


def _again(victim: Victim, folder: Path, whole: Run) -> Iterator[str]:
    """Run a victim again, to its end, and yield what is wrong with the result."""
    chunks, blocks = folder / OUT / "color" / "c", folder / OUT / "blocks"
    # Hogels of a plate are finished when they have a color, which is written last.
    finished = sum(path.is_file() for path in chunks.rglob("*")) if chunks.is_dir() else 0
    measured = {path: path.stat().st_mtime_ns for path in blocks.glob("*.parquet")}
    process = victim.start(folder)
    printed, told = process.communicate()
    if process.returncode != victim.status:
        yield f"status {process.returncode}, said {told[-300:]!r}"
        return
    files = left_files(folder)
    yield from (f"leaves {name}" for name in (*_hidden(folder), *os.listdir(folder / TEMPORARY)))
    yield from (f"other file {name}" for name in files.keys() ^ whole.files.keys())
    other = [
        name for name, content in whole.files.items() if content and files.get(name) != content
    ]
    yield from (f"other content {name}" for name in other)
    yield from (f"broken file {name}" for name in files if not _is_whole(folder / name))
    if victim.name == "plate" and json.loads(printed)["found"] != finished:
        yield f"found {json.loads(printed)['found']} of {finished} hogels"
    twice = sum(
        not path.exists() or path.stat().st_mtime_ns != when for path, when in measured.items()
    )
    if twice:
        yield f"{twice} blocks are lost or measured twice"


def _orphans(folder: Path, patient: bool) -> list[str]:
    """Return the command lines of processes that live on in a folder."""
    until = time.monotonic() + (RENDERER_S if patient else 0.0)
    while True:
        alive = []
        for process in Path("/proc").iterdir():
            try:
                if process.name.isdecimal() and (process / "cwd").readlink() == folder:
                    words = (process / "cmdline").read_bytes().replace(b"\0", b" ")
                    alive.append(words.decode(errors="replace"))
            except OSError:  # the process belongs to another user, or is gone
                continue
        if not alive or time.monotonic() > until:
            return alive
        time.sleep(0.05)


def main(arguments: list[str] | None = None) -> int:
    """Kill, print the table, and return 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kill", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="of each signal, for each command")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--command", action="append", help="report, plate, verify, verify-command or study"
    )
    chosen = parser.parse_args(arguments)
    found = 0
    for victim in victims(Path(__file__).resolve().parent):
        if chosen.command is not None and victim.name not in chosen.command:
            continue
        with ThreadPoolExecutor(chosen.jobs) as pool:
            # At least two, to find which output is always the same.
            runs = [pool.submit(victim.run) for _ in range(max(2, chosen.jobs))]
            whole = undisturbed([run.result() for run in runs])
            print(f"{victim.name}: undisturbed {whole.length_s:.1f} s", flush=True)
            for number in SIGNALS:
                kills = [
                    pool.submit(killed, victim, number, seed, whole) for seed in range(chosen.count)
                ]
                endings = [kill.result() for kill in kills]
                statuses = Counter(status for status, _ in endings)
                wrong = Counter(problem for _, problems in endings for problem in problems)
                told = ", ".join(f"{status}: {count}" for status, count in sorted(statuses.items()))
                print(
                    f"  {number.name} {len(endings)}: statuses {told}; problems {dict(wrong)}",
                    flush=True,
                )
                found += wrong.total()
    print(f"{found} problems")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
