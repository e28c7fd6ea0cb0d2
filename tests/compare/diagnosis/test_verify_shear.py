"""A recentered frustum's images do not tell all apart: moved screens, shifts, missing or reversed shears."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

import xfrustum
from tests.support.foreign_renderers import Faulty, small
from tests.support.long_tail import kept
from xfrustum.compare.diagnosis.diagnosis import Evidence, diagnose
from xfrustum.compare.diagnosis.faults import TOGETHER
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import Camera, Scene

SIZE = 32
SOME = [(0, 0), (4, 1), (2, 3)]


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
        named = diagnosed(scene, DrawnModel(screen_center=(-shift * per_px, 0.0)), *SOME)
        assert set(named) == {first}
        assert named[first].alternatives == (other,)
        assert f"or {other}: images cannot tell" in named[first].words
    centered = diagnosed(small("asymmetric", SIZE), DrawnModel(shift=(3.0, 0.0)), *SOME)
    assert {name: fault.alternatives for name, fault in centered.items()} == {"shift-x": ()}


def test_one_hogel_or_one_side_of_the_plate_do_not_tell_what_became_of_a_shear() -> None:
    scene = small("asymmetric-recentered", SIZE)
    (fault,) = diagnosed(scene, DrawnModel(recentering=Recentering.NONE), SOME[0]).values()
    assert (fault.fault, fault.alternatives) == ("not-recentered", ("screen-center-x", "screen-center-y"))
    assert "images cannot tell" in fault.words
    before = replace(scene, frustum=replace(scene.frustum, reach=(scene.frustum.reach[0], 1e-3)))
    (fault,) = diagnosed(before, DrawnModel(recentering=Recentering.C_STAR_REVERSED), *SOME).values()
    assert (fault.fault, fault.value) == ("shear-sign", "C*")
    assert "images cannot tell" in fault.words


def put_in(scene: Scene, fault: str) -> tuple[dict[str, Any], dict[str, float | str]]:
    """Return the arguments of a renderer with a fault, and the faults that must be named with their sizes."""
    screen = scene.frustum.screen
    assert screen is not None
    x, y = screen.center[0] + 0.05 * screen.size[0], screen.center[1] - 0.03 * screen.size[1]
    height = 1.25 * screen.height
    each: dict[str, tuple[dict[str, Any], dict[str, float | str]]] = {
        "right": ({}, {}),
        "screen-height": ({"screen_height": height}, {"screen-height": height}),
        "screen-center": ({"screen_center": (x, y)}, {"screen-center-x": x, "screen-center-y": y}),
        "not-recentered": ({"recentered": False}, {"not-recentered": "no shear"}),
        "shear-sign": ({"reversed_shears": frozenset({Camera.C_STAR})}, {"shear-sign": "C*"}),
    }
    return each[fault]


SCENES = ("asymmetric-recentered", "car-recentered", "teapot-recentered")
SHEARS = ("right", "screen-height", "screen-center", "not-recentered", "shear-sign")
QUICK = [("asymmetric-recentered", "screen-height", 0.0), ("car-recentered", "right", 0.0)]


# Also beside a near offset, as a share of the reach.
@pytest.mark.parametrize(
    ("name", "fault", "near_per_reach"),
    kept(product(SCENES, SHEARS, (0.0, 0.02)), QUICK),
)
def test_a_wrong_shear_is_named_with_its_size_and_no_other_fault(
    name: str, fault: str, near_per_reach: float
) -> None:
    quick = (name, fault, near_per_reach) == QUICK[0]
    scene = small(name, SIZE if quick else 64)
    near = near_per_reach * scene.frustum.longest_reach
    faults, expected = put_in(scene, fault)
    apertures = SOME if quick else [*SOME, (1, 4), (3, 2)]
    with Faulty(scene=scene, near=near or None, **faults) as renderer:
        found = xfrustum.verify(scene, renderer, apertures=apertures)
    expected |= {"near": near} if near else {}
    named = {one.fault: one for one in found.diagnosis.faults}
    assert found.passed == (not expected)
    if (name, fault) == ("car-recentered", "screen-height") and near:
        # Neither number explains anything of this scene without the other, so that both are one finding.
        (together,) = named.values()
        sizes = dict(one.split() for one in str(together.value).split(", "))
        found_sizes = {one: pytest.approx(float(size), rel=1e-3) for one, size in sizes.items()}
        assert together.fault == TOGETHER and expected == found_sizes
    else:
        assert set(named) == set(expected)
    for one, size in expected.items() if TOGETHER not in named else ():
        low, high = named[one].low, named[one].high
        if isinstance(size, str):
            assert named[one].value == size
        else:
            # The faults are thirty times as large as the interval, or more.
            assert low is not None and high is not None and low <= size <= high and high - low < 0.1
    for hogel in found.hogels if expected else ():
        assert hogel.corrected is not None and hogel.corrected.surface is not None
        assert hogel.corrected.surface.fraction < 0.01
    assert not expected or found.summary()["corrected"]["causes"]["unexplained"] == 0
