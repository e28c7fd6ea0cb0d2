"""A diagnosis explains what is wrong, or it is none; and faults that show the same images say so."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import xfrustum
from tests.support.foreign_renderers import Faulty, small
from xfrustum.compare.diagnosis.diagnosis import MIN_EXPLAINED_FRACTION, Evidence
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.diagnosis.geometry_fit import claims_of, fit_geometry
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Front
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification, render_page, table
from xfrustum.scenes import NOTHING, Aperture, HogelImage, Plate, Scene

SIZE = 48
CENTERED, RECENTERED = "asymmetric", "asymmetric-recentered"
SOME = [(0, 0), (4, 1), (2, 3), (1, 4), (3, 2)]
Offset = tuple[float, float, float]


def moved(scene: Scene, scale: float = 1.0, offset: Offset = (0.0, 0.0, 0.0)) -> Scene:
    """Return the hogels of a renderer that has the scene elsewhere: the vertices themselves are moved."""
    parts = [replace(part, vertices=part.vertices * scale + np.asarray(offset)) for part in scene.objects]
    return replace(scene, objects=tuple(parts))


def verified(name: str, scale: float = 1.0, offset: Offset = (0.0, 0.0, 0.0), **faults: Any) -> Verification:
    scene = small(name, SIZE)
    with Faulty(scene=moved(scene, scale, offset), **faults) as renderer:
        return xfrustum.verify(scene, renderer, apertures=SOME)


def by_name(found: Verification) -> dict[str, Fault]:
    return {fault.fault: fault for fault in found.diagnosis.faults}


def assert_named(found: Verification, expected: Mapping[str, tuple[float, tuple[str, ...]]]) -> None:
    """Check names, values within their intervals, alternatives, and that the rest of the images is right."""
    named = by_name(found)
    assert set(named) == set(expected)
    for name, (value, alternatives) in expected.items():
        fault = named[name]
        assert fault.low is not None
        assert fault.high is not None
        assert fault.low <= value <= fault.high
        assert fault.alternatives == alternatives
        assert ("cannot tell" in fault.words) == bool(alternatives)
        assert fault.explains is not None
        assert fault.explains >= MIN_EXPLAINED_FRACTION
    assert not found.passed
    corrected = found.summary()["corrected"]
    assert corrected["fraction"] < 0.01
    assert corrected["causes"]["unexplained"] == 0


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
    found = verified(name, **drawn)
    assert_named(found, expected)
    if drawn is CORNERS:
        assert all("corners of hogels" in fault.words for fault in found.diagnosis.faults)


def test_a_scene_so_small_that_one_hogel_sees_it_is_known_by_its_units() -> None:
    scene = small(CENTERED, SIZE)
    with Faulty(scene=moved(scene, 0.1)) as renderer:
        found = xfrustum.verify(scene, renderer)
    (fault,) = found.diagnosis.faults
    assert (fault.fault, fault.value, fault.low, fault.high) == ("scene-scale", 0.1, None, None)
    assert "centimeters taken for millimeters" in fault.words
    assert found.summary()["corrected"]["fraction"] < 0.01


@pytest.mark.slow
def test_what_does_not_explain_is_no_finding() -> None:
    # An offset of 5 mm widens the picture most near the plate, which no field of view does.
    found = verified(CENTERED, near=5.0, shown="color")
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
    whole = small(CENTERED, SIZE)
    flat = replace(whole, objects=(replace(whole.objects[0], vertices=_flattened(whole, -30.0)),))
    with Faulty(scene=flat, near=5.0, shown=shown) as renderer:
        found = xfrustum.verify(flat, renderer, apertures=SOME)
    for fault in found.diagnosis.faults:
        assert fault.fault in ("fov-x", "fov-y")
        # 30 mm behind the plate, 5 mm are a sixth.
        assert fault.value == pytest.approx(7 / 6, abs=0.01)
        assert fault.alternatives == ("near",)
        assert f"or near: {witnesses} cannot tell" in fault.words
    assert len(found.diagnosis.faults) == 2


def _flattened(scene: Scene, height: float) -> Any:
    vertices = scene.objects[0].vertices.copy()
    vertices[:, 2] = height
    return vertices


def test_lights_are_named_where_they_explain_the_colors() -> None:
    found = verified(CENTERED, conjugated=False)
    assert set(by_name(found)) == {"lights"}
    assert (by_name(found)["lights"].explains or 0.0) > 0.99


def test_a_fault_that_adds_nothing_is_dropped() -> None:
    scene = small(CENTERED, SIZE)
    shifted = DrawnModel(shift=(-0.5, -0.5))
    with Faulty(scene=scene, shift=shifted.shift) as renderer:
        images = [renderer(scene, scene.plate.aperture(*index)) for index in SOME]
    test = Evidence(reference=Reference(scene), images=images, nominal=DrawnModel())
    idle = replace(shifted, pitch=(1.0 + 1e-7, 1.0))
    assert test.reduced(idle) == shifted
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
    truth = {"aperture-offset": (x, -x), "scene-offset": (x, -x, z), "scene-scale": (scale,)}[which]
    drawn = scene
    if which != "aperture-offset":
        offset = (x, -x, z) if which == "scene-offset" else (0.0, 0.0, 0.0)
        drawn = moved(scene, scale if which == "scene-scale" else 1.0, offset)
    reference, images = Reference(drawn), []
    for index in SOME:
        asked = scene.plate.aperture(*index)
        there = replace(asked, x=asked.x + x, y=asked.y - x) if which == "aperture-offset" else asked
        image = reference.trace(there)
        images.append(replace(image, camera=replace(image.camera, aperture=asked)))
    fit = fit_geometry(claims_of(scene, images), DrawnModel())
    nominal = DrawnModel().parameters
    off = np.flatnonzero((fit.low > nominal) | (fit.high < nominal))
    expected = fit.model.with_parameters(nominal)
    field = which.replace("-", "_")
    numbers: dict[str, Any] = {field: truth if len(truth) > 1 else truth[0]}
    expected = replace(expected, **numbers)
    assert np.all(fit.low <= expected.parameters + 1e-12)
    assert np.all(fit.high >= expected.parameters - 1e-12)
    assert set(off) <= set(np.flatnonzero(expected.parameters != nominal))


@pytest.mark.slow
def test_colors_tell_that_the_nearest_surface_of_the_viewers_half_wins() -> None:
    scene = small(CENTERED, SIZE)
    reference, model = Reference(scene), DrawnModel(front=Front.NEAREST)

    def draw(scene: Scene, aperture: Aperture) -> HogelImage:
        image = colored(scene, model, trace_drawn(reference, model, aperture))
        nothing = np.full_like(image.triangle, NOTHING)
        nowhere = np.full_like(image.position, np.nan)
        return replace(image, triangle=nothing, object=nothing, position=nowhere)

    assert set(by_name(xfrustum.verify(scene, draw, apertures=SOME))) == {"front-nearest"}


@pytest.mark.parametrize("hogels", [(5, 1), (1, 1)])
def test_plates_of_one_row_and_of_one_hogel_are_diagnosed(hogels: tuple[int, int]) -> None:
    whole = small(CENTERED, SIZE)
    scene = replace(whole, plate=Plate(size=(whole.plate.size[0], 12.0), hogels=hogels))
    with Faulty(scene=moved(scene, offset=(1.0, 0.0, 0.0))) as renderer:
        found = xfrustum.verify(scene, renderer)
    named = by_name(found)
    assert "scene-offset-x" in named
    assert "aperture-offset-x" in named["scene-offset-x"].alternatives
    # Numbers that are left open are null in JSON, and never NaN.
    json.dumps(found.summary(), allow_nan=False)
