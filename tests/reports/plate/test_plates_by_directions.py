"""Plates by direction have the arrays of plates by hogel; each file is written once."""

import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from zarr.storage import _local as local_store

from tests.reports.plate.test_plate_stream import SETTINGS, flipped, tree
from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reports.blocks import Engine, Part
from xfrustum.reports.exchange.convert import convert
from xfrustum.reports.plate.directions import By, Request, choose, write_directions
from xfrustum.reports.plate.plate import PlateFiles, PlateOptions, write_plate
from xfrustum.reports.plate.store import PlateReader
from xfrustum.scenes import InputError, Plate, Scene
from xfrustum.scenes.appearance import Sampling, Transport
from xfrustum.scenes.model.images import Channel, ColorType, PlateContent
from xfrustum.scenes.plate import DepthFormat, PlateTile

#: Columns and rows of hogels in a shard; memory for 14 hogels, bytes, which makes two
#: tiles of two rows
BLOCK, LITTLE = (3, 2), 12_500
BOTH = PlateContent(color=ColorType.FLOAT32, ids=True)
D24 = DepthFormat.D24
#: Shard of columns 0 to 2 and rows 2 and 3, pixel columns 8 to 15 and pixel rows 0 to 7
SHARD = {"triangle": "triangle/c/1/0/0/1", "color": "color/c/1/0/0/1/0"}
TILES, VIEWS, FILES = 2, 2 * 10 * 3, 2 * 2 * 2 * 3


def small(name: str = "asymmetric", resolution: tuple[int, int] = (10, 3)) -> Scene:
    return replace(view(name, resolution), plate=Plate(size=(80.0, 60.0), hogels=(7, 4)))


def drawn(
    out: Path, depth: DepthFormat | None = D24, memory: int = LITTLE, **options: Any
) -> PlateFiles:
    how = PlateOptions(**{"content": BOTH, "block": BLOCK, **options})
    return write_directions(small(), depth, out, how, memory)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plate in several tiles, drawn without interruption."""
    out = tmp_path_factory.mktemp("clean") / "x.zarr"
    files = drawn(out)
    assert (files.drawn, files.present, files.passes, files.tiles) == (28, 0, VIEWS, TILES)
    return out


@pytest.fixture
def plate(clean: Path, tmp_path: Path) -> Path:
    """Return a copy that tests may damage."""
    return Path(shutil.copytree(clean, tmp_path / "x.zarr"))


def test_truths_by_directions_are_those_by_hogels(tmp_path: Path) -> None:
    scene, how = (
        small(resolution=(9, 3)),
        PlateOptions(content=PlateContent(channels=tuple(Channel))),
    )
    write_plate(scene, None, tmp_path / "hogels.zarr", None, how)
    how = replace(how, block=BLOCK)
    assert write_directions(scene, None, tmp_path / "views.zarr", how, 24_000).tiles == TILES
    ours, theirs = (zarr.open_group(tmp_path / f"{n}.zarr", mode="r") for n in ("views", "hogels"))
    assert sorted(ours.array_keys()) == sorted(theirs.array_keys())
    for name in theirs.array_keys():
        values, expected = np.asarray(ours[name]), np.asarray(theirs[name])
        assert values.dtype == expected.dtype and values.shape == expected.shape
        assert values.tobytes() == expected.tobytes(), name
    described: Any = theirs.attrs["xfrustum"]
    assert ours.attrs["xfrustum"] == {
        **described,
        "layout": {"block": [3, 2], "film": [8, 3], "tile": [7, 2]},
    }


def test_drawn_pixels_are_those_of_the_renderer_in_their_places(clean: Path) -> None:
    scene, group = small(), xarray.open_zarr(clean, chunks=None)
    assert bool(group.finished.all()) and group.triangle.dims == ("row", "column", "v", "u")
    tile = PlateTile(plate=scene.plate, columns=range(7), rows=range(2, 4))
    pixels = [(0, 0), (8, 2), (3, 1), (9, 2)]
    with DirectionRenderer(scene, tile, BOTH, D24) as renderer:
        for image in renderer.images(pixels):
            stored = group.isel(row=slice(2, 4), u=image.pixel[0], v=image.pixel[1])
            np.testing.assert_array_equal(stored.triangle, image.triangle)
            np.testing.assert_array_equal(stored.color, image.color)
    # Other orders of rows, columns or pixels show other triangles.
    triangle = group.triangle.values
    for axes in ((0,), (1,), (2,), (3,), (0, 1), (2, 3)):
        assert np.count_nonzero(np.flip(triangle, axes) != triangle) > 20


def test_triangles_do_not_depend_on_the_tiles_but_for_snapping(clean: Path, tmp_path: Path) -> None:
    content = PlateContent(channels=(Channel.TRIANGLE,))
    files = drawn(tmp_path / "x.zarr", memory=1 << 30, content=content)
    assert (files.passes, files.tiles) == (30, 1)
    whole, tiled = (PlateReader(place).arrays["triangle"][:] for place in (files.out, clean))
    assert np.count_nonzero(whole != tiled) <= 0.002 * whole.size < np.count_nonzero(whole >= 0)


@pytest.mark.parametrize("written", [pytest.param(1, marks=pytest.mark.slow), FILES - 2])
def test_a_run_that_ends_anywhere_goes_on_to_the_same_bytes(
    written: int, clean: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full after `written` files; the command then continues with other memory."""
    out, put, count = tmp_path / "x.zarr", local_store._put, itertools.count(1)

    def ending(path: Path, *arguments: Any, **others: Any) -> int:
        if path.is_relative_to(out) and next(count) > written:
            raise OSError(28, "No space left on device")
        return put(path, *arguments, **others)

    with monkeypatch.context() as patched:
        patched.setattr(local_store, "_put", ending)
        with pytest.raises(InputError, match="No space left"):
            drawn(out)
    assert not PlateReader(out).finished(small().plate.aperture(6, 3))
    files = drawn(out, memory=10 * LITTLE, block=None)
    assert 0 < files.passes == VIEWS - files.kept and drawn(out).passes == 0
    assert tree(out) == tree(clean)


def test_hogels_are_finished_when_the_last_part_is_there(clean: Path, tmp_path: Path) -> None:
    out, here = tmp_path / "x.zarr", small().plate.aperture(0, 0)
    for number, finished in ((2, False), (1, True)):
        files = drawn(out, engine=Engine(part=Part(number=number, count=2)))
        assert 0 < files.passes < VIEWS and files.present == 0
        assert PlateReader(out).finished(here) == finished
        # A hogel with half of its pixels is unfinished.
        again = drawn(out, engine=Engine(part=Part(number=number, count=2)))
        assert (again.drawn, again.present, again.passes) == (0, 28 * finished, 0)
        assert (files.kept, again.kept) == (0, files.passes)
    assert tree(out) == tree(clean)


def test_a_process_killed_before_its_mark_is_gone_on_with(plate: Path, clean: Path) -> None:
    for file in (plate / "finished/c").rglob("*"):
        if file.is_file():
            file.unlink()
    assert drawn(plate).passes == 0
    assert tree(plate) == tree(clean)


@pytest.mark.slow
def test_two_processes_draw_the_same_bytes(clean: Path, tmp_path: Path) -> None:
    assert drawn(tmp_path / "x.zarr", engine=Engine(workers=2)).passes == VIEWS
    assert tree(tmp_path / "x.zarr") == tree(clean)


def test_damaged_files_are_redrawn_and_never_read_as_black(
    plate: Path, clean: Path, tmp_path: Path
) -> None:
    flipped(plate / SHARD["triangle"], 20)
    files = drawn(plate, check=True)
    assert (files.damaged, files.tiles, files.passes) == (6, 1, 6)
    assert tree(plate) == tree(clean)
    (plate / SHARD["color"]).unlink()
    with pytest.raises(InputError, match=r"hogel 0,2 is damaged \(its file is gone\)"):
        convert(plate, tmp_path / "out", write_as="hogels")
    with pytest.raises(InputError, match=r"hogel 2,3 is damaged \(its file is gone\)"):
        PlateReader(plate).image("color", 2, 3)
    (plate / SHARD["triangle"]).write_bytes(b"")
    assert drawn(plate).passes == 6
    assert tree(plate) == tree(clean)


def test_readers_return_the_hogels(clean: Path, tmp_path: Path) -> None:
    reader, group = PlateReader(clean), zarr.open_group(clean, mode="r")
    for column, row in ((0, 0), (6, 3), (4, 1)):
        for name in ("color", "triangle"):
            stored: Any = group[name]
            image = reader.image(name, column, row)
            np.testing.assert_array_equal(image, stored[row, column])
    files = convert(clean, tmp_path / "hogels", write_as="hogels")
    back = convert(tmp_path / "hogels", tmp_path / "back.zarr")
    assert files.files == 28
    color: Any = zarr.open_group(back.out, mode="r")["color"]
    np.testing.assert_array_equal(color[:], np.asarray(group["color"]))


def test_contents_and_scenes_without_views_are_refused(tmp_path: Path) -> None:
    out, scene = tmp_path / "x.zarr", small()
    certain = PlateContent(channels=(Channel.CERTAINTY,))
    lit = replace(scene, transport=Transport(shadows=True, samples=4))
    fine = replace(scene, sampling=Sampling(supersample=2))
    long = replace(scene, plate=Plate(size=(80.0, 60.0), hogels=(20_000, 1)))
    refusals: list[tuple[Any, DepthFormat | None, PlateOptions, int, str]] = [
        (scene, D24, PlateOptions(content=certain), 1 << 30, "certainty is the truth's"),
        (scene, D24, PlateOptions(judge=True), 1 << 30, "--judge"),
        (fine, None, PlateOptions(), 1 << 30, "several samples"),
        (lit, None, PlateOptions(), 1 << 30, "light paths"),
        (scene, D24, PlateOptions(), 1000, "--memory 1000 bytes: a tile of 7 x 4 hogels takes"),
        (small("car-transfer"), D24, PlateOptions(), 1 << 30, "reach the screen"),
        (
            long,
            D24,
            PlateOptions(block=(20_000, 1)),
            1 << 30,
            "--block 20000x1: a tile has at most",
        ),
    ]
    for scene_, depth, how, memory, message in refusals:
        with pytest.raises(InputError, match=message):
            write_directions(scene_, depth, out, how, memory)
    assert not list(tmp_path.iterdir())


def test_going_on_in_another_way_or_depth_is_refused(clean: Path) -> None:
    before = tree(clean)
    with pytest.raises(InputError, match="other directions"):
        drawn(clean, DepthFormat.D32F)
    with pytest.raises(InputError, match="was drawn with"):
        drawn(clean, None)
    with pytest.raises(InputError, match="was drawn with"):
        write_plate(small(), SETTINGS, clean, None, PlateOptions(content=BOTH))
    with pytest.raises(InputError, match="was begun by directions: add --by directions"):
        way(clean, By.HOGELS)
    assert way(clean, truth=True)[0] is way(clean)[0] is By.DIRECTIONS
    assert tree(clean) == before


def way(
    out: Path, by: By = By.AUTO, hogels: tuple[int, int] = (7, 4), **facts: Any
) -> tuple[By, str]:
    scene = replace(small(), plate=Plate(size=(80.0, 60.0), hogels=hogels))
    known = {"truth": False, "near": False, "some": False, "memory": 1 << 30}
    options = PlateOptions(judge=facts.pop("judge", False))
    return choose(scene, Request(by=by, out=out, options=options, **{**known, **facts}))


def test_the_way_with_fewer_images_is_chosen_unless_options_decide(tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    # A hogel has 30 pixels.
    assert way(out, hogels=(6, 5), truth=True)[0] is By.HOGELS
    assert way(out, hogels=(8, 4), truth=True) == (
        By.DIRECTIONS,
        "by directions, for 30 views of a tile stand beside 32 hogels, and fewer are faster",
    )
    assert way(out, hogels=(8, 4), truth=True, some=True) == (By.HOGELS, "")
    assert way(out, hogels=(1000, 1000), near=True) == (By.HOGELS, "")
    chosen, reason = way(out)
    assert (
        chosen is By.DIRECTIONS
        and "30 views of all hogels; --near draws 28 hogels instead" in reason
    )
    assert way(out, By.DIRECTIONS) == (By.DIRECTIONS, "")
    # Tiles multiply the number of views.
    assert way(out, hogels=(1000, 1000), truth=True, memory=1 << 30)[0] is By.DIRECTIONS
    assert way(out, hogels=(1024, 64), truth=True, memory=25 << 20)[1].startswith(
        "by directions, for 60 views"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--near", "0.1", "--by", "directions"], "--near is a setting of two cameras"),
        (["--by", "directions", "--pivot", "camera"], "--pivot is a setting of two cameras"),
        (["--truth", "--by", "directions", "--depth", "d16"], "--depth is a setting of a raster"),
        (["--by", "directions", "--apertures", "0,0"], "leave out --apertures"),
        (["--by", "directions", "--judge"], "--judge compares hogels"),
        (["--by", "hogels"], "Missing option '--near'"),
        (["--apertures", "0,0"], "Missing option '--near'"),
        (["--by", "directions", "--memory", "many"], "'many' is not a size in bytes"),
        (["--offset", "none"], "--offset is a setting of the two cameras"),
    ],
)
def test_contradictions_end_in_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["plate", "hard/only-behind", *options, "--out", str(tmp_path / "x.zarr")]
    assert main(line) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_command_states_its_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = tmp_path / "scene.toml", tmp_path / "p.zarr"
    scene.write_text(
        'units = "mm"\nplate = {size = [80, 60], hogels = [9, 8]}\n'
        "frustum = {fov_deg = [40, 40], resolution = [6, 4], reach = [50, 50]}\n"
        "[[object]]\nshape = 'sphere'\nscale = 20\ntranslate = [3, 4, -25]\n"
    )
    line = ["plate", str(scene), "--ids", "--json", "--quiet", "--out", str(out)]
    assert main([*line, "--truth"]) == 0
    captured = capsys.readouterr()
    printed = json.loads(captured.out)
    assert (printed["by"], printed["passes"], printed["tiles"]) == ("directions", 24, 1)
    assert printed["wall_s"] > 0 and "by directions, for 24 views" in captured.err
    assert main(["plate", str(scene), "--ids", "--truth", "--quiet", "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith("0 views drawn, 24 kept from an earlier run\n")
    shutil.rmtree(out)
    assert main([*line, "--near", "0.1"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["by"], printed["passes"], printed["tiles"]) == ("hogels", 72, 1)
