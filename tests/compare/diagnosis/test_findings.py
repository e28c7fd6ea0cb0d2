"""Findings explain wrong pixels, or are none; and faults that show the same images say so."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import xfrustum
from tests.support.foreign_renderers import Faulty, oblong, saying, small
from tests.support.scene_file import film, named, part
from xfrustum.compare.diagnosis.diagnosis import MIN_EXPLAINED_FRACTION, Evidence
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.diagnosis.geometry_fit import claims_of, fit_geometry
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification, render_page, table
from xfrustum.scenes import NOTHING, Aperture, HogelImage, Plate, Scene, SceneObject, open_scene
from xfrustum.scenes.errors import InputError

SIZE = 48
CENTERED, RECENTERED = "asymmetric", "asymmetric-recentered"
FEW = [(0, 0), (4, 1), (2, 3)]
SOME = [*FEW, (1, 4), (3, 2)]
KEYS = set(Fault(fault="", value="", words="").summary())
Offset = tuple[float, float, float]


def moved(scene: Scene, scale: float = 1.0, offset: Offset = (0.0, 0.0, 0.0)) -> Scene:
    """Return the hogels of a renderer that has the scene elsewhere: the vertices themselves are moved."""
    parts = [replace(part, vertices=part.vertices * scale + np.asarray(offset)) for part in scene.objects]
    return replace(scene, objects=tuple(parts))


def verified(name: str, scale: float = 1.0, offset: Offset = (0.0, 0.0, 0.0), **faults: Any) -> Verification:
    scene = small(name, SIZE)
    with Faulty(scene=moved(scene, scale, offset), **faults) as renderer:
        return xfrustum.verify(scene, renderer, apertures=SOME)


def of_model(scene: Scene, model: DrawnModel) -> Verification:
    """Verify what a model draws in all hogels of a scene."""
    reference = Reference(scene)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        return saying(trace_drawn(reference, model, aperture), "triangle", "object")

    return xfrustum.verify(scene, draw)


def by_name(found: Verification) -> dict[str, Fault]:
    return {fault.fault: fault for fault in found.diagnosis.faults}


CORNERS = {"aperture_offset": (-8.0, 6.0)}  # Half a pitch to the left and up: 80 x 60 mm in 5 x 5 hogels


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "drawn", "expected"),
    [
        (
            CENTERED,
            CORNERS,
            {
                "aperture-offset-x": (-8.0, ("scene-offset-x",)),
                "aperture-offset-y": (6.0, ("scene-offset-y",)),
            },
        ),
        (RECENTERED, CORNERS, {"aperture-offset-x": (-8.0, ()), "aperture-offset-y": (6.0, ())}),
        (CENTERED, {"offset": (0.3, 0, 0)}, {"scene-offset-x": (0.3, ("aperture-offset-x",))}),
        (RECENTERED, {"offset": (0.3, 0, 0)}, {"scene-offset-x": (0.3, ())}),
        (CENTERED, {"offset": (0, 0, 0.5)}, {"scene-offset-z": (0.5, ())}),
        (CENTERED, {"scale": 1.1}, {"scene-scale": (1.1, ("pitch-x", "pitch-y"))}),
        (RECENTERED, {"scale": 1.1}, {"scene-scale": (1.1, ())}),
        (
            RECENTERED,
            {"offset": (1.0, -2.0, 0.0), "near": 1.0},
            {"scene-offset-x": (1.0, ()), "scene-offset-y": (-2.0, ()), "near": (1.0, ())},
        ),
    ],
)
def test_what_a_screen_that_stays_tells_apart_and_what_nothing_does(
    name: str, drawn: dict[str, Any], expected: Mapping[str, tuple[float, tuple[str, ...]]]
) -> None:
    """Names, values within their intervals, alternatives; and the rest of the images is right."""
    found = verified(name, **drawn)
    faults = by_name(found)
    assert set(faults) == set(expected)
    for one, (value, alternatives) in expected.items():
        fault = faults[one]
        assert fault.low is not None and fault.high is not None and fault.explains is not None
        assert fault.low <= value <= fault.high
        assert fault.alternatives == alternatives
        assert ("cannot tell" in fault.words) == bool(alternatives)
        assert fault.explains >= MIN_EXPLAINED_FRACTION
        assert "corners of hogels" in fault.words or drawn is not CORNERS
    corrected = found.summary()["corrected"]
    assert not found.passed
    assert corrected["fraction"] < 0.01 and corrected["causes"]["unexplained"] == 0


def test_a_scene_so_small_that_one_hogel_sees_it_is_known_by_its_units() -> None:
    scene = replace(oblong(), plate=small(CENTERED).plate)
    with Faulty(scene=moved(scene, 0.1)) as renderer:
        found = xfrustum.verify(scene, renderer, apertures=[(0, 0), (2, 2), (4, 1)])
    (fault,) = found.diagnosis.faults
    assert (fault.fault, fault.value, fault.low, fault.high) == ("scene-scale", 0.1, None, None)
    assert "centimeters taken for millimeters" in fault.words
    assert found.summary()["corrected"]["fraction"] < 0.01


@pytest.mark.slow
def test_what_does_not_explain_is_no_finding() -> None:
    # An offset widens the picture most near the plate, a field of view everywhere: neither explains both.
    found = verified(CENTERED, near=8.0, fov=(1.1, 0.95), shown="color")
    assert not found.passed
    assert found.diagnosis.faults == ()
    doubted = found.diagnosis.does_not_explain
    assert {fault.fault for fault in doubted} >= {"fov-x", "fov-y"}
    for fault in doubted:
        assert fault.explains is not None
        assert fault.explains < MIN_EXPLAINED_FRACTION
        assert f"would explain only {100 * fault.explains:.0f} %" in fault.words
    summary = found.summary()
    assert summary["diagnosis"] == []
    assert summary["does_not_explain"] == [fault.summary() for fault in doubted]
    assert summary["corrected"] == summary["as_found"]
    assert "no known fault explains" in table(found)
    assert "No known fault explains what is wrong" in render_page(found)


@pytest.mark.parametrize(("shown", "witnesses"), [("color", "colors"), ("object", "object numbers")])
def test_a_field_of_view_at_one_depth_may_be_a_near_offset_to_pictures(shown: str, witnesses: str) -> None:
    # Three triangles beside one another, 30 mm behind the plate, where an offset of 5 mm is a sixth.
    corners = [(-24, -9), (-4, -13), (-12, 12), (3, -12), (22, -8), (5, -1), (-3, 4), (25, 6), (8, 16)]
    vertices = np.array([(x, y, -30.0) for x, y in corners])
    part = SceneObject(name="flat", vertices=vertices, faces=np.arange(9).reshape(-1, 3))
    flat = replace(small(CENTERED, 32), objects=(part,))
    with Faulty(scene=flat, near=5.0, shown=shown) as renderer:
        found = xfrustum.verify(flat, renderer, apertures=[(2, 2), (1, 2), (3, 1), (2, 3)])
    assert len(found.diagnosis.faults) == 2
    for fault in found.diagnosis.faults:
        assert fault.fault in ("fov-x", "fov-y")
        assert fault.value == pytest.approx(7 / 6, abs=0.01)
        assert fault.alternatives == ("near",)
        assert f"or near: {witnesses} cannot tell" in fault.words


def test_lights_are_named_where_they_explain_the_colors() -> None:
    scene = oblong()
    with Faulty(scene=scene, conjugated=False) as renderer:
        found = by_name(xfrustum.verify(scene, renderer, apertures=FEW))
    assert set(found) == {"lights"}
    assert (found["lights"].explains or 0.0) > 0.99


def test_a_fault_that_adds_nothing_is_dropped() -> None:
    scene, shifted = oblong(), DrawnModel(shift=(-0.5, -0.5))
    with Faulty(scene=scene, shift=shifted.shift) as renderer:
        images = [renderer(scene, scene.plate.aperture(*index)) for index in FEW]
    test = Evidence(reference=Reference(scene), images=images, nominal=DrawnModel())
    assert test.reduced(replace(shifted, pitch=(1.0 + 1e-7, 1.0))) == shifted
    harmful = replace(shifted, front=Front.MISSING)
    assert test.reduced(harmful) == shifted
    assert test.share(shifted) == 1.0
    assert (test.share(harmful) or 0.0) < MIN_EXPLAINED_FRACTION
    assert (test.share(DrawnModel()) or 0.0) < 0.5


@pytest.mark.slow
@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    x=st.floats(-6, 6),
    z=st.floats(-3, 3),
    scale=st.floats(0.7, 1.5),
    which=st.sampled_from(["aperture-offset", "scene-offset", "scene-scale"]),
)
def test_whatever_the_offset_its_interval_contains_it(x: float, z: float, scale: float, which: str) -> None:
    scene = small(RECENTERED, SIZE)
    numbers: dict[str, Any] = {"aperture-offset": (x, -x), "scene-offset": (x, -x, z), "scene-scale": scale}
    offset = (x, -x, z) if which == "scene-offset" else (0.0, 0.0, 0.0)
    reference, images = Reference(moved(scene, scale if which == "scene-scale" else 1.0, offset)), []
    for index in SOME:
        asked = scene.plate.aperture(*index)
        there = replace(asked, x=asked.x + x, y=asked.y - x) if which == "aperture-offset" else asked
        image = reference.trace(there)
        images.append(replace(image, camera=replace(image.camera, aperture=asked)))
    fit = fit_geometry(claims_of(scene, images), DrawnModel())
    nominal = DrawnModel().parameters
    off = np.flatnonzero((fit.low > nominal) | (fit.high < nominal))
    field: Any = {which.replace("-", "_"): numbers[which]}
    expected = replace(fit.model.with_parameters(nominal), **field)
    assert np.all(fit.low <= expected.parameters + 1e-12)
    assert np.all(fit.high >= expected.parameters - 1e-12)
    assert set(off) <= set(np.flatnonzero(expected.parameters != nominal))


@pytest.mark.slow
def test_colors_tell_that_the_nearest_surface_of_the_viewers_half_wins() -> None:
    scene = small(CENTERED, SIZE)
    reference, model = Reference(scene), DrawnModel(front=Front.NEAREST)

    def draw(scene: Scene, aperture: Aperture) -> HogelImage:
        return saying(colored(scene, model, trace_drawn(reference, model, aperture)), "color")

    assert set(by_name(xfrustum.verify(scene, draw, apertures=SOME))) == {"front-nearest"}


@pytest.mark.parametrize("hogels", [(5, 1), (1, 1)])
def test_plates_of_one_row_and_of_one_hogel_are_diagnosed(hogels: tuple[int, int]) -> None:
    whole = oblong(width=SIZE)
    scene = replace(whole, plate=Plate(size=(whole.plate.size[0], 12.0), hogels=hogels))
    with Faulty(scene=moved(scene, offset=(1.0, 0.0, 0.0))) as renderer:
        found = xfrustum.verify(scene, renderer)
    assert "aperture-offset-x" in by_name(found)["scene-offset-x"].alternatives
    # Numbers that are left open are null in JSON, and never NaN.
    json.dumps(found.summary(), allow_nan=False)


# Findings rest on wrong pixels: none without them, and all findings together must explain them.


def test_right_pictures_of_objects_get_no_finding() -> None:
    scene = oblong()
    reference = Reference(scene)
    found = xfrustum.verify(scene, lambda _, a: saying(reference.trace(a), "object"), apertures=FEW)
    assert found.passed
    assert found.diagnosis.faults == found.diagnosis.does_not_explain == ()
    assert found.summary()["explained"] is None


def test_numbers_without_plus_one_do_not_take_the_viewers_half_away() -> None:
    scene = oblong()
    reference = Reference(scene)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        image = saying(reference.trace(aperture), "triangle")
        return replace(image, triangle=np.maximum(image.triangle - 1, NOTHING).astype(np.int32))

    found = xfrustum.verify(scene, draw, apertures=FEW)
    (fault,) = found.summary()["diagnosis"]
    assert fault["fault"] == "id-offset"
    assert set(fault) == KEYS
    assert fault["explains"] >= MIN_EXPLAINED_FRACTION
    assert fault["alternatives"] == []
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0


def test_a_sphere_whose_near_side_is_left_out_shows_its_far_side_as_if_that_won(tmp_path: Path) -> None:
    file = tmp_path / "sphere.toml"
    space = film((40.0, 40.0), hogels=(2, 2), resolution=(32, 32), fov_deg=(60.0, 60.0), reach=(50.0, 60.0))
    before = named("a sphere before the plate", "mm") + space + part("sphere", 12.0, (3.0, -2.0, 25.0))
    file.write_text(before)
    scene = open_scene(str(file))
    for model in (DrawnModel(culled=Culled.COUNTERCLOCKWISE), DrawnModel(front=Front.NEAREST)):
        (fault,) = of_model(scene, model).diagnosis.faults
        assert fault.fault == "front-nearest"
        assert fault.alternatives == ("culling",)
        assert "or culling: images cannot tell" in fault.words


def test_what_counts_as_wrong_is_what_the_verdict_counts() -> None:
    scene = oblong()
    reference, images = Reference(scene), []
    for index in FEW:
        image = reference.trace(scene.plate.aperture(*index))
        assert image.color is not None
        images.append(saying(replace(image, color=0.5 * image.color), "color"))
    test = Evidence(reference=reference, images=images, nominal=DrawnModel())
    assert test.wrong(DrawnModel()) > 0
    assert replace(test, judging=Judging(color_tolerance=1.0), known={}).wrong(DrawnModel()) == 0
    outlines = replace(test, judging=Judging(compared=Compared.GEOMETRY), known={})
    assert outlines.wrong(DrawnModel()) < test.wrong(DrawnModel()) / 10


def test_a_guess_that_shows_nothing_does_not_explain_what_is_shown() -> None:
    scene = oblong()
    reference = Reference(scene)
    image = reference.trace(scene.plate.middle)
    few = np.full_like(image.triangle, NOTHING)
    few[:2, :2] = 1
    dark = saying(replace(image, triangle=few), "triangle")
    test = Evidence(reference=reference, images=[dark], nominal=DrawnModel())
    assert (test.share(DrawnModel(scene_scale=1e-6)) or 0.0) < MIN_EXPLAINED_FRACTION


@pytest.mark.parametrize(
    "asked",
    [
        *({name: "x"} for name in ("max_wrong", "max_displacement_px", "max_color", "near", "accept")),
        *({"near": True}, {"encoding": "banana"}, {"compare": "banana"}),
        *({"apertures": [one]} for one in ("x", (0, "x"), 3)),
    ],
)
def test_options_that_mean_nothing_are_refused(asked: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        xfrustum.verify(oblong(), "none_{i}_{j}.png", **asked)


@pytest.mark.slow
def test_of_closed_bodies_faces_turned_away_may_be_left_out_and_others_not() -> None:
    scene = small(CENTERED, 32)
    assert of_model(scene, DrawnModel(culled=Culled.CLOCKWISE)).passed
    found = of_model(scene, DrawnModel(culled=Culled.COUNTERCLOCKWISE))
    assert [fault.fault for fault in found.diagnosis.faults] == ["culling"]
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0
