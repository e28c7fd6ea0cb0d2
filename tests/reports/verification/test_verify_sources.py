"""Failures of files, commands and functions are reported hogel by hogel, in all outputs."""

import itertools
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import xfrustum
from tests.reports.verification.conftest import run
from tests.reports.verification.synthetic import verification
from tests.support.foreign_renderers import oblong, saying
from xfrustum import (
    Aperture,
    DoubleFrustum,
    HogelImage,
    InputError,
    Rasterizer,
    Reference,
    Scene,
)
from xfrustum.compare.diagnosis import defects
from xfrustum.compare.diagnosis.defects import HYPOTHESES, Defect
from xfrustum.compare.diagnosis.encodings import ENCODING_FAULTS
from xfrustum.compare.judging.judged import MeasuredBy, judge
from xfrustum.compare.judging.verdict import places_of
from xfrustum.compare.renderer_model import drawn_model
from xfrustum.compare.renderer_model.drawn_model import OneCamera, RendererModel
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reports.verification.verdict import plate_map, render_page, table
from xfrustum.reports.verification.verification import with_tested_diagnosis
from xfrustum.scenes import NOTHING
from xfrustum.scenes.files.pictures import bytes_of

NEAR = DoubleFrustum(near=1e-4)


@pytest.fixture
def images(world: Scene) -> dict[tuple[int, int], HogelImage]:
    """Return six rasterized images, and pictures of their triangle numbers."""
    with Rasterizer(world) as rasterizer:
        made = {a.index: rasterizer.render(a, NEAR) for a in world.plate.apertures()}
    for (column, row), image in made.items():
        Image.fromarray(bytes_of(image.triangle + 1)).save(f"{column}-{row}.png")
    return made


INDICES = [[i, j] for j in (0, 1) for i in (0, 1, 2)]
NUMBERED = ("{i}-{j}.png", "--encoding", "triangle-id", "--junit", "junit.xml")


@pytest.mark.usefixtures("images")
def test_right_files_pass_and_leave_page_json_and_junit(capsys: pytest.CaptureFixture[str]) -> None:
    status, result = run(capsys, *NUMBERED, "--out", "out")
    assert (status, result["verdict"], result["diagnosis"]) == (0, "pass", [])
    assert [hogel["aperture"] for hogel in result["hogels"]] == INDICES
    assert json.loads(Path("out/verification.json").read_text()) == result
    assert "Right: all 6 hogels" in Path("out/index.html").read_text()
    suite = ElementTree.parse("junit.xml").getroot()
    assert [suite.get(name) for name in ("tests", "failures", "errors")] == ["6", "0", "0"]


@pytest.mark.usefixtures("images")
def test_missing_damaged_and_wrongly_sized_files_are_listed_and_the_rest_judged(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("0-0.png").unlink()
    Path("1-0.png").write_bytes(Path("1-0.png").read_bytes()[:90])
    Image.new("RGB", (23, 24)).save("2-0.png")
    Path("0-1.png").write_text("no picture")
    Path("1-1.png").unlink()
    Path("1-1.png").mkdir()
    status, result = run(capsys, *NUMBERED)
    words = ("no such file", "damaged", "23 x 24", "not an image", "is a folder")
    for hogel, phrase in zip(result["hogels"], words, strict=False):
        assert phrase in hogel["problem"]
    assert [hogel["verdict"] for hogel in result["hogels"]] == ["missing"] * 5 + ["pass"]
    assert status == 1 and ElementTree.parse("junit.xml").getroot().get("errors") == "5"


RENDERER = """
import os, shutil, signal, sys, time
i, j, out, copies, *words = sys.argv[1:]
kinds = {"1,0": "hang", "2,0": "crash", "0,1": "nothing", "1,1": "garbage"}
what = (kinds | {"2,1": "elsewhere"}).get(f"{i},{j}")
if what == "hang":
    # A child that outlives its parent must end too.
    if os.fork() == 0:
        time.sleep(60)
    time.sleep(60)
if what == "crash":
    sys.exit("first line\\n" + " ".join(words))
if what == "garbage":
    open(out, "wb").write(b"\\x00garbage" * 100)
elif what == "elsewhere":
    shutil.copy(copies + f"/{i}-{j}.png", copies + "/elsewhere.png")
elif what != "nothing":
    shutil.copy(copies + f"/{i}-{j}.png", out)
"""


@pytest.mark.usefixtures("images")
def test_a_command_may_hang_crash_and_write_garbage_and_the_rest_is_judged(
    world: Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands run without a shell, and formats of numbers in their arguments are applied."""
    Path("renderer.py").write_text(RENDERER)
    command = f"{sys.executable} renderer.py {{i}} {{j}} {{out}} '{Path.cwd()}'"
    command += " '$HOME; ls' {x} {y:.3e} {i:03d} {j:d}"
    words = ("--command", command, "--encoding", "triangle-id", "--timeout", "5")
    status, result = run(capsys, *words)
    assert status == 1 and result["hogels"][0]["verdict"] == "pass"
    phrases = ("longer than 5 s", "exit status 1", "wrote no file", "not an image", "wrote no file")
    for hogel, phrase in zip(result["hogels"][1:], phrases, strict=True):
        assert phrase in hogel["problem"]
    aperture = world.plate.aperture(2, 0)
    line = f"first line | $HOME; ls {aperture.x!r} {aperture.y:.3e} 002 0"
    assert line in result["hogels"][2]["problem"]
    with pytest.raises(InputError, match="no-such-renderer is no program that can be run"):
        xfrustum.verify(world, command="no-such-renderer {out}")


def test_a_function_that_raises_or_returns_something_else_is_reported(
    world: Scene, images: dict[tuple[int, int], HogelImage]
) -> None:
    with Rasterizer(replace(world, frustum=replace(world.frustum, resolution=(16, 16)))) as other:
        small = other.render(world.plate.middle, NEAR)

    def renderer(_: Scene, aperture: Aperture) -> HogelImage:
        if aperture.index == (0, 0):
            raise ValueError("no memory of that")
        if aperture.index == (1, 0):
            return None  # as foreign code does
        return small if aperture.index == (2, 0) else images[aperture.index]

    result = xfrustum.verify(world, renderer)
    assert [hogel.problem for hogel in result.hogels[:4]] == [
        "renderer raised ValueError: no memory of that",
        "renderer returned NoneType, not a HogelImage",
        "renderer returned an image that is not 24 x 24",
        None,
    ]
    assert not result.passed and result.hogels[3].passed


SHIFT = Defect(
    fault="shift-x", value=0.1, unit="px", stated=0.0, alternatives=("near",), explains=1.0
)


@pytest.mark.parametrize(("left", "named"), [((0, 200), False), ((0, 20), False), ((0, 0), True)])
def test_a_fault_is_named_where_its_correction_makes_every_hogel_right(
    left: tuple[int, int], named: bool
) -> None:
    """Two hogels have 100 wrong pixels each; after correction, some of the second's remain."""
    result = verification({(0, 0): 100, (1, 0): 100})
    other = verification({(i, 0): wrong for i, wrong in enumerate(left)})
    hogels = tuple(
        replace(mine, corrected=its.as_found, left=wrong, mended=its.passed)
        for mine, its, wrong in zip(result.hogels, other.hogels, left, strict=True)
    )
    result = replace(result, hogels=hogels, diagnosis=replace(result.diagnosis, faults=(SHIFT,)))
    tested = with_tested_diagnosis(result)
    assert (tested.diagnosis.faults == (SHIFT,)) is tested.explained is named
    for words in (table(tested), render_page(tested)):
        assert ("o single fault that was tried explains all hogels" in words) is not named
    if not named:
        (guess,) = tested.guesses()
        assert guess["explains"] == pytest.approx(1 - sum(left) / 200)
        assert "1 of 2 hogels do not pass: 1,0" in guess["words"]


def test_a_correction_that_leaves_no_judged_pixel_explains_nothing() -> None:
    result = verification({(0, 0): 100})
    (hogel,) = result.hogels
    assert hogel.as_found is not None
    blind = replace(
        hogel.as_found, by="outlines", surface=None, displacement_by=MeasuredBy.NO_OUTLINES
    )
    hogel = replace(hogel, corrected=replace(blind, wrong=0), mended=False)
    diagnosis = replace(result.diagnosis, faults=(SHIFT,))
    tested = with_tested_diagnosis(replace(result, hogels=(hogel,), diagnosis=diagnosis))
    assert [guess.explains for guess in tested.diagnosis.does_not_explain] == [0.0]
    assert not tested.diagnosis.guesses


def test_the_page_of_a_failed_verification_maps_wrong_hogels() -> None:
    result = verification({(0, 0): 0, (1, 0): 30, (0, 1): 900, (1, 1): None})
    drawn = plate_map(result)
    assert drawn is not None
    cells = {entry["words"]: entry["cells"] for entry in drawn["classes"]}
    assert cells == {
        "keeps to the limits": [[0, 0]],
        "exceeds a limit": [[0, 1]],
        "half or more is wrong": [[1, 0]],
        "missing or not judged": [[1, 1]],
    }
    assert plate_map(verification({(0, 0): 0, (1, 0): 0})) is None


DOCS = Path(__file__).resolve().parents[3] / "docs" / "verify.md"


@pytest.mark.slow
def test_the_examples_in_python_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    results = []
    for block in re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL):
        exec(compile(block, str(DOCS), "exec"), names)
        results.append(names["found"])
    function, files, command = results
    assert [fault.fault for fault in function.diagnosis.faults] == ["near"]
    assert files.passed and command.passed


def test_every_fault_is_in_the_table() -> None:
    text = DOCS.read_text()
    known = {
        value for name, value in vars(defects).items() if name.isupper() and isinstance(value, str)
    }
    known |= {entry.fault for entry in HYPOTHESES} | set(drawn_model.FAULT_NAMES)
    for side, name in itertools.product((-1, 1), drawn_model.FAULT_NAMES):
        known.add(defects.one_camera_name(name, RendererModel(one_camera=OneCamera(side))))
    assert len(known) >= 45
    assert [name for name in (*known, *ENCODING_FAULTS) if f"`{name}`" not in text] == []


def test_a_plain_picture_has_surfaces_where_it_is_not_black() -> None:
    """All colors of a picture are wrong except in its black corner."""
    scene, right = oblong(), RendererModel()
    reference = Reference(scene)
    truth = trace_drawn(reference, right, scene.plate.aperture(2, 2))
    picture = saying(colored(scene, right, truth), "color")
    assert picture.color is not None
    picture.color[...] = np.random.default_rng(0).uniform(0.1, 1.0, picture.color.shape)
    picture.color[:12, :16] = 0.0
    places = places_of(judge(reference, right, picture, picture.position.astype(np.float64)))
    wrong, _ = places["shown/nothing"]
    assert wrong == (truth.triangle[:12, :16] != NOTHING).sum() > 0
