"""The killing of one victim: the moment, the signal, the files that it leaves, and a second run."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from tests.fuzz.victims import (
    JUNIT,
    OUT,
    TEMPORARY,
    Run,
    Victim,
    answers,
    left_files,
    plate_counts,
    workplace,
)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
ENDS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
"""Exit status by signal; a command that is done before the signal ends as if there had been none."""

WORDS = {signal.SIGINT: b"xfrustum: interrupted\n", signal.SIGTERM: b"xfrustum: terminated\n"}

PATIENCE_S = 60.0
"""Seconds that a command may take to end after a signal."""

RENDERER_S = 10.0
"""Seconds within which a renderer ends by itself if the program that should end it was killed."""


@dataclass(frozen=True, kw_only=True)
class Ending:
    """The end of one victim."""

    moment_s: float  #: Time from the start of the process to the signal, seconds
    #: sent, early: Whether the victim was still running then; and whether Python had not reached the program
    #: yet
    sent: bool
    early: bool
    #: status, told, lasted_s: Exit status, standard error, and seconds from the signal to the end
    status: int
    told: bytes
    lasted_s: float
    children: int  #: Number of the victim's child processes when the signal came
    orphans: tuple[str, ...]  #: Command lines of child processes that live on
    left: tuple[str, ...]  #: Names of files in sight that are neither whole nor absent
    hidden: tuple[str, ...]  #: Names of files that the next run removes
    #: Words for what is wrong with a second run, empty if it is complete; None without a second run
    again: str | None


def killed(victim: Victim, number: signal.Signals, seed: int, whole: Run) -> Ending:
    """Kill a victim at a moment that the seed decides, and examine the files that are left."""
    wanted_s = random.Random(f"{victim.name} {number} {seed}").uniform(0.0, whole.length_s)
    with workplace() as folder:
        begun = time.monotonic()
        process = victim.start(folder)
        time.sleep(max(0.0, begun + wanted_s - time.monotonic()))
        sent, early, children = process.poll() is None, not answers(process.pid), _children(process.pid)
        moment = time.monotonic()
        if sent:
            process.send_signal(number)
        try:
            _, told = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            _, told = process.communicate()
        lasted_s = time.monotonic() - moment
        orphans = tuple(_orphans(folder, RENDERER_S if number is signal.SIGKILL else 0.0))
        left = tuple(_left(victim, folder, whole))
        hidden = tuple(_hidden(folder))
        # A folder without any files is what a first run finds, too.
        untouched = not left and not hidden and not left_files(folder)
        return Ending(
            moment_s=moment - begun,
            sent=sent,
            early=sent and early,
            status=process.returncode,
            told=told,
            lasted_s=lasted_s if sent else 0.0,
            children=children,
            orphans=orphans,
            left=left,
            hidden=hidden,
            again=None if untouched else _again(victim, folder, whole),
        )


def problems(victim: Victim, number: signal.Signals, ending: Ending, whole: Run) -> Iterator[str]:
    """Yield what is wrong with an ending."""
    if ending.early:
        # Python itself ends by the signal, or with its own traceback after Ctrl-C.
        if ending.status not in {-number, ENDS[number], victim.status}:
            yield f"status {ending.status} before the first line"
    elif ending.status == ENDS[number]:
        if number in WORDS and ending.told.removeprefix(whole.told) != WORDS[number]:
            yield f"said {ending.told[-300:]!r}"
    elif ending.status != victim.status:
        yield f"status {ending.status}, said {ending.told[-300:]!r}"
    elif ending.told != whole.told:
        yield f"done, and said {ending.told[-300:]!r}"
    if ending.orphans:
        yield f"a process lives on: {ending.orphans}"
    if ending.left:
        yield f"left {', '.join(ending.left)}"
    if ending.hidden and number is not signal.SIGKILL:
        yield f"left hidden {', '.join(ending.hidden)}"
    if ending.again:
        yield f"second run: {ending.again}"


def _left(victim: Victim, folder: Path, whole: Run) -> Iterator[str]:
    """Yield the names of files in sight that a killed command left neither whole nor absent."""
    expected = {
        OUT,
        JUNIT,
        TEMPORARY,
        "scene.toml",
        *(f"{i}x{j}.png" for i in range(3) for j in range(2)),
    }
    yield from sorted(name for name in os.listdir(folder) if name not in expected and name[0] != ".")
    yield from (f"{TEMPORARY}/{name}" for name in os.listdir(folder / TEMPORARY) if name[0] != ".")
    if victim.resumes:
        return
    found = left_files(folder)
    if (folder / OUT).exists():
        for name in sorted(name for name in whole.files if name != JUNIT):
            if (
                name not in found
                or not _is_whole(folder / name)
                or found[name] != (whole.files[name] or found[name])
            ):
                yield f"{OUT} without a whole {name}"
    if JUNIT in found and found[JUNIT] != whole.files[JUNIT]:
        yield f"part of {JUNIT}"


def _is_whole(path: Path) -> bool:
    """Return whether a file whose bytes differ from run to run has its end."""
    if path.suffix == ".json":
        return bool(json.loads(path.read_bytes()))
    if path.suffix == ".html":
        return path.read_bytes().rstrip().endswith(b"</html>")
    if path.suffix == ".parquet":
        return path.read_bytes()[-4:] == b"PAR1"
    if path.suffix == ".xml":
        return bool(len(ElementTree.parse(path).getroot()))
    return path.stat().st_size > 0


def _hidden(folder: Path) -> Iterator[str]:
    """Yield the names of unfinished files, which begin with a dot, and of SQLite's journals."""
    for path in sorted(folder.rglob("*")):
        if path.name[0] == "." or path.name.endswith(("-journal", "-wal", "-shm")):
            yield path.relative_to(folder).as_posix()


def _again(victim: Victim, folder: Path, whole: Run) -> str:
    """Run a victim again, to its end, and return words for what is wrong with the result."""
    found_before, measured = _finished(folder), _measured(folder)
    process = victim.start(folder)
    printed, told = process.communicate()
    if process.returncode != victim.status:
        return f"status {process.returncode}, said {told[-300:]!r}"
    hidden = list(_hidden(folder))
    if hidden or os.listdir(folder / TEMPORARY):
        return f"leaves {hidden or os.listdir(folder / TEMPORARY)}"
    files = left_files(folder)
    other = sorted(
        name for name, content in whole.files.items() if files.get(name) not in {content} and content
    )
    if files.keys() != whole.files.keys() or other:
        return f"other files: {other or sorted(files.keys() ^ whole.files.keys())}"
    broken = [name for name in files if not _is_whole(folder / name)]
    if broken:
        return f"broken files: {broken}"
    if victim.name == "plate" and plate_counts(printed)[1] != found_before:
        return f"found {plate_counts(printed)[1]} of {found_before} hogels"
    return _measured_twice(folder, measured)


def _finished(folder: Path) -> int:
    """Return how many hogels of a plate are finished: those with a color, which is written last."""
    chunks = folder / OUT / "color" / "c"
    return sum(path.is_file() for path in chunks.rglob("*")) if chunks.is_dir() else 0


def _measured(folder: Path) -> dict[str, int]:
    """Return the blocks that a study has kept so far, and when each was written."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / OUT / "blocks").glob("*.parquet")}


def _measured_twice(folder: Path, before: dict[str, int]) -> str:
    """Return words for blocks that a study has measured again although they were kept, or has lost."""
    after = _measured(folder)
    twice = sum(after.get(name) != when for name, when in before.items())
    return f"{twice} blocks are lost or measured twice" if twice else ""


def _children(pid: int) -> int:
    """Return how many child processes a process has."""
    try:
        return len(Path(f"/proc/{pid}/task/{pid}/children").read_text().split())
    except OSError:
        return 0


def _orphans(folder: Path, patience_s: float) -> Iterator[str]:
    """Yield the command lines of processes that live on in a folder, after some patience."""
    until = time.monotonic() + patience_s
    while (alive := list(_living(folder))) and time.monotonic() < until:
        time.sleep(0.05)
    yield from alive


def _living(folder: Path) -> Iterator[str]:
    for process in Path("/proc").iterdir():
        if process.name.isdecimal():
            try:
                if (process / "cwd").readlink() == folder:
                    yield (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:  # the process belongs to another user, or is gone
                continue
