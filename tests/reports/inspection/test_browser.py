"""In a real browser, the values under the mouse are those of the OpenEXR files, bit for bit."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.reports.inspection.conftest import Channels, Inspected
from xfrustum import open_scene
from xfrustum.reports import inspection as inspection_page
from xfrustum.reports.inspection import (
    PAGE,
    InspectedHogel,
    Inspection,
    PlateMap,
    read_inspection,
    write_inspection,
)

playwright = pytest.importorskip(
    "playwright.sync_api", reason="needs playwright, the extra `browser`"
)

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((found for name in BROWSERS if (found := shutil.which(name))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="needs Chromium, which is not installed"),
]

PIXELS = 20
"""Pixels of each hogel that the mouse visits."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"]
        )
        yield running
        running.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    """A tab whose errors fail the test."""
    tab, errors = browser.new_page(viewport={"width": 1400, "height": 900}), []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    yield tab
    tab.close()
    assert errors == []


def visited(truth: Channels, image: Channels) -> list[tuple[int, int]]:
    """Return columns and rows: corners and edges of the film, background, wrong pixels, and others."""
    height, width = truth["P.Z"].shape
    found = [(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1), (width // 2, 0)]
    random = np.random.default_rng(1)
    for mask in (
        truth["id.triangle"] != image["id.triangle"],
        (truth["id.triangle"] == 0) & (image["id.triangle"] == 0),
        (truth["P.Z"] > 0) & (image["P.Z"] > 0),
    ):
        rows, columns = np.nonzero(mask)
        some = random.permutation(len(rows))[:5]
        found += zip(columns[some].tolist(), rows[some].tolist(), strict=True)
    assert len(found) == PIXELS
    return found


def wait_for(tab: Any, hogel: InspectedHogel) -> None:
    """Wait until the page shows a hogel."""
    tab.wait_for_selector('body[data-shown="{},{}"]'.format(*hogel.aperture))


def count_files(tab: Any) -> int:
    """Return how many files beside the page it has read."""
    return int(tab.eval_on_selector_all("script[src]", "some => some.length"))


def point_at(tab: Any, pixel: tuple[int, int], size: tuple[int, int]) -> None:
    """Move the mouse to a pixel of an image that is shown as a whole, in the middle of the canvas."""
    box = tab.locator("#canvas").bounding_box()
    scale = min(box["width"] / size[0], box["height"] / size[1])
    left, top = (box["width"] - scale * size[0]) / 2, (box["height"] - scale * size[1]) / 2
    tab.mouse.move(
        box["x"] + left + scale * (pixel[0] + 0.5),
        box["y"] + top + scale * (pixel[1] + 0.5),
    )


def values_shown(tab: Any, layer: str) -> dict[str, str]:
    """Return the numbers that stand in the table, without their meanings."""
    script = """cells => Object.fromEntries(cells.filter(cell => cell.firstChild)
        .map(cell => [cell.dataset.channel, cell.firstChild.textContent]))"""
    found: dict[str, str] = tab.eval_on_selector_all(f'#values td[data-layer="{layer}"]', script)
    return found


def same_bits(text: str, value: Any) -> bool:
    """Whether a text, read as the value's type, has its bits."""
    return text == "NaN" if np.isnan(value) else type(value)(text).tobytes() == value.tobytes()


@pytest.mark.parametrize("command", ["report", "verify", "survey"])
def test_the_value_under_the_mouse_is_that_of_the_file(
    inspected: Inspected, opened: Any, command: str
) -> None:
    path = inspected.pages[command] / PAGE
    opened.goto(path.as_uri())
    for number, hogel in enumerate(read_inspection(path)[:2]):
        opened.locator("#hogels button").nth(number).click()
        wait_for(opened, hogel)
        files = {layer: inspected.exr(hogel.aperture, layer) for layer in ("truth", "image")}
        for column, row in visited(**files):
            point_at(opened, (column, row), hogel.size)
            assert opened.inner_text("#where") == f"pixel {column}, {row}"
            for layer, stored in files.items():
                told = values_shown(opened, layer)
                assert told.keys() == hogel.values()[layer].keys()
                for name, text in told.items():
                    assert same_bits(text, stored[name][row, column]), (layer, name, text)


def test_a_hogel_in_a_file_beside_the_page_is_read_when_it_is_looked_at(
    inspected: Inspected, opened: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hogels = read_inspection(inspected.pages["verify"] / PAGE)
    scene = open_scene(inspected.scene)
    monkeypatch.setattr(inspection_page, "MAX_PAGE_BYTES", 0)
    map_ = PlateMap.from_values(scene.plate, "nothing", [])
    write_inspection(
        tmp_path, Inspection(command="verify", scene=scene, told="", hogels=hogels, plate_map=map_)
    )
    opened.goto((tmp_path / PAGE).as_uri())
    wait_for(opened, hogels[0])
    assert count_files(opened) == 1
    opened.keyboard.press("]")
    wait_for(opened, hogels[1])
    assert count_files(opened) == 2
    point_at(opened, (20, 14), hogels[1].size)
    stored = hogels[1].values()["image"]
    assert same_bits(values_shown(opened, "image")["P.X"], stored["P.X"][14, 20])


def test_an_address_shows_somebody_else_the_same_pixel(inspected: Inspected, opened: Any) -> None:
    path = inspected.pages["report"] / PAGE
    hogel = read_inspection(path)[1]
    place = "{},{}".format(*hogel.aperture)
    opened.goto(f"{path.as_uri()}#hogel={place}&channel=P.X&mode=image&pixel=12,20&zoom=24")
    wait_for(opened, hogel)
    opened.wait_for_selector("#where:text-is('pixel 12, 20')")
    assert opened.input_value("#channel") == "P.X"
    assert opened.inner_text('#modes [aria-pressed="true"]') == "image"
    assert same_bits(values_shown(opened, "truth")["P.Z"], hogel.values()["truth"]["P.Z"][20, 12])
