"""`trace --decided-by`: the tracers' own pictures, and what they alone would have got wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from xfrustum.cli.main import main
from xfrustum.reference import TRACERS, Reference
from xfrustum.scenes import Certainty, open_scene
from xfrustum.scenes.files.openexr.images import read_image

HARD = "hard/nearly-coincident"
"""Two surfaces closer to each other than single precision tells."""


@pytest.mark.parametrize("tracer", TRACERS)
def test_a_tracers_own_picture_is_what_it_proposes_and_is_not_examined(tracer: str, tmp_path: Path) -> None:
    assert main(["trace", HARD, "--decided-by", tracer, "--out", str(tmp_path / "a.exr")]) == 0
    image = read_image(tmp_path / "a.exr")
    scene = open_scene(HARD)
    proposed = Reference(scene, tracer=tracer).propose(scene.plate.middle)
    np.testing.assert_array_equal(image.triangle, proposed.triangle)
    assert image.certainty is not None
    assert (image.certainty == Certainty.UNEXAMINED).all()
    assert image.camera.renderer == f"{tracer} alone, nothing certified"


def test_what_tracers_alone_would_have_got_wrong_is_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By definition: pixels of their own pictures with another triangle than the certified truth."""
    assert main(["trace", HARD, "--json", "--quiet", "--out", str(tmp_path / "truth.exr")]) == 0
    told = json.loads(capsys.readouterr().out)
    truth = read_image(tmp_path / "truth.exr")
    assert truth.certainty is not None
    judged = truth.certainty != Certainty.TIE
    assert told["alone"]["judged"] == judged.sum()
    assert sum(told["certainty"].values()) == truth.triangle.size
    scene = open_scene(HARD)
    for tracer in TRACERS:
        alone = Reference(scene, tracer=tracer).propose(scene.plate.middle)
        assert told["alone"][tracer] == ((alone.triangle != truth.triangle) & judged).sum()
    assert told["alone"]["embree"] > 100


def test_an_uncertified_picture_says_so_in_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.exr"
    assert main(["trace", "sheets", "--decided-by", "embree", "--json", "--out", str(out)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["decided_by"] == "embree" and told["alone"] is None
    assert list(told["certainty"]) == ["unexamined"]


def test_a_second_opinion_is_not_asked_of_another_tracer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a.exr"
    arguments = ["trace", "car", "--decided-by", "embree", "--tracer", "mitsuba", "--out", str(out)]
    assert main(arguments) == 2
    assert "--decided-by embree" in capsys.readouterr().err
    assert not out.exists()
