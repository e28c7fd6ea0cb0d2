"""A fault put in on purpose is named, with the right size, and nothing else is; or what shows the
same is.
"""

import itertools
import math
from dataclasses import replace
from typing import Any

import pytest

import xfrustum
from tests.support.foreign_renderers import Faulty, oblong, saying, small
from xfrustum.compare.diagnosis.defects import TOGETHER, Defect, with_joint_numbers
from xfrustum.compare.diagnosis.diagnosis import diagnose
from xfrustum.compare.diagnosis.testset import TestSet
from xfrustum.compare.renderer_model.conventions import Orientation
from xfrustum.compare.renderer_model.drawn_model import Recentering, RendererModel
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import Scene
from xfrustum.scenes.conformance.suite import chosen

TURNED, REVERSED = Orientation(True, False, True), Orientation(False, True, False)
ABOUT, EXCHANGED = Orientation(False, True, True), Orientation(True, False, True)

FAULTS: dict[str, tuple[dict[str, Any], dict[str, float | str]]] = {
    "orientation": ({"orientation": TURNED}, {"orientation": TURNED.labels[0]}),
    "order": ({"order": REVERSED}, {"aperture-order": REVERSED.labels[1]}),
    "corners": ({"shift": (-0.5, -0.5)}, {"shift-x": -0.5, "shift-y": -0.5}),
    "fov": ({"fov": (1.01, 1.01)}, {"fov-x": 1.01, "fov-y": 1.01}),
    "aspect": ({"fov": (1.0, 0.99)}, {"fov-y": 0.99}),
    "pitch": ({"pitch": 1.02}, {"pitch-x": 1.02, "pitch-y": 1.02}),
    "near": ({"near": 1.5}, {"near": 1.5}),
    "pivot": ({"near": 3.0, "pivot": "camera"}, {"pivot": "camera"}),
    "fit": ({"near": 3.0, "fit": "screen"}, {"fit": "screen"}),
    "missing": ({"front": "missing"}, {"front-missing": "missing"}),
    "nearest": ({"front": "nearest"}, {"front-nearest": "nearest wins"}),
    "covered": ({"overlaid": False}, {"not-overlaid": "back over front"}),
    "lights": ({"conjugated": False}, {}),
}
"""By name of a case: the faults that are put in, and the faults that must be named, with their
sizes.
"""

EXACT = {"shift": 0.02, "fov": 5e-4, "pitch": 5e-4, "near": 0.02 * 1.5}
"""Largest errors of the named sizes: a tenth of a pixel, a tenth of a percent, and 2 % of near."""

SIZE = 48
FEW = [(0, 0), (4, 1), (2, 3)]
SOME = [*FEW, (1, 4), (3, 2)]
"""Hogels in each column and in each row of the plate, once; of pairs of faults all are judged."""
OF_PAIRS = [
    (combination, other)
    for combination, other in itertools.combinations(FAULTS, 2)
    # These pairs contradict each other, or one needs a part that the other takes away.
    if not {combination, other} <= {"near", "pivot", "fit"}
    and not {combination, other} <= {"fov", "aspect"}
    # A fit to the screen scales the film as a field of view does: one number is not two.
    and not {combination, other} <= {"fov", "fit"}
    and not {combination, other} <= {"missing", "nearest", "covered", "lights"}
    # Its film is shifted by moving the screen, which moves offset cameras aside: not a sampling
    # point alone any more. Both together are in the hogels of another renderer
    # (test_wrong_renderers).
    and not ("corners" in (combination, other) and {combination, other} & {"near", "pivot", "fit"})
    # The brute force of the nearest surface has the paper's two cameras only.
    and not ("nearest" in (combination, other) and {combination, other} & {"pivot", "fit"})
]


def verified(
    *names: str, scene: Scene | None = None, apertures: list[tuple[int, int]] | None = None
) -> Verification:
    faults: dict[str, Any] = {}
    for name in names:
        faults |= FAULTS[name][0]
    # Pivot and fit need an offset, which is stated.
    stated = faults["near"] if {"pivot", "fit"} & set(names) else None
    world = scene or small(size=SIZE)
    with Faulty(scene=world, **faults) as renderer:
        return xfrustum.verify(world, renderer, near=stated, apertures=apertures)


def assert_named(result: Verification, *names: str) -> None:
    named = {fault.fault: fault for fault in result.diagnosis.faults}
    expected: dict[str, float | str] = {}
    for name in names:
        expected |= FAULTS[name][1]
    assert set(named) == set(expected) | ({"lights"} & set(names))
    for name, size in expected.items():
        value, low, high = named[name].value, named[name].low, named[name].high
        if isinstance(size, str):
            assert value == size
            continue
        assert isinstance(value, float) and low is not None and high is not None
        assert value == pytest.approx(size, abs=EXACT[name.split("-")[0]])
        assert low <= value <= high
        assert low - 1e-3 * abs(size) <= size <= high + 1e-3 * abs(size)
    assert not result.passed
    assert result.summary()["corrected"]["fraction"] < 0.01
    assert result.summary()["corrected"]["causes"]["unexplained"] <= 2


@pytest.mark.parametrize(
    "name", ["corners", pytest.param("near", marks=pytest.mark.slow), "missing"]
)
def test_a_fault_of_sampling_of_the_cameras_or_of_composition_is_named_from_few_small_hogels(
    name: str,
) -> None:
    assert_named(verified(name, scene=oblong(width=SIZE), apertures=FEW), name)


@pytest.mark.slow
@pytest.mark.parametrize("pair", OF_PAIRS, ids=" and ".join)
def test_two_faults_are_told_apart(pair: tuple[str, str]) -> None:
    assert_named(verified(*pair), *pair)


@pytest.mark.parametrize("name", ["asymmetric-recentered", "asymmetric"])
def test_in_a_renderer_that_is_right_nothing_is_named(name: str) -> None:
    result = verified(scene=oblong(name), apertures=FEW)
    assert result.diagnosis.faults == () and result.passed
    summary = result.summary()
    assert summary["verdict"] == "pass"
    assert summary["as_found"]["surface"]["fraction"] < 0.01
    assert summary["as_found"]["displacement_px"]["worst_p99"] < 0.5


@pytest.mark.slow
def test_an_offset_that_is_stated_is_part_of_the_question() -> None:
    world = small(size=SIZE)
    with Faulty(scene=world, near=2.0) as renderer:
        stated, unstated, wrongly = (
            xfrustum.verify(world, renderer, near=near, apertures=SOME) for near in (2.0, None, 1.0)
        )
    assert stated.passed and stated.diagnosis.faults == ()
    for result in (unstated, wrongly):
        assert not result.passed
        assert [fault.fault for fault in result.diagnosis.faults] == ["near"]
        assert math.isclose(float(result.diagnosis.faults[0].value), 2.0, rel_tol=0.02)


def test_one_hogel_leaves_the_order_open_and_tells_the_orientation() -> None:
    world = small(size=32)
    with Faulty(scene=world, orientation=TURNED) as renderer:
        result = xfrustum.verify(world, renderer, apertures=[(2, 2)])
    assert [fault.fault for fault in result.diagnosis.faults] == ["orientation"]


@pytest.mark.slow
def test_accepted_conventions_are_named_but_not_judged() -> None:
    world = small(size=SIZE)
    with Faulty(scene=world, orientation=TURNED, order=REVERSED) as renderer:
        assert not xfrustum.verify(world, renderer, apertures=SOME).passed
        accepted = xfrustum.verify(world, renderer, apertures=SOME, accept=("orientation", "order"))
    assert accepted.passed
    assert {fault.fault for fault in accepted.diagnosis.faults} == {"orientation", "aperture-order"}


# Pictures without numbers are registered with the reference's own.


# Images of a recentered frustum leave open moved screens, shifts, missing or reversed shears.


def evidence_of(
    scene: Scene, model: RendererModel, *apertures: tuple[int, int], near: float = 0.0
) -> TestSet:
    """Return the triangles that a model draws in some hogels, all of `FEW` where none is named."""
    reference = Reference(scene)
    images = [
        trace_drawn(reference, model, scene.plate.aperture(*index)) for index in apertures or FEW
    ]
    shown = [saying(image, "triangle", "object") for image in images]
    return TestSet(reference=reference, images=shown, nominal=RendererModel(near=near))


def diagnosed(evidence: TestSet) -> dict[str, Defect]:
    return {fault.fault: fault for fault in diagnose(evidence).diagnosis.faults}


@pytest.mark.slow
def test_a_moved_screen_and_a_shifted_sampling_point_show_the_same_images() -> None:
    scene = small("asymmetric-recentered", 32)
    assert scene.frustum.screen is not None
    per_px = scene.frustum.screen.size[0] / 32
    # The first name is the likelier mistake: pixels are sampled within themselves.
    for shift, first, other in (
        (0.5, "shift-x", "screen-center-x"),
        (3.0, "screen-center-x", "shift-x"),
    ):
        named = diagnosed(evidence_of(scene, RendererModel(screen_center=(-shift * per_px, 0.0))))
        assert set(named) == {first}
        assert named[first].alternatives == (other,)
    centered = diagnosed(evidence_of(small("asymmetric", 32), RendererModel(shift=(3.0, 0.0))))
    assert {name: fault.alternatives for name, fault in centered.items()} == {"shift-x": ()}


@pytest.mark.slow
def test_one_hogel_or_one_side_of_the_plate_do_not_tell_what_became_of_a_shear() -> None:
    scene = small("asymmetric-recentered", 32)
    (fault,) = diagnosed(
        evidence_of(scene, RendererModel(recentering=Recentering.NONE), FEW[0])
    ).values()
    assert (fault.fault, fault.alternatives) == (
        "not-recentered",
        ("screen-center-x", "screen-center-y"),
    )
    before = replace(scene, frustum=replace(scene.frustum, reach=(scene.frustum.reach[0], 1e-3)))
    reversed_shear = RendererModel(recentering=Recentering.C_STAR_REVERSED)
    (fault,) = diagnosed(evidence_of(before, reversed_shear)).values()
    assert (fault.fault, fault.value) == ("shear-sign", "C*")
    assert fault.details


@pytest.mark.slow
def test_a_half_that_leaves_the_film_by_a_wrong_shear_is_not_called_missing() -> None:
    """With both shears reversed, the corner hogel of this attic shows surfaces behind the plate
    alone.
    """
    (case,) = chosen(names=["L3-attic-0"])
    scene = case.open()
    result = diagnosed(
        evidence_of(scene, RendererModel(recentering=Recentering.BOTH_REVERSED), (0, 0))
    )
    assert set(result) == {"shear-sign"}


# Faults of one camera alone are named as such, and numbers that explain only together are one
# finding.


def test_numbers_that_explain_only_together_are_one_finding() -> None:
    scene = oblong()
    # Behind the plate alone, where a wider film undoes most of an offset.
    behind = replace(scene, frustum=replace(scene.frustum, reach=(1e-3, scene.frustum.reach[1])))
    model = RendererModel(near=3.0, fov=(1 / 1.1, 1 / 1.1))
    test = evidence_of(behind, model)
    assert test.joint_groups(model) == ("fov", "near")
    assert test.joint_groups(RendererModel(near=3.0)) == ()
    names = ("orientation", "fov-x", "near")
    faults = [Defect(fault=name, value=1.1, alternatives=("x",)) for name in names]
    kept_one, joint = with_joint_numbers(faults, ("fov", "near"), model)
    assert (kept_one.fault, joint.fault, joint.alternatives) == ("orientation", TOGETHER, ("x",))
    assert [part.fault for part in joint.parts] == ["fov-x", "near"]
    assert with_joint_numbers(faults, (), model) == tuple(faults)
