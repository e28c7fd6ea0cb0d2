"""What docs/plates.md shows runs, and does what it says."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.reports.plate.test_plate_stream import SETTINGS
from tests.support.views import view
from xfrustum.raster import Rasterizer
from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
from xfrustum.scenes.model.plate_content import Channel, PlateContent

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "plates.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
LEVELS_OF_A_PICTURE = 1.25
"""Largest difference of levels: one by cutting off to whole levels, and 2^-11 of 255 for each of the two
roundings of numbers of 16 bits."""

DRAWN_COLUMNS = (0, 10, 20, 40)


def test_the_mosaic_has_five_lines() -> None:
    [mosaic] = [text for text in PROGRAMS if "mosaic.png" in text]
    assert len([line for line in mosaic.splitlines() if line]) == 5


def test_the_commands_can_be_given_in_order() -> None:
    """A plate is continued by the same command alone, so that each has its own place."""
    places = re.findall(r"^    xfrustum plate .*--out (\S+)", PAGE, re.MULTILINE)
    assert len(places) > 5
    assert len(set(places)) == len(places)
    assert "row.zarr" in places


def test_the_programs_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The row is that of a small scene, and has some of its hogels."""
    monkeypatch.chdir(tmp_path)
    scene = view("asymmetric", (16, 12))
    chosen = blocks_of_apertures(scene.plate, [((column, column), (30, 30)) for column in DRAWN_COLUMNS])
    content = PlateContent(channels=(Channel.COLOR, Channel.HEIGHT))
    write_plate(scene, SETTINGS, Path("row.zarr"), chosen, content, judge=True)
    names: dict[str, object] = {}
    for program in PROGRAMS:
        exec(compile(program, "docs/plates.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "Dimensions" in printed and "displacement_px_p99" in printed and "worst hogel: " in printed
    mosaic = np.asarray(Image.open("mosaic.png"))
    assert mosaic.shape == (12, 9 * 16, 3)
    with Rasterizer(scene) as rasterizer:
        for place in range(9):
            column = 10 * place
            shown = mosaic[:, 16 * place : 16 * (place + 1)]
            if column not in DRAWN_COLUMNS:
                assert not shown.any()
                continue
            color = rasterizer.render_color(scene.plate.aperture(column, 30), SETTINGS).astype(np.float16)
            expected = 255 * color.clip(0, 1).astype(np.float64) ** (1 / 2.2)
            assert np.abs(shown - expected).max() <= LEVELS_OF_A_PICTURE
            assert shown.any()
