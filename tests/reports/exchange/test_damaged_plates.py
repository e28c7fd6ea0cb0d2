"""Plates that are damaged, or declare far more than they hold: one line and status 2, and nothing written."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from xfrustum.reports.exchange.convert import ConversionOptions, PlateArray, convert, write_group
from xfrustum.scenes import InputError
from xfrustum.scenes.files.plate_files import Plates


@pytest.fixture
def group(tmp_path: Path) -> Path:
    """Return a Zarr group of 3 x 2 hogels of 5 x 4 pixels."""
    pixels = np.random.default_rng(1).integers(0, 256, (2, 3, 4, 5, 3), np.uint8)
    write_group(Plates(pixels=pixels, levels=255), tmp_path / "plate.zarr", PlateArray.COLOR, {})
    return tmp_path / "plate.zarr"


def refused(source: Path, out: Path, hogels: tuple[int, int] | None = None) -> str:
    """Return the one line with which `convert` refuses, after it has written nothing."""
    with pytest.raises(InputError) as raised:
        convert(source, out, write_as="hogels", options=ConversionOptions(hogels=hogels))
    assert not out.exists()
    assert len(str(raised.value).splitlines()) == 1
    assert len(str(raised.value)) <= 500
    return str(raised.value)


def chunk_of(group: Path) -> Path:
    """Return the file of the first hogel."""
    return group / "color" / "c" / "0" / "0" / "0" / "0" / "0"


def edited(**keys: object) -> Callable[[Path], None]:
    """Return what gives keys of the array's description other values."""

    def edit(group: Path) -> None:
        path = group / "color" / "zarr.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **keys}))

    return edit


def flipped(group: Path) -> None:
    """Flip a bit of a compressed hogel."""
    damaged = bytearray(chunk_of(group).read_bytes())
    damaged[len(damaged) // 2] ^= 4
    chunk_of(group).write_bytes(damaged)


@pytest.mark.parametrize(
    "damage",
    [
        flipped,
        lambda group: (group / "zarr.json").write_text("[]"),
        lambda group: (group / "color" / "zarr.json").write_text("{}"),
        edited(codecs=[{"name": "nonsense"}]),
        edited(shape=[2, 3, 4]),
        edited(shape="wide"),
        edited(data_type="nothing"),
        edited(shape=[30_000, 30_000, 4, 5, 3]),
        edited(shape=[2, 3, 1 << 20, 1 << 20, 3]),
        edited(chunk_grid={"name": "regular", "configuration": {"chunk_shape": [2, 3, 1 << 18, 1 << 18, 3]}}),
    ],
)
def test_a_damaged_group_is_refused_in_one_line(
    group: Path, damage: Callable[[Path], object], tmp_path: Path
) -> None:
    damage(group)
    assert refused(group, tmp_path / "out")


@pytest.mark.parametrize("place", ["chunk", "description", "beside"])
def test_a_pipe_in_a_group_is_refused_and_not_waited_for(group: Path, place: str, tmp_path: Path) -> None:
    path = {
        "chunk": chunk_of(group),
        "description": group / "color" / "zarr.json",
        "beside": group / ".zgroup",
    }
    path[place].unlink(missing_ok=True)
    os.mkfifo(path[place])
    assert "no regular file" in refused(group, tmp_path / "out")


def folder_of(place: Path, *names: str) -> Path:
    """Return a folder of small pictures of these names."""
    place.mkdir()
    for name in names:
        Image.new("RGB", (4, 4)).save(place / name)
    return place


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("hogel_0000_9999_0000_9999.png", None),
        ("hogel_0x0.png", [30_000, 30_000]),
        ("hogel_0x999999999999.png", None),
    ],
)
def test_more_hogels_than_allowed_are_refused_before_anything_is_made_of_them(
    name: str, facts: list[int] | None, tmp_path: Path
) -> None:
    folder = folder_of(tmp_path / "files", name, *(["hogel_0x0.png"] if "x" in name else []))
    if facts:
        (folder / "plate.json").write_text(json.dumps({"hogels": facts, "resolution": [4, 4]}))
    for hogels in (None, (99_999_999, 99_999_999)):
        assert "--max-hogels" in refused(folder, tmp_path / "out", hogels)


@pytest.mark.parametrize("name", ["hogel_0000_4000_0000_4000.png", "9999_9999.png", "input_Cam99999999.png"])
def test_names_of_millions_of_files_take_no_memory(name: str, tmp_path: Path) -> None:
    # 16 million hogels are allowed; their files are counted, and not listed.
    first = name.replace("9", "0") if name[0] != "h" else name
    folder = folder_of(tmp_path / "files", name, first)
    assert " files of the layout " in refused(folder, tmp_path / "out")
