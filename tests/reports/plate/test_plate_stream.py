"""Plates on disk: each hogel is drawn once; interruptions do not change the bytes."""

import fcntl
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from zarr.storage import _local as local_store

from tests.support.views import view
from xfrustum import (
    Aperture,
    DoubleFrustum,
    InputError,
    PlateFiles,
    PlateOptions,
    Scene,
    write_plate,
)
from xfrustum.reports.blocks import Engine
from xfrustum.reports.plate import store as plate_store
from xfrustum.reports.plate.arrays import Tile, make_group
from xfrustum.reports.plate.plate import arrays_of, blocks_of_apertures, open_source
from xfrustum.reports.plate.store import open_store
from xfrustum.scenes import Plate
from xfrustum.scenes.appearance import Appearance, Environment, Sampling
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.images import ColorType, PlateContent

SETTINGS = DoubleFrustum(near=0.15)
EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)
BLOCK = (3, 2)
#: Shards of columns 0 to 2, rows 2 and 3
SHARD = {"triangle": "triangle/c/1/0/0/0", "color": "color/c/1/0/0/0/0"}


def small(name: str = "asymmetric-recentered") -> Scene:
    return replace(view(name, (20, 12)), plate=Plate(size=(80.0, 60.0), hogels=(7, 5)))


def tree(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def drawn(
    out: Path,
    apertures: Iterable[Aperture] | None = None,
    settings: DoubleFrustum | None = SETTINGS,
    scene: Scene | None = None,
    **options: Any,
) -> PlateFiles:
    """Draw a small plate, by default all its hogels with color and triangle numbers."""
    how = PlateOptions(**{"content": EVERYTHING, **options})
    return write_plate(scene or small(), settings, out, apertures, how)


@contextmanager
def disk_full_after(files: int, out: Path) -> Iterator[None]:
    """Simulate a disk that is full after a number of files of a plate."""
    put, count = local_store._put, itertools.count(1)

    def limited(path: Path, *arguments: Any, **others: Any) -> int:
        if path.is_relative_to(out) and next(count) > files:
            raise OSError(28, "No space left on device")
        return put(path, *arguments, **others)

    with pytest.MonkeyPatch.context() as patched, pytest.raises(InputError, match="No space left"):
        patched.setattr(local_store, "_put", limited)
        yield


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate, stored in blocks, without interruption."""
    out = tmp_path_factory.mktemp("clean") / "x.zarr"
    return drawn(out, block=BLOCK).out


@pytest.fixture
def plate(clean: Path, tmp_path: Path) -> Path:
    """Return a copy that tests may damage."""
    return Path(shutil.copytree(clean, tmp_path / "x.zarr"))


def test_rectangles_add_up_to_the_whole_and_nothing_is_drawn_twice(
    tmp_path: Path, clean: Path
) -> None:
    out = tmp_path / "parts.zarr"
    blocks = [(((1, 3), (0, 2)), 9), (((2, 6), (2, 2)), 3), ((None, (4, 4)), 7), ((None, None), 16)]
    for block, new in blocks:
        apertures = list(blocks_of_apertures(small().plate, [block, block]))
        files = drawn(out, apertures, block=BLOCK)
        assert (files.drawn, files.present) == (new, len(set(apertures)) - new)
    assert tree(out) == tree(clean)


def test_hogels_that_show_nothing_are_finished_too(tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    assert [drawn(out, scene=small("empty")).drawn for _ in range(2)] == [35, 0]


IN_SKY = Appearance(environment=Environment(radiance=np.full((2, 4, 3), 0.5, np.float32)))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda s: (s, replace(SETTINGS, near=0.2), EVERYTHING), "other settings .near was 0.15"),
        (lambda s: (s, SETTINGS, PlateContent(ids=True)), "other content .color was"),
        (lambda s: (replace(s, appearance=IN_SKY), SETTINGS, EVERYTHING), "another scene"),
        (
            lambda s: (s, SETTINGS, replace(EVERYTHING, effects=ALL_EFFECTS - {Effect.DIFFUSE})),
            "other effects",
        ),
        (
            lambda s: (replace(s, sampling=Sampling(aperture=3)), SETTINGS, EVERYTHING),
            "another sampling",
        ),
    ],
)
def test_a_plate_is_not_continued_with_anything_else(
    change: Callable[[Scene], tuple[Scene, DoubleFrustum, PlateContent]], named: str, clean: Path
) -> None:
    before = tree(clean)
    scene, settings, content = change(small())
    with pytest.raises(InputError, match=f"was drawn with .*{named}"):
        drawn(clean, None, settings, scene, content=content)
    with pytest.raises(InputError, match=r"another layout \(block was"):
        drawn(clean, block=(2, 2))
    assert tree(clean) == before


def test_a_plate_is_continued_with_a_moved_scene_and_effects_that_change_no_pixel(
    plate: Path, clean: Path
) -> None:
    (plate / SHARD["color"]).unlink()
    moved = replace(small(), source="/somewhere/else/scene.toml")
    content = replace(EVERYTHING, effects=ALL_EFFECTS)
    files = drawn(plate, scene=moved, content=content)
    assert (files.drawn, files.present, files.notes) == (6, 29, ())
    assert tree(plate) == tree(clean)


DESCRIPTIONS = (b"", b"[" * 100_000, b"\xff", b"1" * 5000, b"{}" + b" " * (1 << 21))


def test_other_folders_and_files_are_left_untouched(tmp_path: Path) -> None:
    """Damaged or hostile descriptions are no plates either."""
    (tmp_path / "file").write_text("mine")
    zarr.create_group(tmp_path / "other.zarr")
    for number, content in enumerate(DESCRIPTIONS):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "zarr.json").write_bytes(content)
    before = tree(tmp_path)
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / "zarr.json")
    for out in tmp_path.iterdir():
        with pytest.raises(InputError, match="is no plate of xfrustum"):
            drawn(out)
    assert tree(tmp_path) == before


# Damaged plates


def replaced_by_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def replaced_by_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def flipped(path: Path, place: int = 200) -> None:
    """Flip one bit, by default in a hogel's pixels, where no length changes."""
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


#: Damage to a block, and hogels that are redrawn: at once, and when all data is read
DAMAGE: list[tuple[Callable[[Path], object], int, int]] = [
    (lambda path: path.write_bytes(b""), 0, 6),
    (flipped, 0, 1),
    (lambda path: flipped(path, -6), 0, 6),
    (replaced_by_link, 6, 0),
]


def test_a_damaged_block_is_drawn_again(plate: Path, clean: Path) -> None:
    """Hogels have checksums: reading all data detects any flipped bit."""
    for damage, gone, damaged in DAMAGE:
        damage(plate / SHARD["triangle"])
        at_once, read = drawn(plate), drawn(plate, check=True)
        assert (at_once.drawn, at_once.damaged, at_once.notes) == (gone, 0, ())
        assert (read.drawn, read.present, read.damaged) == (damaged, 35 - damaged, damaged)
        assert damaged != 6 or read.notes == (f"{plate}: 6 damaged hogels were drawn again",)
        assert tree(plate) == tree(clean)


def test_a_damaged_hogel_beside_a_new_one_is_drawn_by_the_next_command(tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    first, second = (small().plate.aperture(column, 2) for column in (0, 1))
    drawn(out, [first], block=BLOCK)
    (out / SHARD["triangle"]).write_bytes(b"")
    assert drawn(out, [second]).drawn == drawn(out, [first]).drawn == 1


@pytest.mark.slow
def test_several_processes_draw_damaged_hogels_again(plate: Path, clean: Path) -> None:
    flipped(plate / SHARD["color"])
    assert drawn(plate, check=True, engine=Engine(workers=2)).damaged == 1
    assert tree(plate) == tree(clean)


def test_an_obstacle_ends_the_command_in_one_line(plate: Path) -> None:
    replaced_by_pipe(plate / SHARD["triangle"])
    with pytest.raises(InputError, match="is no regular file"):
        drawn(plate)
    (plate / SHARD["triangle"]).unlink()
    chunk = plate / SHARD["color"]
    shutil.rmtree(chunk.parents[1])
    chunk.parents[1].write_text("a file")
    with pytest.raises(InputError, match="cannot write there"):
        drawn(plate)


# Several processes


def test_a_plate_that_appears_while_another_is_being_made_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clean: Path
) -> None:
    """Two processes start a new plate at once: neither deletes the other's files."""
    out = tmp_path / "x.zarr"

    def overtaken(*arguments: Any) -> None:
        monkeypatch.undo()
        drawn(out, [small().plate.aperture(column, 2) for column in range(7)], block=BLOCK)
        make_group(*arguments)

    monkeypatch.setattr(plate_store, "make_group", overtaken)
    files = drawn(out, block=BLOCK)
    assert (files.drawn, files.present) == (28, 7)
    assert tree(out) == tree(clean)
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def test_files_of_killed_processes_are_removed_unless_another_writes(
    plate: Path, clean: Path
) -> None:
    left = (plate / SHARD["color"]).with_suffix(".5f.partial")
    left.write_bytes(b"half")
    with (plate / "zarr.json").open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        assert drawn(plate).drawn == 0 and left.exists()
    assert drawn(plate).drawn == 0
    assert tree(plate) == tree(clean)


def test_four_writers_of_one_block_lose_nothing(tmp_path: Path) -> None:
    """Each process opens the plate before the others write."""
    scene, out = small(), tmp_path / "x.zarr"
    whole = drawn(tmp_path / "w.zarr", block=(7, 5)).out
    with open_source(scene, SETTINGS, EVERYTHING) as source:
        arrays = arrays_of(scene, EVERYTHING, (7, 5))
        stores = [open_store(out, arrays, source.description, free=False) for _ in range(4)]
        (block,) = arrays.blocks(scene.plate.apertures())
        hogels = list(source.hogels(scene.plate.apertures()))
    tiles = [Tile.empty(block, arrays) for _ in stores]
    for number, hogel in enumerate(hogels):
        tiles[number % 4].put(hogel)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda store, tile: store.write(tile), stores, tiles))
    assert stores[0].missing(block, check=True) == ((), 0)
    assert tree(out) == tree(whole)
