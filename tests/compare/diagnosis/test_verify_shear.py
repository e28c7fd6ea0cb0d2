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
