"""The study's other families: one thing changed in each, drawn, judged, and written down from the data."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CHECKOUT
from xfrustum.reference import Reference
from xfrustum.reports.splitting_study import families
from xfrustum.reports.splitting_study.document import document
from xfrustum.reports.splitting_study.figures import maps
from xfrustum.reports.splitting_study.grid import FAMILIES, FULL, Cell, Family, Grid, Picture
from xfrustum.reports.splitting_study.measure import CellResult, PictureWorkbench, seen_scene
from xfrustum.reports.splitting_study.rows import StudyRow, read_parquet
from xfrustum.reports.splitting_study.run import sheets_of
from xfrustum.reports.splitting_study.study import DATA, StudyFiles, make_study
from xfrustum.reports.splitting_study.suitability import case_of, outcomes
from xfrustum.reports.studies.origin import Origin
from xfrustum.scenes import Camera, DepthFormat, DepthMapping
from xfrustum.scenes.arrays import Numbers
from xfrustum.scenes.library.depth_family import REACH, balanced_height
from xfrustum.scenes.plate.double_frustum import Fit, Offset, Pivot
from xfrustum.tolerances import TOLERANCE_PX

PIXELS = 48

EXACT = (DepthFormat.D32F, DepthMapping.REVERSED)
STANDARD = (DepthFormat.D24, DepthMapping.STANDARD)


def picture(family: Family, ratio: float = 10.0) -> Picture:
    side = Camera.BOTH if family in {Family.BOTH_SIDES, Family.THROUGH} else Camera.C
    return Picture(family=family, side=side, ratio=ratio, resolution=PIXELS)


def triangles(shown: Picture) -> Numbers:
    seen = seen_scene(shown)
    return Reference(seen.scene).trace(seen.aperture).triangle


def cell(shown: Picture, near: float, **drawn: object) -> Cell:
    depth, mapping = EXACT
    return Cell(**vars(shown), near=near, depth=depth, mapping=mapping, **drawn)  # type: ignore[arg-type]


# The scenes.


def test_neither_a_shift_nor_a_shear_of_scene_and_frustum_changes_the_picture() -> None:
    """Up to rounding at edges, the aperture off the middle shows what the middle one shows of `cars`."""
    first = triangles(picture(Family.ONE_SIDE))
    assert (first >= 0).mean() > 0.3
    for family in (Family.OFF_MIDDLE, Family.RECENTERED):
        assert (triangles(picture(family)) != first).mean() < 1e-2


def test_the_middle_aperture_does_not_see_the_nearest_cars() -> None:
    nearest = []
    for family in (Family.IN_MIDDLE, Family.OFF_MIDDLE):
        seen = seen_scene(picture(family, 100.0))
        height = np.abs(Reference(seen.scene).trace(seen.aperture).height)
        nearest.append(float(np.nanmin(height)) / REACH)
    assert nearest[1] == pytest.approx(0.01, rel=0.1)
    assert nearest[0] > 5 * nearest[1]


@pytest.mark.parametrize("distance", [1e-2, 1e-4])
def test_an_aperture_beside_a_crossing_sees_surfaces_in_proportion_to_its_distance(distance: float) -> None:
    seen = seen_scene(picture(Family.THROUGH, 1 / distance))
    truth = Reference(seen.scene).trace(seen.aperture)
    heights = np.abs(truth.height[truth.covered]) / REACH
    assert 0.5 < heights.min() / distance < 2
    assert {-1.0, 1.0} == set(np.sign(truth.height[truth.covered]))


def test_a_fit_at_the_balanced_height_displaces_both_ends_alike() -> None:
    """To first order in n displacement goes with |1/|z| - 1/zf|."""
    for ratio in (1.5, 100.0):
        far = 0.999 * REACH
        fitted = 1 / balanced_height(ratio)
        assert ratio / far - fitted == pytest.approx(fitted - 1 / far)


def test_both_cameras_have_sheets_where_there_is_content_on_both_sides() -> None:
    both = cell(picture(Family.BOTH_SIDES), 1e-3)
    assert {one.side for one in sheets_of(both)} == {Camera.C, Camera.C_STAR}
    assert [one.side for one in sheets_of(replace(both, side=Camera.C))] == [Camera.C]


# What is measured.


def test_the_shear_about_the_cameras_moves_the_picture_further_by_what_the_closed_form_says() -> None:
    shown = picture(Family.RECENTERED)
    found: dict[Pivot, CellResult] = {}
    with PictureWorkbench(shown) as bench:
        for pivot in Pivot:
            found[pivot] = bench.measure(cell(shown, 1e-4, pivot=pivot))
    for one in found.values():
        assert one.displacement_p99 == pytest.approx(one.predicted_p99, rel=0.02)
    camera, aperture = (found[pivot].displacement_p99 for pivot in (Pivot.CAMERA, Pivot.APERTURE))
    assert camera is not None and aperture is not None
    # The farthest corner of the film is at u = v = 1, and k = t: twice as much there, nothing is beyond it.
    assert 1.2 < camera / aperture <= 2.0


def test_without_an_offset_nothing_moves_and_with_it_a_near_in_proportion_to_the_distance_is_needed() -> None:
    for distance in (1e-2, 1e-4):
        shown = picture(Family.THROUGH, 1 / distance)
        with PictureWorkbench(shown) as bench:
            large, small = (bench.measure(cell(shown, distance / step)) for step in (10, 1000))
            gap = bench.measure(cell(shown, distance / 10, offset=Offset.NONE))
        assert large.displacement_p99 is not None and large.displacement_p99 > TOLERANCE_PX
        assert large.outside > 0
        assert small.displacement_p99 is not None and small.displacement_p99 <= TOLERANCE_PX
        assert gap.displacement_p99 is not None and gap.displacement_p99 < 0.05
        assert gap.outside == 0


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> StudyFiles:
    grid = Grid(
        nears=(1e-2, 1e-4, 1e-6),
        buffers=(STANDARD, EXACT),
        resolutions=(PIXELS,),
        ratios=(10.0,),
        families=tuple(
            replace(one, ratios=one.ratios[1:2], resolutions=(PIXELS,), buffers=(STANDARD, EXACT))
            for one in FAMILIES
        ),
    )
    return make_study(tmp_path_factory.mktemp("families"), grid)


@pytest.mark.slow
def test_a_small_study_of_all_families_says_what_its_rows_say(tiny: StudyFiles) -> None:
    text = tiny.document.read_text(encoding="utf-8")
    for heading in ("Both sides at once", "Apertures off the middle", "Recentered frusta", "run through"):
        assert heading in text
    assert "when-to-split-families" in {path.stem for path in tiny.figures}
    for one in families.helps(tiny.rows):
        own = [
            a
            for case, a in outcomes(tiny.rows).items()
            if case.family is one.family
            and (case.pivot, case.fit, case.offset) == (Pivot.APERTURE, None, Offset.PLATE)
        ]
        assert one.cases == len(own)
        assert one.slabs == sum(a.slabs is not None for a in own)


# What is published.


@pytest.fixture(scope="module")
def published() -> tuple[tuple[StudyRow, ...], Origin]:
    return read_parquet(CHECKOUT / "docs" / DATA)


def test_the_published_data_have_every_family(published: tuple[tuple[StudyRow, ...], Origin]) -> None:
    measured = {(r.picture, r.near, r.buffer, r.pivot, r.fit, r.offset) for r in published[0] if not r.slabs}
    assert measured == {(c.picture, c.near, c.buffer, c.pivot, c.fit, c.offset) for c in FULL.cells()}


def test_a_shear_in_the_aperture_plane_moves_nothing(published: tuple[tuple[StudyRow, ...], Origin]) -> None:
    """With the paper's pivot a recentered frustum has the displacement of a centered one, near by near."""
    rows = [row for row in published[0] if _as_in_the_paper(row)]
    first = {
        (row.ratio, row.resolution, row.near, row.buffer): row
        for row in rows
        if row.family is Family.ONE_SIDE
    }
    compared = 0
    for row in rows:
        if row.family is Family.RECENTERED and row.depth_wrong == 0 and row.surface_wrong < row.judged / 100:
            centered = first[row.ratio, row.resolution, row.near, row.buffer]
            # A thousandth of a pixel is the rounding of 32-bit positions.
            assert row.displacement_p99 == pytest.approx(centered.displacement_p99, rel=0.01, abs=1e-3)
            compared += 1
    assert compared > 50


def test_the_nears_that_do_not_bend_beside_a_crossing_are_in_proportion_to_the_distance(
    published: tuple[tuple[StudyRow, ...], Origin],
) -> None:
    """A point at |z| moves by W/2 |u| n/(|z| + n): half a step of nears above and below the closed form."""
    found = families.through(published[0])
    assert found is not None
    (resolution,) = {row.resolution for row in published[0] if row.family is Family.THROUGH}
    for line in found.lines:
        if line.straight is not None:
            # |u| is at most sqrt(2), and the next near that was measured is sqrt(10) times as large.
            limit = math.sqrt(2) * TOLERANCE_PX * line.nearest / resolution
            assert line.straight >= limit / math.sqrt(10)
            assert line.straight <= 3 * math.sqrt(10) * limit
    steps = [line.straight for line in found.lines if line.straight is not None]
    assert steps == sorted(steps, reverse=True)


def test_what_helps_is_counted_in_the_rows(published: tuple[tuple[StudyRow, ...], Origin]) -> None:
    found = outcomes(published[0])
    for one in families.helps(published[0]):
        assert one.one_pair + one.failed == one.cases
        assert max(one.slabs, one.other_buffer, one.fit or 0, one.no_offset or 0) <= one.failed
    cases = {case_of(row) for row in published[0]}
    assert cases == found.keys()


def _as_in_the_paper(row: StudyRow) -> bool:
    drawn = (row.side, row.pivot, row.fit, row.offset, row.slabs)
    return drawn == (Camera.C, Pivot.APERTURE, None, Offset.PLATE, ())


@pytest.mark.slow
def test_rows_of_one_family_alone_give_a_document_too(
    published: tuple[tuple[StudyRow, ...], Origin], tmp_path: Path
) -> None:
    rows, origin = published
    first = [row for row in rows if row.family is Family.ONE_SIDE]
    assert "## Other scenes" not in document(first, origin)
    assert "when-to-split-families" not in maps(first)
    some = [row for row in rows if row.family in {Family.ONE_SIDE, Family.RECENTERED}]
    text = document(some, origin)
    assert "### Recentered frusta" in text
    assert "### Surfaces that run through the plate" not in text
    assert Fit.SCREEN in {row.fit for row in some}
