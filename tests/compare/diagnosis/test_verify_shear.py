"""A recentered frustum's images do not tell all apart: moved screens, shifts, missing or reversed shears."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.foreign_renderers import small
from xfrustum.compare.diagnosis.diagnosis import diagnose
from xfrustum.compare.diagnosis.evidence import Evidence
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, Recentering
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import Scene

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


def test_one_hogel_does_not_tell_a_missing_shear_from_a_screen_elsewhere() -> None:
    scene = small("asymmetric-recentered", SIZE)
    named = diagnosed(scene, DrawnModel(recentering=Recentering.NONE), SOME[0])
    assert set(named) == {"not-recentered"}
    assert named["not-recentered"].alternatives == ("screen-center-x", "screen-center-y")
    assert "images cannot tell" in named["not-recentered"].words


def test_what_lies_before_the_plate_alone_does_not_tell_whether_c_is_sheared_rightly() -> None:
    whole = small("asymmetric-recentered", SIZE)
    before = replace(whole, frustum=replace(whole.frustum, reach=(whole.frustum.reach[0], 1e-3)))
    named = diagnosed(before, DrawnModel(recentering=Recentering.C_STAR_REVERSED), *SOME)
    assert set(named) == {"shear-sign"}
    assert named["shear-sign"].value == "C*"
    assert "images cannot tell" in named["shear-sign"].words


def test_a_centered_frustum_has_no_shear_to_be_wrong() -> None:
    scene = small("asymmetric", SIZE)
    named = diagnosed(scene, DrawnModel(shift=(3.0, 0.0)), *SOME)
    assert set(named) == {"shift-x"}
    assert named["shift-x"].alternatives == ()
