"""Plans to what eyes see: near is as large as nobody notices, whatever hogels' pixels show."""

import json
from dataclasses import replace
from typing import Any

import pytest

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.compare.eye.noticeable import (
    Content,
    Display,
    Viewer,
    replay_noise_arcsec,
    stereo_change_arcsec,
)
from xfrustum.compare.planning.plan import Plan, plan
from xfrustum.compare.planning.viewer import CRACK, STEREO, ViewerRequirement, binding, view_zone
from xfrustum.compare.planning.views import Errors, Quality, Requirement
from xfrustum.compare.sampling import RandomSample
from xfrustum.reports.planning import (
    PlannedRecord,
    Replayed,
    exceeded,
    make_viewer_plan,
    planned_table,
    replayed_plan,
    scouted_plate,
    seen_view_zone,
    table,
)
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, InputError, Scene, open_scene


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("scene") / "through.toml"
    size = film(
        (40.0, 30.0), hogels=(8, 6), resolution=(48, 36), fov_deg=(50.0, 40.0), reach=(60.0, 60.0)
    )
    torus, box = part("torus", 24.0, (2.0, 1.0, 0.0)), part("box", 12.0, (-6.0, 1.0, -40.0))
    path.write_text(named("through", "mm") + size + torus + box)
    return str(path)


def requirement(scene: Scene, viewer: Viewer, *, through: bool = True) -> ViewerRequirement:
    content = Content(before=(0.1, 12.0), behind=(0.1, 46.0), through=through)
    return ViewerRequirement(viewer=viewer, display=Display.from_scene(scene), content=content)


def test_the_smallest_limit_binds_and_a_larger_near_is_noticed(scene_file: str) -> None:
    scene = open_scene(scene_file)
    wanted = requirement(scene, Viewer(distance=600.0))
    # Hogels of 5 mm would hide any crack.
    wanted = replace(wanted, display=replace(wanted.display, pitch=0.5))
    stereo, crack = wanted.limits
    assert (stereo.name, crack.name) == (STEREO, CRACK)
    assert binding(wanted.limits) == stereo
    near = stereo.largest_near
    assert near is not None and crack.largest_near is not None and near < crack.largest_near
    assert wanted.by_eyes(DoubleFrustum(near=near)) <= 1
    # Plans have three digits.
    larger = DoubleFrustum(near=near * 1.01)
    assert wanted.by_eyes(larger) > 1
    assert "arc seconds" in wanted.limit_of_near(larger, "mm")


def test_a_plan_keeps_the_noise_of_its_replay_as_a_margin(scene_file: str) -> None:
    bare = requirement(open_scene(scene_file), Viewer(distance=600.0), through=False)
    wanted = replace(bare, eye_pixel=0.2)
    near = binding(wanted.limits).largest_near
    assert near == binding(bare.limits).largest_near
    settings = DoubleFrustum(near=near)
    noise = replay_noise_arcsec(wanted.content, wanted.viewer, wanted.display, settings, 0.2)
    acuity = wanted.viewer.stereo_acuity_arcsec
    assert bare.by_eyes(settings) <= 1 < wanted.by_eyes(settings)
    assert wanted.by_eyes(settings) - bare.by_eyes(settings) == pytest.approx(noise / acuity)
    assert "the noise of a replay" in wanted.limit_of_near(settings, "mm")
    # Change and noise both grow with near: a plan that leaves room for the noise changes less.
    kept = DoubleFrustum(near=near / (1 + noise / acuity))
    assert wanted.by_eyes(kept) <= 1 and wanted.noticed(kept)[STEREO][0] < 0.9 * acuity


def test_eyes_that_see_no_depth_are_left_with_the_crack(scene_file: str) -> None:
    scene = open_scene(scene_file)
    viewer = Viewer(distance=600.0, stereo_acuity_arcsec=1e6)
    fine = replace(
        requirement(scene, viewer), display=replace(Display.from_scene(scene), pitch=0.1)
    )
    binds = binding(fine.limits)
    assert (binds.name, binds.hidden_by) == (CRACK, "acuity")
    assert "crack" in fine.limit_of_near(DoubleFrustum(near=2 * binds.largest_near), "mm")
    # Without a surface at the plate nothing is noticed at any near.
    apart = replace(fine, content=replace(fine.content, through=False))
    assert binding(apart.limits) is None and len(apart.limits) == 1


def test_a_cut_that_is_fitted_leaves_a_smaller_gap(scene_file: str) -> None:
    wanted = requirement(open_scene(scene_file), Viewer(distance=600.0))
    whole, cut = DoubleFrustum(near=2.0), DoubleFrustum(near=2.0, slabs=(6.0,))
    small, large = wanted.noticed(cut), wanted.noticed(whole)
    assert 0 < small[STEREO][0] < large[STEREO][0]
    assert small[CRACK][0] == pytest.approx(large[CRACK][0] * 6 / 8)


def test_where_even_the_smallest_near_is_noticed_none_is_named(scene_file: str) -> None:
    scene = open_scene(scene_file)
    wanted = requirement(scene, Viewer(distance=600.0, stereo_acuity_arcsec=1e-9))
    assert wanted.by_eyes(DoubleFrustum(near=1e-8 * scene.frustum.longest_reach)) > 1
    stereo, crack = wanted.limits
    assert stereo.largest_near == 0.0
    assert crack.largest_near != 0.0
    assert binding(wanted.limits) == stereo
    assert "no near" in planned_table(record_of(wanted), "mm")


def test_limits_are_told_without_cuts_and_with_those_of_the_plan(scene_file: str) -> None:
    wanted = requirement(open_scene(scene_file), Viewer(distance=600.0))
    cut = DoubleFrustum(near=0.2, slabs=(0.4,))
    (without, _), (with_cuts, _) = wanted.limits, wanted.limits_with(cut)
    assert with_cuts.largest_near is None or with_cuts.largest_near > without.largest_near
    told = planned_table(record_of(wanted, limits_with_cuts=wanted.limits_with(cut)), "mm")
    assert "without cuts: change of depth" in told
    assert "with these cuts: change of depth" in told
    assert "with these cuts" not in planned_table(record_of(wanted), "mm")


def record_of(wanted: ViewerRequirement, **changes: Any) -> PlannedRecord:
    return PlannedRecord(
        viewer=wanted.viewer,
        pitch_arcmin=1.0,
        pixel_arcmin=1.0,
        diffraction_arcmin=1.0,
        rays_per_pupil=None,
        limits=wanted.limits,
        binding=STEREO,
        stereo_change_arcsec=20.0,
        crack_arcmin=0.1,
        separation=1.0,
        separation_limited_by="pitch",
        measured=changes.pop("measured", None),
        **changes,
    )


SHOWN = Replayed(
    hogels=48,
    matched=300,
    disparity_change_arcsec=20.4,
    depth=None,
    wrong=0.1,
    depth_wrong=0.0,
    judged=1728,
)


@pytest.mark.parametrize(
    ("shown", "beyond"),
    [
        (SHOWN, ""),
        # 2 of 1,728 pixels are 0.116 %, which is more than 0.1 %.
        (replace(SHOWN, depth_wrong=2 / 1728), "wrong by depth"),
        (replace(SHOWN, depth_wrong=1 / 1728), ""),
        (replace(SHOWN, disparity_change_arcsec=22.0), "arc seconds"),
        (replace(SHOWN, disparity_change_arcsec=None), ""),
    ],
)
def test_a_plan_holds_only_where_its_replay_does(
    scene_file: str, shown: Replayed, beyond: str
) -> None:
    scene = open_scene(scene_file)
    wanted = requirement(scene, Viewer(distance=600.0))
    quality = Quality(
        displacement_p99_px=9.0,
        surface_fraction=0.1,
        depth_wrong=0.0,
        misordered=0.0,
        separation=0.1,
    )
    made = Plan(
        near=0.2,
        slabs=(),
        depth=DepthFormat.D16,
        mapping=DepthMapping.STANDARD,
        predicted=quality,
        measured=quality,
        within=True,
        reason="One pair of frusta is enough.",
    )
    record = record_of(
        wanted, measured=shown, noise_arcsec=1.0, exceeded=exceeded(shown, wanted, noise_arcsec=1.0)
    )
    judged = replayed_plan(made, record)
    told = table(judged, scene, [scene.plate.middle], wanted, record.exceeded)
    assert judged.within == (not beyond)
    assert (beyond in judged.reason) and ("DOES NOT HOLD" in told) == bool(beyond)
    assert ("The plan holds, replayed to two eyes" in told) == (not beyond)
    assert f"{shown.judged:,} pixels" in planned_table(record, "mm")


@pytest.mark.slow
def test_a_plan_whose_replay_shows_too_much_wrong_by_depth_does_not_hold() -> None:
    car = open_scene("car")
    scene = replace(
        car,
        plate=replace(car.plate, hogels=(16, 12)),
        frustum=replace(car.frustum, resolution=(48, 48)),
    )
    choices = [(DepthFormat.D16, DepthMapping.STANDARD)]
    viewer, sample = Viewer(distance=40.0), RandomSample(hogels=4)
    seen = make_viewer_plan(
        scouted_plate(scene, False), viewer, Requirement(), choices, sample=sample
    )
    assert seen.record.measured.depth_wrong > seen.requirement.max_wrong
    assert not seen.plan.within
    assert (
        "But replayed it does not hold" in seen.plan.reason and "wrong by depth" in seen.plan.reason
    )


@pytest.mark.slow
def test_a_plan_for_eyes_takes_the_largest_near_that_is_not_noticed_and_replays_it(
    scene_file: str, capfd: pytest.CaptureFixture[str]
) -> None:
    asked = [
        "plan",
        scene_file,
        "--viewer=60cm",
        "--sample=4",
        "--depth=d32f",
        "--mapping=reversed",
    ]
    assert main([*asked, "--json", "--quiet"]) == 0
    made = json.loads(capfd.readouterr().out)
    seen = made["viewer"]
    assert made["within"] and not made["slabs"]
    assert made["plate"]["infeasible"] == 0
    assert seen["viewer"]["distance"] == 600
    assert seen["binding"] == STEREO
    # Near stays below the largest by the noise of a replay, so that the replay finds at most the
    # threshold. Eight columns of hogels show few points: each is seen through hogels up to half a
    # pitch beside it.
    assert made["near"] == pytest.approx(seen["limits"][0]["largest_near"], rel=0.25)
    assert 15 < seen["stereo_change_arcsec"] < 20
    assert 14 < seen["measured"]["disparity_change_arcsec"] <= 20
    assert seen["measured"]["depth_wrong"] == 0
    # Where the torus meets the plate, hogels' pixels are far from right.
    assert made["measured"]["displacement_p99_px"] > 0.5


def test_the_border_of_the_plate_counts_where_one_side_alone_is_seen(scene_file: str) -> None:
    scene = open_scene(scene_file)
    behind = Content(before=None, behind=(20.0, 46.0), through=False)
    viewer, settings = Viewer(distance=600.0), DoubleFrustum(near=1.0)
    change = stereo_change_arcsec(behind, viewer, Display.from_scene(scene), settings)
    farther = 65 / (600 + 20) - 65 / (600 + 21)
    assert change == pytest.approx(farther * 206264.806, rel=1e-6)


# The view zone
# -------------------------------------------------------------------------------------------

PROJECTED = """
name = "zone"
units = "mm"
[plate]
size = [80.0, 60.0]
hogels = [20, 15]
[frustum]
resolution = [64, 64]
screen = { height = 600.0, center = [0.0, 0.0], size = [60.0, 60.0] }
reach = [100.0, 100.0]
"""
"""A plate whose screen, 60 mm wide, stands in the view zone."""


@pytest.fixture(scope="module")
def projected(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    path = tmp_path_factory.mktemp("zone") / "zone.toml"
    path.write_text(PROJECTED + part("sphere", 40.0, (0.0, 0.0, -40.0)))
    return open_scene(path)


@pytest.mark.parametrize(
    ("distance", "some", "every"),
    [
        # In the plane of the screen every film sends its rays through the screen.
        (600.0, 60.0, 60.0),
        # Nearer by a third: films of 40 mm, whose middles follow 76 mm of apertures by a third.
        (400.0, 40.0 + 76.0 / 3, 40.0 - 76.0 / 3),
        # Twice as far: films of 120 mm, whose middles go the other way, as far as the apertures.
        (1200.0, 120.0 + 76.0, 120.0 - 76.0),
    ],
)
def test_the_view_zone_is_the_screen_and_spreads_away_from_it(
    projected: Scene, distance: float, some: float, every: float
) -> None:
    zone = view_zone(projected, distance)
    assert zone.some_eyes_apart == pytest.approx(some) and zone.all_eyes_apart == pytest.approx(
        every
    )
    assert zone.every is not None and zone.every[0][1] == pytest.approx(every / 2)


def test_sheets_that_alone_ask_for_cuts_are_said_to(projected: Scene) -> None:
    """D16 orders sheets 0.05 mm apart only with a cut; what the scene shows needs none."""
    asked, choices = Requirement(separation=0.05), [(DepthFormat.D16, DepthMapping.STANDARD)]
    chosen = [projected.plate.middle]
    made = plan(projected, chosen, asked, choices)
    found = made.without_cuts
    assert (
        made.slabs
        and found is not None
        and not found.slabs
        and (found.judged, found.beyond) == (1, 0)
    )
    told = " ".join(table(made, projected, chosen, asked).split())
    assert "Hypothetical sheets alone ask for cuts" in told
    assert "the one hogel that was measured is not beyond" in told


def test_beyond_means_the_same_in_a_plan_for_eyes(projected: Scene) -> None:
    """A hogel that eyes do not mind is beyond the usual tolerance all the same."""
    wanted, pixels = requirement(projected, Viewer(distance=600.0)), Requirement(tolerance_px=2.0)
    moved = Errors(displacement_p99_px=1.1, surface_fraction=0.002, depth_wrong=0.0)
    assert moved.beyond(wanted.beyond_px) and not wanted.missed_by(moved)
    assert not moved.beyond(pixels.beyond_px)
    assert pixels.worst_measure(moved) == "displacement_p99_px"
    assert pixels.worst_measure(replace(moved, surface_fraction=0.02)) == "surface_fraction"
    assert pixels.worst_measure(replace(moved, depth_wrong=0.02)) == "depth_wrong"
    assert wanted.worst_measure(moved) == "surface_fraction"


def test_eyes_outside_the_view_zone_are_refused_by_name(projected: Scene) -> None:
    """Eyes 59 mm apart see hogels; beyond half a pitch more none, and neither does one eye of two."""
    assert seen_view_zone(projected, Viewer(distance=600.0, eyes_apart_mm=59.0)).every is not None
    for scene in (projected, aside(projected, (5.0, 0.0))):
        with pytest.raises(
            InputError, match=r"view zone is 60 x 60 mm at 600 mm .*eyes may be up to"
        ):
            seen_view_zone(scene, Viewer(distance=600.0, eyes_apart_mm=65.0))
    with pytest.raises(InputError, match="no eyes straight before the plate's middle"):
        seen_view_zone(aside(projected, (0.0, 33.0)), Viewer(distance=600.0))


def aside(scene: Scene, center: tuple[float, float]) -> Scene:
    """Return a scene with its screen elsewhere."""
    assert scene.frustum.screen is not None
    screen = replace(scene.frustum.screen, center=center)
    return replace(scene, frustum=replace(scene.frustum, screen=screen))


def test_plan_and_recommend_exit_with_2_outside_the_view_zone(
    projected: Scene, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "zone.toml"
    path.write_text(PROJECTED + part("sphere", 40.0, (0.0, 0.0, -40.0)))
    for verb in ("plan", "recommend"):
        assert main([verb, str(path), "--viewer=600mm", "--quiet"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert (
            "view zone is 60 x 60 mm at 600 mm" in line
            and "up to 60 mm apart, and these are 65" in line
        )
