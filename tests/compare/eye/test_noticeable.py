"""Closed forms of noticeable effects, compared with points replayed aperture by aperture."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.commands import Command
from tests.support.moved_scene import replayed_points
from tests.support.views import view
from xfrustum.compare.eye_loss import ARCMIN_PER_RADIAN
from xfrustum.compare.noticeable import (
    ARCSEC_PER_RADIAN,
    EYES_APART_MM,
    Content,
    Display,
    Viewer,
    crack_arcmin,
    disparity_changes,
    display_limits,
    resolved_crack,
    resolved_separation,
    runs_through_plate,
    scene_length,
    stereo_change_arcsec,
)
from xfrustum.compare.planning.requirement import CRACK
from xfrustum.reports.scene_check.effects import viewer_record
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Pivot, Scene
from xfrustum.scenes.arrays import Floats

SCENES = {name: view(name, (64, 48)) for name in ("car", "asymmetric-recentered", "car-recentered")}

FULL_REACH = Content(before=(0.0, 150.0), behind=(0.0, 150.0), through=True)


def slope_seen(
    scene: Scene, settings: DoubleFrustum, point: Floats, eye: tuple[float, float]
) -> float:
    """Return the slope along x from an eye (x, height) to a replayed point, found by iteration."""
    side = 1 if point[2] <= 0 else -1
    x = 0.0
    for _ in range(200):
        # Fixed-point iteration: the eye sees the replayed point through the aperture that replays
        # it.
        aperture = Aperture(column=0, row=0, x=x, y=0.0)
        (moved,) = replayed_points(point[None], scene.frustum, aperture, settings, side)
        x = eye[0] + (moved[0] - eye[0]) * eye[1] / (eye[1] - moved[2])
    return (x - eye[0]) / eye[1]


@given(
    name=st.sampled_from(sorted(SCENES)),
    near=st.floats(0.01, 5.0),
    height=st.floats(-140.0, 140.0).filter(lambda z: abs(z) > 1e-3),
    distance=st.floats(250.0, 2000.0),
    pivot=st.sampled_from(Pivot),
    fit=st.sampled_from([None, 40.0]),
)
def test_disparity_changes_as_two_eyes_see_replayed_points(
    name: str, near: float, height: float, distance: float, pivot: Pivot, fit: float | None
) -> None:
    scene, viewer = SCENES[name], Viewer(distance=distance)
    settings = DoubleFrustum(near=near, pivot=pivot, fit=fit)
    point = np.array([3.0, 0.0, height])
    half = EYES_APART_MM / 2
    left, right = (slope_seen(scene, settings, point, (x, distance)) for x in (-half, half))
    change = left - right - EYES_APART_MM / (distance - height)
    result = disparity_changes(np.array([height]), viewer, Display.from_scene(scene), settings)
    assert result[0] == pytest.approx(change * ARCSEC_PER_RADIAN, abs=1e-6, rel=1e-6)


@given(st.floats(0.01, 5.0), st.floats(160.0, 5000.0))
def test_the_gap_changes_disparity_as_its_two_halves_do_and_nearer_surfaces_change_more(
    near: float, distance: float
) -> None:
    viewer, display = Viewer(distance=distance), Display.from_scene(SCENES["car"])
    at_plate = Content(before=(0.0, 0.0), behind=(0.0, 0.0), through=True)
    settings = DoubleFrustum(near=near)
    change = stereo_change_arcsec(at_plate, viewer, display, settings)
    halves = EYES_APART_MM / (distance - near) - EYES_APART_MM / (distance + near)
    assert change == pytest.approx(halves * ARCSEC_PER_RADIAN, rel=1e-7)
    assert stereo_change_arcsec(FULL_REACH, viewer, display, settings) > change


@given(st.floats(0.001, 20.0), st.floats(200.0, 2000.0), st.sampled_from(Pivot))
def test_a_crack_spans_the_gap_between_the_halves_seen_through_corners(
    near: float, distance: float, pivot: Pivot
) -> None:
    scene, settings = SCENES["car-recentered"], DoubleFrustum(near=near, pivot=pivot)
    widths = []
    for corner in ((x, y) for x in (-20.0, 20.0) for y in (-15.0, 15.0)):
        aperture = Aperture(column=0, row=0, x=corner[0], y=corner[1])
        point = np.array([[*corner, 0.0]])
        ends = []
        for side in (1, -1):
            (moved,) = replayed_points(point, scene.frustum, aperture, settings, side)
            # At the height of the moved end, the ray from the eye through the corner passes it.
            ends.append(moved[:2] - np.array(corner) * (distance - moved[2]) / distance)
        widths.append(float(np.linalg.norm(ends[0] - ends[1])) / distance * ARCMIN_PER_RADIAN)
    result = crack_arcmin(Viewer(distance=distance), Display.from_scene(scene), settings)
    assert result == pytest.approx(max(widths), rel=1e-9)


def test_the_coarsest_of_eye_pitch_pixel_and_diffraction_hides_a_crack() -> None:
    display, viewer = Display.from_scene(SCENES["car"]), Viewer(distance=600.0)
    fine = replace(display, pitch=0.05, diffraction=0.0)
    pitch = display_limits(SCENES["car"], viewer).pitch_arcmin
    for item, mask in (
        (display, ("pitch", pitch)),
        (fine, ("acuity", 1.0)),
        (replace(fine, pixel=0.5), ("pixel", pytest.approx(2.87, rel=0.01))),
    ):
        assert resolved_crack(viewer, item, DoubleFrustum(near=1.0))[:2] == mask


@given(st.floats(-140.0, 140.0), st.floats(300.0, 3000.0))
def test_just_distinguishable_depths_differ_by_the_stereo_acuity(
    height: float, distance: float
) -> None:
    display, viewer = Display.from_scene(SCENES["car"]), Viewer(distance=distance)
    name, separation = resolved_separation(
        height, viewer, replace(display, pitch=1e-6, pixel=1e-9, diffraction=0)
    )
    assert name == "stereo acuity"
    near, far = distance - height, distance - height + separation
    assert (65 / near - 65 / far) * ARCSEC_PER_RADIAN == pytest.approx(20.0, rel=1e-6)


def test_surfaces_through_the_plate_are_those_within_its_border() -> None:
    through = [runs_through_plate(view(name, (64, 48))) for name in ("car", "car-transfer")]
    assert through == [True, False]


# Limits of a display at a viewing distance, and their table in `check`


@given(st.floats(160, 5000))
def test_at_the_ends_of_the_depth_of_field_pixels_span_the_visual_acuity(
    distance: float,
) -> None:
    result = display_limits(SCENES["car"], Viewer(distance=distance))
    finest = max(result.pitch_arcmin, 1.0)
    before = result.pixel_arcmin * result.before / (distance - result.before)
    assert before == pytest.approx(finest, rel=1e-12)
    if math.isfinite(result.behind):
        behind = result.pixel_arcmin * result.behind / (distance + result.behind)
        assert behind == pytest.approx(finest, rel=1e-9)
    else:
        assert result.pixel_arcmin <= finest


def test_check_lists_the_limits_at_a_distance(command: Command) -> None:
    record = command("check asymmetric --viewer=600 --near 0.2 --json").record["viewer"]
    assert record["limits"]["viewer"]["distance"] == 600
    assert record["largest_unseen_near"] == 0.232
    assert not record["seen"]


def test_lengths_of_eyes_are_not_guessed_where_the_unit_is_not_known() -> None:
    scene = replace(SCENES["car"], units="units")
    limits = display_limits(scene, Viewer(distance=600.0))
    assert limits.diffraction_arcmin is limits.rays_per_pupil is None
    record = viewer_record(scene, 600.0, DoubleFrustum(near=1.0))
    assert record["stereo_change_arcsec"] is None
    assert [item.name for item in record["near_limits"]] == [CRACK]
    assert scene_length((1.0, "m"), SCENES["car"]) == 1000 * scene_length((1.0, None), scene)
    with pytest.raises(InputError, match="how long"):
        scene_length((1.0, "mm"), scene)
    with pytest.raises(InputError, match="distance"):
        Viewer(distance=-1.0)
