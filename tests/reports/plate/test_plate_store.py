"""A plate that several processes make, and one that something has damaged."""

import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, finished, small, tree
from tests.support.long_tail import thinned
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.reports.blocks import Engine
from xfrustum.reports.plate import store as plate_store
from xfrustum.reports.plate.plate import PlateFiles, layout_of, source_of, write_plate
from xfrustum.reports.plate.store import open_store
from xfrustum.scenes import InputError

CHUNK = {"triangle": "triangle/c/2/3/0/0", "color": "color/c/2/3/0/0/0"}  # chunks of column 3, row 2


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate that nobody disturbed."""
    out = tmp_path_factory.mktemp("clean") / "x.zarr"
    return write_plate(small(), SETTINGS, str(out), content=EVERYTHING, block=(1, 1)).out


@pytest.fixture
def plate(clean: Path, tmp_path: Path) -> Path:
    """A copy to be damaged."""
    return Path(shutil.copytree(clean, tmp_path / "x.zarr"))


def drawn_again(plate: Path, *, check: bool = False) -> PlateFiles:
    return write_plate(small(), SETTINGS, plate, content=EVERYTHING, check=check)


def replaced_by_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def replaced_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def flipped(path: Path) -> None:
    """Change one bit near the end, where it changes pixels and no length."""
    data = bytearray(path.read_bytes())
    data[-8] ^= 1
    path.write_bytes(data)


CHUNK_DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "something else": lambda path: path.write_bytes(b"something else" * 20),
    "a bit": flipped,
    "a link": replaced_by_link,
    "a pipe": replaced_by_pipe,
    "gone": Path.unlink,
}


@pytest.mark.parametrize("name", ["triangle", "color"])
def test_damaged_chunks_are_drawn_again(name: str, plate: Path, clean: Path) -> None:
    """Chunks have checksums: no change of a bit goes unnoticed where all is read; what is gone always is."""
    array, _, place = CHUNK[name].partition("/c/2/3")
    for number, damage in enumerate(CHUNK_DAMAGE.values()):
        damage(plate / f"{array}/c/{number // 7}/{number % 7}{place}")
    gone = drawn_again(plate)
    assert (gone.drawn, gone.found, gone.damaged, gone.notes) == (3, 32, 0, ())
    files = drawn_again(plate, check=True)
    assert (files.drawn, files.found, files.damaged) == (5, 30, 5)
    assert files.notes == (f"{plate}: 5 damaged hogels were drawn again",)
    assert tree(plate) == tree(clean)
    assert drawn_again(plate, check=True).drawn == 0


def test_several_processes_draw_damaged_hogels_again(plate: Path, clean: Path) -> None:
    flipped(plate / CHUNK["color"])
    files = write_plate(
        small(), SETTINGS, plate, content=EVERYTHING, block=(1, 1), check=True, engine=Engine(workers=2)
    )
    assert files.damaged == 1 and tree(plate) == tree(clean)


def test_what_is_in_the_way_ends_in_one_line(plate: Path) -> None:
    chunk = plate / CHUNK["color"]
    shutil.rmtree(chunk.parents[1])
    chunk.parents[1].write_text("a file")
    with pytest.raises(InputError, match="cannot write there"):
        drawn_again(plate)


METADATA_DAMAGE: dict[str, Callable[[dict[str, Any]], object]] = {
    "a shape of 10^12": lambda said: said.update(shape=[10**6, 10**6, 12, 20, 3]),
    "another shape": lambda said: said["shape"].reverse(),
    "chunks of 10^12": lambda said: said["chunk_grid"]["configuration"].update(chunk_shape=[10**12] * 5),
    "another type": lambda said: said.update(data_type="float64"),
    "no codecs": lambda said: said.update(codecs=[]),
    "unknown codecs": lambda said: said.update(codecs=[{"name": "unknown"}]),
    "another place for chunks": lambda said: said.update(chunk_key_encoding={"name": "v2"}),
    "nothing": lambda said: said.clear(),
}


@pytest.mark.parametrize("damage", thinned(METADATA_DAMAGE, 3))
def test_descriptions_of_an_array_are_never_believed(damage: str, plate: Path, clean: Path) -> None:
    """That in the array's folder is not read; that in the group, which is, is refused where it is damaged."""
    said = json.loads((plate / "color/zarr.json").read_bytes())
    METADATA_DAMAGE[damage](said)
    (plate / "color/zarr.json").write_text(json.dumps(said))
    (plate / CHUNK["color"]).unlink()
    assert drawn_again(plate).drawn == 1
    assert (plate / CHUNK["color"]).read_bytes() == (clean / CHUNK["color"]).read_bytes()
    said = json.loads((plate / "zarr.json").read_bytes())
    METADATA_DAMAGE[damage](said["consolidated_metadata"]["metadata"]["color"])
    (plate / "zarr.json").write_text(json.dumps(said))
    before = tree(plate)
    with pytest.raises(InputError):
        drawn_again(plate)
    assert tree(plate) == before


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"\xff", b"1" * 5000, b"{}" + b" " * (1 << 21)]
)
def test_descriptions_that_are_none_are_refused(content: bytes, plate: Path) -> None:
    (plate / "zarr.json").write_bytes(content)
    with pytest.raises(InputError, match="is no plate of xfrustum"):
        drawn_again(plate)


@pytest.mark.parametrize("replaced", [replaced_by_link, replaced_by_pipe])
def test_what_is_no_file_is_no_description(replaced: Callable[[Path], None], plate: Path) -> None:
    replaced(plate / "zarr.json")
    with pytest.raises(InputError, match="is no plate of xfrustum"):
        drawn_again(plate)


def test_a_scene_that_was_moved_with_its_plate_is_gone_on_with(plate: Path, clean: Path) -> None:
    chunk = plate / CHUNK["color"]
    whole = chunk.read_bytes()
    chunk.unlink()
    moved = replace(small(), source="/somewhere/else/scene.toml")
    files = write_plate(moved, SETTINGS, plate, content=EVERYTHING)
    assert (files.drawn, files.notes) == (1, ())
    assert chunk.read_bytes() == whole
    assert tree(plate) == tree(clean)  # it goes on saying where the scene was when the plate was made


def test_a_plate_that_appears_while_another_is_being_made_is_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clean: Path
) -> None:
    """Two processes that start at once on a new plate: neither takes the other's away."""
    out = tmp_path / "x.zarr"
    others: list[PlateFiles] = []
    make = plate_store._make

    def overtaken(*arguments: Any) -> None:
        monkeypatch.setattr(plate_store, "_make", make)
        apertures = [small().plate.aperture(column, 2) for column in range(7)]
        others.append(write_plate(small(), SETTINGS, out, apertures, EVERYTHING, block=(1, 1)))
        make(*arguments)

    monkeypatch.setattr(plate_store, "_make", overtaken)
    files = drawn_again(out)
    assert others[0].drawn == 7
    assert (files.drawn, files.found) == (28, 7)
    assert tree(out) == tree(clean)
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def test_what_killed_processes_left_is_removed_unless_somebody_writes(plate: Path, clean: Path) -> None:
    left = (plate / CHUNK["color"]).with_suffix(".5f.partial")
    left.write_bytes(b"half")
    with (plate / "zarr.json").open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        assert drawn_again(plate).drawn == 0 and left.exists()
    assert drawn_again(plate).drawn == 0
    assert tree(plate) == tree(clean)


def test_two_writers_of_one_block_lose_nothing(tmp_path: Path) -> None:
    """Each has opened the plate before the other has written, and knows nothing of its hogels."""
    scene, out = small(), tmp_path / "x.zarr"
    write_plate(scene, SETTINGS, out, [scene.plate.aperture(6, 4)], EVERYTHING, block=(7, 5))
    with source_of(scene, SETTINGS, EVERYTHING) as source:
        layout = layout_of(scene, EVERYTHING, (7, 5))
        stores = [open_store(out, layout, source.description, free=False) for _ in range(8)]
        (block,) = stores[0].layout.blocks(scene.plate.apertures())
        drawn = list(source.hogels(scene.plate.apertures()))
    writing = []
    with ThreadPoolExecutor(8) as pool:
        for number, store in enumerate(stores):
            writing.append(pool.submit(store.write, block, {one.aperture: one for one in drawn[number:34:8]}))
    for one in writing:
        one.result()
    assert stores[0].missing(block, check=True) == ((), 0)
    whole = write_plate(scene, SETTINGS, tmp_path / "whole.zarr", content=EVERYTHING, block=(7, 5)).out
    assert tree(out) == tree(whole)


@pytest.mark.slow
def test_a_killed_worker_changes_no_byte_of_a_plate(tmp_path: Path) -> None:
    path, out = tmp_path / "boxes.toml", tmp_path / "killed.zarr"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes") + film((40, 32), (7, 5), (16, 16), (60, 60), (60, 60)) + objects)
    words = ["plate", str(path), "--near", "0.5", "--ids", "--block", "1x1", "--quiet"]
    assert main([*words, "--out", str(tmp_path / "one.zarr")]) == 0
    command = [sys.executable, "-m", "xfrustum", *words, "--out", str(out), "--workers", "2"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as run:
        while not finished(out) and run.poll() is None:
            time.sleep(0.01)
        psutil.Process(run.pid).children()[0].kill()
    assert run.returncode == 0
    assert tree(out) == tree(tmp_path / "one.zarr")
