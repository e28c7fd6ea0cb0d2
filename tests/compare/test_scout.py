"""The scout selects the apertures with the plate's largest errors; a sample bounds the rest."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.lit import ball, lit
from tests.support.views import view
from xfrustum.compare import scout as scouting
from xfrustum.compare.scout import (
    AutoApertures,
    CoarseView,
    Criterion,
    PlateScan,
    nearest_cells,
    scout,
)
from xfrustum.reference import Reference
from xfrustum.scenes import Camera, DoubleFrustum, Frustum, Plate, Scene
from xfrustum.scenes.appearance import Material

RADIUS, GAP = 3.0, 0.25  #: radius of a ball, and distance of its surface behind the plate

OVER = (31, 7)  #: column and row of the aperture right over the ball


@pytest.fixture(scope="module")
def ball_behind_a_plate() -> Scene:
    """Return a small ball close behind one point of a plate of 40 x 30 hogels."""
    plate = Plate(size=(40.0, 30.0), hogels=(40, 30))
    over = plate.aperture(*OVER)
    part = ball((over.x, over.y, -GAP - RADIUS), RADIUS, "paint")
    frustum = Frustum(
        resolution=(128, 96), fov=(math.radians(60), math.radians(45)), reach=(5.0, 50.0)
    )
    return replace(lit(part, frustum=frustum, paint=Material()), plate=plate)


@pytest.fixture(scope="module")
def scouted(ball_behind_a_plate: Scene) -> PlateScan:
    return scout(ball_behind_a_plate)


def test_the_worst_aperture_lies_over_the_surface_nearest_to_the_plate(
    scouted: PlateScan, ball_behind_a_plate: Scene
) -> None:
    """A large plate is scanned in part, with corners and middle; a small plate is scanned fully."""
    worst = scouted.worst(1)[0]
    assert max(abs(worst.aperture.column - OVER[0]), abs(worst.aperture.row - OVER[1])) <= 1
    assert GAP <= worst.nearest < 1.2 * GAP
    indices = {aperture.index for aperture in scouted.apertures}
    assert {(0, 0), (39, 0), (0, 29), (39, 29), scouted.scene.plate.middle.index} <= indices
    assert len(indices) == len(scouted.looks) < 1200
    small = replace(ball_behind_a_plate, plate=Plate(size=(40.0, 30.0), hogels=(8, 6)))
    assert len(scout(small).looks) == 48


def test_surfaces_smaller_than_the_lattice_are_located_by_vertices(
    ball_behind_a_plate: Scene,
) -> None:
    """The ball is smaller than a hogel and lies between the points of the lattice."""
    plate = replace(ball_behind_a_plate.plate, hogels=(60, 45))
    for column, row in ((30, 21), (31, 23), (32, 22)):
        over = plate.aperture(column, row)
        part = ball((over.x, over.y, -0.3), 0.2, "paint")
        scene = replace(ball_behind_a_plate, plate=plate, objects=(part,))
        assert nearest_cells(scene, 1) == [(column, row)]


def test_vertices_in_the_plate_count_last_and_vertices_out_of_reach_do_not_count(
    ball_behind_a_plate: Scene,
) -> None:
    triangle = np.array([[1.5, 0.5, 0.0], [3.5, 0.5, -4.0], [5.5, 0.5, 5.5]])
    faces = np.array([[0, 1, 2]])
    part = replace(
        ball_behind_a_plate.objects[0], vertices=triangle, faces=faces, vertex_normals=None
    )
    assert nearest_cells(replace(ball_behind_a_plate, objects=(part,)), 3) == [(23, 14), (21, 14)]


def test_displacement_is_scouted_to_a_factor_of_two_and_grows_with_small_nears(
    scouted: PlateScan,
) -> None:
    """The closed form gives about the same on the coarse film and on the full film."""
    scene, settings = scouted.scene, DoubleFrustum(near=0.01)
    reference = Reference(scene)
    for look in scouted.worst(3, settings):
        truth = reference.trace(look.aperture)
        z = np.abs(truth.height[truth.covered].astype(np.float64))
        radius = np.hypot(*np.meshgrid(np.arange(128) - 63.5, np.arange(96) - 47.5))[truth.covered]
        expected = np.percentile(radius * 0.01 / (z + 0.01), 99)
        assert expected / 2 < look.displacement_p99_px(settings, scene) < expected * 2
    for look in scouted.looks:
        moved = look.displacement_p99_px(DoubleFrustum(near=1e-6), scene)
        assert moved == pytest.approx(look.pixels_per_near * 1e-6, rel=1e-4)


def test_sides_are_counted_separately_and_an_empty_film_has_no_displacement(
    scouted: PlateScan,
) -> None:
    far = scouted.farthest(Camera.C)
    assert GAP < far.farthest(Camera.C) <= GAP + 2 * RADIUS
    assert far.farthest(Camera.C_STAR) == 0 < far.outline_widths
    corner = next(look for look in scouted.looks if look.aperture.index == (0, 29))
    assert corner.nearest == math.inf and corner.outline_widths == 0
    assert corner.displacement_p99_px(DoubleFrustum(near=1.0), scouted.scene) == 0


def test_no_more_apertures_are_looked_through_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scouting, "LATTICE_APERTURES", 30)
    monkeypatch.setattr(scouting, "MAX_APERTURES", 44)
    steps: list[int] = []
    result = scout(view("asymmetric", (32, 24)), steps.append)
    assert len(result.looks) == len(steps) <= 44


# Apertures of `auto`


@pytest.fixture(scope="module")
def both_sides() -> PlateScan:
    """Return all apertures of a small plate, in the middle of a scene on both sides."""
    scene: Scene = view("asymmetric", (64, 48))
    return scout(replace(scene, plate=Plate(size=scene.plate.size, hogels=(6, 4))))


def chosen_of(scan: PlateScan, *looks: CoarseView) -> AutoApertures:
    return AutoApertures.from_scan(replace(scan, looks=looks))


def test_the_middle_comes_first_and_each_other_one_is_the_worst_by_some_criterion(
    both_sides: PlateScan,
) -> None:
    auto, looks = AutoApertures.from_scan(both_sides), both_sides.looks
    middle = both_sides.scene.plate.middle
    assert auto.apertures[0] == middle
    assert 2 <= len(auto.chosen) <= 4 and len(set(auto.apertures)) == len(auto.chosen)
    criteria = {choice.aperture: choice.criteria for choice in auto.chosen}
    for worst, criterion in (
        (max(looks, key=lambda look: look.pixels_per_near), Criterion.DISPLACEMENT),
        (min(looks, key=lambda look: look.nearest), Criterion.NEAREST),
        (max(looks, key=lambda look: look.outline_widths), Criterion.OUTLINES),
    ):
        assert criterion in criteria[worst.aperture]
    same: dict[str, Any] = {"height": looks[0].height, "outline_widths": looks[0].outline_widths}
    alike = [replace(look, **same) for look in looks]
    assert chosen_of(both_sides, *alike).apertures == (middle,)


def test_an_empty_middle_is_left_out_unless_all_hogels_are_empty(
    both_sides: PlateScan,
) -> None:
    middle = both_sides.scene.plate.middle
    (seeing,) = (look for look in both_sides.looks if look.aperture == middle)
    dark = replace(seeing, height=np.full_like(seeing.height, np.nan))
    others = [look for look in both_sides.looks if look is not seeing]
    assert middle not in chosen_of(both_sides, dark, *others).apertures
    assert chosen_of(both_sides, dark).apertures == (middle,)


def test_an_aperture_that_a_surface_passes_through_is_chosen_only_where_there_is_no_other(
    both_sides: PlateScan,
) -> None:
    first, *others = both_sides.looks
    blocked = replace(first, height=np.zeros_like(first.height))
    auto = chosen_of(both_sides, blocked, *others)
    assert auto.blocked == 1 and blocked.aperture not in auto.apertures
    assert chosen_of(both_sides, blocked).apertures == (blocked.aperture,)
