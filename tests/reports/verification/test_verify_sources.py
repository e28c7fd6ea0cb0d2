"""Files, commands and functions that do not give what they should are reported, hogel by hogel."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import xfrustum
from tests.reports.verification.synthetic import packed
from tests.support.foreign_renderers import Faulty, small
from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.raster import Rasterizer
from xfrustum.scenes import Aperture, DoubleFrustum, HogelImage, Scene, open_scene
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.exr import write_image

SCENE = (
    named("three parts", "mm")
    + film((40.0, 40.0), hogels=(3, 2), resolution=(32, 32), fov_deg=(60.0, 60.0), reach=(50.0, 60.0))
    + part("torus", 12.0, (6.0, 3.0, 25.0), rotate_deg=(20.0, 30.0, 0.0))
    + part("sphere", 30.0, (-4.0, 2.0, -35.0))
)
NEAR = DoubleFrustum(near=1e-4)
SOME = [(0, 0), (4, 1), (2, 2), (1, 4), (3, 3)]
"""Hogels all over a plate of 5 x 5, the middle one among them."""


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    return open_scene("scene.toml")


@pytest.fixture
def pattern(world: Scene) -> str:
    """Six pictures of triangle numbers by our own rasterizer."""
    with Rasterizer(world) as rasterizer:
        for aperture in world.plate.apertures():
            pixels = packed(rasterizer.render(aperture, NEAR).triangle)
            Image.fromarray(pixels).save(f"{aperture.column}-{aperture.row}.png")
    return "{i}-{j}.png"


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    status = main(["verify", "scene.toml", *arguments, "--json", "--quiet"])
    output = capsys.readouterr()
    return status, json.loads(output.out)


def test_right_files_pass_and_leave_page_json_and_junit(
    pattern: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status, found = run(capsys, pattern, "--encoding", "triangle-id", "--out", "out", "--junit", "junit.xml")
    assert (status, found["verdict"], found["diagnosis"]) == (0, "pass", [])
    assert [hogel["aperture"] for hogel in found["hogels"]] == [[i, j] for j in (0, 1) for i in (0, 1, 2)]
    assert json.loads(Path("out/verification.json").read_text()) == found
    page = Path("out/index.html").read_text()
    assert "Right: all 6 hogels" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    suite = ElementTree.parse("junit.xml").getroot()
    assert [suite.get(name) for name in ("tests", "failures", "errors")] == ["6", "0", "0"]


def test_missing_damaged_and_wrongly_sized_files_are_listed_and_the_rest_judged(
    pattern: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("0-0.png").unlink()
    Path("1-0.png").write_bytes(Path("1-0.png").read_bytes()[:90])
    Image.new("RGB", (31, 32)).save("2-0.png")
    Path("0-1.png").write_text("no picture")
    Path("1-1.png").unlink()
    Path("1-1.png").mkdir()
    status, found = run(capsys, pattern, "--encoding", "triangle-id", "--junit", "junit.xml")
    assert status == 1
    words = ("no such file", "damaged", "31 x 32", "not an image", "is a folder")
    for hogel, told in zip(found["hogels"], words, strict=False):
        assert told in hogel["problem"]
    assert [hogel["verdict"] for hogel in found["hogels"]] == ["missing"] * 5 + ["pass"]
    assert ElementTree.parse("junit.xml").getroot().get("errors") == "5"


RENDERER = """
import os, shutil, signal, sys, time
i, j, out, copies = sys.argv[1:]
what = {"1,0": "hang", "2,0": "crash", "0,1": "nothing", "1,1": "garbage", "2,1": "elsewhere"}.get(f"{i},{j}")
if what == "hang":
    # A child that outlives its parent must end too.
    if os.fork() == 0:
        time.sleep(60)
    time.sleep(60)
if what == "crash":
    print("first line\\nno such lens", file=sys.stderr)
    sys.exit(7)
if what == "garbage":
    open(out, "wb").write(b"\\x00garbage" * 100)
elif what == "elsewhere":
    shutil.copy(copies + f"/{i}-{j}.png", copies + "/elsewhere.png")
elif what != "nothing":
    shutil.copy(copies + f"/{i}-{j}.png", out)
"""


def test_a_command_may_hang_crash_and_write_garbage_and_the_rest_is_judged(
    pattern: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("renderer.py").write_text(RENDERER)
    command = f"{sys.executable} renderer.py {{i}} {{j}} {{out}} '{Path.cwd()}'"
    status, found = run(capsys, "--command", command, "--encoding", "triangle-id", "--timeout", "1")
    assert status == 1 and found["hogels"][0]["verdict"] == "pass"
    words = ("longer than 1 s", "exit status 7", "wrote no file", "not an image", "wrote no file")
    for hogel, told in zip(found["hogels"][1:], words, strict=True):
        assert told in hogel["problem"]
    assert "no such lens" in found["hogels"][2]["problem"]


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("{python} tell.py --x {{x}} {{i}} {{j}} '$HOME; ls' {{out}}", "--x {x!r} 2 0 $HOME; ls"),
        ("{python} tell.py {{x:.6f}} {{y:.3e}} {{i:03d}} {{j:d}} {{out}}", "{x:.6f} {y:.3e} 002 0"),
        ("no-such-renderer {{out}}", "cannot be run"),
    ],
)
def test_a_command_sees_the_aperture_as_it_asks_and_no_shell(
    world: Scene, command: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wrong field is answered with `{i:03d}` and `{x:.6f}` as examples: these work."""
    Path("tell.py").write_text("import sys; sys.exit(' '.join(sys.argv[1:]))")
    status, found = run(capsys, "--command", command.format(python=sys.executable), "--apertures", "2,0")
    assert status == 1
    aperture = world.plate.aperture(2, 0)
    assert told.format(x=aperture.x, y=aperture.y) in found["hogels"][0]["problem"]


def test_a_function_that_raises_or_returns_something_else_is_reported(world: Scene) -> None:
    smaller = replace(world, frustum=replace(world.frustum, resolution=(24, 24)))
    with Rasterizer(world) as rasterizer, Rasterizer(smaller) as other:

        def renderer(scene: Scene, aperture: Aperture) -> HogelImage:
            if aperture.index == (0, 0):
                raise ValueError("no memory of that")
            if aperture.index == (1, 0):
                return None  # as strangers do
            return (other if aperture.index == (2, 0) else rasterizer).render(aperture, NEAR)

        found = xfrustum.verify(world, renderer)
    assert [hogel.problem for hogel in found.hogels[:4]] == [
        "renderer raised ValueError: no memory of that",
        "renderer returned NoneType, not a HogelImage",
        "renderer returned an image that is not 32 x 32",
        None,
    ]
    assert not found.passed and found.hogels[3].passed


def test_python_refuses_what_the_command_line_refuses_and_nothing_is_nothing(world: Scene) -> None:
    with pytest.raises(InputError, match="accept"):
        xfrustum.verify(world, "{i}{j}", accept=("everything",))
    with pytest.raises(InputError, match="max-wrong"):
        xfrustum.verify(world, "{i}{j}", max_wrong=2.0)
    empty = replace(world, objects=())
    with Rasterizer(empty) as rasterizer:
        found = xfrustum.verify(empty, lambda scene, aperture: rasterizer.render(aperture, NEAR))
    assert found.passed and found.diagnosis.faults == ()


@pytest.mark.parametrize("kept", ["triangle", "object", "position"])
def test_any_subset_of_an_exr_files_channels_is_judged(kept: str, world: Scene, tmp_path: Path) -> None:
    with Rasterizer(world) as rasterizer:
        for aperture in world.plate.apertures():
            image = rasterizer.render(aperture, NEAR)
            nothing, nowhere = np.full_like(image.triangle, -1), np.full_like(image.position, np.nan)
            empty = replace(
                image, triangle=nothing, object=nothing, position=nowhere, normal=None, color=None
            )
            channel: dict[str, Any] = {kept: getattr(image, kept)}
            write_image(tmp_path / f"{aperture.column}{aperture.row}.exr", replace(empty, **channel))
    found = xfrustum.verify(world, str(tmp_path / "{i}{j}.exr"))
    assert found.passed
    assert found.diagnosis.faults == ()


@pytest.mark.slow
def test_noise_is_no_convention_and_one_file_of_it_spoils_nothing_else() -> None:
    scene = small(size=16)
    random = np.random.default_rng(1)

    def noise(image: HogelImage) -> HogelImage:
        number = random.integers(0, 2 * len(scene.faces), image.triangle.shape, dtype=np.int32)
        return replace(image, triangle=number)

    with Faulty(scene=scene, shift=(-0.5, -0.5)) as renderer:

        def partly(scene: Scene, aperture: Aperture) -> HogelImage:
            image = renderer(scene, aperture)
            return noise(image) if aperture.index == (2, 2) else image

        one = xfrustum.verify(scene, partly, apertures=SOME)
        every = xfrustum.verify(scene, lambda s, a: noise(renderer(s, a)), apertures=SOME)
    assert [fault.fault for fault in one.diagnosis.faults] == ["shift-x", "shift-y"]
    assert every.diagnosis.faults == ()
    assert "no convention explains" in every.diagnosis.means
    assert not every.passed
