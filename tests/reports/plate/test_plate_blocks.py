"""Blocks of hogels: shards that Zarr reads, whole or absent, drawn by any process, labelled for xarray."""

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr
from hypothesis import given
from hypothesis import strategies as st

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, array, small, tree
from tests.support.long_tail import examples, thinned
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
from xfrustum.reports.plate.store import (
    BLOCK_BYTES,
    MAX_BLOCK_SIDE,
    Layout,
    StoredPlate,
    camera_of,
    default_side,
)
from xfrustum.scenes import InputError, Plate
from xfrustum.scenes.appearance.sampling import Transport
from xfrustum.scenes.model.plate_content import DRAWN_CHANNELS, Channel, ColorType, PlateContent

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


def test_the_default_block_holds_at_most_what_it_says() -> None:
    for resolution in ((8, 8), (128, 128), (512, 512), (4096, 4096)):
        frustum = replace(small().frustum, resolution=resolution)
        plate = Plate(size=(1.0, 1.0), hogels=(81, 61))
        columns, rows = default_side(plate, frustum, ALL)
        layout = Layout(plate=plate, frustum=frustum, units="", content=ALL, side=(columns, rows))
        stored = sum(math.prod(one.shape) * one.dtype.itemsize for one in layout.arrays) * columns * rows
        assert columns == rows <= MAX_BLOCK_SIDE
        assert stored <= BLOCK_BYTES or columns == 1
