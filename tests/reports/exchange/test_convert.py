"""`convert`: a plate survives every layout and Zarr bit for bit."""

import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from PIL import Image

from tests.support.commands import Command
from tests.support.worlds import World
from xfrustum import ConversionOptions, DoubleFrustum, InputError, Rasterizer, convert, write_plate
from xfrustum.reports.exchange.convert import LaidOutPlate, PlateArray, open_plate, write_group
from xfrustum.scenes.files.layouts import NAMES, PlateShape, layouts_named
from xfrustum.scenes.files.plate_files import PlateRows, find_files

TRIANGLES = ConversionOptions(array="triangle")


def group(
    folder: Path, dtype: str, resolution: tuple[int, int] = (6, 5)
) -> tuple[Path, np.ndarray]:
    """Write a plate of random colors to a Zarr group."""
    rng = np.random.default_rng(1)
    shape = PlateShape(hogels=(4, 3), resolution=resolution).array
    pixels: np.ndarray = rng.integers(0, 256, shape, np.uint8)
    if dtype != "uint8":
        pixels = rng.random(shape, np.float32).astype(dtype)
    write_group(PlateRows.from_pixels(pixels), folder / "plate.zarr", PlateArray.COLOR, {})
    return folder / "plate.zarr", pixels


def stored(tmp_path: Path, array: str) -> np.ndarray:
    """Return an array of the converted group."""
    return np.asarray(zarr.open_array(tmp_path / "back.zarr" / array)[...])


@pytest.mark.parametrize("name", NAMES)
def test_from_zarr_through_every_layout_and_back(name: str, tmp_path: Path) -> None:
    flat = layouts_named(name)[0].horizontal
    source, pixels = group(tmp_path, "uint8", (40, 1) if flat else (6, 5))
    there = convert(source, tmp_path / name, write_as=name)
    assert (there.read_as, there.written_as, there.losses) == ("zarr", name, ())
    back = convert(tmp_path / name, tmp_path / "back.zarr", read_as=name)
    assert back.read_as == name
    assert np.array_equal(open_plate(tmp_path / "back.zarr").rows.whole(), pixels)


def test_losses_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    source, pixels = group(tmp_path, "float32")
    monkeypatch.chdir(tmp_path)
    printed = command(f"convert {source} quilt.png --to quilt --tiles 3,2 --json")
    losses = [lost.partition(":")[0] for lost in printed.record["losses"]]
    assert losses == ["vertical parallax", "floating-point numbers"]
    assert "note: lost: vertical parallax" in printed.err
    convert(Path("quilt_qs3x2a1.333.png"), tmp_path / "back.zarr")
    levels = np.rint(pixels[:, :, 2:3].astype(np.float64) * 255)
    assert np.array_equal(stored(tmp_path, "color"), levels.astype(np.uint8))


def test_quilts_of_drawn_plates_are_linear_and_of_files_as_encoded(
    tiny: World, tmp_path: Path
) -> None:
    flat = replace(tiny.scene, frustum=replace(tiny.scene.frustum, resolution=(6, 1)))
    drawn = write_plate(flat, tiny.settings, tmp_path / "drawn.zarr").out
    done = convert(drawn, tmp_path / "quilt.png", write_as="quilt")
    assert Image.open(done.out).info["gamma"] == 1.0
    again = convert(done.out, tmp_path / "again_qs9x9a9.png", write_as="quilt")
    assert again.out.name == done.out.name.replace("quilt", "again")
    assert "gamma" not in Image.open(again.out).info
    assert np.array_equal(np.asarray(Image.open(again.out)), np.asarray(Image.open(done.out)))


def test_numbers_of_triangles_become_pictures_and_numbers_again(tmp_path: Path) -> None:
    numbers = np.array([-1, 0, 254, 255, 65535, (1 << 24) - 2], dtype=np.int32).reshape(1, 1, 2, 3)
    plate = zarr.create_group(tmp_path / "plate.zarr")
    plate.create_array("triangle", data=numbers)
    convert(tmp_path / "plate.zarr", tmp_path / "pictures", write_as="hogels")
    convert(tmp_path / "pictures", tmp_path / "back.zarr", options=TRIANGLES)
    assert np.array_equal(stored(tmp_path, "triangle"), numbers)


@pytest.mark.parametrize(("drawn", "missing"), [(None, 14), (15, 0), (13, 2)])
def test_hogels_that_were_never_drawn_are_counted(
    drawn: int | None, missing: int, tmp_path: Path
) -> None:
    """A plate states its finished hogels; otherwise hogels without files count as missing."""
    plate = zarr.create_group(tmp_path / "plate.zarr")
    color = plate.create_array(
        "color", shape=(3, 5, 4, 5, 3), chunks=(1, 1, 4, 5, 3), dtype="uint8"
    )
    color[1, 1] = np.full((4, 5, 3), 7, np.uint8)
    if drawn is not None:
        finished = np.arange(15, dtype=np.uint8).reshape(3, 5) < drawn
        plate.create_array("finished", data=finished.astype("u1"), chunks=(2, 2))
    assert open_plate(tmp_path / "plate.zarr").missing == missing
    done = convert(tmp_path / "plate.zarr", tmp_path / "views", write_as="views")
    note = (f"{missing} hogels are not there and count as empty",) if missing else ()
    assert done.reasons[2:] == done.notes == note


def test_no_hogel_is_left_out_unnoticed(tmp_path: Path) -> None:
    """File names alone describe a smaller plate; for a stated plate, files are missing or extra."""
    source, _ = group(tmp_path, "uint8", (6, 1))
    files, out = tmp_path / "files", tmp_path / "out"
    convert(source, files, write_as="hogels")
    beyond = "6 of 12 files of the layout hogels lie beyond a plate of 2 x 3 hogels"
    assert beyond in refused(files, out, (2, 3))
    assert "--max-hogels" in refused(files, out, (99_999_999, 99_999_999))
    for column in range(4):
        (files / f"hogel_{column}x2.png").unlink()
    assert convert(files, tmp_path / "short", write_as="views").hogels == (4, 2)
    missing = "4 files of the layout hogels are not there, for a plate of 4 x 3"
    assert missing in refused(files, out, (4, 3))
    for hogels, message in (([4, 3], missing), ([30_000, 30_000], "--max-hogels")):
        (files / "plate.json").write_text(json.dumps({"hogels": hogels, "resolution": [6, 1]}))
        assert message in refused(files, out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("plate.zarr out", "--to"),
        ("plate.zarr plate.zarr", "exists"),
        ("plate.zarr out --to quilt --tiles 4,2", "4 x 2 tiles hold no 6 views"),
        ("plate.zarr out --array triangle --to views", "no array triangle"),
        ("floating out.zarr --array triangle", "holds floating-point colors, and no numbers"),
        ("mosaic.png out --to views", "--hogels"),
        ("damaged out --to mosaic", "000_000.ppm: the image is damaged"),
    ],
)
def test_bad_input_is_refused_in_one_line_and_leaves_nothing(
    arguments: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Command,
) -> None:
    monkeypatch.chdir(tmp_path)
    group(Path(), "uint8")
    Image.new("RGB", (4, 4)).save("mosaic.png")
    convert("plate.zarr", "floating", write_as="views", options=ConversionOptions(suffix=".exr"))
    Path("damaged").mkdir()
    Path("damaged", "000_000.ppm").write_bytes(b"P6\n4 3\n255\n12")
    before = sorted(Path().iterdir())
    error = command(f"convert {arguments}", status=2).err
    assert message in error and error.count("\n") == 1
    assert sorted(Path().iterdir()) == before


def refused(source: Path, out: Path, hogels: tuple[int, int] | None = None) -> str:
    """Return the error of `convert` for a source; assert that nothing was written."""
    with pytest.raises(InputError) as raised:
        convert(source, out, write_as="hogels", options=ConversionOptions(hogels=hogels))
    assert not out.exists()
    assert len(str(raised.value).splitlines()) == 1
    assert len(str(raised.value)) <= 500
    return str(raised.value)


CHUNK = "color/c/0/0/0/0/0"  #: file of the first hogel
DAMAGES: dict[str, dict[str, object] | None] = {
    "bit of a hogel": None,
    "no codec": {"codecs": [{"name": "nonsense"}]},
    "three axes": {"shape": [3, 4, 5]},
    "large hogels": {"shape": [3, 4, 1 << 20, 1 << 20, 3]},
    "large chunks": {
        "chunk_grid": {
            "name": "regular",
            "configuration": {"chunk_shape": [3, 4, 1 << 18, 1 << 18, 3]},
        }
    },
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_group_is_refused_in_one_line(damage: str, tmp_path: Path) -> None:
    source, _ = group(tmp_path, "uint8")
    keys, chunk, description = DAMAGES[damage], source / CHUNK, source / "color" / "zarr.json"
    if keys is None:
        content = bytearray(chunk.read_bytes())
        content[len(content) // 2] ^= 4
        chunk.write_bytes(content)
    else:
        description.write_text(json.dumps({**json.loads(description.read_text()), **keys}))
    assert refused(source, tmp_path / "out")


@pytest.mark.parametrize("place", [CHUNK, "color/zarr.json"])
def test_a_pipe_in_a_group_is_refused_and_not_waited_for(place: str, tmp_path: Path) -> None:
    source, _ = group(tmp_path, "uint8")
    (source / place).unlink()
    os.mkfifo(source / place)
    assert "no regular file" in refused(source, tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hogel_0000_9999_0000_9999.png", "--max-hogels"),
        # 16 million hogels are allowed; their files are counted, not listed.
        ("hogel_0000_4000_0000_4000.png", " files of the layout "),
    ],
)
def test_plates_that_names_declare_too_large_are_refused_before_they_take_memory(
    name: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "files").mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / "files" / name)
    assert message in refused(tmp_path / "files", tmp_path / "out")


# `plate --layout` writes a plate in a layout, next to its Zarr group or in place of it.


def test_next_to_the_group_lies_the_same_plate_as_views(
    tiny: World, tmp_path: Path, command: Command
) -> None:
    scene, out, files = tiny.scene, tmp_path / "plate.zarr", tmp_path / "plate-views"
    line = f"plate {scene.source} --out {out} --layout views --channels color,triangle"
    printed = command(f"{line} --near 1 --quiet --json").record
    assert printed["layout"]["files"] == math.prod(scene.frustum.resolution)
    drawn = open_plate(out).rows.whole()
    views = find_files(files).plate
    assert views.dtype == np.float16 and np.array_equal(views.pixels, drawn) and drawn.any()
    numbers = convert(out, tmp_path / "m.png", write_as="mosaic", options=TRIANGLES).out
    mosaic = find_files(numbers, layouts=layouts_named("mosaic")).plate.pixels
    assert np.array_equal(mosaic, open_plate(out, PlateArray.TRIANGLE).rows.whole())
    # The numbers of hogels give an aspect of 1.25; the file name states the plate's own.
    quilt = LaidOutPlate(out=tmp_path / "quilt.png", layout="quilt")
    shutil.move(out, quilt.group)
    plate_width, plate_height = scene.plate.size
    assert quilt.write(scene).out.stem.endswith(f"a{plate_width / plate_height:.4g}")


def test_instead_of_the_group_there_are_pictures_alone_and_a_stopped_run_continues(
    tiny: World, tmp_path: Path, command: Command
) -> None:
    out, near = tmp_path / "pictures", DoubleFrustum(near=1.0)
    begun = LaidOutPlate(out=out, layout="burnett")
    write_plate(tiny.scene, near, begun.group, [tiny.scene.plate.aperture(3, 1)])
    line = f"plate {tiny.scene_file} --out {out} --layout burnett"
    printed = command(f"{line} --near 1 --quiet --json").record
    assert (printed["out"], printed["found"], printed["drawn"]) == (None, 1, 19)
    assert [path.name for path in tmp_path.iterdir()] == ["pictures"]
    hogel = find_files(out, layouts=layouts_named("burnett")).hogel(3, 1)
    with Rasterizer(tiny.scene) as rasterizer:
        drawn = rasterizer.render(tiny.scene.plate.aperture(3, 1), near, color=True).color
    # Half precision has steps of at most 2^-11 below 1: shaders and NumPy may round either way.
    assert np.abs(hogel.pixels.astype(np.float32) - drawn).max() <= 2.0**-11
