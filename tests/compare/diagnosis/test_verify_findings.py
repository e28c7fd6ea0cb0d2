"""Findings rest on wrong pixels: none without them, and all findings together must explain them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import xfrustum
from tests.support.foreign_renderers import small
from tests.support.scene_file import film, named, part
from xfrustum.compare.diagnosis.diagnosis import MIN_EXPLAINED_FRACTION, Evidence
from xfrustum.compare.diagnosis.faults import Fault
from xfrustum.compare.judging.judged import Compared, Judging
from xfrustum.compare.renderer_model.drawn_model import Culled, DrawnModel, Front
from xfrustum.compare.renderer_model.pictures import trace_drawn
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import NOTHING, Aperture, HogelImage, Scene, open_scene
from xfrustum.scenes.errors import InputError

SIZE = 32
SOME = [(0, 0), (4, 1), (2, 3)]
KEYS = set(Fault(fault="", value="", words="").summary())


def of_objects(image: HogelImage, added: int = 0) -> HogelImage:
    """Return an image of object numbers with a constant added; numbers below 0 show nothing."""
    nothing = np.full_like(image.triangle, NOTHING)
    named = np.where(image.object == NOTHING, NOTHING, np.maximum(image.object + added, NOTHING))
    nowhere = np.full_like(image.position, np.nan)
    return replace(image, triangle=nothing, object=named.astype(np.int32), position=nowhere, color=None)


def test_right_pictures_of_objects_get_no_finding() -> None:
    scene = small("asymmetric", SIZE)
    reference = Reference(scene)
    found = xfrustum.verify(scene, lambda _, a: of_objects(reference.trace(a)), apertures=SOME)
    assert found.passed
    assert found.diagnosis.faults == found.diagnosis.does_not_explain == ()
    assert found.summary()["explained"] is None


def test_numbers_without_plus_one_do_not_take_the_viewers_half_away() -> None:
    scene = small("asymmetric", SIZE)
    reference = Reference(scene)
    found = xfrustum.verify(scene, lambda _, a: replaced(reference, a), apertures=SOME)
    (fault,) = found.summary()["diagnosis"]
    assert fault["fault"] == "id-offset"
    assert set(fault) == KEYS
    assert fault["explains"] >= MIN_EXPLAINED_FRACTION
    assert fault["alternatives"] == []
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0


def replaced(reference: Reference, aperture: Aperture) -> HogelImage:
    image = reference.trace(aperture)
    nowhere = np.full_like(image.position, np.nan)
    fewer = np.maximum(image.triangle - 1, NOTHING).astype(np.int32)
    return replace(image, triangle=fewer, object=np.full_like(fewer, NOTHING), position=nowhere, color=None)


SPHERE = (
    named("a sphere before the plate", "mm")
    + film((40.0, 40.0), hogels=(2, 2), resolution=(32, 32), fov_deg=(60.0, 60.0), reach=(50.0, 60.0))
    + part("sphere", 12.0, (3.0, -2.0, 25.0))
)


def verified(scene: Scene, model: DrawnModel) -> Verification:
    reference = Reference(scene)

    def draw(_: Scene, aperture: Aperture) -> HogelImage:
        image = trace_drawn(reference, model, aperture)
        return replace(image, position=np.full_like(image.position, np.nan))

    return xfrustum.verify(scene, draw)


def test_a_sphere_whose_near_side_is_left_out_shows_its_far_side_as_if_that_won(tmp_path: Path) -> None:
    file = tmp_path / "sphere.toml"
    file.write_text(SPHERE)
    scene = open_scene(str(file))
    for model in (DrawnModel(culled=Culled.COUNTERCLOCKWISE), DrawnModel(front=Front.NEAREST)):
        (fault,) = verified(scene, model).diagnosis.faults
        assert fault.fault == "front-nearest"
        assert fault.alternatives == ("culling",)
        assert "or culling: images cannot tell" in fault.words


def test_what_counts_as_wrong_is_what_the_verdict_counts() -> None:
    scene = small("asymmetric", SIZE)
    reference = Reference(scene)
    images = []
    for index in SOME:
        image = reference.trace(scene.plate.aperture(*index))
        assert image.color is not None
        nothing, nowhere = np.full_like(image.triangle, NOTHING), np.full_like(image.position, np.nan)
        images.append(
            replace(image, color=0.5 * image.color, triangle=nothing, object=nothing, position=nowhere)
        )
    test = Evidence(reference=reference, images=images, nominal=DrawnModel())
    assert test.wrong(DrawnModel()) > 0
    assert replace(test, judging=Judging(color_tolerance=1.0), known={}).wrong(DrawnModel()) == 0
    outlines = replace(test, judging=Judging(compared=Compared.GEOMETRY), known={})
    assert outlines.wrong(DrawnModel()) < test.wrong(DrawnModel()) / 10


def test_a_guess_that_shows_nothing_does_not_explain_what_is_shown() -> None:
    scene = small("asymmetric", SIZE)
    reference, image = Reference(scene), Reference(scene).trace(scene.plate.middle)
    few = np.full_like(image.triangle, NOTHING)
    few[:2, :2] = 1
    nowhere = np.full_like(image.position, np.nan)
    dark = replace(image, triangle=few, object=np.full_like(few, NOTHING), position=nowhere, color=None)
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
        xfrustum.verify(small("asymmetric", SIZE), "none_{i}_{j}.png", **asked)


@pytest.mark.slow
def test_of_closed_bodies_faces_turned_away_may_be_left_out_and_others_not() -> None:
    scene = small("asymmetric", SIZE)
    assert verified(scene, DrawnModel(culled=Culled.CLOCKWISE)).passed
    found = verified(scene, DrawnModel(culled=Culled.COUNTERCLOCKWISE))
    assert [fault.fault for fault in found.diagnosis.faults] == ["culling"]
    assert found.summary()["corrected"]["causes"]["unexplained"] == 0
