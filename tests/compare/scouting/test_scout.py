"""The scout finds the apertures that decide the error of a plate; a sample bounds what it has not seen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.views import view
from xfrustum.compare.scouting import scout as scouting
from xfrustum.compare.scouting.sample import RandomSample, sample_hogels, share_at_most
from xfrustum.compare.scouting.scout import FILM_PIXELS, Scout, scout
from xfrustum.reference import Reference
from xfrustum.scenes import Camera, DoubleFrustum, Frustum, InputError, Plate, Scene, SceneObject
from xfrustum.scenes.geometry.shapes import build_shape

RADIUS, GAP = 3.0, 0.25
"""Radius of a ball, and its distance behind the plate."""

OVER = (31, 7)
"""Column and row of the aperture that lies right over the ball."""


@pytest.fixture(scope="module")
def ball_behind_a_plate() -> Scene:
    """A small ball close behind one place of a plate of 40 x 30 hogels."""
    plate = Plate(size=(40.0, 30.0), hogels=(40, 30))
    over = plate.aperture(*OVER)
    unit = build_shape("sphere")
    center = np.array([over.x, over.y, -GAP - RADIUS])
    size = RADIUS / np.abs(unit.vertices).max()
    ball = SceneObject(name="ball", vertices=unit.vertices * size + center, faces=unit.faces)
    frustum = Frustum(resolution=(128, 96), fov=(math.radians(60), math.radians(45)), reach=(5.0, 50.0))
    return Scene(name="ball", plate=plate, frustum=frustum, objects=(ball,))


@pytest.fixture(scope="module")
def scouted(ball_behind_a_plate: Scene) -> Scout:
    return scout(ball_behind_a_plate)


def test_the_worst_aperture_lies_over_what_is_nearest_to_the_plate(scouted: Scout) -> None:
    """A third of the 1,200 hogels is looked through; the worst are those right over the ball."""
    worst = scouted.worst(1)[0]
    assert max(abs(worst.aperture.column - OVER[0]), abs(worst.aperture.row - OVER[1])) <= 1
    assert GAP <= worst.nearest < 1.2 * GAP
    assert len(scouted.looks) < 1200


def test_corners_and_the_middle_are_always_looked_through(scouted: Scout) -> None:
    indices = {aperture.index for aperture in scouted.apertures}
    assert {(0, 0), (39, 0), (0, 29), (39, 29), scouted.scene.plate.middle.index} <= indices
    assert len(indices) == len(scouted.looks)


def test_a_plate_of_few_hogels_is_looked_at_whole(ball_behind_a_plate: Scene) -> None:
    small = replace(ball_behind_a_plate, plate=Plate(size=(40.0, 30.0), hogels=(8, 6)))
    assert len(scout(small).looks) == 48


def test_the_coarse_film_shows_what_the_truth_shows(scouted: Scout) -> None:
    """Each coarse pixel is a line of the certified truth of a film of that size."""
    scene, look = scouted.scene, scouted.worst(1)[0]
    coarse = replace(scene, frustum=replace(scene.frustum, resolution=(FILM_PIXELS, FILM_PIXELS)))
    truth = Reference(coarse).trace(look.aperture)
    np.testing.assert_array_equal(look.height, np.where(truth.covered, truth.height, np.nan))


def test_displacement_is_scouted_to_a_factor_of_two(scouted: Scout) -> None:
    """The closed form over the coarse film agrees with the same over the film in full."""
    scene, settings = scouted.scene, DoubleFrustum(near=0.01)
    reference = Reference(scene)
    for look in scouted.worst(3, settings):
        truth = reference.trace(look.aperture)
        z = np.abs(truth.height[truth.covered].astype(np.float64))
        radius = np.hypot(*np.meshgrid(np.arange(128) - 63.5, np.arange(96) - 47.5))[truth.covered]
        expected = np.percentile(radius * 0.01 / (z + 0.01), 99)
        assert expected / 2 < look.displacement_p99_px(settings, scene) < expected * 2


def test_for_small_nears_displacement_grows_in_proportion(scouted: Scout) -> None:
    near = 1e-6
    for look in scouted.looks:
        moved = look.displacement_p99_px(DoubleFrustum(near=near), scouted.scene)
        assert moved == pytest.approx(look.pixels_per_near * near, rel=1e-4)


def test_what_is_seen_on_each_side_is_told_apart(scouted: Scout) -> None:
    far = scouted.farthest(Camera.C)
    assert GAP < far.farthest(Camera.C) <= GAP + 2 * RADIUS
    assert far.farthest(Camera.C_STAR) == 0
    assert far.outline_widths > 0


def test_an_aperture_that_sees_nothing_displaces_nothing(scouted: Scout) -> None:
    corner = next(look for look in scouted.looks if look.aperture.index == (0, 29))
    assert corner.nearest == math.inf
    assert corner.displacement_p99_px(DoubleFrustum(near=1.0), scouted.scene) == 0
    assert corner.outline_widths == 0


def test_no_more_apertures_are_looked_through_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scouting, "LATTICE_APERTURES", 30)
    monkeypatch.setattr(scouting, "MAX_APERTURES", 44)
    steps: list[int] = []
    found = scout(view("asymmetric", (32, 24)), steps.append)
    assert len(found.looks) == len(steps) <= 44


# What a sample bounds ------------------------------------------------------------------------------------


def test_fifty_nine_clean_hogels_bound_one_in_twenty_and_299_one_in_a_hundred() -> None:
    """(1 - q)^59 < 0.05 from q = 0.0495 on: Clopper and Pearson's bound where nothing was found."""
    assert share_at_most(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert share_at_most(0, 59) < 0.05 < share_at_most(0, 58)
    assert share_at_most(0, 299) < 0.01 < share_at_most(0, 298)
    assert share_at_most(59, 59) == 1.0


@given(beyond=st.integers(0, 20), more=st.integers(0, 20), share=st.floats(0.01, 0.99))
def test_the_bound_holds_as_often_as_it_says(beyond: int, more: int, share: float) -> None:
    """A share beyond the bound would show so few hogels, or fewer, with a chance of at most 5 %."""
    count = beyond + more + 1
    bound = share_at_most(beyond, count)
    if share > bound:
        chance = sum(math.comb(count, k) * share**k * (1 - share) ** (count - k) for k in range(beyond + 1))
        assert chance <= 0.05 + 1e-9


@given(
    columns=st.integers(1, 30),
    rows=st.integers(1, 30),
    hogels=st.integers(1, 80),
    seed=st.integers(0, 99),
)
def test_a_sample_is_seeded_and_spread_and_leaves_out_what_it_must(
    columns: int, rows: int, hogels: int, seed: int
) -> None:
    plate, sample = Plate(size=(1.0, 1.0), hogels=(columns, rows)), RandomSample(hogels=hogels, seed=seed)
    taken = [plate.middle]
    drawn = [one.index for one in sample_hogels(plate, sample, taken)]
    assert drawn == [one.index for one in sample_hogels(plate, sample, taken)]
    assert len(set(drawn)) == len(drawn) == min(hogels, columns * rows - 1)
    assert plate.middle.index not in drawn
    if len(drawn) >= 4 * rows:
        # One of each part of the plate: no row is left out.
        assert {row for _, row in drawn} == set(range(rows))


def test_a_sample_of_nothing_is_refused() -> None:
    for wrong in ({"hogels": 0}, {"seed": -1}):
        with pytest.raises(InputError):
            RandomSample(**wrong)
