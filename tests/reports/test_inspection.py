"""Inspection pages of all commands show the values of the OpenEXR files at wrong pixels."""

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.support.scene_file import film, named, part
from tests.support.views import view
from xfrustum import DoubleFrustum, Evaluator
from xfrustum.cli.main import main
from xfrustum.reports.inspection import (
    COLORS,
    DRAWN,
    PAGE,
    PlateMap,
    inspected_frame,
    replacing_inspection,
)
from xfrustum.reports.plotting import MAX_MAP_CELLS
from xfrustum.scenes import Plate

SCENE = (
    named("two <b>parts</b>", "mm")
    + film(
        (40.0, 30.0), hogels=(2, 1), resolution=(28, 20), fov_deg=(60.0, 44.0), reach=(50.0, 60.0)
    )
    + part("torus", 12.0, (3.0, 1.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    + part("box", 30.0, (-4.0, 2.0, -35.0), rotate_deg=(10.0, 40.0, 0.0))
)
SETTING = ("--near", "4", "--depth", "d24")  # displaces points by several pixels


def exr_channels(path: Path) -> dict[str, Any]:
    """Return the channels of an OpenEXR file, read without the package's reader."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a report, a verification of rasterized files, and a survey."""
    folder = tmp_path_factory.mktemp("inspected")
    scene = folder / "parts.toml"
    scene.write_text(SCENE)
    for i in range(2):
        words = [str(scene), "--aperture", f"{i},0"]
        assert main(["trace", *words, "--quiet", "--out", str(folder / f"truth-{i}-0.exr")]) == 0
        assert main(["raster", *words, *SETTING, "--out", str(folder / f"image-{i}-0.exr")]) == 0
    apertures = ("--apertures", "0,0;1,0")
    commands = {
        "report": (str(scene), *SETTING, *apertures),
        "verify": (str(scene), str(folder / "image-{i}-{j}.exr")),
        "survey": (str(scene), *SETTING, "--all", "--workers", "1"),
    }
    for name, line in commands.items():
        status = main([name, *line, "--quiet", "--out", str(folder / name)])
        assert status == (1 if name == "verify" else 0)
    return folder


@pytest.mark.parametrize("command", ["report", "verify", "survey"])
def test_listed_pixels_have_the_values_of_the_files(folder: Path, command: str) -> None:
    page = (folder / command / PAGE).read_text()
    data = json.loads(re.search(r'type="application/json" id="data">(.*?)</script>', page)[1])
    places = re.findall(r"<h2>Hogel (\d),0", page)
    assert sorted(places) == ["0", "1"] and "<b>parts" not in page
    for place, hogel in zip(places, data, strict=True):
        assert hogel["size"] == [28, 20]
        assert hogel["pixels"]
        layers = {
            name: exr_channels(folder / f"{name}-{place}-0.exr") for name in ("truth", "image")
        }
        for values in hogel["pixels"]:
            named_values = dict(zip(hogel["columns"], values, strict=True))
            at = named_values["row"], named_values["column"]
            for name, layer in layers.items():
                number = named_values[f"{name} triangle"]
                assert layer["id.triangle"][at] == (0 if number is None else number + 1)
                height = named_values[f"{name} z"]
                stored = layer["P.Z"][at]
                assert np.isnan(stored) if height is None else np.float32(height) == stored


def test_panes_show_the_classes_of_all_pixels() -> None:
    scene = view("asymmetric", (40, 30))
    with Evaluator(scene) as evaluator:
        (frame,) = evaluator.frames([scene.plate.middle], [DoubleFrustum(near=8.0)], DRAWN)
    hogel = inspected_frame(scene, frame)
    states = next(pane for pane in hogel.panes if pane.caption == "Right or wrong")
    picture = np.asarray(Image.open(io.BytesIO(states.content)).convert("RGBA"))
    wrong = frame.comparison.errors.surface & ~frame.comparison.errors.outside
    assert wrong.any()
    assert {entry.label: entry.pixels for entry in states.legend}["wrong surface"] == wrong.sum()
    color = [int(value) for value in re.findall(r"\d+", COLORS[0])]
    np.testing.assert_array_equal((picture[..., :3] == color).all(axis=-1), wrong)
    labels = {entry.label for pane in hogel.panes for entry in pane.legend}
    assert "near offset" in labels


def test_a_page_of_an_earlier_run_is_removed_where_there_is_no_new_one(tmp_path: Path) -> None:
    page = tmp_path / PAGE
    for text, stays in (('<p class="kicker">xfrustum verify', False), ("mine", True)):
        page.write_text(text)
        with replacing_inspection(tmp_path, kept=False):
            assert page.exists()
        assert page.exists() == stays


def test_a_cell_of_a_large_plate_shows_the_worst_of_its_hogels() -> None:
    plate = Plate(size=(100.0, 50.0), hogels=(10 * MAX_MAP_CELLS, 60))
    values = [(0, 0, 0.1), (9, 0, 0.3), (10, 0, 0.2), (1199, 59, 0.0)]
    shown = PlateMap.from_values(plate, "Share of wrong pixels", values)
    assert shown.cells.shape == (60, MAX_MAP_CELLS) and shown.largest == "30 %"
    assert shown.cells[0, 0] == 0.3 and shown.cells[0, 1] == 0.2 and shown.cells[59, -1] == 0.0
    assert np.isnan(shown.cells).sum() == shown.cells.size - 3
