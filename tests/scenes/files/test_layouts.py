"""Layouts: every one is written, read back, and recognized; the files hold what their layout says."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from xfrustum.scenes import InputError
from xfrustum.scenes.files.layouts import (
    LAYOUTS,
    NAMES,
    Naming,
    Pixels,
    PlateShape,
    layout_for,
    layouts_named,
)
from xfrustum.scenes.files.pictures import Picture, read_picture, write_picture
from xfrustum.scenes.files.plate_files import (
    PlateRows,
    Plates,
    Target,
    find_files,
    plate_with_levels,
    with_levels,
    write_files,
)

HORIZONTAL = ("hocking-columns", "quilt", "cubevi")
"""Names of the layouts that keep one row of pixels of each hogel."""


def plate(shape: PlateShape, dtype: str = "uint8") -> Plates:
    """Return a plate of random pixels."""
    rng = np.random.default_rng(3)
    if dtype == "uint8":
        return Plates(pixels=rng.integers(0, 256, shape.array, np.uint8), levels=255)
    return Plates(pixels=rng.random(shape.array, np.float32).astype(dtype), levels=None)


def shape_for(name: str) -> PlateShape:
    """Return a shape with four different numbers, as far as the layout allows it."""
    if name == "cubevi":
        return PlateShape(hogels=(4, 3), resolution=(40, 1))
    return PlateShape(hogels=(4, 3), resolution=(6, 1 if name in HORIZONTAL else 5))


def target(name: str, suffix: str | None = None) -> Target:
    layout = layout_for(name, suffix)
    return Target(layout=layout, naming=Naming(suffix=suffix or layout.suffix))


NAMES_OF_FILES = {
    "hogels": {"hogel_0x0.png", "hogel_3x2.png"},
    "burnett": {"Hogel_0x0.png", "Hogel_2x3.png"},
    "hocking": {"hogel_0000_0004_0000_0003.png", "hogel_0003_0004_0002_0003.png"},
    "hocking-columns": {"Hogel_Column_0.png", "Hogel_Column_3.png"},
    "mosaic": {"mosaic.png"},
    "views": {"0_0.png", "4_5.png"},
    "stanford": {"out_00_00_0.800000_-0.833333.png", "out_04_05_-0.800000_0.833333.png"},
    "pleno": {"000_000.ppm", "004_005.ppm"},
    "hci": {"input_Cam000.png", "input_Cam029.png"},
    "quilt": {"quilt_qs3x2a1.333.png"},
    "cubevi": {"cubevi.png"},
}
"""Names that files of the plates in `shape_for` have: all of one file, or the first and the last."""


@pytest.mark.parametrize("name", NAMES)
def test_a_plate_is_written_recognized_and_read_again_bit_by_bit_whole_and_row_by_row(
    name: str, tmp_path: Path
) -> None:
    shape, asked = shape_for(name), list[int]()
    before = plate(shape)

    def row(number: int) -> Pixels:
        asked.append(number)
        return before.row(number).copy()

    assert target(name).losses(before) == ()
    rows = PlateRows(shape=shape, levels=before.levels, dtype=before.dtype, row=row)
    for folder, written in (("whole", before), ("rows", rows)):
        (tmp_path / folder).mkdir()
        write_files(written, target(name), tmp_path / folder)
    assert asked == [0, 1, 2]
    files = {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "rows").iterdir()}
    names = [target(name).file_name(index, shape) for index in target(name).layout.indices(shape)]
    assert {min(names), max(names)} == NAMES_OF_FILES[name] and set(names) == set(files)
    # Names alone say the layout; all but a mosaic and a CubeVi picture look like no other.
    found = find_files(
        tmp_path / "rows",
        shape if name in ("hci", "cubevi") else None,
        (layouts_named(name) if name == "cubevi" else LAYOUTS),
    )
    assert (found.layout.name, found.missing, found.strangers, found.shape) == (name, 0, 0, shape)
    assert len(found.reasons) >= 2
    assert np.array_equal(with_levels(found.plate.pixels, found.plate.levels, 255), before.pixels)
    for column, line in ((0, 0), (3, 1), (1, 2)):
        hogel = found.hogel(column, line)
        assert np.array_equal(
            with_levels(hogel.pixels, hogel.levels, 255), before.pixels[line, column]
        )
    # Files of other layouts have pixels from all over the plate.
    assert isinstance(found.rows(), Plates) == (name not in ("hogels", "hocking", "burnett"))
    after = plate_with_levels(found.rows(), 255)
    assert (after.shape, after.dtype) == (before.shape, before.dtype)
    for number in (2, 0, 1):
        assert np.array_equal(after.row(number), before.row(number))


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("pleno",)])
@pytest.mark.parametrize("dtype", ["float16", "float32"])
def test_floating_point_is_kept_in_openexr(name: str, dtype: str, tmp_path: Path) -> None:
    before = plate(shape_for(name), dtype)
    write_files(before, target(name, ".exr"), tmp_path)
    found = find_files(tmp_path, shape_for(name), layouts_named(name))
    assert found.plate.pixels.dtype == before.pixels.dtype
    assert np.array_equal(found.plate.pixels, before.pixels)


@pytest.mark.parametrize("name", HORIZONTAL)
def test_horizontal_parallax_keeps_the_stated_row(name: str, tmp_path: Path) -> None:
    shape = PlateShape(hogels=(4, 3), resolution=(40, 5))
    before = plate(shape)
    assert "row 2" in target(name).losses(before)[0]
    write_files(before, target(name), tmp_path)
    flat = PlateShape(hogels=shape.hogels, resolution=(40, 1))
    after = find_files(tmp_path, flat, layouts_named(name)).plate
    assert np.array_equal(after.pixels, before.pixels[:, :, 2:3])


@pytest.mark.slow
def test_video_rows_are_read_again_bit_by_bit(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the package av, the optional part xfrustum[video]")
    before = plate(PlateShape(hogels=(4, 3), resolution=(16, 8)))
    write_files(before, target("burnett", ".avi"), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"HogelRow_{j}.avi" for j in range(3)
    ]
    found = find_files(tmp_path)
    assert found.layout.name == "burnett" and not found.plate.lossy
    assert np.array_equal(found.plate.pixels, before.pixels)


def pixels_of(name: str, file: str, tmp_path: Path, before: Plates) -> np.ndarray:
    write_files(before, target(name), tmp_path)
    return read_picture(tmp_path / file).pixels


@pytest.mark.parametrize(
    ("name", "file", "part", "pixels"),
    [
        ("burnett", "Hogel_2x3.png", np.s_[:], np.s_[2, 3, ::-1, ::-1]),
        ("hocking", "hogel_0003_0004_0000_0003.png", np.s_[:], np.s_[2, 3]),
        ("hocking-columns", "Hogel_Column_3.png", np.s_[2], np.s_[2, 3, 0, ::-1]),
        ("mosaic", "mosaic.png", np.s_[10:15, 18:24], np.s_[2, 3]),
        ("views", "4_1.png", np.s_[:], np.s_[:, :, 4, 1]),
        ("stanford", "out_04_01_-0.800000_-0.500000.png", np.s_[:], np.s_[:, :, 4, 1]),
        # The first camera stands where lines of the last pixel come from.
        ("hci", "input_Cam000.png", np.s_[:], np.s_[:, :, 4, 5]),
    ],
)
def test_a_part_of_a_file_holds_the_pixels_that_its_layout_says(
    name: str, file: str, part: Any, pixels: Any, tmp_path: Path
) -> None:
    before = plate(shape_for(name))
    assert np.array_equal(pixels_of(name, file, tmp_path, before)[part], before.pixels[pixels])


def test_pleno_has_ten_bits_big_endian(tmp_path: Path) -> None:
    before = plate(shape_for("pleno"))
    write_files(before, target("pleno"), tmp_path)
    content = (tmp_path / "004_001.ppm").read_bytes()
    assert content.startswith(b"P6\n4 3\n1023\n")
    first = int.from_bytes(content[len(b"P6\n4 3\n1023\n") :][:2], "big")
    assert first == round(int(before.pixels[0, 0, 4, 1, 0]) * 1023 / 255)


@pytest.mark.parametrize(
    ("name", "first", "size"), [("quilt", (1, 0), (3, 2)), ("cubevi", (0, 0), (8, 5))]
)
def test_the_first_view_of_a_quilt_is_that_of_the_leftmost_eye(
    name: str, first: tuple[int, int], size: tuple[int, int], tmp_path: Path
) -> None:
    before = plate(shape_for(name))
    write_files(before, target(name), tmp_path)
    found = read_picture(next(tmp_path.iterdir())).pixels
    assert found.shape == (3 * size[1], 4 * size[0], 3)
    tile = found[first[0] * 3 :][:3, first[1] * 4 :][:, :4]
    assert np.array_equal(tile, before.pixels[:, :, 0, -1])
    second = found[first[0] * 3 :][:3, 4:8]
    assert np.array_equal(second, before.pixels[:, :, 0, -2])


def test_pixels_beside_the_tiles_of_a_quilt_are_left_out(tmp_path: Path) -> None:
    before = plate(shape_for("quilt"))
    found = pixels_of("quilt", "quilt_qs3x2a1.333.png", tmp_path, before)
    wide = np.pad(found, ((1, 0), (0, 2), (0, 0)))
    write_picture(tmp_path / "quilt_qs3x2a1.333.png", Picture(pixels=wide))
    after = find_files(tmp_path).plate
    assert np.array_equal(after.pixels, before.pixels)


def test_a_quilt_need_not_state_an_aspect(tmp_path: Path) -> None:
    before = plate(shape_for("quilt"))
    write_files(before, target("quilt"), tmp_path)
    (file,) = tmp_path.iterdir()
    file.rename(bare := file.with_name(re.sub(r"a[\d.]+(?=\.png)", "", file.name)))
    assert re.fullmatch(r".*_qs\d+x\d+\.png", bare.name)
    found = find_files(bare)
    assert found.layout.name == "quilt" and np.array_equal(found.plate.pixels, before.pixels)


def test_a_folder_of_other_pictures_looks_like_nothing(tmp_path: Path) -> None:
    for name in ("left.png", "right.png"):
        Image.new("RGB", (4, 4)).save(tmp_path / name)
    with pytest.raises(InputError, match="names of no layout"):
        find_files(tmp_path)


@pytest.mark.parametrize("stated", ["hocking", "quilt"])
def test_files_of_another_layout_than_the_stated_say_which_they_look_like(
    stated: str, tmp_path: Path
) -> None:
    write_files(plate(shape_for("burnett")), target("burnett"), tmp_path)
    with pytest.raises(InputError, match=f"not named as those of {stated}; they look like burnett"):
        find_files(tmp_path, None, layouts_named(stated))


def test_aperture_views_may_name_their_direction_too(tmp_path: Path) -> None:
    before = plate(shape_for("burnett"))
    write_files(before, target("burnett"), tmp_path)
    for file in list(tmp_path.iterdir()):
        row, column = file.stem.removeprefix("Hogel_").split("x")
        file.rename(tmp_path / f"scan_{row}_{column}_0_0.png")
    found = find_files(tmp_path)
    assert (found.layout.name, found.shape, found.missing) == ("burnett", shape_for("burnett"), 0)
    assert np.array_equal(found.plate.pixels, before.pixels)


def test_two_files_of_the_same_numbers_are_refused(tmp_path: Path) -> None:
    write_files(plate(shape_for("hogels")), target("hogels"), tmp_path)
    write_files(plate(shape_for("hogels"), "float32"), target("hogels", ".exr"), tmp_path)
    with pytest.raises(
        InputError, match=r"hogel_0x0\.exr and hogel_0x0\.png state the same numbers"
    ):
        find_files(tmp_path)


def test_a_missing_view_is_named(tmp_path: Path) -> None:
    write_files(plate(shape_for("views")), target("views"), tmp_path)
    (tmp_path / "2_3.png").unlink()
    found = find_files(tmp_path)
    assert found.missing == 1
    with pytest.raises(InputError, match=r"no file such as 2_3\.png"):
        found.hogel(0, 0)
