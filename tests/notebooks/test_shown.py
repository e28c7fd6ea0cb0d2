"""Notebook displays of results: a line, facts and pictures; and short representations."""

import io
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from PIL import Image

from tests.support.views import view as scene_named
from tests.support.worlds import World
from xfrustum import (
    DoubleFrustum,
    Evaluator,
    Eye,
    Reference,
    Scene,
    budget,
    check,
    compare_images,
    cost,
    plan,
    survey,
    verify,
    view,
)
from xfrustum.compare.sampling import SampleRequest
from xfrustum.reports.blocks import Engine
from xfrustum.reports.budget import auto_budget
from xfrustum.reports.displays import DISPLAYED, display, first_png, html
from xfrustum.reports.notebook import MAX_SIDE_PX, Figure, NotebookRepr, png
from xfrustum.reports.plotting import auto_apertures
from xfrustum.scenes import Plate
from xfrustum.scenes.files.pictures import Encoding, StoredPixels, of_stored
from xfrustum.scenes.representation import encoded

SETTINGS = DoubleFrustum(near=2.0)
MAX_LINE = 420  # characters: two or three lines of a wide page


def small_scene(name: str = "asymmetric", resolution: tuple[int, int] = (24, 18)) -> Scene:
    scene = scene_named(name, resolution)
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(4, 3)))


@pytest.fixture(scope="module")
def results(tiny: World) -> dict[str, Any]:
    scene, truth, drawn = tiny.scene, tiny.truth(), tiny.raster()
    pixels = StoredPixels(rgb=np.zeros((*truth.triangle.shape, 3), dtype=np.uint8))
    seen = view(scene, [Eye(position=(0, 0, 600), resolution=(16, 12))])
    with Evaluator(scene) as evaluator:
        hogel = next(evaluator.stream([scene.plate.middle], [SETTINGS], images=True))
    return {
        "scene": scene,
        "object": scene.objects[0],
        "truth": truth,
        "drawn": drawn,
        "foreign": of_stored(pixels, truth.camera, Encoding.SRGB),
        "comparison": compare_images(truth, drawn, tiny.reference),
        "budget": budget(scene, SETTINGS),
        "view": seen,
        "eye": seen.views[0].true,
        "check": check(scene),
        "hogel": hogel,
        "drawing": hogel.drawings[0],
    }


def structure_of(text: str) -> tuple[set[str], list[bytes], str]:
    """Return tags, pictures and words of an HTML text; assert that every element is closed."""
    closed = re.sub(r"(<img[^>]*[^/])>", r"\1/>", text)
    root = Xml.fromstring(f"<div>{closed}</div>")
    pictures = []
    for image in root.iter("img"):
        kind, _, content = image.attrib["src"].partition(";base64,")
        assert kind in ("data:image/png", "data:image/svg+xml")
        pictures.append(b64decode(content, validate=True))
    return {element.tag for element in root.iter()}, pictures, "".join(root.itertext())


def assert_displayed(result: Any) -> str:
    """Check the display of a result; return its line."""
    shown = result._display() if isinstance(result, NotebookRepr) else display(result)
    assert "\n" not in shown.line and len(shown.line) <= MAX_LINE, shown.line
    text = result._repr_html_() if isinstance(result, NotebookRepr) else html(result)
    tags, pictures, words = structure_of(text)
    assert tags <= {"div", "p", "b", "pre", "figure", "figcaption", "img"}
    assert shown.line in words and shown.facts in words
    # The page's colors stay visible, in light and dark mode.
    styles = " ".join(re.findall(r'style="([^"]*)"', text))
    assert "background" not in styles and not re.search(r"(?<![-\w])color", styles)
    if shown.first_png is not None:
        assert shown.first_png == pictures[0]
        assert max(Image.open(io.BytesIO(shown.first_png)).size) <= MAX_SIDE_PX
    return shown.line


def parts_of(value: object) -> Iterator[object]:
    """Yield all nested parts of a result."""
    yield value
    if is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            yield from parts_of(getattr(value, item.name))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from parts_of(part)


def test_results_are_displayed_and_no_part_writes_out_its_arrays(results: dict[str, Any]) -> None:
    for result in results.values():
        assert_displayed(result)
        records = [part for part in parts_of(result) if is_dataclass(part)]
        assert records
        assert [type(part).__name__ for part in records if "array(" in repr(part)] == []
    assert len(repr(results["scene"])) < 10 * MAX_LINE


def test_the_picture_of_an_image_is_its_color_as_a_screen_shows_it(results: dict[str, Any]) -> None:
    truth = results["truth"]
    picture = np.asarray(Image.open(io.BytesIO(first_png(truth) or b"")))
    expected = np.rint(255 * encoded(truth.color)).astype(np.uint8)
    side = len(picture) // len(expected)
    assert picture.shape[1] == side * expected.shape[1] and expected.any()
    assert np.array_equal(picture[side // 2 :: side, side // 2 :: side], expected)


@dataclass(frozen=True, kw_only=True, repr=False)
class Strange(NotebookRepr):
    """A result whose words would be HTML markup, with a large picture."""

    def _said(self) -> str:
        return "<script>1 < 2 & 'so'</script>"

    def _figures(self) -> list[Figure]:
        return [Figure(caption='a "quoted" picture', content=png(np.zeros((1500, 2, 3), np.uint8)))]


def test_words_are_escaped_and_large_pictures_reduced() -> None:
    assert_displayed(Strange())
    assert Image.open(io.BytesIO(Strange()._repr_png_() or b"")).size[1] == 500


SHELL = """
import sys, types
known = []
formatter = types.SimpleNamespace(for_type=lambda kind, shown: known.append(kind.__name__))
display = types.SimpleNamespace(formatters={"text/html": formatter, "image/png": formatter})
shell = types.SimpleNamespace(display_formatter=display)
sys.modules["IPython"] = types.SimpleNamespace(get_ipython=lambda: shell)
import xfrustum
print(*known)
"""
"""Prints the types that the import registers with an IPython shell."""


def test_ipython_displays_objects_once_xfrustum_is_imported() -> None:
    program = [sys.executable, "-c", SHELL]
    printed = subprocess.run(program, capture_output=True, check=True, text=True).stdout.split()
    assert sorted(printed) == sorted(2 * [kind.__name__ for kind in DISPLAYED])


@pytest.mark.slow
def test_plans_surveys_verdicts_costs_and_several_budgets_are_displayed(tmp_path: Path) -> None:
    scene = small_scene()
    reference, middle = Reference(scene), scene.plate.middle
    engine = Engine(workers=1)
    surveyed = survey(scene, SETTINGS, tmp_path, SampleRequest(sample=4), engine=engine)
    verdict = verify(scene, lambda scene, aperture: reference.trace(middle))
    assert "hogels are beyond 0.5 px" in assert_displayed(surveyed)
    assert "Not right" in assert_displayed(verdict)
    for result in (cost(scene, repeat=2), auto_budget(scene, SETTINGS, auto_apertures(scene))):
        assert_displayed(result)
    if isinstance(made := plan(scene), NotebookRepr):
        assert_displayed(made)
    assert surveyed._repr_png_() is not None
