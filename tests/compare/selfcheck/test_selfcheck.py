"""The self-check: integers agree with fractions, and reveal every defect put into a truth."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.brute_force import exact_first
from tests.support.long_tail import examples
from tests.support.strategies import ANYTHING, apertures, coincidences, frusta, triangles
from tests.support.views import at, soup
from xfrustum.compare import selfcheck as module
from xfrustum.compare.rational import ExactRows, first_by_brute_force
from xfrustum.compare.selfcheck import (
    DirectionCheck,
    ImageLines,
    SelfCheck,
    check_directions,
    check_sphere,
    disagreements,
    first_from_center,
    selfcheck,
)
from xfrustum.reference import Reference
from xfrustum.reference.lines import RayBundle, crossed_frustum
from xfrustum.reference.rays.rays import FirstHits
from xfrustum.reports.text import selfcheck_table
from xfrustum.scenes import (
    NOTHING,
    Aperture,
    Certainty,
    Frustum,
    HogelImage,
    InputError,
    Scene,
    Screen,
)
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.library import hard_cases
from xfrustum.scenes.library.builtin import names
from xfrustum.scenes.model.images import DirectionImage

several = examples(20)

SQUARE = Frustum(
    resolution=(8, 8),
    reach=(8.0, 8.0),
    screen=Screen(height=-4.0, center=(0.0, 0.0), size=(8.0, 8.0)),
)
"""Film whose lines have the odd multiples of 1/8 as slopes."""


def all_rows(corners: Floats, frustum: Frustum, aperture: Aperture) -> tuple[ExactRows, RayBundle]:
    bundle = crossed_frustum(frustum, aperture)
    return first_by_brute_force(corners, bundle, range(bundle.resolution[1])), bundle


def assert_decided_as_by_fractions(corners: Floats, frustum: Frustum, aperture: Aperture) -> None:
    """Compare integers with Cramer's rule in fractions, for every triangle and line."""
    decided, bundle = all_rows(corners, frustum, aperture)
    ties: dict[tuple[int, int], list[int]] = {}
    for row, column, number in decided.ties.tolist():
        ties.setdefault((row, column), []).append(number)
    for (row, column), triangle in np.ndenumerate(decided.triangle):
        d = bundle.directions()[row, column]
        s, winners = exact_first(corners, np.array(bundle.center), d, bundle.s_range)
        assert triangle == (winners[0] if winners else NOTHING)
        assert ties.get((row, column), []) == (winners if len(winners) > 1 else [])
        np.testing.assert_equal(decided.s[row, column], np.nan if s is None else float(s))


@several
@given(triangles(coordinates=ANYTHING), frusta(), apertures())
def test_integers_decide_as_fractions_do(
    corners: Floats, frustum: Frustum, aperture: Aperture
) -> None:
    assert_decided_as_by_fractions(corners, frustum, aperture)


@several
@given(st.data(), frusta(exact=True), apertures())
def test_integers_decide_coincidences_as_fractions_do(
    data: st.DataObject, frustum: Frustum, aperture: Aperture
) -> None:
    bundle = crossed_frustum(frustum, aperture)
    lines = bundle.directions().reshape(-1, 3)
    corners = data.draw(coincidences(np.array(bundle.center), lines))
    assert_decided_as_by_fractions(corners, frustum, aperture)


@pytest.mark.slow
def test_a_part_of_the_self_check_agrees() -> None:
    """The views include all kinds of scenes, and pixels with ties, exact decisions and proofs."""
    check = selfcheck(quick=True)
    assert check.agrees and check.total("wrong") == 0, selfcheck_table(check)
    scenes = {view.scene for view in check.views}
    assert scenes >= {*names(), *hard_cases.names(giants=False)}
    assert scenes == {each.scene for each in check.directions}
    pixels, covered, *decided = map(check.total, ("pixels", "covered", "proven", "exact", "ties"))
    assert pixels >= 60_000 and covered > pixels / 3 and sum(decided) == pixels
    assert min(*decided, check.total("tracer_wrong")) > 0
    assert sum(each.pixels for each in check.directions) > 1000
    assert check.summary()["direction_open"] > 50
    assert check.sphere is not None and check.sphere.triangles == 5120
    assert json.loads(json.dumps(check.summary(), allow_nan=False))["agrees"] is True


def small_scene() -> Scene:
    """Return two sheets, one a quarter of the film before the other, and a duplicate triangle."""
    back = np.array(
        [[[-9, -9, -4], [9, -9, -4], [9, 9, -4]], [[-9, -9, -4], [9, 9, -4], [-9, 9, -4]]],
        dtype=float,
    )
    front = back / 4 + [2.1, 2.2, -1.0]
    return soup(np.concatenate((back, front, front[:1])), SQUARE)


def with_class(old: Certainty, new: Certainty) -> Callable[[HogelImage], HogelImage]:
    return lambda image: replace(
        image, certainty=np.where(image.certainty == old, np.uint8(new), image.certainty)
    )


def with_triangle(new: int) -> Callable[[HogelImage], HogelImage]:
    return lambda image: replace(
        image, triangle=np.where(image.triangle == 0, np.int32(new), image.triangle)
    )


SPOILED: dict[str, tuple[str, Callable[[HogelImage], HogelImage]]] = {
    "another triangle": ("triangle", with_triangle(1)),
    "nothing": ("triangle", with_triangle(NOTHING)),
    "a tie not called one": ("certainty", with_class(Certainty.TIE, Certainty.EXACT)),
    "a proof called a tie": ("certainty", with_class(Certainty.PROVEN, Certainty.TIE)),
    "pixels not examined": ("certainty", with_class(Certainty.PROVEN, Certainty.UNEXAMINED)),
    "a tied triangle lost": (
        "companions",
        lambda image: replace(image, tied_triangles=image.tied_triangles[1:]),
    ),
    "a position off by 1e-13": (
        "position",
        lambda image: replace(image, position=image.position * (1 + 1e-13)),
    ),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_every_spoiled_truth_disagrees(kind: str) -> None:
    about, spoil = SPOILED[kind]
    scene, aperture = small_scene(), at(0, 0)
    image = Reference(scene).trace(aperture)
    exact, bundle = all_rows(scene.triangles, scene.frustum, aperture)
    lines = ImageLines.from_bundle(bundle)
    wrong, listed = disagreements(image, exact, lines, scene.triangles)
    assert not wrong.any() and listed == ()
    wrong, listed = disagreements(spoil(image), exact, lines, scene.triangles)
    assert wrong.any()
    assert {finding.about for finding in listed} >= {about}
    assert all(
        wrong[finding.row, finding.column] and finding.expected != finding.got for finding in listed
    )


def test_a_reference_that_believes_its_tracer_fails_the_self_check(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In float32, the tracer returns coinciding or nearly coinciding sheets in either order."""

    class Believer(Reference):
        def trace(self, *args: Any, **options: Any) -> HogelImage:
            image = super().trace(*args, **options)
            return replace(
                image, triangle=np.where(image.overruled, image.triangle + 1, image.triangle)
            )

    monkeypatch.setattr(module, "Reference", Believer)
    check = selfcheck(["hard/nearly-coincident"], quick=True, processes=1)
    assert not check.agrees
    assert check.total("wrong") == check.total("tracer_wrong") > 0
    assert 0 < len(check.views[0].disagreements) <= 5
    assert "DISAGREE" in selfcheck_table(check)


def by_direction(spoil: Callable[[DirectionImage], DirectionImage]) -> DirectionCheck:
    """Check spoiled images by direction on ties, open pixels and plain pixels."""

    class Spoiled(Reference):
        def by_directions(self, *args: Any, **chosen: Any) -> Iterator[DirectionImage]:
            return map(spoil, super().by_directions(*args, **chosen))

    scene = small_scene()
    return check_directions("small", scene, scene.plate.middle, Spoiled, quick=True)


def test_truths_by_direction_agree_with_hogels_and_integers() -> None:
    check = by_direction(lambda image: image)
    assert (check.columns, check.rows, check.directions) == ((6, 10), (7, 9), 6)
    assert check.pixels == 6 * 15 and 0 < check.open < check.pixels
    assert check.differing == check.wrong == 0 and check.disagreements == ()


SPOILED_DIRECTIONS: dict[str, tuple[str, Callable[[DirectionImage], DirectionImage]]] = {
    "the next hogel": ("position", lambda i: replace(i, position=np.roll(i.position, 1, axis=1))),
    "rows flipped": ("position", lambda i: replace(i, position=i.position[::-1])),
    "another triangle": ("triangle", lambda i: replace(i, triangle=i.triangle + np.int32(1))),
    "a tied triangle lost": (
        "companions",
        lambda i: replace(i, tied_triangles=i.tied_triangles[1:]),
    ),
}


@pytest.mark.parametrize("kind", SPOILED_DIRECTIONS)
def test_a_wrong_truth_by_direction_is_detected_twice(kind: str) -> None:
    about, spoil = SPOILED_DIRECTIONS[kind]
    check = by_direction(spoil)
    assert check.wrong > 0 and check.differing > 0
    assert about in {disagreement.about for disagreement in check.disagreements}
    whole = SelfCheck(views=(), directions=(check,), sphere=None, seconds=0.0)
    assert not whole.agrees and whole.summary()["direction_wrong"] == check.wrong


@pytest.mark.parametrize(
    "spoil",
    [
        lambda image: replace(image, position=np.nextafter(image.position, 9.0)),
        lambda image: replace(image, certainty=np.maximum(image.certainty, Certainty.EXACT)),
    ],
    ids=["positions", "certainty"],
)
def test_other_bits_than_by_hogel_differ(spoil: Callable[[DirectionImage], DirectionImage]) -> None:
    """Integers accept positions within the error bound, and `PROVEN` pixels as `EXACT` ones."""
    check = by_direction(spoil)
    assert check.differing > 0 and check.wrong == 0
    assert not SelfCheck(views=(), directions=(check,), sphere=None, seconds=0.0).agrees


@pytest.mark.slow
def test_processes_make_no_difference() -> None:
    serial, two = (selfcheck(["asymmetric"], quick=True, processes=n).views for n in (1, 2))
    assert [replace(v, seconds=0.0) for v in serial] == [replace(v, seconds=0.0) for v in two]


def test_a_giant_is_refused_with_its_reason() -> None:
    with pytest.raises(InputError, match="giant"):
        selfcheck(["hard/giant-mesh"])


def test_no_line_from_a_spheres_center_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trace through vertices and middles of edges; a vertex belongs only to its own triangles."""
    monkeypatch.setattr(module, "QUICK_SUBDIVISIONS", 3)
    check = check_sphere(quick=True)
    assert (check.triangles, check.vertices, check.edges) == (1280, 642, 1920)
    assert check.agrees


def test_a_sphere_with_a_hole_is_not_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines through the hole's vertices and edges still meet the triangles beside it."""

    def all_but_one(corners: Floats, directions: Floats) -> FirstHits:
        return first_from_center(corners[:-1], directions)

    monkeypatch.setattr(module, "first_from_center", all_but_one)
    monkeypatch.setattr(module, "QUICK_SUBDIVISIONS", 2)
    check = check_sphere(quick=True)
    assert not check.agrees
    assert check.wrong >= 3
