"""`plate --layout` writes a drawn plate in a layout: beside its Zarr group, or instead of it."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from tests.support.scene_file import film, named, part
from xfrustum import DoubleFrustum, open_scene, write_plate
from xfrustum.cli.main import main
from xfrustum.reports.exchange.convert import LaidOutPlate, PlateArray, open_plate
from xfrustum.scenes.files.layouts import layouts_named
from xfrustum.scenes.files.plate_files import find_files, whole_plate


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Return a scene of a plate that is wider than its hogels are many."""
    path = tmp_path / "boxes.toml"
    objects = part("box", 12, (4, 0, -14)) + part("box", 6, (-5, 2, 16))
    path.write_text(named("boxes") + film((40, 20), (4, 3), (6, 5), (60, 60), (60, 60)) + objects)
    return path


def plate(scene: Path, out: Path, *words: str) -> int:
    return main(["plate", str(scene), "--near", "0.5", "--out", str(out), "--quiet", "--json", *words])


def test_beside_the_group_lies_the_same_plate_as_views(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "plate.zarr"
    assert plate(scene, out, "--layout", "views", "--ids") == 0
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (said["out"], said["drawn"]) == (str(out), 12)
    wrote = {"layout": "views", "out": str(tmp_path / "plate-views"), "files": 30}
    assert said["layout"] == wrote | {"losses": [], "notes": []}
    drawn = whole_plate(open_plate(out, PlateArray.COLOR))
    files = find_files(tmp_path / "plate-views")
    assert files.plate.pixels.dtype == np.float16
    assert np.array_equal(files.plate.pixels, drawn.pixels)
    assert drawn.pixels.any()
    assert "triangle" in zarr.open_group(out)


def test_instead_of_the_group_there_are_pictures_alone_and_a_stopped_run_goes_on(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, opened = tmp_path / "pictures", open_scene(scene)
    begun = LaidOutPlate(out=out, layout="burnett")
    write_plate(opened, DoubleFrustum(near=0.5), begun.group, [opened.plate.aperture(3, 1)])
    assert plate(scene, out, "--layout", "burnett") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["out"], said["found"], said["drawn"]) == (None, 1, 11)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["boxes.toml", "pictures"]
    write_plate(opened, DoubleFrustum(near=0.5), tmp_path / "again.zarr")
    expected = whole_plate(open_plate(tmp_path / "again.zarr", PlateArray.COLOR))
    found = find_files(out, layouts=layouts_named("burnett"))
    assert np.array_equal(found.plate.pixels, expected.pixels)
    assert (out / "Hogel_1x3.exr").exists()


def test_triangle_numbers_alone_become_pictures_and_a_quilt_states_the_shape_of_the_plate(
    scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "plate.zarr"
    assert plate(scene, out, "--layout", "mosaic", "--channels", "triangle") == 0
    expected = whole_plate(open_plate(out, PlateArray.TRIANGLE))
    found = find_files(tmp_path / "plate-mosaic", layouts=layouts_named("mosaic"))
    assert np.array_equal(found.plate.pixels, expected.pixels) and expected.pixels.any()
    quilt = LaidOutPlate(out=tmp_path / "quilt.png", layout="quilt")
    shutil.copytree(out, quilt.group)
    assert quilt.write(open_scene(scene)).files == 1
    assert [path.name for path in tmp_path.glob("quilt*")] == ["quilt_qs3x2a2.png"]
