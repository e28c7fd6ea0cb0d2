"""`auto` takes the middle aperture and the worst ones of a scout, and says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.views import view
from xfrustum.compare.scouting.automatic import MAX_AUTO_APERTURES, AutoApertures
from xfrustum.compare.scouting.scout import Look, Scout, scout
from xfrustum.scenes import Plate, Scene

HOGELS = (6, 4)


@pytest.fixture(scope="module")
def scouted() -> Scout:
    """All apertures of a small plate in the middle of the parts on both of its sides."""
    scene: Scene = view("asymmetric", (64, 48))
    return scout(replace(scene, plate=Plate(size=scene.plate.size, hogels=HOGELS)))


def only(scouted: Scout, *looks: Look) -> AutoApertures:
    return AutoApertures.of(replace(scouted, looks=looks))


def test_the_middle_comes_first_and_each_other_one_is_the_worst_in_some_respect(scouted: Scout) -> None:
    auto = AutoApertures.of(scouted)
    assert auto.apertures[0] == scouted.scene.plate.middle
    assert 2 <= len(auto.chosen) <= MAX_AUTO_APERTURES and len(set(auto.apertures)) == len(auto.chosen)
    reasons = {one.aperture: one.why for one in auto.chosen}
    for worst, words in (
        (max(scouted.looks, key=lambda look: look.pixels_per_near), "largest displacement"),
        (min(scouted.looks, key=lambda look: look.nearest), "surface nearest to the plate"),
        (max(scouted.looks, key=lambda look: look.outline_widths), "longest outlines"),
    ):
        assert words in reasons[worst.aperture]
        assert f"nearest visible |z| {worst.nearest:.2g}" in reasons[worst.aperture]


def test_the_near_from_which_on_the_worst_is_displaced_too_much_is_told(scouted: Scout) -> None:
    worst = max(scouted.looks, key=lambda look: look.pixels_per_near)
    told = next(one.why for one in AutoApertures.of(scouted).chosen if one.aperture == worst.aperture)
    near = float(told.split("from near ")[1].split()[0])
    assert near == pytest.approx(0.5 / worst.pixels_per_near, rel=0.05)


def test_a_middle_that_sees_nothing_is_left_out_unless_nothing_is_seen_at_all(scouted: Scout) -> None:
    middle = scouted.scene.plate.middle
    dark = [
        replace(look, height=np.full_like(look.height, np.nan)) if look.aperture == middle else look
        for look in scouted.looks
    ]
    assert middle not in only(scouted, *dark).apertures
    assert only(scouted, *(look for look in dark if look.aperture == middle)).apertures == (middle,)


def test_an_aperture_that_a_surface_passes_through_is_taken_only_where_there_is_no_other(
    scouted: Scout,
) -> None:
    first, *others = scouted.looks
    blocked = replace(first, height=np.zeros_like(first.height))
    auto = only(scouted, blocked, *others)
    assert auto.blocked == 1 and blocked.aperture not in auto.apertures
    assert only(scouted, blocked).apertures == (blocked.aperture,)


def test_where_all_apertures_see_alike_the_middle_is_enough(scouted: Scout) -> None:
    seen = scouted.looks[0]
    alike = [replace(look, height=seen.height, outline_widths=seen.outline_widths) for look in scouted.looks]
    assert only(scouted, *alike).apertures == (scouted.scene.plate.middle,)
