"""The planner: its plans pass when measured, simpler settings fail, and invariances hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.long_tail import thinned
from tests.support.views import SHARED_SCENES, reversed_d32f, view
from xfrustum.compare.error_maps import displacement
from xfrustum.compare.planning.plan import Cause, plan_apertures
from xfrustum.compare.planning.requirement import (
    DepthBuffer,
    Requirement,
    depth_buffers,
    index_below,
    round_number,
)
from xfrustum.compare.planning.search import (
    COMPARED_BUFFERS,
    SEPARATION_MARGIN,
    Search,
    buffer_limit,
)
from xfrustum.compare.planning.views import Views, displacement_bound, measured
from xfrustum.compare.sampling import PERCENTILE
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Scene,
    SceneObject,
    open_scene,
)
from xfrustum.scenes.library import builtin
from xfrustum.scenes.shapes import refine

SMALL = (96, 72)  #: film for tests that do not need a scene's own resolution, pixels

D16, D24 = (DepthFormat.D16, DepthMapping.STANDARD), (DepthFormat.D24, DepthMapping.STANDARD)
FINE = (DepthFormat.D32F, DepthMapping.REVERSED)


def traced(scene: Scene) -> Views:
    return Views.traced(Reference(scene), [scene.plate.middle])


@cache
def views_of(name: str) -> Views:
    return traced(view(name, SMALL))


def planned(views: Views, requirement: Requirement, *buffers: DepthBuffer) -> DoubleFrustum:
    """Return the cheapest settings predicted to pass, with their largest near offset."""
    outcome = Search(views, replace(requirement, choices=buffers)).best()
    assert outcome.best is not None and outcome.largest_near is not None
    return replace(outcome.best.settings, near=outcome.largest_near)


def holds(views: Views, settings: DoubleFrustum, requirement: Requirement) -> bool:
    return requirement.met_by(measured(views, settings, requirement, smallest=False)[1])


# Plans meet their requirements.

SCENES = [name for name in (*builtin.names(), *SHARED_SCENES) if name != "crossing"]


@pytest.mark.parametrize(
    ("name", "size", "choices"),
    [
        ("asymmetric-recentered", SMALL, ()),
        ("empty", SMALL, ()),
        *(
            pytest.param(name, None, choices, marks=pytest.mark.slow)
            for name, choices in product(SCENES, ((), (D16,)))
        ),
    ],
)
def test_a_plan_holds_when_it_is_measured(
    name: str, size: tuple[int, int] | None, choices: tuple[DepthBuffer, ...]
) -> None:
    """Plan at the scene's own resolution, and for recentered frusta also at a corner.

    Without cuts, a depth buffer of 16 bits is too coarse for all scenes but the empty scene.
    """
    scene = view(name, size)
    made = plan_apertures(scene, scene.default_apertures()[:2], Requirement(choices=choices))
    assert made.within, made
    assert made.slabs or not choices or name == "empty"
    for length in (made.near, *made.slabs):
        assert length is not None and length == round_number(index_below(length))


def test_surfaces_outside_the_film_limit_the_planned_near() -> None:
    """An offset camera images surfaces outside the film where |z| is less than n."""
    scene, requirement, near = open_scene("hard/edge-on"), Requirement(), 51.1
    wide = DoubleFrustum(near=near, slabs=(near,), depth=D16[0])
    truth = Reference(scene).trace(scene.plate.middle)
    assert displacement_bound(truth, scene.frustum, wide) < requirement.tolerance_px
    _, measurement, _ = measured(traced(scene), wide, requirement, smallest=False)
    assert measurement.displacement_p99_px > requirement.tolerance_px
    made = plan_apertures(scene, [scene.plate.middle], replace(requirement, choices=(D16,)))
    assert made.within, made
    assert made.near is not None and made.near < near


@pytest.mark.slow
def test_a_surface_through_the_aperture_itself_leaves_no_plan() -> None:
    """The cameras draw only the part of this surface that is closer than n: no near suffices."""
    scene, requirement = view("crossing", SMALL), Requirement()
    made = plan_apertures(scene, [scene.plate.middle], requirement)
    assert (made.near, made.slabs, made.settings, made.within) == (None, (), None, False)
    assert made.cause is Cause.IN_APERTURE
    neighbor = plan_apertures(scene, [scene.plate.aperture(31, 17)], requirement)
    assert neighbor.within, neighbor


@pytest.mark.parametrize("name", thinned(["asymmetric-recentered", "car", "large-triangles"], 3))
def test_no_picture_is_displaced_by_more_than_predicted(name: str) -> None:
    """Bounds up to a pixel hold, with and without cuts; their median is under a tenth too high."""
    scene = view(name, (192, 144))
    aperture, reach = scene.default_apertures()[-1], scene.frustum.longest_reach
    truth = Reference(scene).trace(aperture)
    ratios = []
    with Rasterizer(scene) as rasterizer:
        for near, slabs in product((1e-3, 3e-4, 1e-4, 3e-5), ((), (0.2 * reach,), (0.5 * reach,))):
            settings = replace(reversed_d32f(near * reach), slabs=slabs)
            bound = displacement_bound(truth, scene.frustum, settings)
            drawn = rasterizer.render(aperture, settings, normals=False, color=False)
            moved = np.linalg.norm(displacement(drawn, truth.camera), axis=-1)
            if 1e-3 < bound <= 1:
                ratios.append(bound / np.percentile(moved[np.isfinite(moved)], PERCENTILE))
    assert len(ratios) > 3
    assert min(ratios) >= 1
    assert np.median(ratios) < 1.1


@pytest.mark.parametrize("near", [5.0, 10.0])
def test_the_bound_of_a_wall_close_to_the_plate_is_the_displacement_of_the_drawing(
    near: float,
) -> None:
    """A wall at |z| is drawn u n / |z| away from where the point belongs, at the pixel u."""
    film, z = (6, 4), -10.0
    corners = np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]]) * [100, 100, 1]
    wall = SceneObject(name="wall", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    scene = replace(view("asymmetric", film), objects=(wall,))
    settings, middle = reversed_d32f(near), scene.plate.middle
    truth = Reference(scene).trace(middle)
    bound = displacement_bound(truth, scene.frustum, settings)
    with Rasterizer(scene) as rasterizer:
        drawn = rasterizer.render(middle, settings, normals=False, color=False)
    moved = np.linalg.norm(displacement(drawn, truth.camera), axis=-1)
    # The corner pixel's center is 2.5 and 1.5 pixels off the axis.
    assert bound == pytest.approx(near / abs(z) * np.hypot(2.5, 1.5), rel=1e-5)
    assert moved.max() == pytest.approx(bound, rel=1e-5)


# No simpler settings meet the requirement.

NEEDING_CUTS = [
    ("large-triangles", D16, None),
    ("car", D16, None),
    ("asymmetric", D24, 0.003),
    ("asymmetric-recentered", D16, 0.002),
    ("truck", (DepthFormat.D16, DepthMapping.GL), 0.0005),
]


@pytest.mark.parametrize(("name", "buffer", "separation"), thinned(NEEDING_CUTS, 5))
def test_with_one_slab_less_it_does_not_hold(
    name: str, buffer: DepthBuffer, separation: float | None
) -> None:
    """The plan fails without any one of its cuts, and so does the best plan with fewer cuts.

    The planner adds a cut only if no near offset suffices without it.
    """
    views, requirement = views_of(name), Requirement(separation=separation)
    settings = planned(views, requirement, buffer)
    slabs = settings.slabs
    assert slabs and holds(views, settings, requirement)
    best = Search(views, requirement).attempt(buffer, len(slabs) - 1)
    assert not best.holds
    others = [replace(settings, slabs=slabs[:i] + slabs[i + 1 :]) for i in range(len(slabs))]
    if len(slabs) == 1:
        nears = np.geomspace(1e-1, 1e-7, 4) * views.scene.frustum.longest_reach
        others += [replace(settings, near=float(near), slabs=()) for near in nears]
    for other in (best.settings, *others):
        assert not holds(views, other, requirement), other


@pytest.mark.parametrize("name", thinned(["car", "asymmetric", "teapot-recentered"], 3))
def test_where_no_cut_is_planned_twice_the_near_does_not_hold(name: str) -> None:
    views, requirement = views_of(name), Requirement()
    settings = planned(views, requirement)
    assert not settings.slabs and holds(views, settings, requirement)
    doubled = replace(settings, near=2 * settings.near)
    _, measurement, _ = measured(views, doubled, requirement, smallest=False)
    assert measurement.displacement_p99_px > 1.5 * requirement.tolerance_px


# The search returns the best settings.


@pytest.mark.parametrize(
    ("name", "separation"), thinned([("car", 0.003), ("bunny-transfer", 0.001)], 2)
)
def test_no_two_sufficient_cuts_lie_closer_to_the_plate(name: str, separation: float) -> None:
    """Compare brute force over pairs of heights with cuts placed one by one from the far end."""
    views = views_of(name)
    search = Search(views, Requirement())
    target = separation / SEPARATION_MARGIN
    first, second = search.cuts(D16, 2, target)

    def separated(low: float, high: float | None) -> bool:
        return search.separation_between(D16, low, high) <= target

    assert separated(first, second) and separated(second, None)
    heights = [float(h) for h in np.geomspace(1e-3, 0.999, 120) * views.scene.frustum.longest_reach]
    outer = [height for height in heights if separated(height, None)]
    assert min(outer) >= second
    # No pair with a smaller first cut suffices.
    pairs = [(low, high) for high in outer for low in heights if low < min(high, first)]
    assert pairs and not any(separated(low, high) for low, high in pairs)
    # Cuts are as small as three digits allow: the next smaller numbers fail.
    assert not separated(round_number(index_below(first) - 1), second)
    assert not separated(round_number(index_below(second) - 1), None)


# Invariances


@pytest.mark.parametrize(
    ("name", "requirement", "choices"),
    thinned(
        [
            ("large-triangles", Requirement(), [D16]),
            ("car", Requirement(), depth_buffers()),
            ("asymmetric-recentered", Requirement(tolerance_px=0.05), [D24]),
        ],
        3,
    ),
)
def test_refining_a_mesh_four_and_sixteen_times_leaves_the_plan(
    name: str, requirement: Requirement, choices: Sequence[DepthBuffer]
) -> None:
    scene = view(name, SMALL)
    whole, four, sixteen = (
        planned(traced(refine(scene, levels)), requirement, *choices) for levels in range(3)
    )
    assert whole == four == sixteen


def test_surfaces_behind_and_before_the_plate_count_equally() -> None:
    """Point reflection of tilted squares through the aperture exchanges C and C*."""
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


@pytest.mark.parametrize("name", thinned(["asymmetric-recentered", "car"], 2))
def test_a_harder_requirement_never_gives_fewer_slabs_or_else_a_larger_near(name: str) -> None:
    views = views_of(name)
    easier = Requirement(tolerance_px=2.0, separation=2.0, max_wrong=0.1)
    easily = planned(views, easier, D16)
    for harder in (
        [replace(easier, tolerance_px=px) for px in (0.5, 0.02)],
        [replace(easier, separation=d) for d in (0.5, 0.005)],
        [replace(easier, max_wrong=share) for share in (1e-2, 1e-3)],
    ):
        before = easily
        for requirement in harder:
            after = planned(views, requirement, D16)
            assert len(after.slabs) >= len(before.slabs)
            # If near equals the first cut, the first slab is empty, and nothing is displaced.
            if len(after.slabs) == len(before.slabs) and after.near not in after.slabs:
                assert after.near <= before.near
            before = after


# Lengths of three digits


@given(st.floats(1e-30, 1e30))
def test_rounding_down_to_three_digits(length: float) -> None:
    index = index_below(length)
    assert round_number(index) <= length < round_number(index + 1)
    assert float(f"{round_number(index):.3g}") == round_number(index)
    assert round_number(index + 900) == pytest.approx(10 * round_number(index), rel=1e-15)
    assert round_number(index_below(round_number(index), strictly=True)) == round_number(index - 1)


# Depth buffers


def test_a_separation_that_no_float_resolves_leaves_no_plan() -> None:
    views = views_of("asymmetric")
    outcome = Search(views, Requirement(separation=1e-6, choices=(D16, FINE))).best()
    assert outcome.best is None and not outcome.able


@pytest.mark.slow
def test_the_cheapest_sufficient_depth_buffer_is_chosen() -> None:
    views = views_of("car")
    best = Search(views, Requirement()).best().best
    assert (best.settings.depth, best.settings.mapping) == (DepthFormat.D24, DepthMapping.REVERSED)
    # Depth that fragments write needs no cut in 16 bits: fewer slabs rank before cheaper buffers.
    sixteen = Search(views, Requirement(choices=depth_buffers(DepthFormat.D16))).best().best
    assert sixteen.settings.slabs == () and sixteen.settings.mapping is DepthMapping.LOGARITHMIC


def test_a_depth_buffer_orders_sheets_from_its_smallest_near_on() -> None:
    views, requirement = views_of("asymmetric-recentered"), Requirement()
    coarse, usual, fine = (buffer_limit(views, requirement, buffer) for buffer in COMPARED_BUFFERS)
    assert coarse.smallest_near is not None and usual.smallest_near is not None and fine.any_near
    assert coarse.smallest_near > 10 * usual.smallest_near

    def keeps(near: float) -> bool:
        settings = DoubleFrustum(near=near, depth=coarse.depth, mapping=coarse.mapping)
        allowed = requirement.separation_in(views.scene.frustum) / SEPARATION_MARGIN
        ordered = views.separation(settings) <= allowed
        return ordered and views.depth_wrong(settings) <= requirement.max_wrong

    assert keeps(coarse.smallest_near) and not keeps(coarse.smallest_near / 1.01)
