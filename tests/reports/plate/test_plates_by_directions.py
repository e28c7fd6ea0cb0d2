"""Plates by direction have the arrays of plates by hogel; each file is written once."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr

from tests.reports.plate.test_plate_stream import SETTINGS, disk_full_after, flipped, tree
from tests.support.commands import Command
from tests.support.scene_file import film, part
from tests.support.views import view
from xfrustum import DepthFormat, InputError, PlateFiles, PlateOptions, Scene, convert, write_plate
from xfrustum.raster.plate.directions import DirectionRenderer
from xfrustum.reports.blocks import Engine, Part
from xfrustum.reports.plate.directions import By, Request, choose, write_directions
from xfrustum.reports.plate.store import PlateReader
from xfrustum.scenes import Plate
from xfrustum.scenes.appearance import Sampling, Transport
from xfrustum.scenes.model.images import Channel, ColorType, PlateContent
from xfrustum.scenes.plate import PlateTile

#: Columns and rows of hogels in a shard; memory in bytes for 14 hogels: two tiles of two rows of
#: hogels each
BLOCK, LITTLE = (3, 2), 12_500
BOTH = PlateContent(color=ColorType.FLOAT32, ids=True)
D24, CERTAINTY = DepthFormat.D24, Channel.CERTAINTY
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
    scene = small(resolution=(9, 3))
    how = PlateOptions(content=PlateContent(channels=tuple(Channel)))
    write_plate(scene, None, tmp_path / "hogels.zarr", None, how)
    how = replace(how, block=BLOCK)
    assert write_directions(scene, None, tmp_path / "views.zarr", how, 24_000).tiles == TILES
    ours, theirs = (zarr.open_group(tmp_path / f"{n}.zarr", mode="r") for n in ("views", "hogels"))
    assert sorted(ours.array_keys()) == sorted(theirs.array_keys())
    for name in theirs.array_keys():
        values, expected = np.asarray(ours[name]), np.asarray(theirs[name])
        assert values.dtype == expected.dtype and values.shape == expected.shape
        assert values.tobytes() == expected.tobytes(), name


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
    written: int, clean: Path, tmp_path: Path
) -> None:
    """The command continues with other memory."""
    out = tmp_path / "x.zarr"
    with disk_full_after(written, out):
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
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match=r"hogel 2,3 is damaged \(its file is gone\)"):
        PlateReader(plate).image("color", 2, 3)
    (plate / SHARD["triangle"]).write_bytes(b"")
    assert drawn(plate).passes == 6
    assert tree(plate) == tree(clean)


def test_readers_return_the_hogels(clean: Path, tmp_path: Path) -> None:
    group = xarray.open_zarr(clean, chunks=None)
    triangle = PlateReader(clean).image("triangle", 4, 1)
    np.testing.assert_array_equal(triangle, group.triangle[1, 4])
    convert(clean, tmp_path / "hogels", write_as="hogels")
    back = convert(tmp_path / "hogels", tmp_path / "back.zarr")
    np.testing.assert_array_equal(zarr.open_array(back.out / "color")[:], group.color)


def test_contents_and_scenes_without_views_are_refused(tmp_path: Path) -> None:
    out, scene = tmp_path / "x.zarr", small()
    plain, certain = PlateOptions(), PlateOptions(content=PlateContent(channels=(CERTAINTY,)))
    lit = replace(scene, transport=Transport(shadows=True, samples=4))
    fine = replace(scene, sampling=Sampling(supersample=2))
    long = replace(scene, plate=Plate(size=(80.0, 60.0), hogels=(20_000, 1)))
    refusals: list[tuple[Scene, DepthFormat | None, PlateOptions, str]] = [
        (scene, D24, certain, "certainty is the truth's"),
        (scene, D24, PlateOptions(judge=True), "--judge"),
        (fine, None, plain, "several samples"),
        (lit, None, plain, "light paths"),
        (small("car-transfer"), D24, plain, "reach the screen"),
        (long, D24, PlateOptions(block=(20_000, 1)), "--block 20000x1: a tile has at most"),
    ]
    for refused, depth, how, message in refusals:
        with pytest.raises(InputError, match=message):
            write_directions(refused, depth, out, how, 1 << 30)
    with pytest.raises(InputError, match="--memory 1000 bytes: a tile of 7 x 4 hogels takes"):
        write_directions(scene, D24, out, plain, 1000)
    assert not list(tmp_path.iterdir())


def test_a_plate_is_not_continued_in_another_way_or_depth(clean: Path) -> None:
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
    assert way(out, hogels=(8, 4), truth=True)[0] is By.DIRECTIONS
    assert way(out, hogels=(8, 4), truth=True, some=True) == (By.HOGELS, "")
    assert way(out, hogels=(1000, 1000), near=True) == (By.HOGELS, "")
    chosen, reason = way(out)
    assert chosen is By.DIRECTIONS and "--near draws 28 hogels instead" in reason
    # Tiles multiply the number of views.
    assert way(out, hogels=(1024, 64), truth=True, memory=25 << 20)[1].startswith(
        "by directions, for 60 views"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--near 0.1 --by directions", "--near is a setting of two cameras"),
        ("--truth --by directions --depth d16", "--depth is a setting of a raster"),
        ("--by directions --apertures 0,0", "leave out --apertures"),
        ("--by directions --judge", "--judge compares hogels"),
        ("--by hogels", "Missing option '--near'"),
        ("--by directions --memory many", "'many' is not a size in bytes"),
        ("--offset none", "--offset is a setting of the two cameras"),
    ],
)
def test_contradictions_end_in_one_line(
    options: str, message: str, tmp_path: Path, command: Command
) -> None:
    error = command(f"plate hard/only-behind {options} --out {tmp_path}/x.zarr", status=2).err
    assert message in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_command_states_its_way(tmp_path: Path, command: Command) -> None:
    scene, out = tmp_path / "scene.toml", tmp_path / "p.zarr"
    lens = film((80, 60), (9, 8), resolution=(6, 4), fov_deg=(40, 40), reach=(50, 50))
    scene.write_text(lens + part("sphere", 20, (3, 4, -25)))
    line = f"plate {scene} --ids --quiet --out {out}"
    printed = command(f"{line} --truth --json")
    drawn = printed.record
    assert (drawn["by"], drawn["passes"], drawn["tiles"]) == ("directions", 24, 1)
    assert "by directions, for 24 views" in printed.err
    kept = command(f"{line} --truth").out
    assert kept.startswith("0 views drawn, 24 kept from an earlier run\n")
    shutil.rmtree(out)
    drawn = command(f"{line} --near 0.1 --json").record
    assert (drawn["by"], drawn["passes"], drawn["tiles"]) == ("hogels", 72, 1)
