"""The limits of a display at a distance, against their definitions."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.views import view
from xfrustum.cli.main import main
from xfrustum.compare.eye.noticeable import (
    EYES_APART_MM,
    STEREO_ACUITY_ARCSEC,
    Display,
    Viewer,
    crack_arcmin,
    display_limits,
    resolved_crack,
    stereo_change_arcsec,
    surface_content,
)
from xfrustum.compare.planning.viewer import CRACK, seen_content
from xfrustum.compare.scout import scout
from xfrustum.reports.explain import viewer_record
from xfrustum.scenes import DoubleFrustum, InputError

CAR = view("car", (192, 192))
ARCSEC = math.radians(1 / 3600)


@given(st.floats(100, 5000))
def test_the_near_offset_that_is_not_seen_changes_disparity_by_the_stereo_acuity(distance: float) -> None:
    near = display_limits(CAR, Viewer(distance=distance)).near_stereo
    assert near is not None
    change = EYES_APART_MM / (distance - near) - EYES_APART_MM / (distance + near)
    # Two quotients near 65 / 100 are subtracted: twenty roundings of them.
    assert change == pytest.approx(STEREO_ACUITY_ARCSEC * ARCSEC, abs=1e-14)


@given(st.floats(160, 5000))
def test_at_the_ends_of_the_depth_of_field_pixels_look_as_large_as_what_can_be_told_apart(
    distance: float,
) -> None:
    found = display_limits(CAR, Viewer(distance=distance))
    finest = max(found.pitch_arcmin, 1.0)
    before = found.pixel_arcmin * found.before / (distance - found.before)
    assert before == pytest.approx(finest, rel=1e-12)
    if math.isfinite(found.behind):
        behind = found.pixel_arcmin * found.behind / (distance + found.behind)
        assert behind == pytest.approx(finest, rel=1e-9)
    else:
        assert found.pixel_arcmin <= finest


def test_a_gap_as_wide_as_the_limit_is_a_crack_of_one_hogel_at_the_plates_corners() -> None:
    found = display_limits(CAR, Viewer(distance=600.0))
    slope = math.hypot(40.0, 30.0) / 600.0
    assert 2 * found.near_crack * slope == pytest.approx(80 / 81, rel=1e-12)
    assert found.near == found.near_stereo


def test_explain_tells_the_limits_at_a_distance(capfd: pytest.CaptureFixture[str]) -> None:
    asked = ["explain", "asymmetric", "--viewer=600", "--near"]
    assert main([*asked, "0.2", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)["viewer"]
    assert told["limits"]["viewer"]["distance"] == 600
    # What stands before the plate is seen to change more than what lies at it.
    assert told["largest_unseen_near"] == 0.232
    assert told["largest_unseen_near"] < min(told["limits"]["near_stereo"], told["limits"]["near_crack"])
    assert not told["seen"]
    assert main([*asked, "0.3"]) == 0
    assert "n = 0.3 mm is seen" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("name", "distance", "near"),
    [("asymmetric", 300.0, 0.06), ("car-recentered", 1200.0, 1.0), ("asymmetric", 300.0, 0.045)],
)
def test_explain_and_the_study_agree_on_what_is_seen(name: str, distance: float, near: float) -> None:
    scene, settings = view(name, (64, 48)), DoubleFrustum(near=near)
    record = viewer_record(scene, distance, settings)
    viewer, display = Viewer(distance=distance), Display.of(scene)
    change = stereo_change_arcsec(surface_content(scene), viewer, display, settings)
    _, hidden, crack = resolved_crack(viewer, display, settings)
    assert (record["stereo_change_arcsec"], record["crack_arcmin"]) == (change, crack)
    assert record["seen"] == (change > STEREO_ACUITY_ARCSEC or crack > hidden) == (near != 0.045)
    assert record["seen"] == (near > record["largest_unseen_near"])


@pytest.mark.slow
def test_all_surfaces_stand_for_what_a_scout_sees() -> None:
    scene = view("asymmetric", (192, 192))
    seen, everything = seen_content(scout(scene)), surface_content(scene)
    assert seen.before is not None and everything.before is not None
    assert seen.behind is not None and everything.behind is not None
    assert everything.before[0] <= seen.before[0] and seen.before[1] <= everything.before[1]
    # The ends of what is seen are those of the scene but for the lattice of the scout's lines.
    assert everything.before[1] == pytest.approx(seen.before[1], rel=0.01)


def test_a_crack_is_seen_sooner_with_shear() -> None:
    sheared, plain = (view(name, (64, 48)) for name in ("car-recentered", "car"))
    viewer = Viewer(distance=1200.0)
    limit = display_limits(sheared, viewer).near_crack
    display = Display.of(sheared)
    width = crack_arcmin(viewer, display, DoubleFrustum(near=limit))
    assert width == pytest.approx(max(display_limits(sheared, viewer).pitch_arcmin, 1.0), rel=1e-9)
    assert limit < display_limits(plain, viewer).near_crack


def test_lengths_of_eyes_are_not_guessed_where_the_unit_is_not_known() -> None:
    found = display_limits(replace(CAR, units="units"), Viewer(distance=600.0))
    assert (found.near_stereo, found.diffraction_arcmin, found.rays_per_pupil) == (None, None, None)
    assert found.near == found.near_crack
    record = viewer_record(replace(CAR, units="units"), 600.0, DoubleFrustum(near=1.0))
    assert record["stereo_change_arcsec"] is None
    assert [one.name for one in record["near_limits"]] == [CRACK]
    with pytest.raises(InputError, match="distance"):
        Viewer(distance=-1.0)
