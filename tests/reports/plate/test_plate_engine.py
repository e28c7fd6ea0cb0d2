"""Plates drawn on the engine have the bytes of those that one process draws alone."""

import random
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, open_scene
from xfrustum.cli.main import main
from xfrustum.reports.blocks import Engine
from xfrustum.reports.plate.plate import write_plate
from xfrustum.scenes.model.plate_content import PlateContent


@pytest.fixture(scope="module")
def scene_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes") + film((40, 32), (7, 5), (16, 16), (60, 60), (60, 60)) + objects)
    return path


def drawn(scene_path: Path, out: Path, *more: str) -> dict[str, bytes]:
    words = ["plate", str(scene_path), "--near", "0.5", "--ids", "--block", "2x2", "--quiet"]
    assert main([*words, "--out", str(out), *more]) == 0
    return files_of(out)


def files_of(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def alone(scene_path: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return drawn(scene_path, tmp_path_factory.mktemp("alone") / "x.zarr")


def test_parts_of_a_job_array_make_the_plate_between_them(
    scene_path: Path, alone: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "x.zarr"
    assert drawn(scene_path, out, "--part", "2/2") != alone
    assert drawn(scene_path, out, "--part", "1/2") == alone


@pytest.mark.slow
def test_workers_draw_a_scene_that_was_made_in_memory(
    scene_path: Path, alone: dict[str, bytes], tmp_path: Path
) -> None:
    scene = replace(open_scene(scene_path), source="")
    found = write_plate(
        scene,
        DoubleFrustum(near=0.5),
        tmp_path / "x.zarr",
        content=PlateContent(ids=True),
        block=(2, 2),
        engine=Engine(workers=2),
    )
    assert (found.drawn, found.found) == (35, 0)
    shards = {name for name in alone if not name.endswith("zarr.json")}
    drawn = files_of(tmp_path / "x.zarr")
    assert {name: drawn[name] for name in shards} == {name: alone[name] for name in shards}


@pytest.mark.slow
def test_killed_workers_change_no_byte_of_a_plate(
    scene_path: Path, alone: dict[str, bytes], tmp_path: Path
) -> None:
    out, chance, kills = tmp_path / "x.zarr", random.Random(5), 0
    words = ["plate", str(scene_path), "--near", "0.5", "--ids", "--block", "2x2", "--out", str(out)]
    run = subprocess.Popen(
        [sys.executable, "-m", "xfrustum", *words, "--workers", "2"], stderr=subprocess.PIPE
    )
    while run.poll() is None:
        with suppress(psutil.NoSuchProcess):
            workers = psutil.Process(run.pid).children()
            if out.exists() and workers and kills < 20:
                chance.choice(workers).kill()
                kills += 1
        time.sleep(chance.uniform(0.5, 4.0))
    assert run.returncode == 0
    assert kills
    assert files_of(out) == alone


@pytest.mark.slow
def test_workers_make_the_same_plate(scene_path: Path, alone: dict[str, bytes], tmp_path: Path) -> None:
    assert drawn(scene_path, tmp_path / "x.zarr", "--workers", "2") == alone
