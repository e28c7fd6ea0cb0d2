"""Results say in a line what they are, and notebooks show them with pictures and tables."""

import io
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.views import view as scene_named
from xfrustum import (
    Aperture,
    DoubleFrustum,
    Evaluator,
    Eye,
    HogelImage,
    Rasterizer,
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
from xfrustum.reports.blocks import Engine
from xfrustum.reports.budget import auto_budget
from xfrustum.reports.scout import auto_apertures
from xfrustum.reports.survey.survey import Chosen
from xfrustum.scenes import Plate
from xfrustum.scenes.appearance.display import encoded
from xfrustum.scenes.files.foreign_images import Encoding, StoredPixels, of_stored
from xfrustum.scenes.notebook import MAX_SIDE_PX, Figure, NotebookRepr, png

SETTINGS = DoubleFrustum(near=2.0)
MAX_LINE = (
    420  # largest number of characters of a line: what fits into two lines or three of a wide page
)


def small_scene(name: str = "asymmetric", resolution: tuple[int, int] = (24, 18)) -> Scene:
    scene = scene_named(name, resolution)
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(4, 3)))


@pytest.fixture(scope="module")
def results() -> dict[str, NotebookRepr]:
    scene = small_scene()
    aperture, reference = scene.plate.middle, Reference(scene)
    truth = reference.trace(aperture)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, SETTINGS)
    rgb = np.zeros((18, 24, 3), dtype=np.uint8)
    seen = view(scene, [Eye(position=(0, 0, 600), resolution=(16, 12))])
    with Evaluator(scene) as judge:
        hogel = next(judge.stream([aperture], [SETTINGS], images=True))
    return {
        "Scene": scene,
        "SceneObject": scene.objects[0],
        "HogelImage": truth,
        "drawn": drawn,
        "ForeignImage": of_stored(StoredPixels(rgb=rgb), truth.camera, Encoding.SRGB),
        "Comparison": compare_images(truth, drawn, reference),
        "BudgetReport": budget(scene, SETTINGS),
        "SceneView": seen,
        "EyeImage": seen.views[0].true,
        "SceneCheck": check(scene),
        "JudgedHogel": hogel,
        "JudgedDrawing": hogel.drawings[0],
    }


class Structure(HTMLParser):
    """What an HTML text is made of; every element that begins ends."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.pictures: list[bytes] = []
        self.words: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "img":
            kind, _, content = (dict(attrs)["src"] or "").partition(";base64,")
            assert kind in ("data:image/png", "data:image/svg+xml")
            self.pictures.append(b64decode(content, validate=True))
        else:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def assert_right_for_a_notebook(name: str, one: NotebookRepr) -> None:
    line = repr(one)
    assert "\n" not in line and "array(" not in line
    assert len(line) <= MAX_LINE, line
    if name[0].isupper():
        assert line.startswith(f"{name}: ")
    html = one._repr_html_()
    shown = Structure(html)
    assert set(shown.tags) <= {"div", "p", "b", "pre", "figure", "figcaption", "img"}
    assert line.partition(": ")[2] in "".join(shown.words)
    # Neither ink nor paper is chosen: both are the page's, be it light or dark.
    styles = " ".join(re.findall(r'style="([^"]*)"', html))
    assert "background" not in styles and not re.search(r"(?<![-\w])color", styles)
    first = one._repr_png_()
    if first is not None:
        assert first == shown.pictures[0]
        assert max(Image.open(io.BytesIO(first)).size) <= MAX_SIDE_PX


def parts_of(value: object) -> Iterator[object]:
    """Yield everything that a result is made of."""
    yield value
    if is_dataclass(value) and not isinstance(value, type):
        for one in fields(value):
            yield from parts_of(getattr(value, one.name))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from parts_of(part)


def test_a_result_says_what_it_is_and_is_shown_and_no_part_writes_out_its_arrays(
    results: dict[str, NotebookRepr],
) -> None:
    for name, one in results.items():
        assert_right_for_a_notebook(name, one)
        made = [part for part in parts_of(one) if is_dataclass(part)]
        assert made
        assert [type(part).__name__ for part in made if "array(" in repr(part)] == []


def test_the_words_are_those_of_the_numbers(results: dict[str, NotebookRepr]) -> None:
    truth, scene = results["HogelImage"], results["Scene"]
    assert isinstance(truth, HogelImage) and isinstance(scene, Scene)
    assert (
        "a plate of 80 x 60 mm with 4 x 3 hogels of 24 x 18 pixels, each 60 x 60 degrees"
        in repr(scene)
    )
    assert f"{len(scene.objects)} objects, {len(scene.faces):,} triangles" in repr(scene)
    assert (
        f"truth of aperture 2,1 of 'asymmetric' by {truth.camera.renderer}; 24 x 18 pixels"
        in repr(truth)
    )
    assert f"{np.count_nonzero(truth.covered):,} (" in repr(truth)
    assert "drawing with near 2 D24 standard" in repr(results["drawn"])
    assert "aperture 2,1 with near 2 mm" in repr(results["BudgetReport"])
    screen = repr(small_scene("asymmetric-recentered"))
    assert "recentered on a screen of 160 x 120 mm at height 120 mm" in screen


def test_the_picture_of_an_image_is_its_color_as_a_screen_shows_it(
    results: dict[str, NotebookRepr],
) -> None:
    truth = results["HogelImage"]
    assert isinstance(truth, HogelImage) and truth.color is not None
    content = truth._repr_png_()
    assert content is not None
    found = np.asarray(Image.open(io.BytesIO(content)))
    side = found.shape[0] // 18
    expected = np.rint(255 * encoded(truth.color)).astype(np.uint8)
    assert found.shape == (18 * side, 24 * side, 3)
    assert np.array_equal(found[side // 2 :: side, side // 2 :: side], expected)
    assert expected.any()


@dataclass(frozen=True, kw_only=True, repr=False)
class Strange(NotebookRepr):
    """A result whose words hold what HTML means otherwise."""

    def _said(self) -> str:
        return "<script>1 < 2 & 'so'</script>"

    def table(self) -> str:
        return "<b>"

    def _figures(self) -> list[Figure]:
        return [Figure(caption='a "quoted" picture', content=png(np.zeros((1500, 2, 3), np.uint8)))]


def test_words_are_escaped_and_large_pictures_reduced() -> None:
    one = Strange()
    assert_right_for_a_notebook("Strange", one)
    assert Structure(one._repr_html_()).words[-1] == "<b>"
    content = one._repr_png_()
    assert content is not None and Image.open(io.BytesIO(content)).size[1] == 500


def test_saying_what_it_is_loads_no_library_that_shows_it() -> None:
    program = (
        "import sys\nfrom xfrustum import open_scene\nsaid = repr(open_scene('asymmetric'))\n"
        "assert said.startswith('Scene: '), said\n"
        "heavy = ('PIL', 'xarray', 'pandas', 'matplotlib', 'IPython', 'jinja2')\n"
        "print(*(name for name in heavy if name in sys.modules))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout.strip(), ended.stderr) == (0, "", "")


@pytest.mark.slow
def test_plans_surveys_verdicts_costs_and_several_budgets_are_shown(tmp_path: Path) -> None:
    scene = small_scene()
    middle, auto = scene.plate.middle, auto_apertures(scene)

    def always_the_middle(scene: Scene, aperture: Aperture) -> HogelImage:
        del aperture
        return Reference(scene).trace(middle)

    surveyed = survey(scene, SETTINGS, tmp_path, Chosen(sample=4), engine=Engine(workers=1))
    verdict, budgets = verify(scene, always_the_middle), auto_budget(scene, SETTINGS, auto)
    assert_right_for_a_notebook("Survey", surveyed)
    assert_right_for_a_notebook("Verification", verdict)
    for made in (plan(scene), plan(scene, [middle]), cost(scene, repeat=2), budgets):
        assert_right_for_a_notebook(type(made).__name__, made)
    assert surveyed._repr_png_() is not None
    assert "hogels are beyond 0.5 px" in repr(surveyed)
    assert "Not right" in repr(verdict)
    assert repr(budgets).startswith(f"AutoBudget: {len(auto.chosen)} apertures; ")
