"""Surveys on worker processes: the same bytes, whoever is killed, and no process left behind."""

from __future__ import annotations

import json
import random
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from tests.support.processes import signals_by_default
from tests.support.scene_file import film, named, part

LONGEST_WAIT_S = 300


@pytest.fixture(scope="module")
def scene_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes", "mm") + film((40, 32), (9, 7), (48, 48), (60, 60), (60, 60)) + objects)
    return path


def started(scene_path: Path, out: Path, *where: str) -> subprocess.Popen[str]:
    words = ["survey", str(scene_path), "--near", "0.8", "--all", "--out", str(out), "--json"]
    return subprocess.Popen(
        [sys.executable, "-m", "xfrustum", *words, *(where or ("--workers", "2"))],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=signals_by_default,  # noqa: PLW1509 - no thread holds a lock that it needs
    )


def parts_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in out.glob("survey.parquet/part-*")}


def wait_for_parts(out: Path, count: int) -> None:
    end = time.monotonic() + LONGEST_WAIT_S
    while len(list(out.glob("survey.parquet/part-*"))) < count:
        assert time.monotonic() < end
        time.sleep(0.02)


def workers_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return the worker processes of a command; others that it has started hold no scene."""
    with suppress(psutil.NoSuchProcess):
        children = psutil.Process(process.pid).children(recursive=True)
        return [one for one in children if "xfrustum.reports.blocks" in " ".join(one.cmdline())]
    return []


@pytest.fixture(scope="module")
def undisturbed(scene_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed") / "survey"
    run = started(scene_path, out, "--workers", "1")
    printed, _ = run.communicate(timeout=LONGEST_WAIT_S)
    assert run.returncode == 0 and json.loads(printed)["judged"] == 63
    return out


@pytest.mark.slow
def test_workers_make_the_same_bytes_as_one_process_however_many_are_killed(
    scene_path: Path, undisturbed: Path, tmp_path: Path
) -> None:
    out, chance = tmp_path / "survey", random.Random(3)
    kills: list[int] = []
    run = started(scene_path, out)

    def kill_at_random() -> None:
        seen = 0
        while run.poll() is None and len(kills) < 20:
            time.sleep(chance.uniform(0.1, 1.0))
            some, finished = workers_of(run), len(parts_of(out))
            # Workers are at work, and not all starting, where blocks have been finished since the last kill.
            if some and finished > seen:
                with suppress(psutil.NoSuchProcess):
                    chance.choice(some).kill()
                    kills.append(1)
                    seen = finished

    wait_for_parts(out, 1)
    killer = threading.Thread(target=kill_at_random)
    killer.start()
    printed, errors = run.communicate(timeout=LONGEST_WAIT_S)
    killer.join()
    assert run.returncode == 0, errors
    assert kills
    assert json.loads(printed)["workers"] == 2
    assert parts_of(out) == parts_of(undisturbed)
    assert (out / "index.html").read_bytes() == (undisturbed / "index.html").read_bytes()
