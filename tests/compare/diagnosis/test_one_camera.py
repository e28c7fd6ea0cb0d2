"""Faults of one camera alone are named as such, and numbers that explain only together are one finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.foreign_renderers import small
from xfrustum.compare.diagnosis.diagnosis import Evidence, diagnose
from xfrustum.compare.diagnosis.faults import TOGETHER, Fault, with_joint_numbers
from xfrustum.compare.renderer_model.drawn_model import DrawnModel, OneCamera
from xfrustum.compare.renderer_model.pictures import colored, trace_drawn
from xfrustum.reference import Reference
from xfrustum.scenes import NOTHING, HogelImage

SIZE = 32
SOME = [(0, 0), (4, 1), (2, 3)]
C, C_STAR = OneCamera(1), OneCamera(-1)
UNTURNED = OneCamera(-1, flip_x=True, flip_y=True)


def drawn(reference: Reference, model: DrawnModel) -> list[HogelImage]:
    """Return the triangles that a model draws in some hogels."""
    images = [trace_drawn(reference, model, reference.scene.plate.aperture(*index)) for index in SOME]
    return [replace(image, position=np.full_like(image.position, np.nan)) for image in images]


@pytest.mark.parametrize(
    ("scene", "model", "expected"),
    [
        ("asymmetric", DrawnModel(near=1.0, one_camera=C_STAR), {"front-near-offset": 1.0}),
        ("asymmetric-recentered", DrawnModel(near=1.0, one_camera=C), {"back-near-offset": 1.0}),
        ("asymmetric", DrawnModel(one_camera=UNTURNED), {"front-unturned": None}),
        ("asymmetric", DrawnModel(one_camera=replace(C, flip_x=True)), {"back-mirrored": None}),
        ("asymmetric", DrawnModel(back_missing=True), {"back-missing": None}),
        # The offset of 2 is stated, and one camera keeps it.
        pytest.param(
            "asymmetric",
            DrawnModel(near=3.0, one_camera=replace(C_STAR, other_near=2.0)),
            {"front-near-offset": 3.0},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_fault_of_one_camera_is_named_and_no_other(
    scene: str, model: DrawnModel, expected: dict[str, float | None]
) -> None:
    reference = Reference(small(scene, SIZE))
    nominal = DrawnModel(near=model.one_camera.other_near if model.one_camera else 0.0)
    evidence = Evidence(reference=reference, images=drawn(reference, model), nominal=nominal)
    found = diagnose(evidence).diagnosis
    assert {fault.fault for fault in found.faults} == set(expected)
    for fault in found.faults:
        size = expected[fault.fault]
        assert fault.explains == 1.0
        if size is not None:
            assert fault.low is not None and fault.high is not None
            assert fault.low <= size <= fault.high


def test_a_mirrored_camera_is_named_from_its_colors_and_no_number_beside_it() -> None:
    reference, model, images = Reference(small("asymmetric", SIZE)), DrawnModel(one_camera=UNTURNED), []
    for index in SOME:
        image = trace_drawn(reference, model, reference.scene.plate.aperture(*index))
        picture = colored(reference.scene, model, image)
        nothing = np.full_like(image.triangle, NOTHING)
        nowhere = np.full_like(image.position, np.nan)
        images.append(replace(picture, triangle=nothing, object=nothing, position=nowhere))
    (fault,) = diagnose(Evidence(reference=reference, images=images, nominal=DrawnModel())).diagnosis.faults
    assert (fault.fault, fault.explains) == ("front-unturned", 1.0)


def test_what_mends_one_half_and_spoils_the_other_is_no_explanation() -> None:
    reference = Reference(small("asymmetric", SIZE))
    stepped = DrawnModel(near=1.0, one_camera=C_STAR)
    test = Evidence(reference=reference, images=drawn(reference, stepped), nominal=DrawnModel())
    assert test.spares(stepped)
    assert not test.spares(DrawnModel(near=1.0))


def test_numbers_that_explain_only_together_are_one_finding() -> None:
    scene = small("asymmetric", SIZE)
    # Behind the plate alone, where a wider film undoes most of what an offset does.
    behind = replace(scene, frustum=replace(scene.frustum, reach=(1e-3, scene.frustum.reach[1])))
    reference, model = Reference(behind), DrawnModel(near=3.0, fov=(1 / 1.1, 1 / 1.1))
    test = Evidence(reference=reference, images=drawn(reference, model), nominal=DrawnModel())
    assert test.joint_groups(model) == ("fov", "near")
    assert test.joint_groups(DrawnModel(near=3.0)) == ()
    faults = [
        Fault(fault=name, value=1.1, words=name, alternatives=("x",))
        for name in ("orientation", "fov-x", "near")
    ]
    kept, joint = with_joint_numbers(faults, ("fov", "near"), model)
    assert (kept.fault, joint.fault, joint.alternatives) == ("orientation", TOGETHER, ("x",))
    assert "only together" in joint.words and "fov-x; near" in joint.words
    assert with_joint_numbers(faults, (), model) == tuple(faults)
