"""The suite of hard cases: the truth is as expected, and no answer ever breaks down."""

import json
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.support.exact_brute_force import exact_pixels
from tests.support.long_tail import thinned
from tests.support.views import lines_by_definition
from xfrustum.compare.attribution.budget import explain
from xfrustum.compare.metrics.comparison import compare_images
from xfrustum.raster import Rasterizer
from xfrustum.reference import Reference
from xfrustum.scenes import (
    NOTHING,
    Certainty,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    HogelImage,
    InputError,
    Scene,
    open_scene,
)
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.library import hard_cases as hard

Index = tuple[int, int]
MIDDLE: Index = (2, 2)
SMALL = hard_cases.names(giants=False)


@cache
def scene_of(name: str) -> Scene:
    """Return the scene of a hard case."""
    return open_scene(name)


@cache
def truth_of(name: str, aperture: Index = MIDDLE) -> HogelImage:
    """Return the true image of an aperture, column and row."""
    scene = scene_of(name)
    return Reference(scene).trace(scene.plate.aperture(*aperture))


def companions_of(image: HogelImage) -> dict[Index, list[int]]:
    """Return the triangles of every tie in ascending order, by row and column."""
    assert image.tied_triangles is not None
    ties: dict[Index, list[int]] = defaultdict(list)
    for row, column, triangle in image.tied_triangles.tolist():
        ties[row, column].append(triangle)
    return {index: sorted(triangles) for index, triangles in ties.items()}


def pixel_grid(name: str) -> tuple[Indices, Indices]:
    """Return column and row of every pixel, (H, W) each."""
    width, height = scene_of(name).frustum.resolution
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    return columns, rows


def slopes(name: str, aperture: Index = MIDDLE) -> tuple[Floats, Floats]:
    """Return dx and dy of every pixel's line, (H, W) each."""
    scene = scene_of(name)
    d = lines_by_definition(scene, scene.plate.aperture(*aperture))
    return d[..., 0], d[..., 1]


VIEWS = [
    pytest.param(name, aperture, id=f"{name}-{aperture[0]},{aperture[1]}")
    for name in SMALL
    for aperture in hard_cases.CASES[name].apertures
]
DEPTHS = ((DepthFormat.D24, DepthMapping.STANDARD), (DepthFormat.D32F, DepthMapping.REVERSED))
NEARS = (1e-3, 1e-6)
"""Near offsets as fractions of the reach."""

LINE_ROUNDING = 4 * 2.0**-53
"""Two roundings in a coordinate a + s d of a surface point, relative to its terms, doubled."""

KIB, GIB = 1 << 10, 1 << 30
CHECKED_EXACTLY = 60
"""Pixels of each class that rational arithmetic decides again."""


def test_every_case_is_documented_listed_and_opened_by_its_name() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "hard-cases.md").read_text()
    listed = {entry.name: entry for entry in hard_cases.listing()}
    assert list(listed) == hard_cases.names()
    assert not set(listed) & set(builtin.names())
    for name, case in hard_cases.CASES.items():
        assert f"`{name}`" in page
        assert case.purpose and case.expected and "\n" not in case.purpose + case.expected
    for name in SMALL:
        assert scene_of(name).source == scene_of(name).name == name
        assert listed[name].triangles == len(scene_of(name).faces)
        assert scene_of(name).content_hash == hard_cases.build(name).content_hash
    with pytest.raises(InputError, match="did you mean hard/needles"):
        open_scene("hard/needle")


@pytest.mark.parametrize(("name", "aperture"), VIEWS)
def test_the_truth_is_finite_and_consistent(name: str, aperture: Index) -> None:
    scene, image = scene_of(name), truth_of(name, aperture)
    assert image.normal is not None and image.color is not None
    assert image.certainty is not None and image.tied_triangles is not None
    shown = image.triangle != NOTHING
    np.testing.assert_array_equal(image.covered, shown)
    assert np.isfinite(image.position[shown]).all() and np.isnan(image.position[~shown]).all()
    np.testing.assert_allclose(np.linalg.norm(image.normal[shown], axis=-1), 1.0, rtol=1e-12)
    assert np.isnan(image.normal[~shown]).all()
    assert np.isfinite(image.color).all() and not image.color[~shown].any()
    np.testing.assert_array_equal(
        image.object[shown], scene.object_of_triangle[image.triangle[shown]]
    )
    assert (image.object[~shown] == NOTHING).all()
    viewer, back = scene.frustum.reach
    assert (image.height[shown] <= viewer).all() and (image.height[shown] >= -back).all()

    assert not (image.certainty == Certainty.UNEXAMINED).any()
    ties = companions_of(image)
    assert sorted(ties) == [
        tuple(index) for index in np.argwhere(image.certainty == Certainty.TIE).tolist()
    ]
    for (row, column), triangles in ties.items():
        assert len(set(triangles)) == len(triangles) >= 2
        assert image.triangle[row, column] == min(triangles)
    # Every surface point lies on the line of its pixel.
    where = scene.plate.aperture(*aperture)
    center = np.array([where.x, where.y, 0.0])
    along = -image.height[..., None] * lines_by_definition(scene, where)
    off = np.abs(image.position - (center + along))[shown]
    assert (off <= LINE_ROUNDING * (np.abs(center) + np.abs(along[shown]))).all()


@pytest.mark.parametrize(("name", "aperture"), thinned((view.values for view in VIEWS), 7))
def test_rational_arithmetic_agrees(name: str, aperture: Index) -> None:
    scene, image = scene_of(name), truth_of(name, aperture)
    assert image.certainty is not None
    random = np.random.default_rng(5)
    classes = [np.flatnonzero(image.certainty.ravel() == kind) for kind in Certainty]
    pixels = np.concatenate([random.permutation(members)[:CHECKED_EXACTLY] for members in classes])
    ties = companions_of(image)
    for pixel, exact in zip(
        pixels.tolist(), exact_pixels(scene, scene.plate.aperture(*aperture), pixels), strict=True
    ):
        row, column = divmod(pixel, scene.frustum.resolution[0])
        assert image.triangle[row, column] == min(exact.winners, default=NOTHING), (row, column)
        assert -image.height[row, column] == pytest.approx(exact.s, rel=1e-12, abs=0, nan_ok=True)
        expected = exact.winners if len(exact.winners) > 1 else []
        assert ties.get((row, column), []) == expected, (row, column)


def bits(image: HogelImage) -> list[bytes]:
    assert image.normal is not None and image.color is not None
    return [
        a.tobytes()
        for a in (image.triangle, image.object, image.position, image.normal, image.color)
    ]


@pytest.mark.parametrize("name", thinned(SMALL, 9))
def test_the_rasterizer_is_finite_explained_and_the_same_from_run_to_run(name: str) -> None:
    scene = scene_of(name)
    reference = Reference(scene)
    with Rasterizer(scene) as rasterizer, Rasterizer(scene) as other:
        for aperture in hard_cases.CASES[name].apertures:
            where = scene.plate.aperture(*aperture)
            for near in NEARS:
                for depth, mapping in DEPTHS:
                    settings = DoubleFrustum(
                        near=near * scene.frustum.longest_reach, depth=depth, mapping=mapping
                    )
                    drawn = rasterizer.render(where, settings)
                    shown = drawn.triangle != NOTHING
                    assert np.isfinite(drawn.position[shown]).all()
                    assert drawn.color is not None and np.isfinite(drawn.color).all()
                    assert bits(drawn) == bits(other.render(where, settings))
                    judged = compare_images(truth_of(name, aperture), drawn, reference)
                    json.dumps(judged.summary(), allow_nan=False)
                    model = reference.trace_model(where, settings)
                    explained = explain(scene, model, drawn, rasterizer.model)
                    assert not explained.unexplained.any(), (aperture, settings)


def peak_memory(work: str) -> int:
    """Return the largest memory, bytes, that a process of its own needed for some work."""
    # Not ru_maxrss: a program begins with the value of its parent process.
    measured = f"{work}\nfrom pathlib import Path\nprint(Path('/proc/self/status').read_text())"
    done = subprocess.run(
        [sys.executable, "-c", measured], capture_output=True, text=True, check=True
    )
    peak = re.search(r"VmHWM:\s*(\d+) kB", done.stdout)
    assert peak, done.stdout
    return int(peak[1]) * KIB


BYTES_PER_TRIANGLE = 512
"""Largest memory, bytes: with two triangles a vertex, 132 stay: vertices 12, faces 24, corners 72,
normals 24.

Making the normals takes about as much again three times over. An image adds hardly any.
"""


GIANTS = {
    "hard/giant-mesh": (
        "image = Reference(scene).trace(scene.plate.middle)\n"
        "assert image.covered.all() and -69 < image.height.min() and image.height.max() < -51\n"
        "assert (image.certainty == Certainty.PROVEN).mean() > 0.999\n",
        BYTES_PER_TRIANGLE * 10_000_000,
    ),
    "hard/giant-image": (
        "bands = list(\n"
        "(len(band.triangle), int(band.covered.sum()), int((band.certainty != 0).sum()))\n"
        "    for band in Reference(scene).trace_bands(scene.plate.middle))\n"
        "rows, covered, unproven = map(sum, zip(*bands))\n"
        "assert rows == 8192 and 0.2 < covered / 8192**2 < 0.9 and unproven < 1e-3 * 8192**2\n",
        3 * GIB,
    ),
}
"""Assertions about each giant, and the largest memory that it may take, bytes."""


@pytest.mark.slow
@pytest.mark.parametrize("name", GIANTS)
def test_giants_are_traced_in_bounded_memory(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    program, limit = GIANTS[name]
    needed = peak_memory(
        "from xfrustum.reference import Reference\n"
        "from xfrustum.scenes import Certainty, open_scene\n"
        f"scene = open_scene({name!r})\n"
        f"assert len(scene.faces) == {hard_cases.CASES[name].triangles}\n{program}"
    )
    record_property("peak_gib", needed / GIB)
    assert needed < limit


# Each hard case shows its closed form, pixel by pixel.


def certain(image: HogelImage, kind: Certainty) -> Mask:
    assert image.certainty is not None
    return np.asarray(image.certainty == kind)


def inside(values: Indices, limits: tuple[float, float]) -> Mask:
    return np.asarray((values > limits[0]) & (values < limits[1]))


@pytest.mark.parametrize(("part", "columns"), [(0, (2, 30)), (1, (34, 62))])
def test_lines_through_vertices_and_edges_meet_all_triangles_there(
    part: int, columns: Index
) -> None:
    """In the image the sheet is a grid of squares cut along one diagonal, whatever its depths."""
    name, rows = "hard/vertices-and-edges", (2, 58)
    image, ties = truth_of(name), companions_of(truth_of(name))
    column, row = pixel_grid(name)
    sheet = (column >= columns[0]) & (column <= columns[1]) & (row >= rows[0]) & (row <= rows[1])
    assert (image.object[sheet] == part).all(), "no crack"
    assert image.covered.sum() == 2 * sheet.sum()
    across, down = (column - columns[0]) % hard.GRID_STEP, (row - rows[0]) % hard.GRID_STEP
    expected = np.where((across == 0) | (down == 0) | (across == down), 2, 1)
    expected[(across == 0) & (down == 0)] = 6
    interior = inside(column, columns) & inside(row, rows)
    counts = np.ones_like(column)
    for index, triangles in ties.items():
        counts[index] = len(triangles)
    np.testing.assert_array_equal(counts[interior], expected[interior])
    assert (certain(image, Certainty.PROVEN) == (expected == 1))[interior].all()


def test_the_outline_of_a_triangle_belongs_to_it() -> None:
    image = truth_of("hard/closed-edges")
    column, row = pixel_grid("hard/closed-edges")
    first = (column >= 8) & (row >= 8) & (column + row <= 48)
    second = (column <= 60) & (row <= 60) & (column + row >= 96)
    outline = first & ((column == 8) | (row == 8) | (column + row == 48))
    outline |= second & ((column == 60) | (row == 60) | (column + row == 96))
    np.testing.assert_array_equal(image.triangle, np.where(first, 0, np.where(second, 1, NOTHING)))
    np.testing.assert_array_equal(certain(image, Certainty.EXACT), outline)
    np.testing.assert_array_equal(certain(image, Certainty.PROVEN), ~outline)
    for (r, c), depth in {(8, 8): 32.0, (8, 40): 64.0, (40, 8): 48.0, (60, 60): -32.0}.items():
        assert image.height[r, c] == -depth


def test_a_surface_through_the_aperture_is_met_there_but_by_the_lines_that_lie_in_it() -> None:
    image = truth_of("hard/surface-through-aperture")
    column, _ = pixel_grid("hard/surface-through-aperture")
    in_surface = column == hard.THROUGH_COLUMN
    np.testing.assert_array_equal(image.triangle, np.where(in_surface, 1, 0))
    np.testing.assert_array_equal(image.height, np.where(in_surface, -100.0, 0.0))
    np.testing.assert_array_equal(certain(image, Certainty.EXACT), in_surface)
    assert (image.position[~in_surface] == 0).all()


def test_every_line_through_the_tip_of_a_pyramid_is_a_tie_of_its_sides() -> None:
    image = truth_of("hard/vertex-on-aperture")
    assert certain(image, Certainty.TIE).all()
    assert (image.position == 0).all()
    assert set(map(tuple, companions_of(image).values())) == {(0, 1, 2, 3)}
    control = truth_of("hard/vertex-on-aperture", (3, 2))
    assert certain(control, Certainty.PROVEN).all()
    assert (control.height[control.covered] < 0).all()


def test_an_edge_through_the_aperture_is_a_tie_but_for_lines_in_either_side() -> None:
    image = truth_of("hard/edge-through-aperture")
    column, row = pixel_grid("hard/edge-through-aperture")
    in_first, in_second = row == hard.THROUGH_ROW, column == hard.THROUGH_COLUMN
    expected = np.where(in_first, np.where(in_second, 2, 1), 0)
    np.testing.assert_array_equal(image.triangle, expected)
    np.testing.assert_array_equal(image.height, np.where(expected == 2, -100.0, 0.0))
    np.testing.assert_array_equal(certain(image, Certainty.TIE), ~(in_first | in_second))
    assert set(map(tuple, companions_of(image).values())) == {(0, 1)}


IN_PLATE = {"inside": (1, 3), "on an edge": (2, 2), "on a corner": (0, 4), "beside": (3, 1)}


@pytest.mark.parametrize("place", IN_PLATE)
def test_a_triangle_in_the_plate_is_met_wherever_it_holds_the_aperture(place: str) -> None:
    image = truth_of("hard/triangle-in-plate", IN_PLATE[place])
    met = place != "beside"
    assert (image.triangle == (0 if met else 1)).all() and (
        image.height == (0 if met else -100)
    ).all()
    assert not certain(image, Certainty.TIE).any()


@pytest.mark.parametrize(("name", "times"), [("hard/coincident-copies", 2), ("hard/duplicates", 3)])
def test_copies_tie_with_each_other_and_show_the_first(name: str, times: int) -> None:
    image, once = truth_of(name), len(scene_of(name).faces) // times
    np.testing.assert_array_equal(certain(image, Certainty.TIE), image.covered)
    assert image.covered.sum() > 1000
    for pixel, triangles in companions_of(image).items():
        first = [t for t in triangles if t < once]
        assert triangles == [t + k * once for k in range(times) for t in first]
        assert image.triangle[pixel] == first[0]


def test_the_same_plane_in_other_triangles_ties_everywhere() -> None:
    name = "hard/coincident-other-triangles"
    image = truth_of(name)
    dx, dy = slopes(name)
    s = 64 / (1 + dx / 4 + dy / 8)
    covered = np.maximum(np.abs(dx), np.abs(dy)) * s <= 24
    np.testing.assert_array_equal(image.covered, covered)
    np.testing.assert_array_equal(certain(image, Certainty.TIE), covered)
    np.testing.assert_allclose(-image.height[covered], s[covered], rtol=1e-14)
    assert (image.object[covered] == 0).all()
    for triangles in companions_of(image).values():
        assert min(triangles) < 2 <= max(triangles)


def test_the_upper_of_nearly_coincident_sheets_shows_down_to_one_step_of_a_double() -> None:
    name = "hard/nearly-coincident"
    image = truth_of(name)
    column, row = pixel_grid(name)
    some = np.zeros_like(image.covered)
    for index in range(len(hard.SEPARATIONS) + 1):
        for rows in hard.SHEET_ROWS:
            cell = inside(column, hard.sheet_columns(index)) & inside(row, rows)
            assert (image.object[cell] == 1).all(), (index, rows)
            last = index == len(hard.SEPARATIONS)
            assert certain(image, Certainty.EXACT if last else Certainty.PROVEN)[cell].all()
            some |= cell
    np.testing.assert_array_equal(image.covered, some)


def test_the_reach_is_closed() -> None:
    image = truth_of("hard/at-the-reach")
    column, row = pixel_grid("hard/at-the-reach")
    behind, in_front = (
        inside(column, hard.AT_REACH[0]) & inside(row, rows) for rows in hard.AT_REACH
    )
    np.testing.assert_array_equal(image.covered, behind | in_front)
    assert (image.height[behind] == -hard.REACH).all() and (
        image.height[in_front] == hard.REACH
    ).all()
    assert (image.object[image.covered] == 0).all()


@pytest.mark.parametrize("name", ["hard/nothing", "hard/only-out-of-reach"])
def test_where_nothing_is_in_reach_nothing_shows_and_that_is_proven(name: str) -> None:
    image = truth_of(name)
    assert not image.covered.any()
    assert certain(image, Certainty.PROVEN).all()


@pytest.mark.parametrize(("name", "side"), [("hard/only-in-front", 1), ("hard/only-behind", -1)])
def test_one_side_alone_shows_alone(name: str, side: int) -> None:
    heights = truth_of(name).height[truth_of(name).covered]
    # The nearest and the farthest point of a ball about height 50 of radius 12, and 1 % of facets.
    assert len(heights) > 500 and (np.abs(side * heights - 50) < 12.1).all()
    assert (side * (heights - side * 50)).mean() * side > 0, "the side turned to the viewer"


def test_an_edge_on_triangle_covers_nothing_and_one_turned_by_a_step_of_a_double_its_column() -> (
    None
):
    image = truth_of("hard/edge-on")
    column, _ = pixel_grid("hard/edge-on")
    _, dy = slopes("hard/edge-on")
    turned = (column == hard.TURNED_COLUMN) & (
        np.abs(dy) * hard.TURNED_MIDDLE <= hard.TURNED_HALF_HEIGHT
    )
    assert turned.sum() == 26
    np.testing.assert_array_equal(image.triangle, np.where(turned, 1, 2))
    np.testing.assert_array_equal(image.height, np.where(turned, -hard.TURNED_MIDDLE, -100.0))
    assert not certain(image, Certainty.TIE).any()


def test_needles_cover_exactly_the_pixel_centers_that_they_run_over() -> None:
    image = truth_of("hard/needles")
    expected = np.full(image.triangle.shape, NOTHING)
    expected[4:61, 20] = 0
    expected[np.arange(4, 33), np.arange(30, 59)] = 2
    expected[44, 4:61] = 3  # in front of the first
    np.testing.assert_array_equal(image.triangle, expected)
    assert not certain(image, Certainty.TIE).any()


def test_triangles_without_area_are_not_there() -> None:
    image = truth_of("hard/zero-area")
    scene = scene_of("hard/zero-area")
    assert (image.triangle == len(scene.faces) - 1).all()
    assert (image.height == -100).all()
    assert not certain(image, Certainty.TIE).any()


def test_the_smallest_sheets_hide_each_other_and_the_wall() -> None:
    image = truth_of("hard/smallest")
    expected = np.full(image.triangle.shape, 2)
    expected[4:61, 4:41], expected[12:53, 20:57] = 0, 1
    np.testing.assert_array_equal(image.object, expected)
    np.testing.assert_array_equal(
        image.height, np.choose(expected, [-2 * hard.SMALLEST, -hard.SMALLEST, -100.0])
    )


@pytest.mark.parametrize(
    ("name", "scale"),
    [("hard/far-from-origin", 1.0), *((f"hard/{k}", s) for k, s in hard.SCALES.items())],
)
@pytest.mark.parametrize("aperture", [(40, 30), (12, 50)])
def test_neither_place_in_the_file_nor_size_moves_a_bit(
    name: str, scale: float, aperture: Index
) -> None:
    scene, parts = scene_of(name), hard.asymmetric_on_a_grid()
    plain = Scene(
        name="near", plate=hard.ASYMMETRIC_PLATE, frustum=hard.ASYMMETRIC_FRUSTUM, objects=parts
    )
    where = plain.plate.aperture(*aperture)
    expected, image = Reference(plain).trace(where), truth_of(name, aperture)
    assert expected.covered.sum() > 500
    np.testing.assert_array_equal(image.triangle, expected.triangle)
    np.testing.assert_array_equal(image.position, expected.position * scale)
    np.testing.assert_array_equal(image.certainty, expected.certainty)
    settings = DoubleFrustum(near=1e-3 * 150)
    with Rasterizer(plain) as near, Rasterizer(scene) as other:
        drawn = near.render(where, settings)
        same = other.render(
            scene.plate.aperture(*aperture), replace(settings, near=settings.near * scale)
        )
    np.testing.assert_array_equal(same.triangle, drawn.triangle)
    np.testing.assert_array_equal(same.position, drawn.position * np.float32(scale))


@pytest.mark.parametrize(
    "name", ["hard/steep", "hard/screen-near-plate", "hard/screen-near-plate-in-front"]
)
@pytest.mark.parametrize("aperture", [MIDDLE, (0, 3)])
def test_a_box_about_the_aperture_is_met_where_each_line_enters_it(
    name: str, aperture: Index
) -> None:
    """Lines end at the first of the planes x = +-24, y = +-24 and z = 20 toward the viewer."""
    image = truth_of(name, aperture)
    where = scene_of(name).plate.aperture(*aperture)
    dx, dy = slopes(name, aperture)
    ways = [
        (half + center * np.sign(d)) / np.abs(d)
        for half, center, d in zip(hard.ROOM[:2], (where.x, where.y), (dx, dy), strict=True)
    ]
    np.testing.assert_allclose(
        image.height, np.minimum(np.minimum(*ways), hard.ROOM[2]), rtol=1e-14
    )
    if name == "hard/steep":
        assert 11 < np.abs(dx).max() < 11.5
    else:
        assert image.height.max() < 1e-6


def test_a_screen_in_front_shears_the_other_way_and_from_the_middle_not_at_all() -> None:
    behind, in_front = "hard/screen-near-plate", "hard/screen-near-plate-in-front"
    np.testing.assert_array_equal(truth_of(in_front).triangle, truth_of(behind).triangle)
    np.testing.assert_array_equal(truth_of(in_front).position, truth_of(behind).position)
    camera, other = truth_of(in_front, (0, 3)).camera, truth_of(behind, (0, 3)).camera
    assert camera.shear == (-other.shear[0], -other.shear[1]) != (0.0, 0.0)
    assert camera.half_extent == other.half_extent


def test_the_picture_on_the_screen_fills_every_aperture_alike() -> None:
    name = "hard/sheared-five-screens"
    scene, middle = scene_of(name), truth_of(name)
    column, row = pixel_grid(name)
    half = hard.SHEARED_SCREEN.size[0] / 2
    x, y = half * ((2 * column + 1) / 64 - 1), half * (1 - (2 * row + 1) / 64)
    hole = (np.abs(x + 2.5) < 2.5) & (np.abs(y + 2.5) < 2.5)
    assert hole.sum() == 256
    for aperture in hard.CASES[name].apertures:
        image = truth_of(name, aperture)
        np.testing.assert_array_equal(image.triangle, middle.triangle)
        np.testing.assert_array_equal(image.certainty, middle.certainty)
        np.testing.assert_array_equal(
            image.height, np.where(hole, -90.0, hard.SHEARED_SCREEN.height)
        )
        np.testing.assert_array_equal(image.position[~hole][:, 0], x[~hole])
        np.testing.assert_array_equal(image.position[~hole][:, 1], y[~hole])
    shear = truth_of(name, (0, 0)).camera
    assert abs(shear.shear[0]) == 10 * shear.half_extent[0], "five widths of the screen"
    assert (image.object[hole] == len(scene.objects) - 1).all()


def test_one_pixel_is_a_tie_along_the_diagonal_of_the_box() -> None:
    image = truth_of("hard/one-pixel")
    assert image.triangle.shape == (1, 1) and image.height[0, 0] == -32
    assert certain(image, Certainty.TIE).all()
    assert len(companions_of(image)[0, 0]) == 2
