"""No command reads a stored plate whose labels or descriptions differ, and a plate's size is known before."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zarr

from tests.reports.plate.test_plate_stream import EVERYTHING, SETTINGS, small
from xfrustum.cli.main import main
from xfrustum.reports.exchange.convert import convert
from xfrustum.reports.plate.plate import layout_of, write_plate
from xfrustum.reports.plate.size import plate_size
from xfrustum.reports.view import StoredPlate
from xfrustum.scenes import InputError

Spoil = Callable[[Path], object]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_plate(
        small(), SETTINGS, tmp_path_factory.mktemp("whole") / "p.zarr", content=EVERYTHING
    ).out


def without(file: str) -> Spoil:
    return lambda place: (place / file).unlink()


def described(array: str, key: str, value: Any, *, group_too: bool) -> Spoil:
    """Change what an array's description says, in the array's own file, or in the group's copy too."""

    def spoil(place: Path) -> None:
        own = place / array / "zarr.json"
        own.write_text(json.dumps(json.loads(own.read_text()) | {key: value}))
        if group_too:
            told = json.loads((place / "zarr.json").read_text())
            told["consolidated_metadata"]["metadata"][array][key] = value
            (place / "zarr.json").write_text(json.dumps(told))

    return spoil


def moved(name: str) -> Spoil:
    def spoil(place: Path) -> None:
        group = zarr.open_group(place)
        array = group[name]
        assert isinstance(array, zarr.Array)
        array[2] = np.asarray(array[:])[2] + 1

    return spoil


SPOILED: dict[str, tuple[Spoil, str]] = {
    "no x": (without("x/c/0"), r"7 of 7|6 of 7 values of x are not the scene's"),
    "no v": (without("v/c/0"), "values of v are not"),
    **{
        f"{name} moved": (moved(name), f"1 of . values of {name}|1 of .. values of {name}")
        for name in "xyuv"
    },
    "row moved": (moved("row"), "1 of 5 values of row"),
    "column moved": (moved("column"), "1 of 7 values of column"),
    "fill": (described("triangle", "fill_value", 7, group_too=True), "fill value of triangle is 7"),
    "fill, own": (
        described("triangle", "fill_value", 7, group_too=False),
        "fill value of triangle is 7",
    ),
    "names": (
        described("color", "dimension_names", ["row", "column", "u", "v", "rgb"], group_too=False),
        "dimension names of color",
    ),
    "type": (
        described("color", "data_type", "uint32", group_too=True),
        "data type of color|is damaged",
    ),
    "type of x": (
        described("x", "data_type", "int64", group_too=True),
        "data type of x|values of x",
    ),
    "shape": (described("y", "shape", [9], group_too=True), "shape of y"),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_every_reader_refuses_a_plate_that_is_not_what_its_scene_says(
    kind: str, whole: Path, tmp_path: Path
) -> None:
    spoil, told = SPOILED[kind]
    place = tmp_path / "p.zarr"
    shutil.copytree(whole, place)
    spoil(place)
    readers: dict[str, Callable[[], object]] = {
        "plate --check": lambda: write_plate(
            small(), SETTINGS, place, content=EVERYTHING, check=True
        ),
        "plate": lambda: write_plate(small(), SETTINGS, place, content=EVERYTHING),
        "view --plate": lambda: StoredPlate(place, small()),
        "convert": lambda: convert(place, tmp_path / "out", write_as="hogels"),
    }
    for name, read in readers.items():
        with pytest.raises(InputError, match=told) as caught:
            read()
        assert "p.zarr" in str(caught.value) and "\n" not in str(caught.value), name
    assert not (tmp_path / "out").exists()


def test_hogels_whose_file_is_gone_are_not_read_as_black_and_are_drawn_again(
    whole: Path, tmp_path: Path
) -> None:
    place = tmp_path / "p.zarr"
    shutil.copytree(whole, place)
    next(path for path in (place / "color" / "c" / "0" / "0").rglob("*") if path.is_file()).unlink()
    with pytest.raises(InputError, match=r"hogel 0,0 is damaged \(its file is gone\)"):
        convert(place, tmp_path / "out", write_as="hogels")
    assert write_plate(small(), SETTINGS, place, content=EVERYTHING).drawn == 35
    assert convert(place, tmp_path / "out", write_as="hogels").files == 35


def test_a_plate_says_how_large_it_will_be_and_stops_where_the_disk_is_smaller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "plate",
        "hard/only-behind",
        "--near",
        "0.1",
        "--ids",
        "--out",
        str(tmp_path / "p.zarr"),
    ]
    needed = 25 * 64 * 64 * (3 * 2 + 4)  # hogels, pixels, float16 colors and 32-bit numbers
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=needed - 1))
    assert main([*command, "--quiet"]) == 2
    told = capsys.readouterr().err
    assert (
        "25 hogels to draw take at most 1 MB before compression" in told and told.count("\n") == 1
    )
    assert "free some space" in told and "--ignore-disk-space" in told
    assert not list(tmp_path.iterdir())
    assert main([*command, "--quiet", "--ignore-disk-space", "--apertures", "*,0-1"]) == 0
    assert "note: " in (said := capsys.readouterr().err) and "10 hogels to draw" in said
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=needed * 15 // 25))
    assert main([*command, "--quiet", "--json"]) == 0
    assert (
        json.loads(capsys.readouterr().out.splitlines()[-1])["bytes_at_most"] == needed * 15 // 25
    )


def test_the_size_said_is_that_of_the_arrays_in_memory(whole: Path) -> None:
    scene, group = small(), zarr.open_group(whole)
    images = [np.asarray(group[name][:]) for name in ("color", "triangle")]  # type: ignore[index]
    size = plate_size(
        whole.parent / "new.zarr", layout_of(scene, EVERYTHING, None), scene.plate.apertures()
    )
    assert size.needed == sum(image.nbytes for image in images)
    assert (
        plate_size(whole, layout_of(scene, EVERYTHING, None), scene.plate.apertures()).hogels == 0
    )
