"""Plans to what eyes see: near is as large as nobody notices, whatever hogels' pixels show."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.compare.eye.limits import Viewer
from xfrustum.compare.eye.noticeable import Content, Display, stereo_change_arcsec
from xfrustum.compare.planning.viewer import CRACK, STEREO, EyeRequirement
from xfrustum.scenes import DoubleFrustum, Scene, open_scene


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("scene") / "through.toml"
    size = film((40.0, 30.0), hogels=(8, 6), resolution=(48, 36), fov_deg=(50.0, 40.0), reach=(60.0, 60.0))
    torus, box = part("torus", 24.0, (2.0, 1.0, 0.0)), part("box", 12.0, (-6.0, 1.0, -40.0))
    path.write_text(named("through", "mm") + size + torus + box)
    return str(path)


def requirement(scene: Scene, viewer: Viewer, *, through: bool = True) -> EyeRequirement:
    content = Content(before=(0.1, 12.0), behind=(0.1, 46.0), through=through)
    return EyeRequirement(viewer=viewer, display=Display.of(scene), content=content)


def test_the_smallest_limit_binds_and_a_larger_near_is_noticed(scene_file: str) -> None:
    scene = open_scene(scene_file)
    wanted = requirement(scene, Viewer(distance=600.0))
    # Hogels of 5 mm would hide any crack.
    wanted = replace(wanted, display=replace(wanted.display, pitch=0.5))
    stereo, crack = wanted.limits
    assert (stereo.name, crack.name) == (STEREO, CRACK)
    assert wanted.binding == stereo
    near = stereo.largest_near
    assert near is not None and crack.largest_near is not None and near < crack.largest_near
    assert wanted.allows(DoubleFrustum(near=near))
    # Plans have three digits.
    larger = DoubleFrustum(near=near * 1.01)
    assert not wanted.allows(larger)
    assert "arc seconds" in wanted.limit_of_near(larger, "mm")


def test_eyes_that_see_no_depth_are_left_with_the_crack(scene_file: str) -> None:
    scene = open_scene(scene_file)
    viewer = Viewer(distance=600.0, stereo_acuity_arcsec=1e6)
    fine = replace(requirement(scene, viewer), display=replace(Display.of(scene), pitch=0.1))
    binding = fine.binding
    assert binding is not None and binding.largest_near is not None
    assert (binding.name, binding.hidden_by) == (CRACK, "acuity")
    assert "crack" in fine.limit_of_near(DoubleFrustum(near=2 * binding.largest_near), "mm")
    # Without a surface at the plate nothing is noticed at any near.
    apart = replace(fine, content=replace(fine.content, through=False))
    assert apart.binding is None and len(apart.limits) == 1


def test_a_cut_that_is_fitted_leaves_a_smaller_gap(scene_file: str) -> None:
    wanted = requirement(open_scene(scene_file), Viewer(distance=600.0))
    whole, cut = DoubleFrustum(near=2.0), DoubleFrustum(near=2.0, slabs=(6.0,))
    assert 0 < wanted.stereo_change(cut) < wanted.stereo_change(whole)
    assert (wanted.crack_width(cut) or 0.0) == pytest.approx((wanted.crack_width(whole) or 0.0) * 6 / 8)


@pytest.mark.slow
def test_a_plan_for_eyes_takes_the_largest_near_that_is_not_noticed_and_replays_it(
    scene_file: str, capfd: pytest.CaptureFixture[str]
) -> None:
    asked = ["plan", scene_file, "--viewer=60cm", "--sample=4", "--depth=d32f", "--mapping=reversed"]
    assert main([*asked, "--json", "--quiet"]) == 0
    made = json.loads(capfd.readouterr().out)
    seen = made["viewer"]
    assert made["within"] and not made["slabs"]
    assert made["plate"]["hopeless"] == 0
    assert seen["viewer"]["distance"] == 600
    assert seen["binding"] == STEREO
    assert made["near"] == seen["limits"][0]["largest_near"]
    assert seen["stereo_change_arcsec"] == pytest.approx(20.0, rel=0.01)
    # Eight columns of hogels show few points: each is seen through hogels up to half a pitch beside it.
    assert seen["measured"]["disparity_change_arcsec"] == pytest.approx(20.0, rel=0.15)
    assert seen["measured"]["depth_wrong"] == 0
    # Where the torus meets the plate, hogels' pixels are far from right.
    assert made["measured"]["displacement_p99_px"] > 0.5


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ipd=60"], "give --viewer too"),
        (["--viewer=600mm", "--aperture=1,1"], "leave out"),
        (["--viewer=600mm", "--tolerance-px=1"], "leave out"),
        (["--viewer=far"], "LENGTH|length such as 600"),
        (["--viewer=600parsec"], "not known"),
        (["--viewer=-5"], "positive"),
        (["--viewer=5mm"], "larger distance"),
    ],
)
def test_what_makes_no_sense_of_a_viewer_is_said_in_one_line(
    scene_file: str, arguments: list[str], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", scene_file, *arguments, "--quiet"]) == 2
    output = capfd.readouterr()
    assert output.out == ""
    assert any(words in output.err for words in said.split("|"))
    assert output.err.count("\n") == 1


def test_the_border_of_the_plate_counts_where_one_side_alone_is_seen(scene_file: str) -> None:
    scene = open_scene(scene_file)
    behind = Content(before=None, behind=(20.0, 46.0), through=False)
    viewer, settings = Viewer(distance=600.0), DoubleFrustum(near=1.0)
    change = stereo_change_arcsec(behind, viewer, Display.of(scene), settings)
    farther = 65 / (600 + 20) - 65 / (600 + 21)
    assert change == pytest.approx(farther * 206264.806, rel=1e-6)
