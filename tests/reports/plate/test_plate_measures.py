"""Plates that are judged: the measures of `compare` beside the pixels, as arrays and as a table."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray
from zarr.storage import _local as local_store

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, small, tree
from tests.support.long_tail import thinned
from xfrustum.cli.main import main
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.plate.plate import PlateFiles, write_plate
from xfrustum.scenes import InputError
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.plate_content import DRAWN_CHANNELS, ColorType, PlateContent
from xfrustum.scenes.plate.plate import Aperture

BLOCK = (2, 2)
CHOSEN = [(3, 2), (0, 0), (1, 0), (6, 4)]


def apertures() -> list[Aperture]:
    return [small().plate.aperture(*index) for index in CHOSEN]


def judged(out: Path, chosen: list[Aperture] | None = None) -> PlateFiles:
    wanted = apertures() if chosen is None else chosen
    return write_plate(small(), SETTINGS, out, wanted, EVERYTHING, block=BLOCK, judge=True)


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four hogels of a plate, judged, in three blocks."""
    out = tmp_path_factory.mktemp("judged") / "x.zarr"
    assert judged(out).drawn == len(CHOSEN)
    return out


def test_the_measures_are_those_of_compare_and_the_others_are_not_a_number(plate: Path) -> None:
    opened = xarray.open_zarr(plate, chunks=None)
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
    measured = np.isfinite(opened.displacement_px_p99.values)
    assert {(column, row) for row, column in np.argwhere(measured).tolist()} == set(CHOSEN)
    assert opened.displacement_px_p99.dims == ("row", "column")
    assert opened.displacement_px_p99.attrs["units"] == "px" and opened.height_rms.attrs["units"] == "mm"
    assert not [name for name in opened if str(name).startswith("radiance")]


def test_the_table_has_a_row_for_each_hogel_and_the_columns_of_the_arrays(plate: Path) -> None:
    table = pq.read_table(plate.with_suffix(".parquet"))
    assert sorted(zip(*(table[name].to_pylist() for name in ("column", "row")), strict=True)) == sorted(
        CHOSEN
    )
    opened = xarray.open_zarr(plate, chunks=None)
    for row in table.to_pylist():
        hogel = opened.isel(row=row["row"], column=row["column"])
        assert (row["x"], row["y"]) == (float(hogel.x), float(hogel.y))
        for name, array in hogel.data_vars.items():
            if array.ndim == 0 and name != "finished":
                assert row[str(name)] == float(array) or (row[str(name)] is None and np.isnan(array))


@pytest.mark.parametrize("damage", ["part", "array"])
def test_measures_that_are_gone_or_damaged_are_made_again(damage: str, plate: Path, tmp_path: Path) -> None:
    out = Path(shutil.copytree(plate, tmp_path / "x.zarr"))
    table = Path(shutil.copytree(plate.with_suffix(".parquet"), tmp_path / "x.parquet"))
    if damage == "part":
        (table / "block-00000000.parquet").write_bytes(b"nothing")
    else:
        (out / "surface_wrong" / "c" / "0" / "0").write_bytes(b"")
    files = write_plate(
        small(), SETTINGS, out, apertures(), EVERYTHING, block=BLOCK, judge=True, check=damage == "array"
    )
    assert files.drawn == 2
    assert tree(out) == tree(plate) and tree(table) == tree(plate.with_suffix(".parquet"))


def test_rows_of_one_block_add_up_in_any_order(plate: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    second_of_its_block = [apertures()[2]]
    assert judged(out, second_of_its_block).drawn == 1
    files = judged(out)
    assert (files.drawn, files.found) == (len(CHOSEN) - 1, 1)
    assert tree(out) == tree(plate)
    assert tree(out.with_suffix(".parquet")) == tree(plate.with_suffix(".parquet"))


@pytest.mark.parametrize("written", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_a_run_that_ends_after_any_file_of_a_block_goes_on_to_the_same_bytes(
    written: int, plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    assert tree(out) == tree(plate)
    assert tree(out.with_suffix(".parquet")) == tree(plate.with_suffix(".parquet"))


def test_judging_changes_no_pixel_and_is_asked_for_from_the_beginning(plate: Path, tmp_path: Path) -> None:
    out = write_plate(small(), SETTINGS, tmp_path / "x.zarr", apertures(), EVERYTHING, block=BLOCK).out
    pixels = {path: data for path, data in tree(out).items() if path.startswith(("color/c", "triangle/c"))}
    assert pixels.items() <= tree(plate).items()
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
