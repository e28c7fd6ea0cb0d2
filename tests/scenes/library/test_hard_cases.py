"""The suite of hard cases: truths are as expected, and reference and rasterizer never break."""

import json
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from tests.conftest import CHECKOUT
from tests.support.exact_brute_force import exact_pixels
from tests.support.images import assert_same
from tests.support.long_tail import thinned
from tests.support.views import lines_by_definition
from xfrustum.compare.attribution import explain
from xfrustum.compare.comparison import compare_images
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
from xfrustum.scenes.arrays import Indices, Mask
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
    """Return the true image of an aperture, given by column and row."""
    scene = scene_of(name)
    return Reference(scene).trace(scene.plate.aperture(*aperture))


class View:
    """The truth of an aperture, with column, row, line slopes and ties of its pixels."""

    def __init__(self, name: str, aperture: Index = MIDDLE) -> None:
        self.image, scene = truth_of(name, aperture), scene_of(name)
        self.row, self.column = np.indices(self.image.triangle.shape, dtype=np.int64)
        self.where = scene.plate.aperture(*aperture)
        self.lines = lines_by_definition(scene, self.where)
        self.dx, self.dy, _ = np.moveaxis(self.lines, 2, 0)
        assert self.image.tied_triangles is not None
        #: ascending triangles of each tie, by row and column
        self.ties: dict[Index, list[int]] = defaultdict(list)
        for row, column, triangle in sorted(self.image.tied_triangles.tolist()):
            self.ties[row, column].append(triangle)


equal = np.testing.assert_array_equal

VIEWS = [
    pytest.param(name, aperture, id=f"{name}-{aperture[0]},{aperture[1]}")
    for name in SMALL
    for aperture in hard_cases.CASES[name].apertures
]
DEPTHS = ((DepthFormat.D24, DepthMapping.STANDARD), (DepthFormat.D32F, DepthMapping.REVERSED))
ARRAYS = ("triangle", "object", "position", "normal", "color")
NEARS = (1e-3, 1e-6)
"""Near offsets as fractions of the reach."""

LINE_ROUNDING = 4 * 2.0**-53
"""Two roundings in a coordinate a + s d of a surface point, relative to its terms, doubled."""

KIB, GIB = 1 << 10, 1 << 30
CHECKED_EXACTLY = 60
"""Number of pixels of each class that are compared with rational arithmetic."""


def test_every_case_is_documented_listed_and_opened_by_its_name() -> None:
    page = (CHECKOUT / "docs" / "hard-cases.md").read_text()
    listed = {entry.name: entry for entry in hard_cases.listing()}
    assert list(listed) == hard_cases.names() and not set(listed) & set(builtin.names())
    for name, case in hard_cases.CASES.items():
        assert f"`{name}`" in page
        assert case.purpose and case.expected and "\n" not in case.purpose + case.expected
    for name in SMALL:
        scene = scene_of(name)
        assert scene.source == scene.name == name and listed[name].triangles == len(scene.faces)
        assert scene.content_hash == hard_cases.build(name).content_hash
    with pytest.raises(InputError, match="did you mean hard/needles"):
        open_scene("hard/needle")


@pytest.mark.parametrize(("name", "aperture"), VIEWS)
def test_the_truth_is_finite_and_consistent(name: str, aperture: Index) -> None:
    view, frustum = View(name, aperture), scene_of(name).frustum
    image, shown = view.image, view.image.triangle != NOTHING
    assert image.normal is not None and image.color is not None
    assert image.certainty is not None
    equal(image.covered, shown)
    assert np.isfinite(image.position[shown]).all()
    np.testing.assert_allclose(np.linalg.norm(image.normal[shown], axis=-1), 1.0, rtol=1e-12)
    assert np.isfinite(image.color).all() and not image.color[~shown].any()
    viewer, back = frustum.reach
    assert (image.height[shown] <= viewer).all() and (image.height[shown] >= -back).all()

    assert not (image.certainty == Certainty.UNEXAMINED).any()
    assert sorted(view.ties) == list(map(tuple, np.argwhere(image.certainty == Certainty.TIE)))
    for pixel, triangles in view.ties.items():
        assert len(set(triangles)) == len(triangles) >= 2
        assert image.triangle[pixel] == min(triangles)
    # Every surface point lies on the line of its pixel.
    center = np.array([view.where.x, view.where.y, 0.0])
    along = -image.height[..., None] * view.lines
    off = np.abs(image.position - (center + along))[shown]
    assert (off <= LINE_ROUNDING * (np.abs(center) + np.abs(along[shown]))).all()


@pytest.mark.parametrize(("name", "aperture"), thinned((view.values for view in VIEWS), 7))
def test_rational_arithmetic_agrees(name: str, aperture: Index) -> None:
    view, random = View(name, aperture), np.random.default_rng(5)
    image = view.image
    assert image.certainty is not None
    classes = [np.flatnonzero(image.certainty.ravel() == kind) for kind in Certainty]
    pixels = np.concatenate([random.permutation(members)[:CHECKED_EXACTLY] for members in classes])
    for pixel, exact in zip(
        pixels.tolist(), exact_pixels(scene_of(name), view.where, pixels), strict=True
    ):
        at = divmod(pixel, image.triangle.shape[1])
        assert image.triangle[at] == min(exact.winners, default=NOTHING), at
        assert -image.height[at] == pytest.approx(exact.s, rel=1e-12, abs=0, nan_ok=True)
        assert view.ties.get(at, []) == (exact.winners if len(exact.winners) > 1 else []), at


@pytest.mark.parametrize("name", thinned(SMALL, 9))
def test_the_rasterizer_is_finite_explained_and_the_same_from_run_to_run(name: str) -> None:
    scene = scene_of(name)
    reference, reach = Reference(scene), scene.frustum.longest_reach
    settings = [
        DoubleFrustum(near=near * reach, depth=depth, mapping=mapping)
        for near in NEARS
        for depth, mapping in DEPTHS
    ]
    with Rasterizer(scene) as rasterizer, Rasterizer(scene) as other:
        for aperture, how in product(hard_cases.CASES[name].apertures, settings):
            where = scene.plate.aperture(*aperture)
            drawn = rasterizer.render(where, how)
            assert drawn.color is not None and np.isfinite(drawn.color).all()
            assert np.isfinite(drawn.position[drawn.covered]).all()
            assert_same(other.render(where, how), drawn, *ARRAYS)
            judged = compare_images(truth_of(name, aperture), drawn, reference)
            json.dumps(judged.summary(), allow_nan=False)
            model = reference.trace_model(where, how)
            explained = explain(scene, model, drawn, rasterizer.model)
            assert not explained.unexplained.any(), (aperture, how)


def peak_memory(work: str) -> int:
    """Return the peak memory, bytes, of a new process that does some work."""
    # Not ru_maxrss: a process inherits the initial value from its parent.
    measured = f"{work}\nfrom pathlib import Path\nprint(Path('/proc/self/status').read_text())"
    done = subprocess.run(
        [sys.executable, "-c", measured], capture_output=True, text=True, check=True
    )
    peak = re.search(r"VmHWM:\s*(\d+) kB", done.stdout)
    assert peak, done.stdout
    return int(peak[1]) * KIB


BYTES_PER_TRIANGLE = 512
"""Largest memory per triangle, bytes. With two triangles per vertex, 132 bytes remain: vertices
12, faces 24, corners 72, normals 24. Computing normals temporarily takes about three times as much.
An image adds very little.
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
"""Assertions about each giant, and its memory limit, bytes."""


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


# Each hard case has its closed form, pixel by pixel.

#: Expected fields of the truth and masks of certainties, exact, by case and aperture
FORMS: dict[tuple[str, Index], Callable[[View], dict[str, Any]]] = {}
Form = Callable[[View], dict[str, Any]]


def shows(*names: str, apertures: tuple[Index, ...] = (MIDDLE,)) -> Callable[[Form], Form]:
    """Return a decorator that registers the closed form of some cases."""

    def register(form: Form) -> Form:
        FORMS.update({(f"hard/{name}", at): form for name in names for at in apertures})
        return form

    return register


def inside(values: Indices | np.int64, limits: tuple[float, float]) -> Mask:
    return np.asarray((values > limits[0]) & (values < limits[1]))


@shows("vertices-and-edges")
def all_triangles_at_vertices_and_edges(view: View) -> dict[str, Any]:
    """In the image, two sheets are grids of squares with diagonals, whatever their depths."""
    row, rows = view.row, (2, 58)
    counts = np.ones_like(row)
    for index, triangles in view.ties.items():
        counts[index] = len(triangles)
    expected = np.full_like(row, NOTHING)
    for part, columns in enumerate([(2, 30), (34, 62)]):
        column = view.column
        sheet = (
            (column >= columns[0]) & (column <= columns[1]) & (row >= rows[0]) & (row <= rows[1])
        )
        expected[sheet] = part  # without a crack in between
        across, down = (column - columns[0]) % hard.GRID_STEP, (row - rows[0]) % hard.GRID_STEP
        met = np.where((across == 0) | (down == 0) | (across == down), 2, 1)
        met[(across == 0) & (down == 0)] = 6
        interior = inside(column, columns) & inside(row, rows)
        equal(counts[interior], met[interior])
        equal((view.image.certainty == Certainty.PROVEN)[interior], (met == 1)[interior])
    return {"object": expected}


@shows("closed-edges")
def outlines_belong_to_triangles(view: View) -> dict[str, Any]:
    column, row = view.column, view.row
    first = (column >= 8) & (row >= 8) & (column + row <= 48)
    second = (column <= 60) & (row <= 60) & (column + row >= 96)
    outline = first & ((column == 8) | (row == 8) | (column + row == 48))
    outline |= second & ((column == 60) | (row == 60) | (column + row == 96))
    heights = view.image.height[[8, 8, 40, 60], [8, 40, 8, 60]]
    assert heights.tolist() == [-32.0, -64.0, -48.0, 32.0]
    triangle = np.where(first, 0, np.where(second, 1, NOTHING))
    return {"triangle": triangle, "exact": outline, "proven": ~outline}


@shows("surface-through-aperture")
def only_lines_within_a_surface_pass_it(view: View) -> dict[str, Any]:
    within = view.column == hard.THROUGH_COLUMN
    return {"triangle": within, "height": np.where(within, -100.0, 0.0), "exact": within}


@shows("vertex-on-aperture")
def every_line_through_a_tip_is_a_tie_of_its_sides(view: View) -> dict[str, Any]:
    return {"tie": True, "position": 0, "ties": {(0, 1, 2, 3)}}


@shows("vertex-on-aperture", apertures=((3, 2),))
def beside_the_tip_nothing_ties(view: View) -> dict[str, Any]:
    assert (view.image.height[view.image.covered] < 0).all()
    return {"proven": True}


@shows("edge-through-aperture")
def only_lines_within_either_side_of_an_edge_are_no_tie(view: View) -> dict[str, Any]:
    in_first, in_second = view.row == hard.THROUGH_ROW, view.column == hard.THROUGH_COLUMN
    triangle = np.where(in_first, np.where(in_second, 2, 1), 0)
    height = np.where(triangle == 2, -100.0, 0.0)
    return {
        "triangle": triangle,
        "height": height,
        "tie": ~(in_first | in_second),
        "ties": {(0, 1)},
    }


@shows("triangle-in-plate", apertures=((1, 3), (2, 2), (0, 4)))
def a_triangle_in_the_plate_holds_the_aperture_inside_on_an_edge_on_a_corner(
    view: View,
) -> dict[str, Any]:
    return {"triangle": 0, "height": 0, "tie": False}


@shows("triangle-in-plate", apertures=((3, 1),))
def beside_a_triangle_in_the_plate_the_wall_shows(view: View) -> dict[str, Any]:
    return {"triangle": 1, "height": -100, "tie": False}


@shows("coincident-copies", "duplicates")
def copies_tie_with_each_other_and_show_the_first(view: View) -> dict[str, Any]:
    image = view.image
    scene = scene_of(image.camera.scene)
    times = 2 if scene.name == "hard/coincident-copies" else 3
    once = len(scene.faces) // times
    assert image.covered.sum() > 1000
    for pixel, triangles in view.ties.items():
        first = [t for t in triangles if t < once]
        assert triangles == [t + k * once for k in range(times) for t in first]
        assert image.triangle[pixel] == first[0]
    return {"tie": image.covered}


@shows("coincident-other-triangles")
def the_same_plane_in_other_triangles_ties_everywhere(view: View) -> dict[str, Any]:
    s = 64 / (1 + view.dx / 4 + view.dy / 8)
    covered = np.maximum(np.abs(view.dx), np.abs(view.dy)) * s <= 24
    np.testing.assert_allclose(-view.image.height[covered], s[covered], rtol=1e-14)
    assert all(min(triangles) < 2 <= max(triangles) for triangles in view.ties.values())
    return {"covered": covered, "tie": covered, "object": np.where(covered, 0, NOTHING)}


@shows("nearly-coincident")
def the_upper_sheet_shows_down_to_one_step_of_a_double(view: View) -> dict[str, Any]:
    cells = np.zeros_like(view.image.covered)
    for index in range(len(hard.SEPARATIONS) + 1):
        across = inside(view.column, hard.sheet_columns(index))
        cell = across & np.logical_or.reduce([inside(view.row, rows) for rows in hard.SHEET_ROWS])
        last = index == len(hard.SEPARATIONS)
        assert (view.image.certainty[cell] == (Certainty.EXACT if last else Certainty.PROVEN)).all()
        cells |= cell
    return {"object": np.where(cells, 1, NOTHING)}


@shows("at-the-reach")
def the_reach_is_closed(view: View) -> dict[str, Any]:
    across = inside(view.column, hard.AT_REACH[0])
    behind, before = (across & inside(view.row, rows) for rows in hard.AT_REACH)
    height = np.where(behind, -hard.REACH, np.where(before, hard.REACH, np.nan))
    return {"height": height, "object": np.where(behind | before, 0, NOTHING)}


@shows("nothing", "only-out-of-reach")
def nothing_in_reach_is_proven(view: View) -> dict[str, Any]:
    return {"covered": False, "proven": True}


@shows("edge-on")
def an_edge_covers_nothing_and_a_triangle_turned_by_a_step_of_a_double_its_column(
    view: View,
) -> dict[str, Any]:
    tall = np.abs(view.dy) * hard.TURNED_MIDDLE <= hard.TURNED_HALF_HEIGHT
    turned = (view.column == hard.TURNED_COLUMN) & tall
    assert turned.sum() == 26
    height = np.where(turned, -hard.TURNED_MIDDLE, -100.0)
    return {"triangle": np.where(turned, 1, 2), "height": height, "tie": False}


@shows("needles")
def needles_cover_exactly_the_pixel_centers_that_they_run_over(view: View) -> dict[str, Any]:
    expected = np.full_like(view.row, NOTHING)
    expected[4:61, 20] = 0
    expected[np.arange(4, 33), np.arange(30, 59)] = 2
    expected[44, 4:61] = 3  # in front of the first needle
    return {"triangle": expected, "tie": False}


@shows("zero-area")
def triangles_without_area_are_not_there(view: View) -> dict[str, Any]:
    return {"triangle": len(scene_of("hard/zero-area").faces) - 1, "height": -100, "tie": False}


@shows("smallest")
def the_smallest_sheets_hide_each_other_and_the_wall(view: View) -> dict[str, Any]:
    expected = np.full_like(view.row, 2)
    expected[4:61, 4:41], expected[12:53, 20:57] = 0, 1
    heights = np.array([-2 * hard.SMALLEST, -hard.SMALLEST, -100.0])
    return {"object": expected, "height": heights[expected]}


@pytest.mark.parametrize(("name", "aperture"), FORMS)
def test_a_case_shows_its_closed_form(name: str, aperture: Index) -> None:
    view = View(name, aperture)
    for field, expected in FORMS[name, aperture](view).items():
        if field == "ties":
            assert set(map(tuple, view.ties.values())) == expected
        elif field in ("proven", "exact", "tie"):
            equal(view.image.certainty == Certainty[field.upper()], expected, field)
        else:
            equal(getattr(view.image, field), expected, field)


@pytest.mark.parametrize(("name", "side"), [("hard/only-in-front", 1), ("hard/only-behind", -1)])
def test_one_side_alone_shows_alone(name: str, side: int) -> None:
    image = truth_of(name)
    outward = side * image.height[image.covered] - 50
    # A ball about height 50 with radius 12, to 1 % for facets
    assert len(outward) > 500 and np.abs(outward).max() < 12.1
    assert side * outward.mean() > 0, "the side turned to the viewer"


@pytest.mark.parametrize(
    ("name", "scale"),
    [("hard/far-from-origin", 1.0), *((f"hard/{k}", s) for k, s in hard.SCALES.items())],
)
def test_neither_place_in_the_file_nor_size_moves_a_bit(name: str, scale: float) -> None:
    scene, aperture = scene_of(name), (12, 50)
    plain = Scene(
        name="near",
        plate=hard.ASYMMETRIC_PLATE,
        frustum=hard.ASYMMETRIC_FRUSTUM,
        objects=hard.asymmetric_on_a_grid(),
    )
    where = plain.plate.aperture(*aperture)
    expected, image = Reference(plain).trace(where), truth_of(name, aperture)
    assert expected.covered.sum() > 500
    equal(image.triangle, expected.triangle)
    equal(image.position, expected.position * scale)
    equal(image.certainty, expected.certainty)
    settings = DoubleFrustum(near=1e-3 * 150)
    with Rasterizer(plain) as near, Rasterizer(scene) as other:
        drawn = near.render(where, settings)
        same = other.render(
            scene.plate.aperture(*aperture), replace(settings, near=settings.near * scale)
        )
    equal(same.triangle, drawn.triangle)
    equal(same.position, drawn.position * np.float32(scale))


@pytest.mark.parametrize(
    "name", ["hard/steep", "hard/screen-near-plate", "hard/screen-near-plate-in-front"]
)
@pytest.mark.parametrize("aperture", [MIDDLE, (0, 3)])
def test_a_box_about_the_aperture_is_met_where_each_line_enters_it(
    name: str, aperture: Index
) -> None:
    """Lines end at the first of the planes x = +-24, y = +-24 and z = 20 toward the viewer."""
    view = View(name, aperture)
    across = (hard.ROOM[0] + view.where.x * np.sign(view.dx)) / np.abs(view.dx)
    along = (hard.ROOM[1] + view.where.y * np.sign(view.dy)) / np.abs(view.dy)
    height = np.minimum(np.minimum(across, along), hard.ROOM[2])
    np.testing.assert_allclose(view.image.height, height, rtol=1e-14)
    if name == "hard/steep":
        assert 11 < np.abs(view.dx).max() < 11.5
    else:
        assert height.max() < 1e-6


def test_the_picture_on_the_screen_fills_every_aperture_alike() -> None:
    name, screen = "hard/sheared-five-screens", hard.SHEARED_SCREEN
    middle = View(name)
    half = screen.size[0] / 2
    x, y = half * ((2 * middle.column + 1) / 64 - 1), half * (1 - (2 * middle.row + 1) / 64)
    hole = (np.abs(x + 2.5) < 2.5) & (np.abs(y + 2.5) < 2.5)
    assert hole.sum() == 256
    assert (middle.image.object[hole] == len(scene_of(name).objects) - 1).all()
    for aperture in hard.CASES[name].apertures:
        image = truth_of(name, aperture)
        equal(image.triangle, middle.image.triangle)
        equal(image.certainty, middle.image.certainty)
        equal(image.height, np.where(hole, -90.0, screen.height))
        equal(image.position[~hole, :2], np.stack([x, y], axis=-1)[~hole])
    shear = truth_of(name, (0, 0)).camera
    assert abs(shear.shear[0]) == 10 * shear.half_extent[0], "five widths of the screen"


def test_one_pixel_is_a_tie_along_the_diagonal_of_the_box() -> None:
    view = View("hard/one-pixel")
    assert view.image.triangle.shape == (1, 1) and view.image.height[0, 0] == -32
    assert [len(triangles) for triangles in view.ties.values()] == [2]
