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
from xfrustum.compare.eye.limits import (
    EYES_APART_MM,
    STEREO_ACUITY_ARCSEC,
    Viewer,
    display_limits,
)
from xfrustum.scenes import InputError

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


def test_a_gap_as_wide_as_the_limit_is_a_crack_of_one_hogel_at_the_plates_border() -> None:
    found = display_limits(CAR, Viewer(distance=600.0))
    slope = 40.0 / 600.0
    assert 2 * found.near_crack * slope == pytest.approx(80 / 81, rel=1e-12)
    assert found.near == found.near_stereo


def test_explain_tells_the_limits_at_a_distance(capfd: pytest.CaptureFixture[str]) -> None:
    asked = ["explain", "asymmetric", "--viewer=600", "--near"]
    assert main([*asked, "0.2", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)["viewer"]
    assert told["limits"]["viewer"]["distance"] == 600
    assert told["largest_unseen_near"] == min(told["limits"]["near_stereo"], told["limits"]["near_crack"])
    assert not told["seen"]
    assert main([*asked, "0.3"]) == 0
    assert "n = 0.3 mm is seen" in capfd.readouterr().out


def test_lengths_of_eyes_are_not_guessed_where_the_unit_is_not_known() -> None:
    found = display_limits(replace(CAR, units="units"), Viewer(distance=600.0))
    assert (found.near_stereo, found.diffraction_arcmin, found.rays_per_pupil) == (None, None, None)
    assert found.near == found.near_crack
    with pytest.raises(InputError, match="distance"):
        Viewer(distance=-1.0)
