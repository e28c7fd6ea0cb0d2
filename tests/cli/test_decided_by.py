"""`--decided-by`: pictures of single tracers, their errors, and reports relative to them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import Command
from tests.support.views import view
from xfrustum import Cull, DoubleFrustum, HogelImage, InputError, Reference, open_scene, read_image
from xfrustum.reference import TRACERS
from xfrustum.reference.alone import Decision, PlainReference, open_reference
from xfrustum.scenes import Certainty
from xfrustum.scenes.appearance import Sampling

HARD = "hard/nearly-coincident"
"""Scene with two surfaces closer together than the resolution of single precision."""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def proposed(tracer: str) -> HogelImage:
    """Return the picture of one tracer without certification."""
    scene = open_scene(HARD)
    return Reference(scene, tracer=tracer).propose(scene.plate.middle)


@pytest.mark.parametrize("tracer", TRACERS)
def test_the_picture_of_one_tracer_is_marked_unexamined(tracer: str, command: Command) -> None:
    answer = command(f"trace {HARD} --decided-by {tracer} --json --out a.exr").record
    assert answer["decided_by"] == tracer and answer["alone"] is None
    assert list(answer["certainty"]) == ["unexamined"]
    image = read_image("a.exr")
    np.testing.assert_array_equal(image.triangle, proposed(tracer).triangle)
    assert (image.certainty == Certainty.UNEXAMINED).all()
    assert image.camera.renderer == f"{tracer} alone, nothing certified"
    note = f"xfrustum: note: truth: {tracer.title()} alone, not examined\n"
    assert command("compare a.exr a.exr").err == note


def test_errors_of_uncertified_tracers_are_counted(command: Command) -> None:
    """Count by definition: pixels whose triangle differs between tracer and certified truth."""
    answer = command(f"trace {HARD} --json --quiet --out truth.exr").record
    truth = read_image("truth.exr")
    judged = truth.certainty != Certainty.TIE
    assert answer["alone"]["judged"] == judged.sum()
    assert sum(answer["certainty"].values()) == truth.triangle.size
    for tracer in TRACERS:
        wrong = ((proposed(tracer).triangle != truth.triangle) & judged).sum()
        assert answer["alone"][tracer] == wrong
    assert answer["alone"]["embree"] > 100
    assert command("compare truth.exr truth.exr").err == ""


def test_a_report_counts_and_shows_errors_of_uncertified_tracers(
    command: Command,
) -> None:
    """Embree's arithmetic confuses the two surfaces; Mitsuba's does not in this scene."""
    how = "--pivot aperture --near 0.01 --depth d32f:reversed --apertures 2,2 --quiet"
    command(f"report {HARD} {how} --out out")
    content = json.loads(Path("out/report.json").read_text())
    page = Path("out/index.html").read_text()
    (alone,) = content["tracers_alone"]
    scene = open_scene(HARD)
    wrong = proposed("embree").triangle != Reference(scene).trace(scene.plate.middle).triangle
    assert alone["embree"] == wrong.sum() > 100
    assert alone["mitsuba"] == 0
    assert content["decided_by"] == "certified"
    assert f'wrong by Embree alone</td><td class="n">{alone["embree"]:,}</td>' in page


def test_offset_cameras_of_a_plain_tracer_are_those_of_the_certified_ones() -> None:
    """Away from edges, a tracer in single precision is right."""
    scene = view("asymmetric-recentered", (48, 36))
    settings = DoubleFrustum(near=0.5, slabs=(15.0,))
    certified = Reference(scene).trace_model(scene.plate.middle, settings)
    plain = PlainReference(scene, "mitsuba").trace_model(scene.plate.middle, settings)
    assert plain.certainty is not None and (plain.certainty == Certainty.UNEXAMINED).all()
    same = plain.triangle == certified.triangle
    assert same.mean() > 0.99 and certified.covered.mean() > 0.1
    apart = np.abs(plain.position - certified.position)[same & certified.covered]
    assert apart.max() < 1e-9


def test_a_plain_tracer_neither_culls_nor_averages() -> None:
    scene = view("asymmetric", (8, 8))
    with pytest.raises(InputError, match="several samples a pixel"):
        PlainReference(replace(scene, sampling=Sampling(supersample=2)))
    with pytest.raises(InputError, match="culls no faces"):
        PlainReference(scene).trace_model(
            scene.plate.middle, DoubleFrustum(near=1.0, cull=Cull.BACK)
        )
    with pytest.raises(InputError, match="must be one of certified, embree, mitsuba"):
        Decision(by="povray")
    assert type(open_reference(scene, Decision(tracer="mitsuba"))) is Reference
