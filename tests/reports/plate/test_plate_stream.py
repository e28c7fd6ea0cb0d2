"""A plate on disk: every hogel once, the same bytes however often the process was killed."""

import contextlib
import io
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from zarr.storage import _local as local_store

from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
from xfrustum.scenes import DoubleFrustum, InputError, Plate, Scene
from xfrustum.scenes.appearance.appearance import Appearance, Environment, Material
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.geometry.shapes import smoothed
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.plate_content import ColorType, PlateContent
from xfrustum.scenes.model.scene import look_hash

SETTINGS = DoubleFrustum(near=0.15)
EVERYTHING = PlateContent(color=ColorType.FLOAT32, ids=True)


def small(name: str = "asymmetric-recentered") -> Scene:
    return replace(view(name, (20, 12)), plate=Plate(size=(80.0, 60.0), hogels=(7, 5)))


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def array(group: zarr.Group, name: str) -> zarr.Array[Any]:
    found = group[name]
    assert isinstance(found, zarr.Array)
    return found


def finished(folder: Path) -> dict[str, tuple[int, int]]:
    """Every block that has finished hogels, with what changes when it is written again."""
    found = {}
    for path in folder.glob("finished/c/*/*"):
        if not path.name.endswith(".partial"):
            status = path.stat()
            found[str(path)] = (status.st_ino, status.st_mtime_ns)
    return found


def test_the_group_says_what_was_drawn_and_how(tmp_path: Path) -> None:
    scene = small()
    out = write_plate(scene, SETTINGS, tmp_path / "x.zarr", [scene.plate.middle]).out
    said = json.loads(json.dumps(zarr.open_group(out, mode="r").attrs["xfrustum"]))
    assert said["scene"]["hash"] == scene.content_hash
    assert said["plate"] == {"size": [80.0, 60.0], "hogels": [7, 5]}
    assert said["frustum"]["resolution"] == [20, 12] and said["frustum"]["screen"]["height"] == 120.0
    assert said["settings"]["near"] == 0.15 and said["content"] == {"color": "float16", "ids": False}


def test_parts_add_up_to_the_whole_and_nothing_is_drawn_twice(tmp_path: Path) -> None:
    scene = small()
    whole = write_plate(scene, SETTINGS, tmp_path / "whole.zarr", content=EVERYTHING, block=(1, 1)).out
    out = tmp_path / "parts.zarr"
    blocks = [(((1, 3), (0, 2)), 9), (((2, 6), (2, 2)), 3), ((None, (4, 4)), 7), ((None, None), 16)]
    before: dict[str, tuple[int, int]] = {}
    for block, drawn in blocks:
        apertures = list(blocks_of_apertures(scene.plate, [block, block]))
        files = write_plate(scene, SETTINGS, out, apertures, EVERYTHING, block=(1, 1))
        assert (files.drawn, files.found) == (drawn, len(set(apertures)) - drawn)
        after = finished(out)
        assert before.items() <= after.items() and len(after) == len(before) + drawn
        before = after
    assert tree(out) == tree(whole)


def test_hogels_that_show_nothing_are_finished_too(tmp_path: Path) -> None:
    assert [write_plate(small("empty"), SETTINGS, tmp_path / "x.zarr").drawn for _ in range(2)] == [35, 0]


def test_rows_come_first_and_blocks_in_the_order_given_each_aperture_once() -> None:
    plate = Plate(size=(1.0, 1.0), hogels=(3, 2))
    assert [a.index for a in plate.apertures()] == [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    found = blocks_of_apertures(plate, [((1, 1), None), ((0, 1), (0, 0))])
    assert [a.index for a in found] == [(1, 0), (1, 1), (0, 0)]


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate of one hogel."""
    out = tmp_path_factory.mktemp("begun") / "x.zarr"
    return write_plate(small(), SETTINGS, out, [small().plate.middle], EVERYTHING).out


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda s: (s, replace(SETTINGS, near=0.2), EVERYTHING), "other settings .near was 0.15, now 0.2"),
        (lambda s: (s, SETTINGS, PlateContent(ids=True)), "other content .color was"),
        (lambda s: (small("crossing"), SETTINGS, EVERYTHING), "another scene .name was"),
        (lambda s: (replace(s, objects=s.objects[1:]), SETTINGS, EVERYTHING), "another scene;"),
        (lambda s: (replace(s, appearance=Appearance(lights=())), SETTINGS, EVERYTHING), "another scene"),
        (
            lambda s: (s, SETTINGS, replace(EVERYTHING, effects=ALL_EFFECTS - {Effect.DIFFUSE})),
            "other effects",
        ),
    ],
)
def test_going_on_with_anything_else_is_refused(
    change: Callable[[Scene], tuple[Scene, DoubleFrustum, PlateContent]], named: str, begun: Path
) -> None:
    before = tree(begun)
    scene, settings, content = change(small())
    with pytest.raises(InputError, match=f"was drawn with .*{named}"):
        write_plate(scene, settings, begun, content=content)
    assert tree(begun) == before


def test_going_on_with_effects_that_change_no_pixel_is_going_on(tmp_path: Path) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    write_plate(scene, SETTINGS, out, [scene.plate.middle], EVERYTHING)
    files = write_plate(scene, SETTINGS, out, content=replace(EVERYTHING, effects=ALL_EFFECTS))
    assert (files.drawn, files.found) == (34, 1)


def mirrored_in(strength: float, material: Material, name: str) -> Scene:
    parts = tuple(replace(part, material=name) for part in small().objects)
    sky = Environment(radiance=np.full((2, 4, 3), 0.5, dtype=np.float32), strength=strength)
    return replace(small(), objects=parts, appearance=Appearance(materials={name: material}, environment=sky))


def test_the_look_is_everything_that_color_depends_on_and_no_name() -> None:
    mirror = Material(reflectivity=(0.5, 0.5, 0.5))
    scene = mirrored_in(1.0, mirror, "mirror")
    smooth = replace(scene, objects=tuple(smoothed(part) for part in scene.objects))
    others = [mirrored_in(0.5, mirror, "mirror"), mirrored_in(1.0, Material(), "mirror"), smooth, small()]
    assert len({look_hash(other) for other in (scene, *others)}) == 5
    assert {other.content_hash for other in others} == {scene.content_hash}
    assert look_hash(mirrored_in(1.0, mirror, "another name")) == look_hash(scene)


def test_finer_sampling_is_drawn_as_raster_draws_it_and_said(tmp_path: Path) -> None:
    scene = replace(small("grating"), sampling=Sampling(supersample=2, multisample=4, aperture=3))
    apertures = [scene.plate.middle, scene.plate.aperture(0, 4)]
    out = write_plate(scene, SETTINGS, tmp_path / "x.zarr", apertures, EVERYTHING).out
    group = zarr.open_group(out, mode="r")
    with Rasterizer(scene) as rasterizer:
        for aperture in apertures:
            image = rasterizer.render(aperture, SETTINGS)
            np.testing.assert_array_equal(array(group, "color")[aperture.row, aperture.column], image.color)
            np.testing.assert_array_equal(
                array(group, "triangle")[aperture.row, aperture.column], image.triangle
            )
    said = group.attrs["xfrustum"]
    assert isinstance(said, dict) and said["sampling"] == {"aperture": 3, "supersample": 2, "multisample": 4}


def test_a_plate_goes_on_with_its_own_sub_apertures_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "x.zarr"
    arguments = ["plate", "sheets", "--near", "0.1", "--apertures", "3,4", "--out", str(out), "--quiet"]
    assert [main([*arguments, "--aperture-samples", "3"]) for _ in range(2)] == [0, 0]
    assert main([*arguments, "--aperture-samples", "car"]) == main(arguments) == 2
    assert "another sampling" in capsys.readouterr().err


def test_what_is_no_plate_is_left_alone(tmp_path: Path) -> None:
    folder, file = tmp_path / "folder", tmp_path / "file"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    file.write_text("mine")
    zarr.create_group(tmp_path / "other.zarr")
    for out in (folder, file, tmp_path / "other.zarr"):
        with pytest.raises(InputError, match="is no plate of xfrustum"):
            write_plate(small(), SETTINGS, out)
    assert tree(folder) == {"mine.txt": b"mine"} and file.read_text() == "mine"


def test_a_full_disk_ends_in_one_line_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    put = local_store._put

    def full(path: Path, *arguments: Any, **others: Any) -> int:
        if path == out / "color/c/3/2/0/0/0":
            raise OSError(28, "No space left on device")
        return put(path, *arguments, **others)

    with monkeypatch.context() as patched:
        patched.setattr(local_store, "_put", full)
        with pytest.raises(InputError, match="No space left on device"):
            write_plate(scene, SETTINGS, out, block=(1, 1))
    assert len(finished(out)) == 23
    files = write_plate(scene, SETTINGS, out)
    assert (files.drawn, files.found) == (12, 23)


KILLED_BLOCK = (9, 1)  # columns and rows of the blocks of plates whose drawing is killed: a ninth of a row


def command(out: Path, rows: str) -> list[str]:
    arguments = ["plate", "asymmetric", "--near", "0.15", "--apertures", f"*,{rows}", "--color", "uint8"]
    arguments += ["--block", "x".join(map(str, KILLED_BLOCK))]
    return [sys.executable, "-m", "xfrustum", *arguments, "--ids", "--out", str(out), "--quiet", "--json"]


def killed(out: Path, rows: str, delay: float, *, from_first_hogel: bool) -> bool:
    """Run the command, kill it after a delay, and return whether it had not ended by then."""
    before = len(finished(out))
    process = subprocess.Popen(command(out, rows), stdout=subprocess.DEVNULL, start_new_session=True)
    while from_first_hogel and process.poll() is None and len(finished(out)) == before:
        time.sleep(0.002)
    time.sleep(delay)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def resumed(out: Path, rows: str) -> dict[str, int]:
    with contextlib.redirect_stdout(io.StringIO()) as written:
        assert main(command(out, rows)[3:]) == 0
    found: dict[str, int] = json.loads(written.getvalue())
    return found


def assert_kills_do_no_harm(tmp_path: Path, rows: str, count: int, delays: Iterator[float]) -> None:
    clean, out = tmp_path / "clean.zarr", tmp_path / "killed.zarr"
    assert resumed(clean, rows)["found"] == 0
    kills = 0
    for number, delay in enumerate(delays):
        before = finished(out)
        # Some kills come while the command is still starting.
        kills += killed(out, rows, delay, from_first_hogel=number % 4 != 3)
        after = finished(out)
        assert before.items() <= after.items(), "a finished block was lost or drawn again"
    assert kills > 0
    before = finished(out)
    found = len(before) * KILLED_BLOCK[0] * KILLED_BLOCK[1]
    last = resumed(out, rows)
    assert (last["drawn"], last["found"]) == (count - found, found)
    assert before.items() <= finished(out).items()
    assert tree(out) == tree(clean)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clean.zarr", "killed.zarr"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "hogels", "kills", "longest_s"), [("28", 81, 3, 0.2), ("20-39", 1620, 20, 0.8)]
)
def test_killing_it_changes_no_byte(
    rows: str, hogels: int, kills: int, longest_s: float, tmp_path: Path
) -> None:
    chance = random.Random(kills)
    delays = (chance.uniform(0.0, 3.0 if number % 4 == 3 else longest_s) for number in range(kills))
    assert_kills_do_no_harm(tmp_path, rows, hogels, delays)
