"""Plans for a viewer's eyes: the largest near offset that stays unnoticed, and the view zone."""

from dataclasses import replace

import pytest

from tests.support.commands import Command
from tests.support.worlds import World
from xfrustum.compare.noticeable import Content, Display, Viewer, stereo_change_arcsec
from xfrustum.compare.planning.requirement import (
    CRACK,
    STEREO,
    Errors,
    Requirement,
    ViewerRequirement,
    binding,
    view_zone,
)
from xfrustum.reports.planning import seen_view_zone
from xfrustum.scenes import DoubleFrustum, InputError, Plate, Scene, Screen


def requirement(scene: Scene, viewer: Viewer) -> ViewerRequirement:
    content = Content(before=(0.1, 12.0), behind=(0.1, 46.0), through=True)
    return ViewerRequirement(viewer=viewer, display=Display.from_scene(scene), content=content)


def test_the_smallest_limit_binds_and_a_larger_near_is_noticed(tiny: World) -> None:
    required = requirement(tiny.scene, Viewer(distance=600.0))
    # The pitch of the hogels, 8 mm, would hide any crack.
    required = replace(required, display=replace(required.display, pitch=0.5))
    stereo, crack = required.limits()
    assert (stereo.name, crack.name) == (STEREO, CRACK)
    assert binding(required.limits()) == stereo
    near = stereo.largest_near
    assert near is not None and crack.largest_near is not None and near < crack.largest_near
    assert required.excess(DoubleFrustum(near=near)) <= 1
    # Plans round lengths to three digits.
    assert required.excess(DoubleFrustum(near=near * 1.01)) > 1


def test_eyes_that_see_no_depth_are_left_with_the_crack(tiny: World) -> None:
    required = requirement(tiny.scene, Viewer(distance=600.0, stereo_acuity_arcsec=1e6))
    fine = replace(required, display=replace(required.display, pitch=0.1))
    binds = binding(fine.limits())
    assert (binds.name, binds.hidden_by) == (CRACK, "acuity")
    # Without a surface at the plate, no near offset has a noticeable effect.
    apart = replace(fine, content=replace(fine.content, through=False))
    assert binding(apart.limits()) is None and len(apart.limits()) == 1


def test_a_cut_that_is_fitted_leaves_a_smaller_gap(tiny: World) -> None:
    required = requirement(tiny.scene, Viewer(distance=600.0))
    whole = DoubleFrustum(near=2.0)
    small, large = required.noticed(replace(whole, slabs=(6.0,))), required.noticed(whole)
    assert 0 < small[STEREO][0] < large[STEREO][0]
    assert small[CRACK][0] == pytest.approx(large[CRACK][0] * 6 / 8)


@pytest.mark.slow
def test_a_plan_for_eyes_takes_the_largest_near_that_is_not_noticed(
    tiny: World, command: Command
) -> None:
    line = f"plan {tiny.scene_file} --viewer=60cm --sample=4 --depth=d32f --mapping=reversed"
    made = command(f"{line} --json --quiet").record
    seen = made["viewer"]
    assert made["within"] and not made["slabs"]
    assert seen["viewer"]["distance"] == 600 and seen["binding"] == STEREO
    assert made["near"] == seen["limits"][0]["largest_near"] == made["limits"]["eye"]
    assert made["binds"] == "eye" and 19 < seen["stereo_change_arcsec"] <= 20
    # Where the torus meets the plate, displacements in hogels are large.
    assert made["measured"]["displacement_p99_px"] > 0.5
    # With a tolerance, pixel errors limit near too, and more strongly.
    both = command(f"{line} --tolerance-px=0.5 --json --quiet").record
    assert both["binds"] == "pixels" and both["near"] <= both["limits"]["pixels"] < made["near"]


def test_the_border_of_the_plate_counts_where_one_side_alone_is_seen(tiny: World) -> None:
    behind = Content(before=None, behind=(20.0, 46.0), through=False)
    viewer, settings = Viewer(distance=600.0), DoubleFrustum(near=1.0)
    change = stereo_change_arcsec(behind, viewer, Display.from_scene(tiny.scene), settings)
    farther = 65 / (600 + 20) - 65 / (600 + 21)
    assert change == pytest.approx(farther * 206264.806, rel=1e-6)


# The view zone


@pytest.fixture
def projected(tiny: World) -> Scene:
    """Return a scene with a screen, 60 mm wide, in the view zone."""
    screen = Screen(height=600.0, center=(0.0, 0.0), size=(60.0, 60.0))
    frustum = replace(tiny.scene.frustum, fov=None, screen=screen)
    return replace(tiny.scene, plate=Plate(size=(80.0, 60.0), hogels=(20, 15)), frustum=frustum)


@pytest.mark.parametrize(
    ("distance", "some", "every"),
    [
        # In the plane of the screen, every film images exactly the screen.
        (600.0, 60.0, 60.0),
        # A third nearer, films are 40 mm wide; their middles move by a third of the 76 mm between
        # the outermost apertures.
        (400.0, 40.0 + 76.0 / 3, 40.0 - 76.0 / 3),
        # Twice as far, films are 120 mm wide; their middles move by 76 mm in the opposite
        # direction.
        (1200.0, 120.0 + 76.0, 120.0 - 76.0),
    ],
)
def test_the_view_zone_is_the_screen_and_spreads_away_from_it(
    projected: Scene, distance: float, some: float, every: float
) -> None:
    zone = view_zone(projected, distance)
    widths = zone.some_eyes_apart, zone.all_eyes_apart
    assert widths == pytest.approx((some, every))
    assert zone.every is not None and zone.every[0][1] == pytest.approx(every / 2)


def test_beyond_means_the_same_in_a_plan_for_eyes(projected: Scene) -> None:
    """A hogel with errors that eyes do not notice still counts as beyond the usual tolerance."""
    eyes = requirement(projected, Viewer(distance=600.0))
    required, pixels = (
        Requirement(pixels_count=False, viewer=eyes),
        Requirement(tolerance_px=2.0),
    )
    moved = Errors(displacement_p99_px=1.1, surface_fraction=0.002, depth_wrong=0.0)
    assert moved.beyond(required.tolerance_px) and not required.missed_by(moved)
    assert not moved.beyond(pixels.tolerance_px)
    assert pixels.worst_measure(moved) == "displacement_p99_px"
    assert pixels.worst_measure(replace(moved, surface_fraction=0.02)) == "surface_fraction"
    assert pixels.worst_measure(replace(moved, depth_wrong=0.02)) == "depth_wrong"
    assert required.worst_measure(moved) == "surface_fraction"


def test_eyes_outside_the_view_zone_are_refused_by_name(projected: Scene) -> None:
    """Eyes 59 mm apart see hogels; a wider pair does not, nor does a pair off center."""
    assert seen_view_zone(projected, Viewer(distance=600.0, eyes_apart_mm=59.0)).every is not None
    for scene in (projected, aside(projected, (5.0, 0.0))):
        with pytest.raises(
            InputError, match=r"view zone is 60 x 60 mm at 600 mm .*eyes may be up to"
        ):
            seen_view_zone(scene, Viewer(distance=600.0, eyes_apart_mm=65.0))
    with pytest.raises(InputError, match="no eyes straight before the plate's middle"):
        seen_view_zone(aside(projected, (0.0, 33.0)), Viewer(distance=600.0))


def aside(scene: Scene, center: tuple[float, float]) -> Scene:
    """Return the scene with its screen at another center."""
    assert scene.frustum.screen is not None
    screen = replace(scene.frustum.screen, center=center)
    return replace(scene, frustum=replace(scene.frustum, screen=screen))
