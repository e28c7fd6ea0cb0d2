"""A plate that several processes make, and one that something has damaged."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, small, tree
from xfrustum.cli.main import main
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.plate import store as plate_store
from xfrustum.reports.plate.chunks import is_whole
from xfrustum.reports.plate.plate import PlateFiles, write_plate
from xfrustum.scenes import InputError

CHUNK = {"triangle": "triangle/c/2/3/0/0", "color": "color/c/2/3/0/0/0"}
"""Chunks of column 3, row 2."""


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


def replaced_by_folder(path: Path) -> None:
    path.unlink()
    (path / "folder").mkdir(parents=True)
    (path / "file").write_text("in it")


def replaced_by_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def replaced_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def parent_replaced_by_file(path: Path) -> None:
    shutil.rmtree(path.parents[1])
    path.parents[1].write_text("a file")


def flipped(path: Path) -> None:
    """Change one bit near the end, where it changes pixels and no length."""
    data = bytearray(path.read_bytes())
    data[-8] ^= 1
    path.write_bytes(data)


CHUNK_DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "cut off in its header": lambda path: path.write_bytes(path.read_bytes()[:5]),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "too long": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "something else": lambda path: path.write_bytes(b"something else" * 20),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "a folder": replaced_by_folder,
    "a link": replaced_by_link,
    "a pipe": replaced_by_pipe,
}


@pytest.mark.parametrize("name", ["triangle", "color"])
@pytest.mark.parametrize("damage", CHUNK_DAMAGE)
def test_a_damaged_chunk_is_drawn_again(name: str, damage: str, plate: Path, clean: Path) -> None:
    CHUNK_DAMAGE[damage](plate / CHUNK[name])
    files = drawn_again(plate)
    assert (files.drawn, files.found, files.damaged) == (1, 34, 1)
    assert files.notes == (f"{plate}: 1 hogel was damaged, and drawn again",)
    assert tree(plate) == tree(clean)


def test_a_file_where_chunks_have_their_folder_gives_way(plate: Path, clean: Path) -> None:
    parent_replaced_by_file(plate / CHUNK["color"])
    assert drawn_again(plate).drawn == 1
    assert tree(plate) == tree(clean)


def test_a_missing_chunk_is_no_damage(plate: Path) -> None:
    (plate / CHUNK["color"]).unlink()
    files = drawn_again(plate)
    assert (files.drawn, files.damaged, files.notes) == (1, 0, ())


def test_pixels_that_changed_are_found_where_all_is_read(plate: Path, clean: Path) -> None:
    """Chunks have checksums: no change of a bit goes unnoticed."""
    flipped(plate / CHUNK["color"])
    assert drawn_again(plate).drawn == 0
    assert tree(plate) != tree(clean)
    files = drawn_again(plate, check=True)
    assert (files.drawn, files.found, files.damaged) == (1, 34, 1)
    assert tree(plate) == tree(clean)
    assert drawn_again(plate, check=True).drawn == 0


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


@pytest.mark.parametrize("damage", METADATA_DAMAGE)
def test_descriptions_of_arrays_are_not_believed_but_mended(damage: str, plate: Path, clean: Path) -> None:
    place = plate / "color" / "zarr.json"
    said = json.loads(place.read_bytes())
    METADATA_DAMAGE[damage](said)
    place.write_text(json.dumps(said))
    files = drawn_again(plate)
    assert (files.drawn, files.found) == (0, 35)
    assert files.notes == (f"{plate}: the description of color was damaged and has been written again",)
    assert tree(plate) == tree(clean)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"\xff", b"1" * 5000, b"{}" + b" " * (1 << 21)]
)
def test_descriptions_that_are_none_are_mended(content: bytes, plate: Path, clean: Path) -> None:
    (plate / "color" / "zarr.json").write_bytes(content)
    assert drawn_again(plate).drawn == 0
    assert tree(plate) == tree(clean)
    (plate / "zarr.json").write_bytes(content)
    with pytest.raises(InputError, match="is no plate of xfrustum"):
        drawn_again(plate)


@pytest.mark.parametrize("damage", ["a folder", "a link", "a pipe"])
def test_what_is_no_file_is_no_description(damage: str, plate: Path, clean: Path) -> None:
    CHUNK_DAMAGE[damage](plate / "color" / "zarr.json")
    assert drawn_again(plate).drawn == 0
    assert tree(plate) == tree(clean)


def test_a_scene_that_was_moved_with_its_plate_is_gone_on_with(plate: Path, clean: Path) -> None:
    chunk = plate / CHUNK["color"]
    whole = chunk.read_bytes()
    chunk.unlink()
    moved = replace(small(), source="/somewhere/else/scene.toml")
    files = write_plate(moved, SETTINGS, plate, content=EVERYTHING)
    assert (files.drawn, files.notes) == (1, ())
    assert chunk.read_bytes() == whole
    assert tree(plate) == tree(clean)  # it goes on saying where the scene was when the plate was made


def test_the_command_says_what_it_mended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.zarr"
    line = ["plate", "asymmetric", "--near", "0.1", "--apertures", "3-5,7", "--out", str(out), "--quiet"]
    line += ["--block", "1x1"]
    assert main(line) == 0
    flipped(out / "color/c/7/4/0/0/0")
    (out / "color/c/7/5/0/0/0").write_bytes(b"")
    capsys.readouterr()
    assert main([*line, "--check", "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err == f"xfrustum: note: {out}: 2 hogels were damaged, and drawn again\n"
    said = json.loads(printed.out)
    assert (said["drawn"], said["found"], said["damaged"]) == (2, 1, 2)


def test_zarrs_chunks_are_whole_and_no_beginning_of_one_is(tmp_path: Path) -> None:
    """Chunks of any size: one byte, all forms of the size in a frame, and several blocks."""
    chance = np.random.default_rng(3)
    chunk, part = tmp_path / "x" / "c" / "0", tmp_path / "part"
    for size in (1, 255, 256, 65_535, 65_536, 65_792, 300_000):
        array = zarr.create_array(
            tmp_path / "x", shape=(size,), chunks=(size,), dtype="uint8", overwrite=True,
            compressors=[zarr.codecs.ZstdCodec(level=1, checksum=bool(size % 2))],
        )  # fmt: skip
        for content in (chance.integers(1, 256, size), chance.integers(1, 3, size), np.ones(size)):
            array[:] = content
            assert is_whole(chunk, size)
            assert not is_whole(chunk, size + 1)
            data = chunk.read_bytes()
            for length in {0, 1, 4, 5, 6, 9, 10, *chance.integers(0, len(data), 20).tolist()} - {len(data)}:
                part.write_bytes(data[: min(length, len(data) - 1)])
                assert not is_whole(part, size)


def test_a_claim_is_one_processs_until_it_lets_go_or_ends(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"")
    program = f"""
import time
from pathlib import Path
from xfrustum.reports.cluster.claims import Claims
claims = Claims(Path({str(path)!r}))
print(claims.take(7), claims.take(10**12), flush=True)
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "True True\n"
        with Claims(path) as ours, Claims(path) as third:
            assert not ours.take(7) and not ours.take(10**12)
            assert ours.take(8) and ours.take(8) and not third.take(8)
            path.read_bytes()  # which would drop locks that belong to the process
            ours.release(8)
            assert third.take(8)
            other.kill()
            ours.wait(7)
            assert ours.take(7)


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


@pytest.mark.slow
def test_what_another_is_drawing_is_waited_for_and_not_drawn_twice(tmp_path: Path, clean: Path) -> None:
    """Another process has claimed a hogel: the others are drawn, and then either its work is used or done."""
    out = tmp_path / "x.zarr"
    write_plate(small(), SETTINGS, out, [small().plate.middle], EVERYTHING, block=(1, 1))
    column, row = 5, 4
    for finishes in (True, False):
        shutil.rmtree(out / f"color/c/{row}/{column}", ignore_errors=True)
        with ThreadPoolExecutor(1) as pool, Claims(out / "zarr.json") as other:
            assert other.take(row * 7 + column)
            waiting = pool.submit(drawn_again, out)
            done, _ = wait([waiting], timeout=2)
            assert not done
            if finishes:
                shutil.copytree(clean / f"color/c/{row}/{column}", out / f"color/c/{row}/{column}")
                shutil.copytree(
                    clean / f"triangle/c/{row}/{column}",
                    out / f"triangle/c/{row}/{column}",
                    dirs_exist_ok=True,
                )
            other.release(row * 7 + column)
            files = waiting.result()
        assert (files.drawn, files.found) == ((33, 2) if finishes else (1, 34))
        assert tree(out) == tree(clean)


def test_a_failure_leaves_nothing_beside_the_plate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(plate_store, "write_file", full)
    with pytest.raises(InputError, match="No space left on device"):
        drawn_again(tmp_path / "x.zarr")
    assert list(tmp_path.iterdir()) == []


def at_once(out: Path, count: int) -> list[dict[str, Any]]:
    """Start as many processes on one plate and return what they say."""
    line = "plate asymmetric --near 0.15 --apertures 0-9,28-29 --color uint8 --ids --block 2x2 --quiet --json"
    command = [sys.executable, "-m", "xfrustum", *line.split(), "--out", str(out)]
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(count)
    ]
    told = [process.communicate() for process in processes]
    assert [(process.returncode, error) for process, (_, error) in zip(processes, told, strict=True)] == [
        (0, "")
    ] * count
    return [json.loads(text) for text, _ in told]


def assert_four_make_the_same_as_one(tmp_path: Path, rounds: int) -> None:
    at_once(tmp_path / "one.zarr", 1)
    one = tree(tmp_path / "one.zarr")
    for _ in range(rounds):
        said = at_once(tmp_path / "four.zarr", 4)
        assert sum(each["drawn"] for each in said) == 20
        assert [each["drawn"] + each["found"] for each in said] == [20] * 4
        assert tree(tmp_path / "four.zarr") == one
        shutil.rmtree(tmp_path / "four.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["one.zarr"]


@pytest.mark.slow
def test_four_processes_on_one_new_plate_make_the_same_as_one_twenty_times(tmp_path: Path) -> None:
    assert_four_make_the_same_as_one(tmp_path, 20)
