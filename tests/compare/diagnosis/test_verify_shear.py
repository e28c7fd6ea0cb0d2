"""A recentered frustum that is sheared wrongly is named: its screen's place, no shear, or a reversed one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import xfrustum
from tests.support.foreign_renderers import Faulty, small
from tests.support.long_tail import thinned
from xfrustum.compare.diagnosis.diagnosis import diagnose
from xfrustum.compare.diagnosis.evidence import Evidence
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import Camera, Scene

SIZE, MORE = 32, 64
"""Sides of the films of quick tests and of slow ones, px."""

SOME = [(0, 0), (4, 1), (2, 3), (1, 4), (3, 2)]
"""Hogels in each column and in each row of the plate, once."""

NEAR_PER_REACH = 0.02
"""Near offset of the renderers that have one beside a wrong shear."""

FAULTS = ("screen-height", "screen-center", "not-recentered", "shear-sign")


def put_in(scene: Scene, fault: str) -> tuple[dict[str, Any], dict[str, float | str]]:
    """Return the arguments of a renderer with a fault, and the faults that must be named with their sizes."""
    screen = scene.frustum.screen
    assert screen is not None
    x, y = screen.center[0] + 0.05 * screen.size[0], screen.center[1] - 0.03 * screen.size[1]
    height = 1.25 * screen.height
    each: dict[str, tuple[dict[str, Any], dict[str, float | str]]] = {
        "screen-height": ({"screen_height": height}, {"screen-height": height}),
        "screen-center": ({"screen_center": (x, y)}, {"screen-center-x": x, "screen-center-y": y}),
        "not-recentered": ({"recentered": False}, {"not-recentered": "no shear"}),
        "shear-sign": ({"reversed_shears": frozenset({Camera.C_STAR})}, {"shear-sign": "C*"}),
    }
    return each[fault]


def assert_named(found: Verification, expected: dict[str, float | str]) -> None:
    """Check that these faults are named and no others, each with its size, and that nothing else is wrong."""
    named = {fault.fault: fault for fault in found.diagnosis.faults}
    assert set(named) == set(expected)
    for name, size in expected.items():
        if isinstance(size, str):
            assert named[name].value == size
            continue
        low, high = named[name].low, named[name].high
        assert low is not None
        assert high is not None
        assert low <= size <= high
        # The faults are thirty times as large or more.
        assert high - low < 0.1
    assert not found.passed
    for hogel in found.hogels:
        assert hogel.corrected is not None
        assert hogel.corrected.surface is not None
        assert hogel.corrected.surface.fraction < 0.01
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0


def assert_shear_is_named(
    scene: Scene, fault: str, near: float | None, apertures: list[tuple[int, int]] = SOME
) -> None:
    faults, expected = put_in(scene, fault)
    with Faulty(scene=scene, near=near, **faults) as renderer:
        found = xfrustum.verify(scene, renderer, apertures=apertures)
    assert_named(found, {**expected, **({"near": near} if near else {})})


@pytest.mark.parametrize("fault", thinned(FAULTS, 4))
def test_a_wrong_shear_is_named_and_no_other_fault(fault: str) -> None:
    assert_shear_is_named(small("asymmetric-recentered", SIZE), fault, None, SOME[:3])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car-recentered", "teapot-recentered"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_shear_is_named_before_and_behind_other_screens(name: str, fault: str) -> None:
    assert_shear_is_named(small(name, MORE), fault, None)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["asymmetric-recentered", "car-recentered", "teapot-recentered"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_shear_and_a_near_offset_are_told_apart(name: str, fault: str) -> None:
    scene = small(name, MORE)
    assert_shear_is_named(scene, fault, NEAR_PER_REACH * scene.frustum.longest_reach)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car-recentered", "teapot-recentered"])
def test_a_right_renderer_of_a_recentered_scene_stays_right(name: str) -> None:
    scene = small(name, MORE)
    with Faulty(scene=scene) as renderer:
        found = xfrustum.verify(scene, renderer, apertures=SOME)
    assert found.passed
    assert found.diagnosis.faults == ()


def diagnosed(scene: Scene, model: DrawnModel, *apertures: tuple[int, int]) -> Any:
    reference, images = Reference(scene), []
    for index in apertures:
        image = trace_drawn(reference, model, scene.plate.aperture(*index))
        images.append(replace(image, position=np.full_like(image.position, np.nan)))
    evidence = Evidence(reference=reference, images=images, nominal=DrawnModel())
    return {fault.fault: fault for fault in diagnose(evidence).diagnosis.faults}


@pytest.mark.slow
def test_a_moved_screen_and_a_shifted_sampling_point_show_the_same_images() -> None:
    scene = small("asymmetric-recentered", SIZE)
    assert scene.frustum.screen is not None
    per_px = scene.frustum.screen.size[0] / SIZE
    # The first name is that of what a renderer rather does: pixels are sampled within themselves.
    for shift, first, other in ((0.5, "shift-x", "screen-center-x"), (3.0, "screen-center-x", "shift-x")):
        named = diagnosed(scene, DrawnModel(screen_center=(-shift * per_px, 0.0)), *SOME[:3])
        assert set(named) == {first}
        assert named[first].alternatives == (other,)
        assert f"or {other}: images cannot tell" in named[first].words


def test_one_hogel_does_not_tell_a_missing_shear_from_a_screen_elsewhere() -> None:
    scene = small("asymmetric-recentered", SIZE)
    named = diagnosed(scene, DrawnModel(recentering=Recentering.NONE), SOME[0])
    assert set(named) == {"not-recentered"}
    assert named["not-recentered"].alternatives == ("screen-center-x", "screen-center-y")
    assert "images cannot tell" in named["not-recentered"].words


def test_what_lies_before_the_plate_alone_does_not_tell_whether_c_is_sheared_rightly() -> None:
    whole = small("asymmetric-recentered", SIZE)
    before = replace(whole, frustum=replace(whole.frustum, reach=(whole.frustum.reach[0], 1e-3)))
    named = diagnosed(before, DrawnModel(recentering=Recentering.C_STAR_REVERSED), *SOME[:3])
    assert set(named) == {"shear-sign"}
    assert named["shear-sign"].value == "C*"
    assert "images cannot tell" in named["shear-sign"].words


def test_a_centered_frustum_has_no_shear_to_be_wrong() -> None:
    scene = small("asymmetric", SIZE)
    named = diagnosed(scene, DrawnModel(shift=(3.0, 0.0)), *SOME[:3])
    assert set(named) == {"shift-x"}
    assert named["shift-x"].alternatives == ()
