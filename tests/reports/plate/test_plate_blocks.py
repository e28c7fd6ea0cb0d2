"""Blocks of hogels: shards that Zarr reads, whole or absent, drawn by any process, labelled for xarray."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray
import zarr
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from zarr.storage import _local as local_store

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, array, small, tree
from tests.support.long_tail import examples, thinned
from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.plate.plate import PlateFiles, blocks_of_apertures, write_plate
from xfrustum.reports.plate.store import (
    Layout,
    StoredPlate,
    camera_of,
)
from xfrustum.scenes import InputError, Plate
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.plate_content import DRAWN_CHANNELS, Channel, ColorType, PlateContent
from xfrustum.scenes.plate.plate import Aperture

BLOCK = (3, 2)
ALL = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)
SHARD = "color/c/1/0/0/0/0"  # the block of columns 0 to 2 and rows 2 and 3


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate in blocks that nobody disturbed."""
    out = tmp_path_factory.mktemp("clean") / "x.zarr"
    return write_plate(small(), SETTINGS, out, content=ALL, block=BLOCK).out


@pytest.fixture
def plate(clean: Path, tmp_path: Path) -> Path:
    """A copy to be damaged."""
    return Path(shutil.copytree(clean, tmp_path / "x.zarr"))


def test_blocks_are_shards_with_a_chunk_for_each_hogel_and_hold_the_rasterizers_images(clean: Path) -> None:
    scene, group = small(), zarr.open_group(clean, mode="r")
    color = array(group, "color")
    assert (color.shards, color.chunks) == ((2, 3, 12, 20, 3), (1, 1, 12, 20, 3))
    assert array(group, "height").shards == (2, 3, 12, 20)
    with Rasterizer(scene) as rasterizer:
        for aperture in scene.plate.apertures():
            image = rasterizer.render(aperture, SETTINGS)
            for channel in ALL.channels:
                stored = array(group, channel)[aperture.row, aperture.column]
                np.testing.assert_array_equal(stored, getattr(image, channel))


@pytest.mark.parametrize("damage", thinned(["bit", "cut off", "gone", "index"], 2))
def test_a_damaged_block_is_drawn_again(damage: str, plate: Path, clean: Path) -> None:
    """A file that is gone is missed at once; what is not what was written, where all is read."""
    shard = plate / SHARD
    data = shard.read_bytes()
    if damage == "gone":
        shard.unlink()
    else:
        bit = {"cut off": None, "index": len(data) - 6, "bit": 200}[damage]
        shard.write_bytes(data[:-1] if bit is None else data[:bit] + bytes([data[bit] ^ 1]) + data[bit + 1 :])
    files = write_plate(small(), SETTINGS, plate, content=ALL, check=damage != "gone")
    count = 1 if damage == "bit" else 6
    damaged = 0 if damage == "gone" else count
    assert (files.drawn, files.found, files.damaged) == (count, 35 - count, damaged)
    assert tree(plate) == tree(clean)


def test_a_plate_goes_on_in_its_own_blocks_unless_others_are_asked_for(plate: Path, clean: Path) -> None:
    (plate / SHARD).unlink()
    with pytest.raises(InputError, match=r"another layout \(block was"):
        write_plate(small(), SETTINGS, plate, content=ALL, block=(2, 2))
    assert write_plate(small(), SETTINGS, plate, content=ALL).drawn == 6
    assert tree(plate) == tree(clean)


def test_a_plate_of_version_0_2_is_read_as_finished_and_not_gone_on_with(plate: Path) -> None:
    """It did not say which hogels are there."""
    shutil.rmtree(plate / "finished")
    said = json.loads((plate / "zarr.json").read_bytes())
    del said["consolidated_metadata"]["metadata"]["finished"]
    (plate / "zarr.json").write_text(json.dumps(said))
    assert StoredPlate(plate).finished(small().plate.aperture(6, 4))
    with pytest.raises(InputError, match="the description of finished is damaged"):
        write_plate(small(), SETTINGS, plate, content=ALL)


def test_xarray_shows_names_coordinates_and_units(clean: Path) -> None:
    scene = small()
    plate = xarray.open_zarr(clean)
    assert plate.color.dims == ("row", "column", "v", "u", "rgb")
    assert plate.height.dims == ("row", "column", "v", "u")
    assert set(plate.coords) == {"row", "column", "x", "y", "u", "v"} and bool(plate.finished.all())
    shown = repr(plate)
    assert all(name in shown for name in ("row", "column", "color", "height", "normal", "triangle"))
    assert re.search(r"units: +mm", shown)
    for name in ("x", "y", "height"):
        assert plate[name].attrs["units"] == scene.units == "mm"
    hogel = scene.plate.aperture(5, 1)
    here = plate.isel(row=1, column=5)
    assert (float(here.x), float(here.y)) == (hogel.x, hogel.y)
    width, height = scene.frustum.resolution
    np.testing.assert_array_equal(plate.u, (2 * np.arange(width) + 1) / width - 1)
    np.testing.assert_array_equal(plate.v, 1 - (2 * np.arange(height) + 1) / height)
    assert plate.triangle.dtype == np.int32 and plate.color.dtype == np.float32


@pytest.mark.parametrize("name", ["asymmetric-recentered", "sheets"])
def test_the_camera_of_any_hogel_is_the_rasterizers(name: str, tmp_path: Path) -> None:
    scene = small(name)
    out = write_plate(scene, SETTINGS, tmp_path / "x.zarr", [scene.plate.middle]).out
    opened = (out, str(out), zarr.open_group(out, mode="r"), xarray.open_zarr(out))
    for index in ((0, 0), (6, 4), (3, 1)):
        with Rasterizer(scene) as rasterizer:
            drawn = rasterizer.render(
                scene.plate.aperture(*index), SETTINGS, normals=False, color=False
            ).camera
        for store in opened:
            camera = camera_of(store, *index)
            # The rasterizer's own formula for the window differs in the last bit of a double.
            assert replace(camera, renderer="", shear=(0, 0), half_extent=(1, 1)) == replace(
                drawn, renderer="", shear=(0, 0), half_extent=(1, 1)
            )
            np.testing.assert_allclose(camera.shear, drawn.shear, rtol=4 * 2**-53, atol=0)
            np.testing.assert_allclose(camera.half_extent, drawn.half_extent, rtol=4 * 2**-53, atol=0)
    with pytest.raises(InputError, match="lies outside the plate"):
        camera_of(out, 7, 0)


@pytest.mark.parametrize("block", [(1, 1), BLOCK])
def test_a_stored_plate_says_which_hogels_are_finished(block: tuple[int, int], tmp_path: Path) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    drawn = [scene.plate.aperture(*index) for index in ((2, 2), (6, 4), (0, 0))]
    write_plate(scene, SETTINGS, out, drawn, EVERYTHING, block=block)
    stored = StoredPlate(out)
    assert [aperture for aperture in scene.plate.apertures() if stored.finished(aperture)] == sorted(
        drawn, key=lambda one: (one.row, one.column)
    )
    assert list(stored.arrays) == ["triangle", "color"]
    assert stored.description["scene"]["hash"] == scene.content_hash
    for path in (tmp_path, tmp_path / "nosuch.zarr"):
        with pytest.raises(InputError, match="is no plate"):
            StoredPlate(path)


def test_what_is_no_plate_has_no_cameras(tmp_path: Path) -> None:
    zarr.create_group(tmp_path / "other.zarr")
    group = zarr.create_group(tmp_path / "damaged.zarr", attributes={"xfrustum": {"plate": {"size": "x"}}})
    for store in (tmp_path / "other.zarr", tmp_path / "nosuch.zarr", group):
        said = "is damaged" if store is group else "is no plate"
        with pytest.raises(InputError, match=said):
            camera_of(store, 0, 0)


def test_a_plate_of_truths_is_certified(tmp_path: Path) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    content = PlateContent(color=ColorType.FLOAT32, channels=tuple(Channel))
    apertures = [scene.plate.middle, scene.plate.aperture(0, 4)]
    assert write_plate(scene, None, out, apertures, content).drawn == 2
    group = zarr.open_group(out, mode="r")
    for truth in Reference(scene).stream(apertures):
        here = truth.camera.aperture
        for channel in Channel:
            stored = np.asarray(array(group, channel)[here.row, here.column])
            np.testing.assert_array_equal(stored, np.asarray(getattr(truth, channel), dtype=stored.dtype))
    assert camera_of(out, 0, 4).settings is None
    with pytest.raises(InputError, match="other settings"):
        write_plate(scene, SETTINGS, out, apertures, replace(content, channels=(Channel.COLOR,)))
    with pytest.raises(InputError, match="certainty is the truth's alone"):
        write_plate(scene, SETTINGS, tmp_path / "y.zarr", apertures, content)


def test_shadows_are_in_the_truth(tmp_path: Path) -> None:
    scene = replace(small("crossing"), transport=Transport(shadows=True, samples=4))
    out = write_plate(scene, None, tmp_path / "x.zarr", [scene.plate.middle]).out
    said: Any = zarr.open_group(out, mode="r").attrs["xfrustum"]
    assert said["transport"] == {"shadows": True, "interreflection": False, "samples": 4}
    assert "settings" not in said


sizes = st.integers(1, 9)


@given(columns=sizes, rows=sizes, width=sizes, height=sizes, data=st.data())
@examples(60)
def test_every_hogel_lies_in_one_block_at_a_place_of_its_own(
    columns: int, rows: int, width: int, height: int, data: st.DataObject
) -> None:
    plate = Plate(size=(1.0, 1.0), hogels=(columns, rows))
    layout = Layout(
        plate=plate,
        frustum=small().frustum,
        units="mm",
        content=PlateContent(),
        side=(min(width, columns), min(height, rows)),
    )
    ends, others = (
        st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)).map(lambda two: tuple(sorted(two)))
        for count in (columns, rows)
    )
    spans: Any = data.draw(st.lists(st.tuples(ends, others), min_size=1, max_size=3))
    asked = blocks_of_apertures(plate, spans)
    blocks = list(layout.blocks(asked))
    found = [aperture for block in blocks for aperture in block.apertures]
    assert sorted(a.index for a in found) == sorted(a.index for a in asked)
    assert len({block.number for block in blocks}) == len(blocks)
    for block in blocks:
        for aperture in block.apertures:
            row, column = block.place_of(aperture)
            assert (block.columns[column], block.rows[row]) == aperture.index
    listed = list(layout.blocks(list(asked)))
    assert {b.number: set(b.apertures) for b in listed} == {b.number: set(b.apertures) for b in blocks}


# Plates that are judged: the measures of `compare` beside the pixels, as arrays and as a table.

SQUARE = (2, 2)
CHOSEN = [(3, 2), (0, 0), (1, 0), (6, 4)]


def apertures() -> list[Aperture]:
    return [small().plate.aperture(*index) for index in CHOSEN]


def judged(out: Path, chosen: list[Aperture] | None = None) -> PlateFiles:
    wanted = apertures() if chosen is None else chosen
    return write_plate(small(), SETTINGS, out, wanted, EVERYTHING, block=SQUARE, judge=True)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four hogels of a plate, judged, in three blocks."""
    out = tmp_path_factory.mktemp("judged") / "x.zarr"
    assert judged(out).drawn == len(CHOSEN)
    return out


def test_the_measures_are_those_of_compare_and_the_others_are_not_a_number(
    measured: Path,
) -> None:
    opened = xarray.open_zarr(measured, chunks=None)
    reference = Reference(small())
    with Rasterizer(small()) as rasterizer:
        for here in apertures():
            drawn = rasterizer.render(here, SETTINGS)
            numbers = compare_images(reference.trace(here), drawn, reference, radiance=False).numbers
            assert numbers.surface is not None and numbers.displacement_px is not None
            hogel = opened.isel(row=here.row, column=here.column)
            assert int(hogel.surface_wrong) == numbers.surface.wrong
            assert float(hogel.surface_fraction) == numbers.surface.fraction
            assert float(hogel.displacement_px_p99) == numbers.displacement_px.p99
            assert int(hogel.judged) == numbers.judged
            np.testing.assert_array_equal(hogel.color, drawn.color)
    finite = np.isfinite(opened.displacement_px_p99.values)
    assert {(column, row) for row, column in np.argwhere(finite).tolist()} == set(CHOSEN)
    assert opened.displacement_px_p99.dims == ("row", "column")
    assert opened.displacement_px_p99.attrs["units"] == "px" and opened.height_rms.attrs["units"] == "mm"
    assert not [name for name in opened if str(name).startswith("radiance")]


def test_the_table_has_a_row_for_each_hogel_and_the_columns_of_the_arrays(
    measured: Path,
) -> None:
    table = pq.read_table(measured.with_suffix(".parquet"))
    assert sorted(zip(*(table[name].to_pylist() for name in ("column", "row")), strict=True)) == sorted(
        CHOSEN
    )
    opened = xarray.open_zarr(measured, chunks=None)
    for row in table.to_pylist():
        hogel = opened.isel(row=row["row"], column=row["column"])
        assert (row["x"], row["y"]) == (float(hogel.x), float(hogel.y))
        for name, number in hogel.data_vars.items():
            if number.ndim == 0 and name != "finished":
                assert row[str(name)] == float(number) or (row[str(name)] is None and np.isnan(number))


@pytest.mark.parametrize("damage", ["part", "array"])
def test_measures_that_are_gone_or_damaged_are_made_again(
    damage: str, measured: Path, tmp_path: Path
) -> None:
    out = Path(shutil.copytree(measured, tmp_path / "x.zarr"))
    table = Path(shutil.copytree(measured.with_suffix(".parquet"), tmp_path / "x.parquet"))
    if damage == "part":
        (table / "block-00000000.parquet").write_bytes(b"nothing")
    else:
        (out / "surface_wrong" / "c" / "0" / "0").write_bytes(b"")
    files = write_plate(
        small(),
        SETTINGS,
        out,
        apertures(),
        EVERYTHING,
        block=SQUARE,
        judge=True,
        check=damage == "array",
    )
    assert files.drawn == 2
    assert tree(out) == tree(measured) and tree(table) == tree(measured.with_suffix(".parquet"))


def test_rows_of_one_block_add_up_in_any_order(measured: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    second_of_its_block = [apertures()[2]]
    assert judged(out, second_of_its_block).drawn == 1
    files = judged(out)
    assert (files.drawn, files.found) == (len(CHOSEN) - 1, 1)
    assert tree(out) == tree(measured)
    assert tree(out.with_suffix(".parquet")) == tree(measured.with_suffix(".parquet"))


@pytest.mark.parametrize("written", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_a_run_that_ends_after_any_file_of_a_block_goes_on_to_the_same_bytes(
    written: int, measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of a block are its triangles, its colors, the arrays of its measures, and which are finished."""
    out, count, put = tmp_path / "x.zarr", 0, local_store._put

    def ending(path: Path, *arguments: Any, **others: Any) -> int:
        nonlocal count
        count += path.is_relative_to(out)
        if count > written:
            raise OSError(28, "No space left on device")
        return put(path, *arguments, **others)

    with monkeypatch.context() as patched:
        patched.setattr(local_store, "_put", ending)
        with pytest.raises(InputError, match="No space left"):
            judged(out)
    files = judged(out)
    assert (files.drawn, files.found, files.damaged) == (len(CHOSEN), 0, 0)
    assert tree(out) == tree(measured)
    assert tree(out.with_suffix(".parquet")) == tree(measured.with_suffix(".parquet"))


def test_judging_changes_no_pixel_and_is_asked_for_from_the_beginning(measured: Path, tmp_path: Path) -> None:
    out = write_plate(small(), SETTINGS, tmp_path / "x.zarr", apertures(), EVERYTHING, block=SQUARE).out
    pixels = {path: data for path, data in tree(out).items() if path.startswith(("color/c", "triangle/c"))}
    assert pixels.items() <= tree(measured).items()
    with pytest.raises(InputError, match=r"other content"):
        judged(out)


@pytest.mark.parametrize(("name", "points"), thinned([("asymmetric-recentered", 3), ("mirror-sphere", 1)], 2))
def test_a_judged_plate_has_the_pixels_of_one_that_is_not(name: str, points: int, tmp_path: Path) -> None:
    """The one is drawn hogel by hogel, the other many at a time: all channels, light, sub-apertures."""
    scene = replace(small(name), sampling=Sampling(aperture=points))
    content = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)
    written = []
    for judge in (False, True):
        here, out = [scene.plate.aperture(0, 0)], tmp_path / f"{judge}.zarr"
        write_plate(scene, SETTINGS, out, here, content, block=(1, 1), judge=judge)
        written.append({path: data for path, data in tree(out).items() if "/c/" in path})
    pixels, with_measures = written
    assert len(pixels) >= len(DRAWN_CHANNELS) and pixels.items() <= with_measures.items()


def test_a_table_that_cannot_be_written_is_said_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_text("mine")
    with pytest.raises(InputError, match="is no folder"):
        judged(tmp_path / "x.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["x.parquet"]


def test_the_command_judges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.zarr"
    line = ["plate", "hard/only-behind", "--apertures", "1-2,3", "--quiet", "--out", str(out), "--judge"]
    assert main([*line, "--near", "0.1"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "2 hogels drawn, 0 found",
        str(out),
        str(tmp_path / "x.parquet"),
    ]
    assert pq.read_table(tmp_path / "x.parquet").num_rows == 2
    assert main([*line[:-1], "--truth", "--judge", "--apertures", "0,0"]) == 2
    assert "leave out --truth" in capsys.readouterr().err


# What docs/plates.md shows runs, and does what it says.

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "plates.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
LEVELS_OF_A_PICTURE = 1.25
"""Largest difference of levels: one by cutting off to whole levels, and 2^-11 of 255 for each of the two
roundings of numbers of 16 bits."""

DRAWN_COLUMNS = (0, 10, 20, 40)


def test_the_programs_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The row is that of a small scene, and has some of its hogels."""
    monkeypatch.chdir(tmp_path)
    scene = view("asymmetric", (16, 12))
    chosen = blocks_of_apertures(scene.plate, [((column, column), (30, 30)) for column in DRAWN_COLUMNS])
    content = PlateContent(channels=(Channel.COLOR, Channel.HEIGHT))
    write_plate(scene, SETTINGS, Path("row.zarr"), chosen, content, judge=True)
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(compile(program, "docs/plates.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "Dimensions" in printed and "displacement_px_p99" in printed and "worst hogel: " in printed
    mosaic = np.asarray(Image.open("mosaic.png"))
    assert mosaic.shape == (12, 9 * 16, 3)
    with Rasterizer(scene) as rasterizer:
        for place in range(9):
            column = 10 * place
            shown = mosaic[:, 16 * place : 16 * (place + 1)]
            if column not in DRAWN_COLUMNS:
                assert not shown.any()
                continue
            color = rasterizer.render_color(scene.plate.aperture(column, 30), SETTINGS).astype(np.float16)
            expected = 255 * color.clip(0, 1).astype(np.float64) ** (1 / 2.2)
            assert np.abs(shown - expected).max() <= LEVELS_OF_A_PICTURE
            assert shown.any()
