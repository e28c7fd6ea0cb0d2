"""One answer for a plate: each judge's near is its own limit, the smaller of those that count is taken."""

import json
import math
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.scene_file import film, named, part
from xfrustum.cli.main import main
from xfrustum.compare.eye.noticeable import Viewer
from xfrustum.compare.planning.limits import buffer_limits, hogel_limits
from xfrustum.compare.planning.search import SEPARATION_MARGIN, SMALLEST_PER_REACH
from xfrustum.compare.planning.views import Requirement, Views
from xfrustum.compare.sampling import RandomSample
from xfrustum.compare.scout import PlateScan, scout
from xfrustum.reference import Reference
from xfrustum.reports import recommend as recommend_module
from xfrustum.reports.recommend import DEPTH, EYE, PIXELS, Recommendation, for_display, recommend
from xfrustum.scenes import DepthFormat, DepthMapping, DoubleFrustum, InputError, Scene, open_scene

D16 = [(DepthFormat.D16, DepthMapping.STANDARD)]
FINE = ((DepthFormat.D32F, DepthMapping.REVERSED),)
SAMPLE = RandomSample(hogels=6)
STEP = 1.01
"""Ratio beyond the largest step of lengths of three digits."""


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A torus through the plate and a box far behind it, aside of the middle."""
    path = tmp_path_factory.mktemp("scene") / "through.toml"
    size = film(
        (40.0, 30.0), hogels=(4, 3), resolution=(32, 24), fov_deg=(50.0, 40.0), reach=(60.0, 60.0)
    )
    torus, box = part("torus", 24.0, (2.0, 1.0, 0.0)), part("box", 12.0, (-6.0, 1.0, -40.0))
    path.write_text(named("through", "mm") + size + torus + box)
    return str(path)


@pytest.fixture(scope="module")
def scene(scene_file: str) -> Scene:
    return open_scene(scene_file)


@pytest.fixture(scope="module", autouse=True)
def coarse_search() -> Iterator[None]:
    """Find the smallest separation that a plan orders to a factor of 8: nothing here is about it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("xfrustum.compare.planning.measure.SEARCH_HALVINGS", 0)
        yield


@pytest.fixture(scope="module")
def scouted(scene: Scene) -> PlateScan:
    return scout(scene)


def test_the_largest_near_of_a_hogel_keeps_the_tolerance_and_the_next_one_does_not(
    scouted: PlateScan,
) -> None:
    limits, frustum = hogel_limits(scouted, 0.5), scouted.scene.frustum
    smallest = SMALLEST_PER_REACH * frustum.longest_reach
    told = 0
    for look, near in zip(scouted.looks, limits, strict=True):
        if math.isnan(near):
            assert math.isinf(look.nearest)
        elif near == 0:
            assert look.displacement_p99_px(DoubleFrustum(near=smallest), scouted.scene) > 0.5
        else:
            told += 1
            assert look.displacement_p99_px(DoubleFrustum(near=near), scouted.scene) <= 0.5
            assert look.displacement_p99_px(DoubleFrustum(near=STEP * near), scouted.scene) > 0.5
    assert told > len(limits) / 2
    # Displacement is nearly linear in a small near: twice the tolerance allows about twice the
    # near.
    twice = hogel_limits(scouted, 1.0)[limits > 0] / limits[limits > 0]
    assert np.all(twice > 1.9) and np.all(twice < 2.6)


def test_a_depth_buffer_orders_sheets_from_its_smallest_near_on(
    scene: Scene, scouted: PlateScan
) -> None:
    requirement = Requirement()
    views = Views.traced(Reference(scene), [scene.plate.middle])
    coarse, usual, fine = buffer_limits(views, scouted, requirement)
    assert coarse.smallest_near is not None and usual.smallest_near is not None and fine.any_near
    assert fine.smallest_near is not None and usual.smallest_near > fine.smallest_near
    assert coarse.smallest_near > 10 * usual.smallest_near

    def keeps(near: float) -> bool:
        settings = DoubleFrustum(near=near, depth=coarse.depth, mapping=coarse.mapping)
        apart = (
            views.separation(settings)
            * SEPARATION_MARGIN
            / requirement.separation_in(scene.frustum)
        )
        return apart <= 1 and views.depth_wrong(settings) <= requirement.max_wrong

    assert keeps(coarse.smallest_near) and not keeps(coarse.smallest_near / STEP)
    assert "asks for near from" in coarse.words("mm") and "any near" in fine.words("mm")


@pytest.fixture(scope="module")
def both(scene: Scene) -> Recommendation:
    """A tolerance that is asked for counts beside the eyes, and the smaller near keeps both."""
    return recommend(scene, Viewer(distance=600.0), 0.5, FINE, sample=SAMPLE)


def test_pixels_bind_without_a_viewer_and_eyes_with_one(both: Recommendation) -> None:
    assert both.binds == PIXELS and both.chosen is both.pixels
    assert both.chosen.near is not None and both.pixel_limit is not None
    assert both.chosen.near <= both.pixel_limit
    assert shlex.split(both.commands[1])[1] == "view"
    known = both.chosen.plate
    assert known is not None and f"none of the {known.measured} hogels" in both.paragraph
    # The finest depth buffer bounds near from nowhere.
    assert recommend_module._allowed(both)[-1].cells[1:3] == ("", "")
    pixels = replace(both, eyes=None, pixels_count=False)
    assert pixels.binds == PIXELS and shlex.split(pixels.commands[1])[1] == "survey"
    eyes = replace(both, pixels_count=False)
    assert eyes.eyes is not None and eyes.binds == EYE and eyes.chosen is eyes.eyes.plan
    # Of a plate of 400 x 300 hogels, eyes that confirm it are shown a part.
    large = replace(both, scene=for_display(both.scene, 0.1)).commands[1]
    assert "--resolution 115,87 " in large and "--resolution" not in both.commands[1]
    only_asked_for = "counts only with --tolerance-px"
    assert only_asked_for in eyes.paragraph and only_asked_for not in both.paragraph
    # The noise of the replay is kept as a margin.
    limit, near = eyes.eye_limit, eyes.chosen.near
    assert limit is not None and limit.largest_near is not None and near is not None
    assert limit.largest_near / 2 < near < limit.largest_near
    assert (
        "eyes at 600 mm allow near up to" in eyes.paragraph
        and "splitting is not needed" in eyes.paragraph
    )


@pytest.mark.slow
def test_a_coarse_depth_buffer_binds_where_it_asks_for_more_than_pixels_allow(scene: Scene) -> None:
    found = recommend(scene, choices=D16, sample=SAMPLE)
    (buffer,) = found.buffers
    assert buffer.smallest_near is not None and found.pixel_limit is not None
    assert buffer.smallest_near > found.pixel_limit and found.binds == DEPTH
    assert found.chosen.slabs and "one pair of frusta is not enough" in found.paragraph
    assert "What binds: in one pair the depth buffer D16 standard asks for" in found.paragraph
    assert f"--slabs {','.join(f'{one:g}' for one in found.chosen.slabs)}" in found.commands[0]


def test_a_display_has_its_own_pitch_on_a_plate_of_the_same_size(scene: Scene) -> None:
    finer = for_display(scene, 0.5)
    assert finer.plate.hogels == (80, 60) and finer.plate.size == scene.plate.size
    assert finer.name == "through (hogels = [80, 60])"
    with pytest.raises(InputError, match="wider than the plate"):
        for_display(scene, 31.0)


def test_the_command_writes_a_page_and_what_it_prints(
    scene_file: str,
    both: Recommendation,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """What was asked for is what the answer of the other tests was asked for, so that it is found once."""

    def found(
        opened: Scene, *asked: object, choices: object, sample: RandomSample, progress: bool
    ) -> Recommendation:
        assert (opened.name, *asked) == ("through", Viewer(distance=600.0), None)
        assert (choices, sample.hogels, progress) == (FINE, 6, False)
        return replace(both, pixels_count=False)

    monkeypatch.setattr(recommend_module, "recommend", found)
    out = tmp_path / "recommend"
    asked = [
        "recommend",
        scene_file,
        "--viewer=600mm",
        "--sample=6",
        f"--out={out}",
        "--json",
        "--quiet",
    ]
    asked += ["--depth=d32f", "--mapping=reversed"]
    assert main(asked) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "recommend.json").read_text())
    assert printed["binds"] == EYE and printed["within"] and not printed["split"]
    assert printed["near"][0] <= printed["near"][1] == printed["plans"]["eye"]["near"]
    assert (
        printed["limits"]["depth"] <= printed["near"][0]
        and printed["near"][1] < printed["limits"]["eye"]
    )
    assert printed["plate"] == printed["plans"]["eye"]["plate"] and "--near" in printed["command"]
    assert printed["plate_bytes"] == 4 * 3 * 32 * 24 * 6
    quantiles = list(printed["hogels"].values())
    assert quantiles == sorted(quantiles)
    page = (out / "index.html").read_text()
    assert printed["sentence"] in page.replace("&#39;", "'")


def test_nothing_is_recommended_where_a_surface_lies_in_every_aperture(scene: Scene) -> None:
    square = np.array([[-40.0, -40, 0], [40, -40, 0], [40, 40, 0], [-40, 40, 0]])
    flat = replace(scene.objects[0], vertices=square, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    found = recommend(replace(scene, objects=(flat,)), sample=SAMPLE)
    assert found.chosen.settings is None and found.binds == PIXELS and not found.commands
    assert found.paragraph.startswith("No plan: a surface lies in every aperture")
    assert "depth buffer" not in found.paragraph


@pytest.mark.slow
def test_a_surface_in_some_apertures_is_said_once_and_spoils_no_other_number(scene: Scene) -> None:
    """No near draws the hogels in a small square in the plate, and the worst of the others counts."""
    square = np.array([[-6.0, -6, 0], [6, -6, 0], [6, 6, 0], [-6, 6, 0]])
    flat = replace(scene.objects[0], vertices=square, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    found = recommend(
        replace(scene, objects=(*scene.objects, flat)), choices=[*D16, *FINE], sample=SAMPLE
    )
    assert found.paragraph.count("No settings hold for the whole plate") == 1
    assert "these do" in found.paragraph and not found.chosen.within
    moved = [one.displacement_p99_px for one in found.buffers]
    assert all(one is None or math.isfinite(one) for one in moved) and any(moved)


@pytest.mark.slow
def test_the_depth_buffer_that_is_recommended_is_among_those_that_are_compared(
    scene: Scene,
) -> None:
    """Three of six depth buffers are compared, and the only one that is good enough is none of these."""
    logarithmic = (DepthFormat.D24, DepthMapping.LOGARITHMIC)
    found = recommend(scene, choices=[*D16 * 5, logarithmic], sample=SAMPLE)
    assert found.chosen.depth_buffer == logarithmic
    assert "depth buffer D24 logarithmic" in found.paragraph and len(found.buffers) == 4
