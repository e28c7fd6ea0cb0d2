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
from PIL import Image
from zarr.storage import _local as local_store

from tests.reports.plate.test_plate_stream import BLOCK, EVERYTHING, SETTINGS, array, small, tree
from tests.support.long_tail import thinned
from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.plate.plate import PlateFiles, blocks_of_apertures, layout_of, write_plate
from xfrustum.reports.plate.store import Table, camera_of
from xfrustum.reports.plate.stored import StoredPlate
from xfrustum.scenes import InputError
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.model.plate_content import DRAWN_CHANNELS, Channel, ColorType, PlateContent
from xfrustum.scenes.plate.plate import Aperture

ALL = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate in blocks that nobody disturbed."""
    out = tmp_path_factory.mktemp("clean") / "x.zarr"
    return write_plate(small(), SETTINGS, out, content=ALL, block=BLOCK).out


def test_blocks_are_shards_with_a_chunk_for_each_hogel_and_hold_the_rasterizers_images(
    clean: Path,
) -> None:
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


def test_a_plate_of_version_0_2_is_read_as_finished_and_not_gone_on_with(
    clean: Path, tmp_path: Path
) -> None:
    """It did not say which hogels are there."""
    plate = Path(shutil.copytree(clean, tmp_path / "x.zarr"))
    shutil.rmtree(plate / "finished")
    said = json.loads((plate / "zarr.json").read_bytes())
    del said["consolidated_metadata"]["metadata"]["finished"]
    (plate / "zarr.json").write_text(json.dumps(said))
    assert StoredPlate(plate).finished(small().plate.aperture(6, 4))
    with pytest.raises(InputError, match="the description of finished is damaged"):
        write_plate(small(), SETTINGS, plate, content=ALL)


def test_xarray_shows_names_coordinates_and_units(clean: Path) -> None:
    """That they are those of a labelled image is tested in tests/notebooks."""
    plate = xarray.open_zarr(clean)
    assert plate.color.dims == ("row", "column", "v", "u", "rgb")
    assert plate.height.dims == ("row", "column", "v", "u")
    assert set(plate.coords) == {"row", "column", "x", "y", "u", "v"} and bool(plate.finished.all())
    assert re.search(r"units: +mm", repr(plate))
    width, height = small().frustum.resolution
    np.testing.assert_array_equal(plate.u, (2 * np.arange(width) + 1) / width - 1)
    np.testing.assert_array_equal(plate.v, 1 - (2 * np.arange(height) + 1) / height)


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
            np.testing.assert_allclose(
                camera.half_extent, drawn.half_extent, rtol=4 * 2**-53, atol=0
            )
    with pytest.raises(InputError, match="lies outside the plate"):
        camera_of(out, 7, 0)


@pytest.mark.parametrize("block", [(1, 1), BLOCK])
def test_a_stored_plate_says_which_hogels_are_finished(
    block: tuple[int, int], tmp_path: Path
) -> None:
    scene, out = small(), tmp_path / "x.zarr"
    drawn = [scene.plate.aperture(*index) for index in ((2, 2), (6, 4), (0, 0))]
    write_plate(scene, SETTINGS, out, drawn, EVERYTHING, block=block)
    stored = StoredPlate(out)
    assert [
        aperture for aperture in scene.plate.apertures() if stored.finished(aperture)
    ] == sorted(drawn, key=lambda one: (one.row, one.column))
    assert stored.description["scene"]["hash"] == scene.content_hash


def test_what_is_no_plate_has_neither_hogels_nor_cameras(tmp_path: Path) -> None:
    zarr.create_group(tmp_path / "other.zarr")
    group = zarr.create_group(
        tmp_path / "damaged.zarr", attributes={"xfrustum": {"plate": {"size": "x"}}}
    )
    for store in (tmp_path / "other.zarr", tmp_path / "nosuch.zarr"):
        for read in (StoredPlate, lambda place: camera_of(place, 0, 0)):
            with pytest.raises(InputError, match="is no plate"):
                read(store)
    with pytest.raises(InputError, match="is damaged"):
        camera_of(group, 0, 0)


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
            np.testing.assert_array_equal(
                stored, np.asarray(getattr(truth, channel), dtype=stored.dtype)
            )
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
            numbers = compare_images(
                reference.trace(here), drawn, reference, radiance=False
            ).numbers
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
    assert (
        opened.displacement_px_p99.attrs["units"] == "px"
        and opened.height_rms.attrs["units"] == "mm"
    )
    assert not [name for name in opened if str(name).startswith("radiance")]


def test_the_table_has_a_row_for_each_hogel_and_the_columns_of_the_arrays(
    measured: Path,
) -> None:
    table = pq.read_table(measured.with_suffix(".parquet"))
    assert sorted(
        zip(*(table[name].to_pylist() for name in ("column", "row")), strict=True)
    ) == sorted(CHOSEN)
    opened = xarray.open_zarr(measured, chunks=None)
    for row in table.to_pylist():
        hogel = opened.isel(row=row["row"], column=row["column"])
        assert (row["x"], row["y"]) == (float(hogel.x), float(hogel.y))
        for name, number in hogel.data_vars.items():
            if number.ndim == 0 and name != "finished":
                assert row[str(name)] == float(number) or (
                    row[str(name)] is None and np.isnan(number)
                )


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


def test_two_processes_write_the_measures_of_one_block_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole blocks are written under a lock that all share: neither file is in the other's way."""
    scene, table, write = small(), Table(tmp_path), pq.write_table
    block, *_ = layout_of(scene, EVERYTHING, BLOCK).blocks(scene.plate.apertures())

    def overtaken(*arguments: Any) -> None:
        monkeypatch.setattr(pq, "write_table", write)
        write(*arguments)
        table.add(block, ())

    monkeypatch.setattr(pq, "write_table", overtaken)
    table.add(block, ())
    assert (
        list(tmp_path.iterdir()) == [table.path(block)]
        and pq.read_table(table.path(block)).num_rows == 0
    )


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


@pytest.mark.parametrize(
    ("name", "points"), thinned([("asymmetric-recentered", 3), ("mirror-sphere", 1)], 2)
)
def test_a_judged_plate_has_the_pixels_of_one_that_is_not(
    name: str, points: int, tmp_path: Path
) -> None:
    """The one is drawn hogel by hogel, the other many at a time: all channels, light, sub-apertures."""
    scene = replace(small(name), sampling=Sampling(aperture=points))
    content = PlateContent(color=ColorType.FLOAT32, channels=DRAWN_CHANNELS)
    written = []
    for judge in (False, True):
        here, out = [scene.plate.aperture(0, 0)], tmp_path / f"{judge}.zarr"
        write_plate(scene, SETTINGS, out, here, content, block=(1, 1), judge=judge)
        written.append({path: data for path, data in tree(out).items() if "/c/" in path})
    with pytest.raises(InputError, match="other content"):
        write_plate(
            scene, SETTINGS, tmp_path / "False.zarr", here, content, block=(1, 1), judge=True
        )
    pixels, with_measures = written
    assert len(pixels) >= len(DRAWN_CHANNELS) and pixels.items() <= with_measures.items()


def test_a_table_that_cannot_be_written_is_said_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_text("mine")
    with pytest.raises(InputError, match="is no folder"):
        judged(tmp_path / "x.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["x.parquet"]


def test_the_command_judges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.zarr"
    line = [
        "plate",
        "hard/only-behind",
        "--apertures",
        "1-2,3",
        "--quiet",
        "--out",
        str(out),
        "--judge",
    ]
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
DRAWN_COLUMNS = (0, 10, 20, 40)


@pytest.mark.slow
def test_the_programs_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The row is that of a small scene, and has some of its hogels."""
    monkeypatch.chdir(tmp_path)
    scene = view("asymmetric", (16, 12))
    chosen = blocks_of_apertures(
        scene.plate, [((column, column), (30, 30)) for column in DRAWN_COLUMNS]
    )
    content = PlateContent(channels=(Channel.COLOR, Channel.HEIGHT))
    write_plate(scene, SETTINGS, Path("row.zarr"), chosen, content, judge=True)
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(compile(program, "docs/plates.md", "exec"), names)
    printed = capsys.readouterr().out
    assert (
        "Dimensions" in printed and "displacement_px_p99" in printed and "worst hogel: " in printed
    )
    mosaic = np.asarray(Image.open("mosaic.png"))
    assert mosaic.shape == (12, 9 * 16, 3)
    shown = [10 * place for place in range(9) if mosaic[:, 16 * place : 16 * (place + 1)].any()]
    assert shown == list(DRAWN_COLUMNS)
