"""Layouts: each is written, recognized by its file names, and read back bit for bit."""

import re
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from xfrustum.scenes import InputError
from xfrustum.scenes.files.layouts import (
    NAMES,
    Pixels,
    PlateShape,
    Target,
    layouts_named,
)
from xfrustum.scenes.files.pictures import Picture, read_picture, write_picture
from xfrustum.scenes.files.plate_files import PlateRows, find_files, write_files

HORIZONTAL = ("hocking-columns", "quilt")  # layouts that store one pixel row of each hogel


def plate(shape: PlateShape, dtype: str = "uint8") -> PlateRows:
    """Return a plate of random pixels."""
    rng = np.random.default_rng(3)
    if dtype == "uint8":
        return PlateRows.from_pixels(rng.integers(0, 256, shape.array, np.uint8))
    return PlateRows.from_pixels(rng.random(shape.array, np.float32).astype(dtype))


def shape_for(name: str) -> PlateShape:
    """Return a shape of four different numbers, as far as the layout permits."""
    return PlateShape(hogels=(4, 3), resolution=(6, 1 if name in HORIZONTAL else 5))


def written(before: PlateRows, name: str, folder: Path, suffix: str = ".png") -> Target:
    folder.mkdir(exist_ok=True)
    target = Target(layout=layouts_named(name)[0], suffix=suffix)
    write_files(before, target, folder)
    return target


FIRST_AND_LAST = {
    "hogels": {"hogel_0x0.png", "hogel_3x2.png"},
    "burnett": {"Hogel_0x0.png", "Hogel_2x3.png"},
    "hocking": {"hogel_0000_0004_0000_0003.png", "hogel_0003_0004_0002_0003.png"},
    "hocking-columns": {"Hogel_Column_0.png", "Hogel_Column_3.png"},
    "mosaic": {"mosaic.png"},
    "views": {"0_0.png", "4_5.png"},
    "stanford": {"out_00_00_0.800000_-0.833333.png", "out_04_05_-0.800000_0.833333.png"},
    "quilt": {"quilt_qs3x2a1.333.png"},
}


@pytest.mark.parametrize("name", NAMES)
def test_a_plate_is_written_recognized_and_read_bit_by_bit_whole_and_row_by_row(
    name: str, tmp_path: Path
) -> None:
    shape, read = shape_for(name), list[int]()
    before = plate(shape)

    def row(number: int) -> Pixels:
        read.append(number)
        return before.row(number).copy()

    written(before, name, tmp_path / "whole")
    rows = PlateRows(shape=shape, dtype=before.dtype, row=row)
    target = written(rows, name, tmp_path / "rows")
    assert read == [0, 1, 2]
    stored = {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    assert stored == {path.name: path.read_bytes() for path in (tmp_path / "rows").iterdir()}
    names = [target.file_name(index, shape) for index in target.layout.indices(shape)]
    assert {min(names), max(names)} == FIRST_AND_LAST[name] and set(names) == set(stored)
    files = find_files(tmp_path / "rows")
    assert (files.layout.name, files.missing, files.strangers, files.shape) == (name, 0, 0, shape)
    for column, line in ((0, 0), (3, 1), (1, 2)):
        assert np.array_equal(files.hogel(column, line).pixels, before.pixels[line, column])
    for number in (2, 0, 1):
        assert np.array_equal(files.rows().row(number), before.row(number))
    assert np.array_equal(files.plate.pixels, before.pixels)


@pytest.mark.parametrize(("name", "dtype"), list(zip(NAMES, cycle(["float16", "float32"]))))
def test_floating_point_is_kept_in_openexr(name: str, dtype: str, tmp_path: Path) -> None:
    before = plate(shape_for(name), dtype)
    written(before, name, tmp_path, ".exr")
    files = find_files(tmp_path, shape_for(name), layouts_named(name))
    assert files.plate.dtype == before.dtype
    assert np.array_equal(files.plate.pixels, before.pixels)


@pytest.mark.parametrize("name", HORIZONTAL)
def test_horizontal_parallax_keeps_the_middle_row(name: str, tmp_path: Path) -> None:
    before = plate(PlateShape(hogels=(4, 3), resolution=(40, 5)))
    written(before, name, tmp_path)
    after = find_files(tmp_path, None, layouts_named(name)).plate
    assert np.array_equal(after.pixels, before.pixels[:, :, 2:3])


@pytest.mark.parametrize(
    ("name", "file", "part", "pixels"),
    [
        ("burnett", "Hogel_2x3.png", np.s_[:], np.s_[2, 3, ::-1, ::-1]),
        ("hocking", "hogel_0003_0004_0000_0003.png", np.s_[:], np.s_[2, 3]),
        ("hocking-columns", "Hogel_Column_3.png", np.s_[2], np.s_[2, 3, 0, ::-1]),
        ("mosaic", "mosaic.png", np.s_[10:15, 18:24], np.s_[2, 3]),
        ("views", "4_1.png", np.s_[:], np.s_[:, :, 4, 1]),
        ("stanford", "out_04_01_-0.800000_-0.500000.png", np.s_[:], np.s_[:, :, 4, 1]),
        # View 0, for the leftmost eye, is the last pixel column, at the bottom left; views 1 and 2
        # are to its right, views 3 to 5 in the row above.
        ("quilt", "quilt_qs3x2a1.333.png", np.s_[3:, :4], np.s_[:, :, 0, 5]),
        ("quilt", "quilt_qs3x2a1.333.png", np.s_[:3, :4], np.s_[:, :, 0, 2]),
    ],
)
def test_a_part_of_a_file_holds_the_pixels_of_its_layout(
    name: str, file: str, part: Any, pixels: Any, tmp_path: Path
) -> None:
    before = plate(shape_for(name))
    written(before, name, tmp_path)
    assert np.array_equal(read_picture(tmp_path / file).pixels[part], before.pixels[pixels])


def test_pixels_beside_the_tiles_of_a_quilt_are_left_out_and_its_aspect_is_optional(
    tmp_path: Path,
) -> None:
    before = plate(shape_for("quilt"))
    written(before, "quilt", tmp_path)
    (file,) = tmp_path.iterdir()
    wide = np.pad(read_picture(file).pixels, ((1, 0), (0, 2), (0, 0)))
    write_picture(file, Picture(pixels=wide))
    file.rename(bare := file.with_name(re.sub(r"a[\d.]+(?=\.png)", "", file.name)))
    assert bare.name == "quilt_qs3x2.png"
    assert np.array_equal(find_files(bare).plate.pixels, before.pixels)


def test_aperture_views_can_name_their_direction_too(tmp_path: Path) -> None:
    before = plate(shape_for("burnett"))
    written(before, "burnett", tmp_path)
    for file in list(tmp_path.iterdir()):
        row, column = file.stem.removeprefix("Hogel_").split("x")
        file.rename(tmp_path / f"scan_{row}_{column}_0_0.png")
    files = find_files(tmp_path)
    assert (files.layout.name, files.shape, files.missing) == ("burnett", shape_for("burnett"), 0)
    assert np.array_equal(files.plate.pixels, before.pixels)


@pytest.mark.parametrize("stated", ["hocking", "quilt"])
def test_names_that_contradict_the_layout_are_refused(stated: str, tmp_path: Path) -> None:
    written(plate(shape_for("burnett")), "burnett", tmp_path)
    message = f"in the layout {stated}: .* other names; such names are of burnett"
    with pytest.raises(InputError, match=message):
        find_files(tmp_path, None, layouts_named(stated))


def test_names_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    written(plate(shape_for("hogels")), "hogels", tmp_path)
    written(plate(shape_for("hogels"), "float32"), "hogels", tmp_path, ".exr")
    with pytest.raises(InputError, match=r"hogel_0x0\.exr and hogel_0x0\.png state the same"):
        find_files(tmp_path)


def test_a_folder_of_other_pictures_has_no_layout(tmp_path: Path) -> None:
    for name in ("left.png", "right.png"):
        Image.new("RGB", (4, 4)).save(tmp_path / name)
    with pytest.raises(InputError, match=r"such as left\.png, have other names"):
        find_files(tmp_path)


def test_a_missing_view_is_named(tmp_path: Path) -> None:
    written(plate(shape_for("views")), "views", tmp_path)
    (tmp_path / "2_3.png").unlink()
    files = find_files(tmp_path)
    assert files.missing == 1
    with pytest.raises(InputError, match=r"no file such as 2_3\.png"):
        files.hogel(0, 0)


def test_the_limit_of_pillow_is_the_host_programs_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    pixels = np.random.default_rng(1).integers(0, 256, (12, 16, 3), np.uint8)
    write_picture(path, Picture(pixels=pixels))
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    assert np.array_equal(read_picture(path).pixels, pixels)
    assert Image.MAX_IMAGE_PIXELS == 10


def test_levels_beyond_8_bits_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.ppm"
    path.write_bytes(b"P6\n1 1\n255\n\1\2\3")
    assert read_picture(path).pixels.tolist() == [[[1, 2, 3]]]
    path.write_bytes(b"P6\n1 1\n1023\n\0\1\0\2\0\3")
    with pytest.raises(InputError, match="levels up to 1023; write 8 bits"):
        read_picture(path)
