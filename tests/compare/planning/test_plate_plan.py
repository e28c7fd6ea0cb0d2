"""Plans for a whole plate hold at hogels that the scan missed; samples bound the others."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.plate_plans import SHAPES, opened, try_plan
from tests.support.commands import Command
from tests.support.lit import ball, card, lit
from tests.support.long_tail import thinned
from tests.support.scene_file import film, part
from tests.support.views import view
from xfrustum.compare.comparison import compare_images
from xfrustum.compare.planning import plan as plate_plan
from xfrustum.compare.planning.plan import Cause, Plan, PlatePlanner
from xfrustum.compare.planning.requirement import Requirement
from xfrustum.compare.planning.search import hogel_limits
from xfrustum.compare.planning.views import Views, hogel_results
from xfrustum.compare.run import Evaluator
from xfrustum.compare.sampling import CONFIDENCE, RandomSample, share_at_most
from xfrustum.compare.scout import PlateScan, scout
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    Aperture,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    Plate,
    Scene,
    SceneObject,
)
from xfrustum.scenes.appearance import Material
from xfrustum.scenes.library import builtin

FINE = "--depth=d32f --mapping=reversed"
"""Depth buffer that resolves all surfaces here: the tests concern near offsets."""

REVERSED = ((DepthFormat.D32F, DepthMapping.REVERSED),)
HOGELS = (5, 4)
OVER = (3, 1)
"""Aperture over a small ball; all others see it from the side, and a wall far behind it."""


@pytest.fixture(scope="module")
def near_ball() -> Scene:
    """Return a wall 40 behind the plate, and a ball 0.02 behind the plate below one aperture."""
    plate = Plate(size=(90.0, 70.0), hogels=HOGELS)
    over = plate.aperture(*OVER)
    parts = (
        ball((over.x, over.y, -0.02 - 1.0), 1.0, "paint", 3),
        card((0.0, 0.0, -40.0), (500.0, 500.0)),
    )
    frustum = Frustum(
        resolution=(32, 24), fov=(math.radians(50), math.radians(40)), reach=(50.0, 50.0)
    )
    return replace(lit(*parts, frustum=frustum, paint=Material()), plate=plate)


def planner(scene: Scene, scouted: PlateScan) -> PlatePlanner:
    requirement = Requirement(choices=REVERSED)
    return PlatePlanner(reference=Reference(scene), scan=scouted, requirement=requirement)


def displaced(made: Plan, scene: Scene) -> float:
    """Return the 99th percentile of displacement for a plan, measured over the ball."""
    reference, aperture = Reference(scene), scene.plate.aperture(*OVER)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(aperture, made.settings)
    return compare_images(reference.trace(aperture), drawn, reference).displacement_px.p99


@pytest.fixture(scope="module")
def scouted(near_ball: Scene) -> PlateScan:
    return scout(near_ball)


@pytest.fixture(scope="module")
def blind(scouted: PlateScan) -> PlateScan:
    """Return the scan without its view from the aperture over the ball."""
    return replace(
        scouted, looks=tuple(look for look in scouted.looks if look.aperture.index != OVER)
    )


def test_a_plan_of_the_plate_holds_at_its_worst_hogel(near_ball: Scene, scouted: PlateScan) -> None:
    """A sample may look good by chance: each of three bounds has confidence CONFIDENCE^(1/3)."""
    made = planner(near_ball, scouted).plan(RandomSample(hogels=5))
    assert made.within and made.plate is not None
    assert made.plate.worst is not None and made.plate.worst.aperture.index == OVER
    assert displaced(made, near_ball) <= 0.5
    # The bound concerns hogels that were not chosen.
    hogels, chosen = made.plate.hogels, made.plate.measured - made.plate.sampled
    expected = share_at_most(0, 5, CONFIDENCE ** (1 / 3)) * (hogels - chosen) / hogels
    assert made.plate.share_beyond_at_most == pytest.approx(expected)


@pytest.mark.slow
def test_a_hogel_of_the_sample_that_disproves_a_plan_joins(
    near_ball: Scene, blind: PlateScan
) -> None:
    """The sample of all hogels includes a surface that the scan missed: the next plan holds."""
    hogels = math.prod(HOGELS)
    made = planner(near_ball, blind).plan(RandomSample(hogels=hogels))
    assert made.within and made.plate is not None
    assert made.plate.measured == made.plate.hogels == hogels
    assert (made.plate.share_beyond_at_most, made.plate.confidence) == (0.0, 1.0)
    assert displaced(made, near_ball) <= 0.5


def tilted(aperture: Aperture) -> SceneObject:
    """Return a small square through an aperture, which no near offset draws there."""
    square = np.array([(-0.5, -0.4, -0.3), (0.5, -0.4, -0.3), (0.5, 0.4, 0.3), (-0.5, 0.4, 0.3)])
    corners = square + np.array([aperture.x, aperture.y, 0.0])
    return SceneObject(name="tilted", vertices=corners, faces=np.array([(0, 1, 2), (0, 2, 3)]))


def test_a_hogel_without_any_near_stays_infeasible_in_later_samples(
    near_ball: Scene, blind: PlateScan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first sample has this hogel and one that joins the plan; the second has neither."""
    lost, over, other = (near_ball.plate.aperture(*index) for index in ((1, 1), OVER, (0, 0)))
    samples = iter([[lost, over], [other]])
    monkeypatch.setattr(plate_plan, "sample_hogels", lambda *_: next(samples))
    unaware = replace(blind, looks=tuple(look for look in blind.looks if look.aperture != lost))
    scene = replace(near_ball, objects=(*near_ball.objects, tilted(lost)))
    made = planner(scene, unaware).plan(RandomSample(hogels=2))
    assert made.near is not None and not made.within and made.plate is not None
    assert made.plate.infeasible_apertures == ((1, 1),)
    assert (made.plate.sampled, made.plate.beyond) == (1, 0)


@pytest.mark.parametrize(("columns", "share"), [((1,), 1 / 3), ((0, 1, 2), 1.0)])
def test_apertures_in_a_surface_that_the_scan_missed_are_left_out(
    columns: tuple[int, ...], share: float
) -> None:
    """Each film shows a slit between two walls, but no line of the coarse films enters it."""
    half = 2 * math.atan(0.6)
    # At the walls, pixels are 0.25 wide, with centers at 0.125; lines of the scan pass at 0.5.
    frustum = Frustum(resolution=(96, 96), fov=(half, half), reach=(30.0, 30.0))
    plate = Plate(size=(6.0, 2.0), hogels=(3, 1))
    sides = [card((x + 0.125, 0.0, 20.0), (99.9, 100.0)) for x in (-50.05, 50.05)]
    bodies = [tilted(plate.aperture(column, 0)) for column in columns]
    scene = replace(lit(*sides, *bodies, frustum=frustum), plate=plate)
    scan = scout(scene)
    assert all(look.nearest > 1 for look in scan.looks)
    made = planner(scene, scan).plan(RandomSample(hogels=3))
    assert made.plate is not None and made.plate.infeasible_apertures == tuple(
        (column, 0) for column in columns
    )
    assert made.plate.share_beyond_at_most == pytest.approx(share)
    assert (made.cause is Cause.EVERY_APERTURE) == (made.near is None) == (len(columns) == 3)


def test_errors_of_depth_and_of_displacement_are_distinguished(near_ball: Scene) -> None:
    """A large near displaces surfaces but orders them; a tiny one with few bits does neither."""
    over = [near_ball.plate.aperture(*OVER)]
    with Evaluator(near_ball) as judge:
        (bent,) = hogel_results(judge, over, DoubleFrustum(near=5.0, depth=DepthFormat.D32F))
        (starved,) = hogel_results(judge, over, DoubleFrustum(near=1e-7, depth=DepthFormat.D16))
    assert bent.surface_fraction > 0.01 > bent.depth_wrong
    assert starved.depth_wrong == pytest.approx(starved.surface_fraction)
    assert starved.depth_wrong > 0.01
    assert Requirement().missed_by(bent) and Requirement().missed_by(starved)


@pytest.mark.slow
def test_a_plate_whose_middle_sees_nothing_is_planned(tmp_path: Path, command: Command) -> None:
    text = film(
        (90.0, 20.0), hogels=(9, 3), resolution=(32, 24), fov_deg=(20.0, 20.0), reach=(50.0, 50.0)
    )
    scene = tmp_path / "aside.toml"
    scene.write_text(text + part("box", 10.0, (40.0, 0.0, -20.0)))
    assert command(f"plan {scene} --sample=3 {FINE} --json --quiet").record["within"] is True
    command(f"plan {scene} --aperture 4,1 --quiet", status=2)


def test_apertures_in_a_surface_are_infeasible_and_the_plan_holds_for_the_others(
    tmp_path: Path, command: Command
) -> None:
    """A tilted square passes through two of a row of four hogels, or through all of them."""
    row = film(
        (40.0, 5.0), hogels=(4, 1), resolution=(16, 12), fov_deg=(60.0, 45.0), reach=(60.0, 60.0)
    )
    box, file, made = part("box", 10.0, (8.0, 0.0, -30.0)), tmp_path / "crossed.toml", []
    for size in (20.0, 100.0):
        square = part("square", size, (-10.5, 0.0, 0.0), rotate_deg=[30.0, 0.0, 0.0])
        file.write_text(row + square + box)
        made.append(command(f"plan {file} --sample=4 {FINE} --json --quiet").record)
    two, none = made
    plate = two["plate"]
    assert two["near"] is not None and not two["within"]
    # Apertures over the square, from -20.5 to -0.5, in the order of columns
    assert plate["infeasible_apertures"] == [[0, 0], [1, 0]]
    assert plate["infeasible"] == 2 == plate["measured"] and plate["confidence"] == 1.0
    assert plate["share_within_at_least"] == 0.5 == plate["share_beyond_at_most"]
    assert "at 2 of the 4 scanned apertures (0,0; 1,0)" in two["sentence"]
    assert none["near"] is None and "every aperture" in none["reason"]
    assert none["plate"]["infeasible"] == 4 and none["plate"]["share_within_at_least"] == 0.0
    assert none["command"] is None and none["binds"] == "pixels"


def test_errors_at_outlines_are_scouted_to_a_factor_of_two() -> None:
    whole = view("asymmetric", (96, 72))
    scene = replace(whole, plate=replace(whole.plate, hogels=(9, 7)))
    settings, scouted = DoubleFrustum(near=0.4), scout(scene)
    shares = scouted.wrong_shares(settings)
    for number in np.argsort(shares)[::-20]:
        views = Views.traced(Reference(scene), [scouted.apertures[number]])
        _, wrong = views.traced_errors(settings)
        assert wrong / 2 < shares[number] < 2 * wrong


def test_the_largest_near_of_a_hogel_keeps_the_tolerance_and_the_next_one_does_not(
    scouted: PlateScan,
) -> None:
    limits, known = hogel_limits(scouted, 0.5), 0
    for look, near in zip(scouted.looks, limits, strict=True):
        if near > 0:
            known += 1
            assert look.displacement_p99_px(DoubleFrustum(near=near), scouted.scene) <= 0.5
            assert look.displacement_p99_px(DoubleFrustum(near=1.01 * near), scouted.scene) > 0.5
    assert known > len(limits) / 2
    # Displacement is nearly linear in a small near: twice the tolerance needs about twice the near.
    twice = hogel_limits(scouted, 1.0)[limits > 0] / limits[limits > 0]
    assert np.all(twice > 1.9) and np.all(twice < 2.6)


# Surveys confirm plans

SURVEYED = [(name, 0.5) for name in (*SHAPES, *builtin.names())]
"""Scenes with the tolerances of their plans."""


@pytest.mark.parametrize(
    ("name", "tolerance_px"), thinned([*SURVEYED, ("bunny-transfer", 2.0)], len(SURVEYED) + 1)
)
def test_a_survey_confirms_the_promises_of_a_plan(name: str, tolerance_px: float) -> None:
    trial = try_plan(opened(name, 96), 40, Requirement(tolerance_px=tolerance_px))
    if trial.survey is None:
        assert trial.reason.startswith("No plan")
        return
    assert trial.plan is not None and trial.kept
    assert not (trial.plan.within and trial.survey.beyond)
