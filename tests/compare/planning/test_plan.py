"""The planner: its plans hold when they are measured, nothing simpler does, and what people see of a plan."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import kept, thinned
from tests.support.scene_file import film, part
from tests.support.views import SHARED_SCENES, reversed_d32f, view
from xfrustum.cli.main import main
from xfrustum.compare.beyond import PERCENTILE
from xfrustum.compare.metrics.error_maps import displacement
from xfrustum.compare.planning.measure import measured, misordered
from xfrustum.compare.planning.plan import PlatePlanner, depth_buffers, plan
from xfrustum.compare.planning.search import (
    SEPARATION_MARGIN,
    Search,
    index_below,
    round_number,
)
from xfrustum.compare.planning.views import Requirement, Views, displacement_bound
from xfrustum.compare.prediction.depth import MAX_MISORDERED_FRACTION
from xfrustum.compare.scout import scout
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.reports.planning import spread_apertures
from xfrustum.scenes import (
    Aperture,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    InputError,
    Scene,
    SceneObject,
    open_scene,
)
from xfrustum.scenes.geometry.shapes import refine
from xfrustum.scenes.library import builtin
from xfrustum.scenes.model.device_model import safe_model

SMALL = (96, 72)  #: pixels, where a scene's own resolution does not matter

D16, D24 = (DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.STANDARD)


def traced(scene: Scene, apertures: Sequence[Aperture] | None = None) -> Views:
    return Views.traced(Reference(scene), apertures or [scene.plate.middle])


@cache
def views_of(name: str, index: tuple[int, int] | None = None) -> Views:
    scene = view(name, SMALL)
    return traced(scene, None if index is None else [scene.plate.aperture(*index)])


def planned(
    views: Views, requirement: Requirement, buffer: tuple[DepthFormat, DepthMapping]
) -> DoubleFrustum:
    return Search(views, requirement).among([buffer]).holding[0].settings


def holds(views: Views, settings: DoubleFrustum, requirement: Requirement) -> bool:
    return requirement.met_by(measured(views, settings, requirement, smallest=False)[1])


# The plan holds.

SCENES = [name for name in (*builtin.names(), *SHARED_SCENES) if name != "crossing"]


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("asymmetric-recentered", SMALL),
        ("empty", SMALL),
        *(pytest.param(name, None, marks=pytest.mark.slow) for name in SCENES),
    ],
)
def test_a_plan_holds_when_it_is_measured(name: str, size: tuple[int, int] | None) -> None:
    """At the scene's own resolution, for any depth buffer; of a recentered frustum at a corner too."""
    scene = view(name, size)
    made = plan(scene, scene.default_apertures()[:2])
    assert made.within, made
    assert made.near is not None and made.near == round_number(index_below(made.near))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SCENES if name != "empty"])
def test_a_plan_with_cuts_holds_when_it_is_measured(name: str) -> None:
    """A depth buffer of 16 bits is too coarse for any of these without cuts."""
    scene = view(name)
    made = plan(scene, [scene.plate.middle], choices=[D16])
    assert made.slabs and made.within, made
    assert all(height == round_number(index_below(height)) for height in made.slabs)


@pytest.mark.parametrize(
    ("name", "near"), thinned([("hard/edge-on", 51.1), ("hard/steep", 2.18)], 2)
)
def test_what_the_scene_has_beside_the_film_is_kept_out_of_the_picture(
    name: str, near: float
) -> None:
    """A camera that has stepped back sees farther to the side, where |z| is less than n."""
    scene, requirement = open_scene(name), Requirement()
    wide = DoubleFrustum(near=near, slabs=(near,), depth=D16[0])
    truth = Reference(scene).trace(scene.plate.middle)
    assert displacement_bound(truth, scene.frustum, wide) < requirement.tolerance_px
    _, found, _ = measured(traced(scene), wide, requirement, smallest=False)
    assert found.displacement_p99_px > requirement.tolerance_px
    made = plan(scene, [scene.plate.middle], requirement, [D16])
    assert made.within, made
    assert made.near is not None and made.near < near


@pytest.mark.slow
def test_a_surface_through_the_aperture_itself_leaves_no_plan_and_nothing_else_would_do() -> None:
    """The cameras draw only the part of such a surface that is closer than n: no n is small enough."""
    scene, requirement = view("crossing", SMALL), Requirement()
    made = plan(scene, [scene.plate.middle])
    assert (made.near, made.slabs, made.settings, made.within) == (None, (), None, False)
    assert "lies in the aperture itself" in made.reason
    views = views_of("crossing")
    for near in 150 * np.array([1e-2, 1e-5, 1e-8]):
        for slabs in ((), (3.0, 30.0)):
            settings = DoubleFrustum(near=float(near), slabs=slabs, mapping=DepthMapping.REVERSED)
            _, found, _ = measured(views, settings, requirement, smallest=False)
            assert found.displacement_p99_px > 100
    beside = plan(scene, [scene.plate.aperture(31, 17)])
    assert beside.within, beside


@pytest.mark.parametrize(
    "name", thinned(["car", "asymmetric-recentered", "large-triangles", "teapot-recentered"], 3)
)
def test_no_picture_is_displaced_by_more_than_predicted(name: str) -> None:
    """By up to a pixel, with and without cuts; and the bound is not a tenth too high."""
    scene = view(name, (192, 144))
    aperture, reach = scene.default_apertures()[-1], scene.frustum.longest_reach
    truth = Reference(scene).trace(aperture)
    found = []
    with Rasterizer(scene) as rasterizer:
        for near, slabs in product((1e-3, 3e-4, 1e-4, 3e-5), ((), (0.2 * reach,), (0.5 * reach,))):
            settings = reversed_d32f(near * reach)
            settings = replace(settings, slabs=slabs)
            bound = displacement_bound(truth, scene.frustum, settings)
            vectors = displacement(rasterizer.render(aperture, settings), truth.camera)
            moved = np.hypot(vectors[..., 0], vectors[..., 1])
            if 1e-3 < bound <= 1:
                found.append(bound / np.percentile(moved[np.isfinite(moved)], PERCENTILE))
    assert len(found) > 3
    assert min(found) >= 1
    assert np.median(found) < 1.1


# Nothing simpler does.

NEEDING_CUTS = [
    ("car", D16, None),
    ("asymmetric", D24, 0.003),
    ("asymmetric-recentered", D16, 0.002),
    ("large-triangles", D16, None),
    ("truck", (DepthFormat.D16, DepthMapping.GL), 0.0005),
    ("beetle", D16, 0.0005),
]


@pytest.mark.parametrize(("name", "buffer", "separation"), kept(NEEDING_CUTS, NEEDING_CUTS[3:4]))
def test_with_one_slab_less_it_does_not_hold(
    name: str, buffer: tuple[DepthFormat, DepthMapping], separation: float | None
) -> None:
    """Neither the best that the planner itself can do with one cut less, nor the plan without one of its.

    Where one cut is planned, no near at all would do without.
    """
    views, requirement = views_of(name), Requirement(separation=separation)
    settings = planned(views, requirement, buffer)
    assert settings.slabs
    assert holds(views, settings, requirement)
    # Where sheets alone ask for the cuts, and only there, other settings would do.
    uncut = Search(views, requirement).without_cuts([buffer])
    lax = replace(requirement, separation=views.scene.frustum.longest_reach)
    assert (uncut is not None) == (not planned(views, lax, buffer).slabs)
    best = Search(views, requirement).attempt(buffer, len(settings.slabs) - 1)
    assert not best.holds
    slabs = settings.slabs
    others = [replace(settings, slabs=slabs[:i] + slabs[i + 1 :]) for i in range(len(slabs))]
    if len(slabs) == 1:
        nears = np.geomspace(1e-1, 1e-7, 7) * views.scene.frustum.longest_reach
        others += [replace(settings, near=float(near), slabs=()) for near in nears]
    for other in (best.settings, *others):
        assert not holds(views, other, requirement), other


@pytest.mark.parametrize("name", thinned(["car", "asymmetric", "teapot-recentered"], 3))
def test_where_no_cut_is_planned_twice_the_near_does_not_hold(name: str) -> None:
    views, requirement = views_of(name), Requirement()
    settings = Search(views, requirement).among(depth_buffers()).holding[0].settings
    assert not settings.slabs and holds(views, settings, requirement)
    doubled = replace(settings, near=2 * settings.near)
    _, found, _ = measured(views, doubled, requirement, smallest=False)
    assert found.displacement_p99_px > 1.5 * requirement.tolerance_px


# The search finds the best there is.


@pytest.mark.parametrize(
    ("name", "separation"),
    thinned([("car", 0.003), ("sheets", 0.05), ("bunny-transfer", 0.001)], 3, 1),
)
def test_no_two_cuts_that_order_what_is_outside_come_closer_to_the_plate(
    name: str, separation: float
) -> None:
    """Brute force over pairs of heights, against cuts placed one by one from the far end inward."""
    views = views_of(name)
    search = Search(views, Requirement())
    target = separation / SEPARATION_MARGIN
    first, second = search.cuts(D16, 2, target)

    def separated(low: float, high: float | None) -> bool:
        return search.separation_between(D16, low, high) <= target

    assert separated(first, second) and separated(second, None)
    heights = np.geomspace(1e-3, 0.999, 120) * views.scene.frustum.longest_reach
    outer = [float(height) for height in heights if separated(float(height), None)]
    assert min(outer) >= second
    possible = [
        float(low)
        for high in outer
        for low in heights
        if low < high and separated(float(low), high)
    ]
    assert possible and min(possible) >= first
    # And the grid of three digits is used to the full: the next smaller numbers fail.
    assert not separated(round_number(index_below(first) - 1), second)
    assert not separated(round_number(index_below(second) - 1), None)


@pytest.mark.parametrize(
    ("name", "buffer", "separation"), thinned([("car", D24, None), *NEEDING_CUTS[:3]], 2)
)
def test_no_larger_near_is_predicted_to_hold(
    name: str, buffer: tuple[DepthFormat, DepthMapping], separation: float | None
) -> None:
    """Up to the first cut, wherever between the plate and the second that is."""
    views, requirement = views_of(name), Requirement(separation=separation)
    searched = Search(views, requirement)
    settings = planned(views, requirement, buffer)
    assert searched.judged(settings).holds
    reach, index = views.scene.frustum.longest_reach, index_below(settings.near)
    larger = [round_number(index + 1), round_number(index + 2)]
    larger += [float(near) for near in np.geomspace(settings.near * 1.02, 0.9 * reach, 8)]
    cuts: list[tuple[float, ...]] = [()]
    if settings.slabs:
        end = settings.slabs[1] if settings.slabs[1:] else reach
        firsts = np.geomspace(settings.near, 0.999 * end, 8)
        cuts = [(float(first), *settings.slabs[1:]) for first in firsts]
    for slabs, near in product(cuts, larger):
        if not slabs or near <= slabs[0]:
            assert not searched.judged(replace(settings, near=near, slabs=slabs)).holds, (
                near,
                slabs,
            )


# It does not depend on what it should not depend on.


@pytest.mark.parametrize(
    ("name", "requirement", "choices"),
    thinned(
        [
            ("large-triangles", Requirement(), [D16]),
            ("car", Requirement(), depth_buffers()),
            ("car", Requirement(separation=0.003), [D16]),
            (
                "sheets",
                Requirement(separation=0.003),
                depth_buffers(DepthFormat.D24, DepthMapping.REVERSED),
            ),
            ("asymmetric-recentered", Requirement(tolerance_px=0.05), [D24]),
        ],
        5,
    ),
)
def test_refining_a_mesh_four_and_sixteen_times_leaves_the_plan(
    name: str, requirement: Requirement, choices: list[tuple[DepthFormat, DepthMapping]]
) -> None:
    scene = view(name, SMALL)
    plans = []
    for levels in range(3):
        views = traced(refine(scene, levels))
        plans.append(Search(views, requirement).among(choices).holding[0].settings)
    assert plans[0] == plans[1] == plans[2]


def test_what_is_behind_the_plate_and_what_is_before_it_count_alike() -> None:
    """Tilted squares beside each other, reflected through the aperture: C shows what C* did, and back."""
    scene, plans = view("empty", SMALL), []
    square = np.array([(-1.0, -1, 0.3), (1, -1, 0.1), (1, 1, -0.1), (-1, 1, 0.1)])
    for side in (1, -1):
        squares = tuple(
            SceneObject(
                name="square",
                vertices=side * (size * square + [x, 3.0, z]),
                faces=np.array([(0, 1, 2), (0, 2, 3)]),
            )
            for size, x, z in ((8.0, -15.0, -60.0), (3.0, 4.0, -25.0), (9.0, -30.0, 70.0))
        )
        frustum = replace(scene.frustum, reach=(100.0, 130.0) if side == 1 else (130.0, 100.0))
        views = traced(replace(scene, frustum=frustum, objects=squares))
        plans.append(planned(views, Requirement(separation=0.004), D16))
    assert plans[0] == plans[1]
    assert len(plans[0].slabs) > 1


@pytest.mark.parametrize("buffer", [D16, D24])
def test_a_plan_grows_with_the_scene(buffer: tuple[DepthFormat, DepthMapping]) -> None:
    """Eight times as large, which no float rounds: eight times the near, to three digits."""
    scene = view("asymmetric-recentered", SMALL)
    plate, frustum, screen = scene.plate, scene.frustum, scene.frustum.screen
    center, size = np.array([screen.center, screen.size]) * 8
    screen = replace(screen, height=8 * screen.height, center=tuple(center), size=tuple(size))
    larger = replace(
        scene,
        plate=replace(plate, size=(8 * plate.size[0], 8 * plate.size[1])),
        frustum=replace(frustum, reach=(8 * frustum.reach[0], 8 * frustum.reach[1]), screen=screen),
        objects=tuple(replace(part, vertices=8 * part.vertices) for part in scene.objects),
    )
    plans = [planned(traced(one), Requirement(), buffer) for one in (scene, larger)]
    small, large = (np.array([one.near, *one.slabs]) for one in plans)
    assert large == pytest.approx(8 * small, rel=0.02)


@pytest.mark.parametrize("name", thinned(["asymmetric-recentered", "car"], 2))
def test_asking_for_more_never_gives_fewer_slabs_or_else_a_larger_near(name: str) -> None:
    views = traced(view(name, (96, 72)))
    easier = Requirement(tolerance_px=2.0, separation=2.0, max_wrong=0.1)
    for harder in (
        [replace(easier, tolerance_px=px) for px in (0.5, 0.02)],
        [replace(easier, separation=d) for d in (0.5, 0.05, 0.005)],
        [replace(easier, max_wrong=share) for share in (1e-2, 1e-3)],
    ):
        before = planned(views, easier, D16)
        for requirement in harder:
            after = planned(views, requirement, D16)
            assert len(after.slabs) >= len(before.slabs)
            if len(after.slabs) == len(before.slabs):
                assert after.near <= before.near
            before = after


def test_more_apertures_never_ask_for_less() -> None:
    scene = view("car-recentered", SMALL)
    many = traced(scene, spread_apertures(scene.plate, 5))
    few, all_of_them = (planned(views, Requirement(), D24) for views in (traced(scene), many))
    assert len(all_of_them.slabs) > len(few.slabs) or all_of_them.near <= few.near


# Sheets at the farthest surfaces.


@pytest.mark.parametrize(
    ("name", "index", "settings"),
    thinned(
        [
            ("car", None, DoubleFrustum(near=0.1, depth=DepthFormat.D16)),
            (
                "asymmetric-recentered",
                (0, 0),
                DoubleFrustum(near=0.5, slabs=(20, 60), depth=DepthFormat.D16),
            ),
            ("sheets", None, DoubleFrustum(near=0.5, slabs=(40.0,), mapping=DepthMapping.GL)),
            ("large-triangles", None, DoubleFrustum(near=0.05, depth=DepthFormat.D32F)),
        ],
        2,
        1,
    ),
)
def test_sheets_are_misordered_as_predicted(
    name: str, index: tuple[int, int] | None, settings: DoubleFrustum
) -> None:
    """Twice the predicted separation is ordered, a quarter is not; closer sheets are never better off."""
    views = views_of(name, index)
    predicted = views.separation(settings)
    shares = [
        misordered(views.scene, views.views[0], settings, predicted * factor)
        for factor in (0.01, 0.25, 2)
    ]
    assert shares[0] >= shares[1] > MAX_MISORDERED_FRACTION >= shares[2]
    # The sheet that must not show comes first in half of the pairs: wherever depths are equal, it
    # shows.
    assert shares[0] > 0.7


# Lengths of three digits.


@given(st.floats(1e-30, 1e30))
def test_rounding_down_to_three_digits(length: float) -> None:
    index = index_below(length)
    assert round_number(index) <= length < round_number(index + 1)
    assert float(f"{round_number(index):.3g}") == round_number(index)
    assert round_number(index + 900) == pytest.approx(10 * round_number(index), rel=1e-15)
    assert round_number(index_below(round_number(index), strictly=True)) == round_number(index - 1)


KEYS = ["displacement_p99_px", "surface_fraction", "depth_wrong", "misordered", "separation"]


def test_a_separation_that_no_float_resolves_leaves_no_plan() -> None:
    scene = view("asymmetric", SMALL)
    made = plan(scene, [scene.plate.middle], Requirement(separation=1e-6))
    assert not made.within and made.settings is None
    assert "want of digits" in made.reason
    assert list(made.summary()["predicted"]) == list(made.summary()["measured"]) == KEYS


@pytest.mark.slow
def test_too_many_slabs_are_no_plan_and_the_reason_says_what_comes_nearest() -> None:
    scene = view("sheets", (64, 48))
    made = plan(scene, [scene.plate.middle], Requirement(separation=1e-4), [D16])
    assert not made.within and made.settings is None
    assert (made.depth, made.mapping) == D16
    assert "No plan with up to 16 cuts" in made.reason and "sheets out of order" in made.reason
    lengths = re.findall(r"(?:near|cut at|order that are) [-+.e\d]+(?: \S+)?", made.reason)
    assert len(lengths) == 3
    assert all(length.split()[-1].rstrip(",") == scene.units for length in lengths)


@pytest.mark.slow
def test_the_choice_among_depth_buffers_is_the_cheapest_that_does() -> None:
    scene = view("car", SMALL)
    every = plan(scene, [scene.plate.middle])
    assert (every.depth, every.mapping) == (DepthFormat.D24, DepthMapping.REVERSED)
    assert "the cheapest" in every.reason
    sixteen = plan(scene, [scene.plate.middle], choices=depth_buffers(DepthFormat.D16))
    # Only what a fragment writes needs no cut in 16 bits: fewer slabs come first, then the larger
    # margin.
    assert sixteen.slabs == () and sixteen.mapping is DepthMapping.LOGARITHMIC
    assert "the most robust" in sixteen.reason


@pytest.mark.slow
def test_a_plan_orders_sheets_as_the_device_stores_them() -> None:
    scene, buffer = view("asymmetric", SMALL), depth_buffers(DepthFormat.D16, DepthMapping.LINEAR)
    made = plan(scene, [scene.plate.middle], Requirement(device=safe_model()), buffer)
    assert made.settings is not None and made.predicted is not None
    # Two of its steps are one of those that a device takes which stores the nearest.
    assert made.predicted.separation == pytest.approx(
        2 * traced(scene).separation(made.settings), rel=0.01
    )
    whole = PlatePlanner(
        reference=Reference(scene),
        scouted=scout(scene),
        requirement=Requirement(device=safe_model()),
        choices=buffer,
    )
    assert whole.first_views().device == safe_model()


@pytest.fixture(scope="module")
def small_scene(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    size = film(
        (40.0, 30.0), hogels=(5, 4), resolution=(24, 18), fov_deg=(60.0, 50.0), reach=(100.0, 100.0)
    )
    file.write_text(size + part("torus", 30.0, (2.0, 1.0, -40.0)))
    return str(file)


def test_json_is_exactly_as_promised(small_scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["plan", small_scene, "--json", "--quiet"]
    assert main([*asked, "--depth", "d16", "--mapping", "gl", "--sample", "2"]) == 0
    made = json.loads(capsys.readouterr().out)
    names = "near slabs depth mapping predicted measured within reason plate device_model"
    assert list(made) == [*names.split(), "largest", "without_cuts", "apertures"]
    assert made["plate"]["hogels"] == 5 * 4 and made["plate"]["worst"]["displacement_p99_px"] <= 0.5
    assert list(made["predicted"]) == list(made["measured"]) == KEYS
    assert made["within"] is True and made["depth"] == "d16" and made["mapping"] == "gl"
    assert all(isinstance(height, float) for height in made["slabs"])
    assert main([*asked, "--aperture", "2,1", "--separation", "1e-7"]) == 0
    none = json.loads(capsys.readouterr().out)
    assert none["near"] is None and none["slabs"] == [] and none["within"] is False


def test_the_table_ends_in_a_command_that_draws_so(
    small_scene: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = "--depth d16 --mapping standard --aperture 2,2 --separation 0.01 --quiet"
    assert main(["plan", small_scene, *asked.split()]) == 0
    text = capsys.readouterr().out
    command = shlex.split(text.splitlines()[-1])
    assert command[:2] == ["xfrustum", "raster"] and "--slabs" in command
    monkeypatch.chdir(tmp_path)
    assert main(command[1:]) == 0
    assert "holds" in text


def test_a_requirement_checks_itself() -> None:
    for name, wrong in (("tolerance_px", math.nan), ("separation", -1.0), ("max_wrong", 0.0)):
        with pytest.raises(InputError):
            replace(Requirement(), **{name: wrong})  # type: ignore[arg-type]
    scene = open_scene("car")
    assert Requirement().separation_in(scene.frustum) == pytest.approx(0.15)


def test_apertures_all_over_the_plate() -> None:
    scene: Scene = open_scene("car")
    many = spread_apertures(scene.plate, 40)
    columns, rows = scene.plate.hogels
    assert many[0] == scene.plate.middle
    assert {a.index for a in many[1:5]} == {(c, r) for c in (0, columns - 1) for r in (0, rows - 1)}
    assert len({a.index for a in many}) == 40
    assert many[:7] == spread_apertures(scene.plate, 7)
    quarters = {(a.column < columns / 2, a.row < rows / 2) for a in many[5:13]}
    assert len(quarters) == 4
    tiny = replace(scene.plate, hogels=(2, 1))
    assert {a.index for a in spread_apertures(tiny, 9)} == {(0, 0), (1, 0)}
