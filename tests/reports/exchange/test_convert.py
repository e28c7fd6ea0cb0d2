"""`convert`: a plate goes through every layout and through Zarr, and comes back with the same bits."""

import json
from pathlib import Path

import numpy as np
import pytest
import zarr

from xfrustum.cli.main import main
from xfrustum.reports.exchange.convert import (
    ConversionOptions,
    PlateArray,
    convert,
    missing_hogels,
    open_plate,
    write_group,
)
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.files.layouts import PlateShape
from xfrustum.scenes.files.plate_files import Plates, whole_plate

FULL = ("hogels", "burnett", "hocking", "mosaic", "views", "stanford", "pleno", "hci")
HORIZONTAL = ("hocking-columns", "quilt", "cubevi")


def group(folder: Path, dtype: str, resolution: tuple[int, int] = (6, 5)) -> tuple[Path, np.ndarray]:
    """Write a plate of random colors into a Zarr group."""
    rng = np.random.default_rng(1)
    shape = PlateShape(hogels=(4, 3), resolution=resolution).array
    if dtype == "uint8":
        plate = Plates(pixels=rng.integers(0, 256, shape, np.uint8), levels=255)
    else:
        plate = Plates(pixels=rng.random(shape, np.float32).astype(dtype), levels=None)
    write_group(plate, folder / "plate.zarr", PlateArray.COLOR, {})
    return folder / "plate.zarr", plate.pixels


def stored(tmp_path: Path, array: str) -> np.ndarray:
    """Return an array of the group that came back."""
    return np.asarray(zarr.open_array(tmp_path / "back.zarr" / array)[...])


@pytest.mark.parametrize("name", [*FULL, *HORIZONTAL])
def test_from_zarr_through_every_layout_and_back(name: str, tmp_path: Path) -> None:
    source, pixels = group(tmp_path, "uint8", (40, 1) if name in HORIZONTAL else (6, 5))
    there = convert(source, tmp_path / name, write_as=name)
    assert (there.read_as, there.written_as, there.losses) == ("zarr", name, ())
    told = ConversionOptions(hogels=(4, 3) if name == "cubevi" else None)
    back = convert(tmp_path / name, tmp_path / "back.zarr", read_as=name, options=told)
    assert back.read_as == name
    plate = whole_plate(open_plate(tmp_path / "back.zarr", PlateArray.COLOR))
    found = plate.pixels if plate.levels else np.rint(plate.pixels * 255)
    assert np.array_equal(found, pixels)


def test_files_of_pleno_are_ppm_also_where_colors_are_floating_point(tmp_path: Path) -> None:
    """Under another ending they would be no files of `pleno`, and could not be read again as such."""
    source, pixels = group(tmp_path, "float16")
    done = convert(source, tmp_path / "out", write_as="pleno")
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".ppm"}
    assert done.losses[0].endswith("rounded to 1023 levels")
    convert(tmp_path / "out", tmp_path / "back.zarr", read_as="pleno")
    assert np.array_equal(np.rint(stored(tmp_path, "color") * 1023), np.rint(pixels.astype(float) * 1023))
    with pytest.raises(InputError, match=r"layout pleno end in \.ppm"):
        convert(source, tmp_path / "other", write_as="pleno", options=ConversionOptions(suffix=".png"))


def test_what_is_lost_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, pixels = group(tmp_path, "float32")
    out = tmp_path / "quilt.png"
    assert main(["convert", str(source), str(out), "--to", "quilt", "--tiles", "3,2", "--json"]) == 0
    told = capsys.readouterr()
    summary = json.loads(told.out)
    assert Path(summary["out"]).name == "quilt_qs3x2a1.333.png"
    lost = [lost.partition(":")[0] for lost in summary["losses"]]
    assert lost == ["vertical parallax", "floating-point numbers"]
    assert "note: lost: vertical parallax" in told.err
    convert(Path(summary["out"]), tmp_path / "back.zarr")
    found = stored(tmp_path, "color")
    assert np.array_equal(found, np.rint(pixels[:, :, 2:3].astype(np.float64) * 255).astype(np.uint8))


def test_numbers_of_triangles_become_pictures_and_numbers_again(tmp_path: Path) -> None:
    numbers = np.array([-1, 0, 254, 255, 65535, (1 << 24) - 2], dtype=np.int32).reshape(1, 1, 2, 3)
    plate = zarr.create_group(tmp_path / "plate.zarr")
    plate.create_array("triangle", data=numbers)
    convert(tmp_path / "plate.zarr", tmp_path / "pictures", write_as="hogels")
    triangles = ConversionOptions(array="triangle")
    convert(tmp_path / "pictures", tmp_path / "back.zarr", options=triangles)
    assert np.array_equal(stored(tmp_path, "triangle"), numbers)


@pytest.mark.parametrize(("drawn", "missing"), [(None, 14), (15, 0), (14, 1), (0, 15)])
def test_hogels_that_were_never_drawn_are_counted(drawn: int | None, missing: int, tmp_path: Path) -> None:
    """A plate says which hogels are finished; of one that says nothing, those without files are missing."""
    plate = zarr.create_group(tmp_path / "plate.zarr")
    shards = None if drawn is None else (2, 2, 4, 5, 3)
    color = plate.create_array(
        "color", shape=(3, 5, 4, 5, 3), chunks=(1, 1, 4, 5, 3), shards=shards, dtype="uint8"
    )
    color[1, 1] = np.full((4, 5, 3), 7, np.uint8)
    if drawn is not None:
        plate.create_array("finished", data=(np.arange(15) < drawn).astype("u1").reshape(3, 5), chunks=(2, 2))
    assert missing_hogels(open_plate(tmp_path / "plate.zarr", None)) == missing
    done = convert(tmp_path / "plate.zarr", tmp_path / "views", write_as="views")
    told = (f"{missing} hogels are not there and count as empty",) if missing else ()
    assert done.reasons[2:] == done.notes == told


def test_a_folder_whose_plate_is_stated_lacks_whole_rows(tmp_path: Path) -> None:
    """Names alone would tell of a plate of fewer rows."""
    source, _ = group(tmp_path, "uint8")
    convert(source, tmp_path / "files", write_as="hogels")
    for column in range(4):
        (tmp_path / "files" / f"hogel_{column}x2.png").unlink()
    assert convert(tmp_path / "files", tmp_path / "short", write_as="views").hogels == (4, 2)
    (tmp_path / "files" / "plate.json").write_text('{"hogels": [4, 3], "resolution": [6, 5]}')
    with pytest.raises(InputError, match="4 files of the layout hogels are not there, for a plate of 4 x 3"):
        convert(tmp_path / "files", tmp_path / "views", write_as="views")
    assert not (tmp_path / "views").exists()


def test_no_hogel_that_is_there_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, _ = group(tmp_path, "uint8", (6, 1))
    convert(source, tmp_path / "files", write_as="hogels")
    arguments = ["convert", str(tmp_path / "files"), str(tmp_path / "out"), "--to", "quilt"]
    assert main([*arguments, "--hogels", "2,3"]) == 2
    error = capsys.readouterr().err
    assert "6 of 12 files of the layout hogels lie beyond a plate of 2 x 3 hogels" in error
    assert "leave out --hogels" in error
    assert not (tmp_path / "out").exists()
    assert main([*arguments, "--hogels", "4,3"]) == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["plate.zarr", "out"], "--to"),
        (["plate.zarr", "plate.zarr"], "exists"),
        (["plate.zarr", "out", "--to", "cubevi"], "40 pixels wide"),
        (["plate.zarr", "out", "--to", "quilt", "--tiles", "4,2"], "4 x 2 tiles hold no 6 views"),
        (["plate.zarr", "out", "--array", "triangle", "--to", "views"], "no array triangle"),
        (["mosaic.png", "out", "--to", "views"], "--hogels"),
        (["damaged", "out", "--to", "views"], "000_000.ppm: the image is damaged"),
    ],
)
def test_bad_input_is_told_in_one_line_and_leaves_nothing(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from PIL import Image  # noqa: PLC0415

    monkeypatch.chdir(tmp_path)
    group(Path(), "uint8")
    Image.new("RGB", (4, 4)).save("mosaic.png")
    Path("damaged").mkdir()
    Path("damaged", "000_000.ppm").write_bytes(b"P6\n4 3\n1023\n12")
    before = sorted(Path().iterdir())
    assert main(["convert", *arguments]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert sorted(Path().iterdir()) == before


def test_a_folder_says_its_layout_and_a_bar_counts_files_and_hogels_unless_nobody_wants_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, _ = group(tmp_path, "uint8")
    assert main(["convert", str(source), str(tmp_path / "files"), "--to", "hocking"]) == 0
    assert "12/12" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "files"), str(tmp_path / "back.zarr")]) == 0
    assert "12/12" in capsys.readouterr().err
    assert (
        main(["convert", str(tmp_path / "files"), str(tmp_path / "views"), "--to", "views", "--quiet"]) == 0
    )
    printed = capsys.readouterr()
    assert printed.err == "" and printed.out.startswith("read as hocking: 12 of 12 names fit: ")
    assert len(list((tmp_path / "views").iterdir())) == 30


@pytest.mark.slow
def test_an_encoding_that_files_cannot_have_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenEXR files with colors alone are judged by colors, whatever --encoding says."""
    width, height = open_scene("asymmetric").frustum.resolution
    pixels = np.zeros((1, 1, height, width, 3), np.float32)
    write_group(Plates(pixels=pixels, levels=None), tmp_path / "one.zarr", PlateArray.COLOR, {})
    convert(tmp_path / "one.zarr", tmp_path / "hogels", write_as="hogels")
    pattern = str(tmp_path / "hogels" / "hogel_{i}x{j}.exr")
    arguments = ["verify", "asymmetric", pattern, "--apertures", "0,0", "--quiet", "--encoding"]
    main([*arguments, "triangle-id"])
    assert "--encoding triangle-id is not used" in capsys.readouterr().err
    main([*arguments, "rgb"])
    assert "is not used" not in capsys.readouterr().err
