"""`make kill`: signals at random moments of every command: how it ends, what it leaves, whether it goes on.

Run as `python -m tests.fuzz.kill [--count N] [--jobs J] [--command NAME]`.
"""

from __future__ import annotations

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
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.inputs import SCENE, SHAPE

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
ENDS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
"""Exit status by signal; a command that was done before ends as if there had been none."""

PATIENCE_S = 60.0
"""Seconds that a command may take to end after a signal."""


@dataclass(frozen=True, kw_only=True)
class Victim:
    """A command that is killed.

    Attributes
    ----------
    name
        What it is called here.
    arguments
        Of `xfrustum`, in a folder with the scene.
    statuses
        With which it ends when nobody disturbs it.
    resumes
        Folder that a second run goes on with, and completes to the same bytes; empty where each run is
        complete or leaves nothing.
    output
        What a run that was not killed leaves.
    """

    name: str
    arguments: tuple[str, ...]
    statuses: frozenset[int] = frozenset({0})
    resumes: str = ""
    output: str = ""


def victims(checkout: Path) -> list[Victim]:
    """Return the commands that take long enough to be killed, on a scene that makes them short."""
    renderer = f"{sys.executable} {checkout / 'tests' / 'fuzz' / 'renderer.py'} {{i}} {{j}} {{out}}"
    return [
        Victim(
            name="report",
            arguments=(
                "report",
                "scene.toml",
                "--near",
                "1,0.1",
                "--depth",
                "d24",
                "--out",
                "out",
                "--quiet",
            ),
            output="out",
        ),
        Victim(
            name="plate",
            arguments=("plate", "scene.toml", "--near", "0.1", "--ids", "--out", "out", "--quiet"),
            resumes="out",
            output="out",
        ),
        Victim(
            name="verify",
            arguments=(
                *("verify", "scene.toml", "{i}x{j}.png", "--encoding", "triangle-id", "--quiet"),
                *("--out", "out", "--junit", "out.xml"),
            ),
            statuses=frozenset({1}),
            output="out",
        ),
        Victim(
            name="verify-command",
            arguments=(
                *("verify", "scene.toml", "--encoding", "triangle-id", "--quiet", "--command", renderer),
                *("--out", "out", "--junit", "out.xml"),
            ),
            statuses=frozenset({1}),
            output="out",
        ),
        Victim(
            name="study",
            arguments=("study", "splitting", "--quick", "--out", "out", "--quiet"),
            resumes="out",
            output="out",
        ),
    ]


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How one victim ended."""

    status: int
    sent: bool
    traceback: bool
    lines: int
    leftovers: tuple[str, ...]
    resumed: bool | None


def folder_with_inputs(folder: Path) -> None:
    """Put the scene and some pictures into a folder."""
    from PIL import Image

    (folder / "scene.toml").write_text(SCENE + SHAPE)
    for j in range(2):
        for i in range(3):
            Image.new("RGB", (16, 12), (0, 0, 20 + i + j)).save(folder / f"{i}x{j}.png")


def command_line(victim: Victim) -> list[str]:
    """Return the victim's own command line."""
    return [sys.executable, "-m", "xfrustum", *victim.arguments]


def undisturbed(victim: Victim) -> tuple[float, dict[str, str]]:
    """Return how long a victim takes, and the hashes of what it leaves."""
    with tempfile.TemporaryDirectory(prefix="kill-") as name:
        folder = Path(name)
        folder_with_inputs(folder)
        start = time.monotonic()
        done = subprocess.run(command_line(victim), cwd=folder, capture_output=True, check=False)
        if done.returncode not in victim.statuses:
            raise RuntimeError(f"{victim.name} ended with {done.returncode}: {done.stderr.decode()[-500:]}")
        return time.monotonic() - start, hashes(folder / victim.output)


def hashes(folder: Path) -> dict[str, str]:
    """Return the hash of every file below a folder, by its name; measured times make some differ."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
    }


def killed(
    victim: Victim, number: signal.Signals, seed: int, length_s: float, whole: dict[str, str]
) -> Ending:
    """Kill a victim at a moment that the seed decides, and look at what is left."""
    moment = random.Random(f"{victim.name} {number} {seed}").uniform(0.0, length_s)
    with tempfile.TemporaryDirectory(prefix="kill-") as name:
        folder = Path(name)
        folder_with_inputs(folder)
        before = set(os.listdir(folder))
        # A shell's background job ignores SIGINT, and so would the child: it begins as in the foreground.
        process = subprocess.Popen(
            command_line(victim),
            cwd=folder,
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_default_signals,  # noqa: PLW1509 - it takes no lock
        )
        time.sleep(moment)
        sent = process.poll() is None
        if sent:
            process.send_signal(number)
        try:
            _, told = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            _, told = process.communicate()
        return Ending(
            status=process.returncode,
            sent=sent,
            traceback=b"Traceback" in told,
            lines=len([line for line in told.splitlines() if line.strip()]),
            leftovers=_leftovers(victim, folder, before, process.returncode, number),
            resumed=_resumed(victim, folder, whole),
        )


def _default_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)


def _leftovers(
    victim: Victim, folder: Path, before: set[str], status: int, number: signal.Signals
) -> tuple[str, ...]:
    """Return what nobody should find; what SIGKILL leaves hidden, the next run removes."""
    left = set(os.listdir(folder)) - before
    if status in victim.statuses or victim.resumes:
        left -= {"out", "out.xml"}
    if number is signal.SIGKILL:
        left = {name for name in left if not name.startswith(".")}
    return tuple(sorted(left))


def _resumed(victim: Victim, folder: Path, whole: dict[str, str]) -> bool | None:
    """Return whether a second run completes what is there, and leaves nothing hidden."""
    done = subprocess.run(command_line(victim), cwd=folder, capture_output=True, check=False)
    hidden = [name for name in os.listdir(folder) if name.startswith(".")]
    complete = done.returncode in victim.statuses and not hidden
    if not victim.resumes or victim.name == "study":  # whose measurements are times, too
        return complete and set(hashes(folder / victim.output)) >= set(whole)
    return complete and hashes(folder / victim.output) == whole


def main(arguments: list[str] | None = None) -> int:
    """Kill, print the table, and return 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kill", description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="of each signal, for each command")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--command", action="append")
    chosen = parser.parse_args(arguments)
    found = 0
    for victim in victims(Path(__file__).resolve().parents[2]):
        if chosen.command is None or victim.name in chosen.command:
            found += sum(1 for _ in _tried(victim, chosen.count, chosen.jobs))
    return int(found > 0)


def _tried(victim: Victim, count: int, jobs: int) -> Iterator[str]:
    """Kill one victim with every signal; print a line for each, and yield what was found."""
    length_s, whole = undisturbed(victim)
    for number in SIGNALS:
        with ThreadPoolExecutor(jobs) as pool:
            endings = list(
                pool.map(lambda seed: killed(victim, number, seed, length_s, whole), range(count))  # noqa: B023
            )
        counts = Counter(str(ending.status) for ending in endings)
        wrong = [problem for ending in endings for problem in _problems(victim, number, ending)]
        resumed = sum(ending.resumed is True for ending in endings)
        told = ", ".join(f"{status}: {n}" for status, n in sorted(counts.items()))
        sent = sum(ending.sent for ending in endings)
        print(
            f"{victim.name} {number.name}: {count} runs, {sent} hit; statuses {told}; "
            f"{resumed} resumed or ran again; {len(wrong)} problems {dict(Counter(wrong)) or ''}",
            flush=True,
        )
        yield from wrong


def _problems(victim: Victim, number: signal.Signals, ending: Ending) -> Iterator[str]:
    if ending.status not in {ENDS[number], *victim.statuses}:
        yield f"status {ending.status}"
    if ending.traceback:
        yield "traceback"
    elif ending.lines > 1:
        yield "more than one line"
    if ending.leftovers:
        yield f"left {', '.join(ending.leftovers)}"
    if ending.resumed is False:
        yield "second run"


if __name__ == "__main__":
    raise SystemExit(main())
