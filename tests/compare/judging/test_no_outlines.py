"""Displacement of images that name objects: 0 where no pixel differs, and not limited without
outlines.
"""

from pathlib import Path

import numpy as np
import pytest

import xfrustum
from tests.support.long_tail import thinned
from tests.support.scene_file import film, named, part
from xfrustum.compare.judging.judged import MeasuredBy
from xfrustum.compare.judging.verdict import Outcome
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import reference_colors
from xfrustum.reference import Reference
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.words import sentence
from xfrustum.scenes import HogelImage, Scene, open_scene
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.tolerances import MAX_WRONG

SIDE = 32
FILM = film(
    (40.0, 40.0), hogels=(1, 1), resolution=(SIDE, SIDE), fov_deg=(60.0, 60.0), reach=(50.0, 60.0)
)
FILLED = np.ones((SIDE, SIDE), dtype=np.bool_)
LEFT = np.arange(SIDE)[None, :] < np.full((SIDE, 1), SIDE // 2)


def box_at(folder: Path, x: float) -> Scene:
    """Return a box of 100 mm, 20 mm behind the plate; at x = 0 it fills the film, at -50 mm its
    left half.
    """
    file = folder / "scene.toml"
    file.write_text(named("box", "mm") + FILM + part("box", 100.0, (x, 0.0, -70.0)))
    return open_scene(str(file))


def verified(scene: Scene, covered: Mask, max_wrong: float = MAX_WRONG) -> Verification:
    """Verify a renderer that names the box in some pixels (H, W)."""
    camera = Reference(scene).camera(scene.plate.middle)
    image = HogelImage(
        camera=camera,
        triangle=np.full(covered.shape, NOTHING, dtype=np.int32),
        object=np.where(covered, 0, NOTHING).astype(np.int32),
        position=np.full((*covered.shape, 3), np.nan),
    )
    return xfrustum.verify(scene, lambda _, __: image, max_wrong=max_wrong)


def test_an_object_that_fills_the_film_is_neither_right_nor_wrong(tmp_path: Path) -> None:
    """Whatever a renderer of this box does wrong, its pictures name the box everywhere."""
    result = verified(box_at(tmp_path, 0.0), FILLED)
    numbers = result.hogels[0].as_found
    assert numbers is not None
    assert (numbers.wrong, numbers.displacement_px) == (0, None)
    assert numbers.displacement_by is MeasuredBy.NO_OUTLINES
    assert (result.passed, result.verdict, result.summary()["verdict"]) == (
        False,
        Outcome.NOT_JUDGED,
        "not judged",
    )
    assert [(check.figure, check.held) for check in result.checks][-1] == ("displacement", None)
    assert sentence(result).startswith(
        "Not judged, neither right nor wrong: in the hogel the truth has no"
    )
    assert result.explained is None
    assert verified(box_at(tmp_path, 0.0), ~FILLED).verdict == "fail"
    half = sentence(verified(box_at(tmp_path, 0.0), LEFT))
    assert half == "Not right: the hogel exceeds a limit: at worst wrong surfaces 50 % (limit 1 %)."


def test_one_straight_edge_in_its_place_has_not_moved(tmp_path: Path) -> None:
    """The edge has 32 steps, fewer than registration needs."""
    result = verified(box_at(tmp_path, -50.0), LEFT)
    numbers = result.hogels[0].as_found
    assert numbers is not None
    assert numbers.wrong == 0
    assert numbers.displacement_px is not None
    assert numbers.displacement_px.max == 0
    assert result.passed


@pytest.mark.parametrize("columns", thinned([1, -3, 3], 3))
def test_an_outline_that_has_moved_and_cannot_be_registered_keeps_no_limit(
    tmp_path: Path, columns: int
) -> None:
    moved = np.arange(SIDE)[None, :] < np.full((SIDE, 1), SIDE // 2 + columns)
    result = verified(box_at(tmp_path, -50.0), moved, max_wrong=1.0)
    assert not result.passed
    assert "displacement unknown (limit 0.5 px)" in sentence(result)


@pytest.mark.parametrize(("brighter", "right"), thinned([(0.0, True), (0.1, False)], 2))
def test_a_film_of_one_color_is_judged_by_its_colors_alone(
    tmp_path: Path, brighter: float, right: bool
) -> None:
    scene = box_at(tmp_path, 0.0)
    reference = Reference(scene)
    true = reference_colors(reference, RendererModel(), reference.trace(scene.plate.middle))
    assert true.color is not None
    image = HogelImage(
        camera=true.camera,
        triangle=np.full(FILLED.shape, NOTHING, dtype=np.int32),
        object=np.full(FILLED.shape, NOTHING, dtype=np.int32),
        position=np.full((*FILLED.shape, 3), np.nan),
        color=true.color + np.float32(brighter),
    )
    result = xfrustum.verify(scene, lambda _, __: image)
    assert result.passed is right
    assert [check.figure for check in result.checks if not check.held] == (
        [] if right else ["wrong colors"]
    )
