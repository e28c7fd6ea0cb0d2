"""What people see of a plan: its reason, its table and JSON, and what its requirements may not be."""

from __future__ import annotations

import json
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.scene_file import film, part
from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.compare.planning.plan import depth_buffers, plan
from xfrustum.compare.planning.views import Requirement
from xfrustum.reports.planning import spread_apertures
from xfrustum.scenes import DepthFormat, DepthMapping, InputError, Scene, open_scene

SMALL = (192, 144)
"""Pixels, where a scene's own resolution does not matter."""

D16 = (DepthFormat.D16, DepthMapping.STANDARD)

KEYS = ["displacement_p99_px", "surface_fraction", "depth_wrong", "misordered", "separation"]


def test_a_separation_that_no_float_resolves_leaves_no_plan() -> None:
    scene = view("asymmetric", SMALL)
    made = plan(scene, [scene.plate.middle], Requirement(separation=1e-6))
    assert not made.within and made.settings is None
    assert "want of digits" in made.reason
    assert list(made.summary()["predicted"]) == list(made.summary()["measured"]) == KEYS


@pytest.mark.slow
def test_too_many_slabs_are_no_plan_and_the_reason_says_what_comes_nearest() -> None:
    scene = view("sheets", (64, 48))
    made = plan(scene, [scene.plate.middle], Requirement(separation=1e-4), [D16])
    assert not made.within and made.settings is None
    assert (made.depth, made.mapping) == D16
    assert "No plan with up to 16 cuts" in made.reason and "sheets out of order" in made.reason
    lengths = re.findall(r"(?:near|cut at|order that are) [-+.e\d]+(?: \S+)?", made.reason)
    assert len(lengths) == 3
    assert all(length.split()[-1].rstrip(",") == scene.units for length in lengths)


@pytest.mark.slow
def test_the_choice_among_depth_buffers_is_the_cheapest_that_does() -> None:
    scene = view("car", SMALL)
    every = plan(scene, [scene.plate.middle])
    assert (every.depth, every.mapping) == (DepthFormat.D24, DepthMapping.REVERSED)
    assert "the cheapest" in every.reason
    sixteen = plan(scene, [scene.plate.middle], choices=depth_buffers(DepthFormat.D16))
    # Only what a fragment writes needs no cut in 16 bits: fewer slabs come first, then the larger margin.
    assert sixteen.slabs == () and sixteen.mapping is DepthMapping.LOGARITHMIC
    assert "the most robust" in sixteen.reason


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    size = film((40.0, 30.0), hogels=(9, 7), resolution=(48, 36), fov_deg=(60.0, 50.0), reach=(100.0, 100.0))
    file.write_text(size + part("torus", 30.0, (2.0, 1.0, -40.0)))
    return str(file)


def test_json_is_exactly_as_promised(small_scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["plan", small_scene, "--json", "--quiet"]
    assert main([*asked, "--depth", "d16", "--mapping", "gl", "--sample", "5"]) == 0
    made = json.loads(capsys.readouterr().out)
    names = "near slabs depth mapping predicted measured within reason plate apertures"
    assert list(made) == names.split()
    assert made["plate"]["hogels"] == 9 * 7 and made["plate"]["worst"]["displacement_p99_px"] <= 0.5
    assert list(made["predicted"]) == list(made["measured"]) == KEYS
    assert made["within"] is True and made["depth"] == "d16" and made["mapping"] == "gl"
    assert all(isinstance(height, float) for height in made["slabs"])
    assert main([*asked, "--aperture", "4,3", "--separation", "1e-7"]) == 0
    none = json.loads(capsys.readouterr().out)
    assert none["near"] is None and none["slabs"] == [] and none["within"] is False


def test_the_table_ends_in_a_command_that_draws_so(
    small_scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = [
        "plan",
        small_scene,
        "--depth",
        "d16",
        "--mapping",
        "standard",
        "--aperture",
        "3,4",
        "--separation=0.01",
        "--quiet",
    ]
    assert main(asked) == 0
    text = capsys.readouterr().out
    command = shlex.split(text.splitlines()[-1])
    assert command[:2] == ["xfrustum", "raster"] and "--slabs" in command
    monkeypatch.chdir(tmp_path)
    assert main(command[1:]) == 0
    assert "holds" in text


@pytest.mark.parametrize(
    "given",
    [
        "--tolerance-px -1",
        "--separation 0",
        "--separation nan",
        "--max-wrong 1",
        "--aperture 1,1 --apertures 3",
        "--apertures 0",
        "--depth d17",
        "--aperture 99,1",
    ],
)
def test_bad_input_is_one_line(given: str, capsys: pytest.CaptureFixture[str]) -> None:
    option, value, *more = given.split()
    assert main(["plan", "asymmetric", option, value, *more]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    if option in ("--tolerance-px", "--separation", "--max-wrong"):
        assert f"'{option}': '{value}' is not a" in captured.err


def test_a_requirement_checks_itself() -> None:
    for wrong in ({"tolerance_px": math.nan}, {"separation": -1.0}, {"max_wrong": 0.0}):
        with pytest.raises(InputError):
            Requirement(**wrong)
    scene = open_scene("car")
    assert Requirement().separation_in(scene.frustum) == pytest.approx(0.15)


def test_apertures_all_over_the_plate() -> None:
    scene: Scene = open_scene("car")
    many = spread_apertures(scene.plate, 40)
    columns, rows = scene.plate.hogels
    assert many[0] == scene.plate.middle
    assert {a.index for a in many[1:5]} == {(c, r) for c in (0, columns - 1) for r in (0, rows - 1)}
    assert len({a.index for a in many}) == 40
    assert many[:7] == spread_apertures(scene.plate, 7)
    quarters = {(a.column < columns / 2, a.row < rows / 2) for a in many[5:13]}
    assert len(quarters) == 4
    tiny = replace(scene.plate, hogels=(2, 1))
    assert {a.index for a in spread_apertures(tiny, 9)} == {(0, 0), (1, 0)}
