"""Truth by direction: one pixel of all hogels, decided as in the images of the hogels."""

from dataclasses import replace

import numpy as np
import pytest

from xfrustum.reference import Reference
from xfrustum.reference.certify.certify import Certifier
from xfrustum.reference.certify.cone import Triangles
from xfrustum.reference.certify.directions import ExactGrid
from xfrustum.reference.lines import PixelLines, TileLines
from xfrustum.scenes import Frustum, InputError, Plate, Scene, Screen, open_scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.library import builtin, hard_cases
from xfrustum.scenes.plate import PlateTile

CHANNELS = ("triangle", "position", "normal", "color", "certainty")


def small(name: str, hogels: tuple[int, int], resolution: tuple[int, int]) -> Scene:
    """Return a scene with few hogels and pixels; hard cases keep their small aimed films.

    Colors have one sample per pixel: images by direction have no means.
    """
    scene = replace(open_scene(name), sampling=Sampling())
    if max(scene.plate.hogels) > 9:
        scene = replace(scene, plate=Plate(size=scene.plate.size, hogels=hogels))
    if max(scene.frustum.resolution) > 64:
        scene = replace(scene, frustum=replace(scene.frustum, resolution=resolution))
    return scene


def assert_equal_to_hogels(scene: Scene, tile: PlateTile, every: int = 1) -> None:
    """Compare images by direction with the same pixels and ties of hogels, bit for bit."""
    reference = Reference(scene)
    width, height = scene.frustum.resolution
    hogels = [
        [reference.trace(scene.plate.aperture(column, row)) for column in tile.columns]
        for row in tile.rows
    ]
    pixels = [(column, row) for row in range(height) for column in range(width)][::every]
    for image in reference.by_directions(tile, pixels):
        at = image.pixel[::-1]
        for name in CHANNELS:
            expected = np.array([[getattr(hogel, name)[at] for hogel in row] for row in hogels])
            assert_same_bytes(getattr(image, name), expected)
        ties = {
            (row, column, triangle)
            for row, line in enumerate(hogels)
            for column, hogel in enumerate(line)
            for *place, triangle in hogel.tied_triangles.tolist()
            if tuple(place) == at
        }
        assert set(map(tuple, image.tied_triangles.tolist())) == ties


def assert_same_bytes(values: np.ndarray, expected: np.ndarray) -> None:
    """Compare bytes, which distinguish -0 from 0, and treat equal NaNs as equal."""
    assert values.dtype == expected.dtype and values.shape == expected.shape
    assert np.ascontiguousarray(values).tobytes() == np.ascontiguousarray(expected).tobytes()


@pytest.mark.parametrize(
    "name",
    [
        "asymmetric",
        "asymmetric-recentered",
        "hard/vertex-on-aperture",
        "hard/edge-through-aperture",
        "hard/screen-near-plate",
        "hard/screen-near-plate-in-front",
        "hard/duplicates",
        "hard/triangle-in-plate",
        "empty",
    ],
)
def test_pixels_by_direction_equal_those_of_hogels_bit_for_bit(name: str) -> None:
    scene = small(name, (6, 5), (9, 8))
    # An off-center tile that contains the middle, with different numbers of columns and rows
    column, row = scene.plate.middle.index
    tile = PlateTile(
        plate=scene.plate, columns=range(column - 1, column + 2), rows=range(row, row + 2)
    )
    assert_equal_to_hogels(scene, tile, every=1 if np.prod(scene.frustum.resolution) < 100 else 211)


def whole_plate(scene: Scene) -> PlateTile:
    columns, rows = map(range, scene.plate.hogels)
    return PlateTile(plate=scene.plate, columns=columns, rows=rows)


def test_edge_on_triangles_leave_the_same_pixels_open() -> None:
    """Pixel 28, 20 lies beside an edge-on triangle that reaches the screen's height."""
    scene = small("hard/edge-through-aperture", (9, 7), (40, 32))
    assert_equal_to_hogels(scene, whole_plate(scene), every=20 * 64 + 28)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*builtin.names(), *hard_cases.names(giants=False)])
def test_whole_plates_by_direction_equal_those_by_hogels(name: str) -> None:
    scene = small(name, (9, 7), (40, 32))
    assert_equal_to_hogels(scene, whole_plate(scene))


def first_triangles(scene: Scene, lines: PixelLines) -> np.ndarray:
    height = lines.resolution[1]
    return Certifier(Triangles(scene.triangles), lines).decide(range(height)).triangle


def test_negated_flipped_and_shifted_lines_differ() -> None:
    scene = small("asymmetric", (24, 20), (16, 12))
    tile = whole_plate(scene)
    lines = TileLines(scene.frustum, tile).of_pixel((3, 2))
    right = first_triangles(scene, lines)
    wrong = {
        "direction": replace(lines, dx=-lines.dx, dy=-lines.dy),
        "half a pitch": replace(lines, x=lines.x + lines.pitch[0] / 2),
        "pixel": TileLines(scene.frustum, tile).of_pixel((3, 9)),
    }
    for defect, others in wrong.items():
        assert np.count_nonzero(first_triangles(scene, others) != right) > 5, defect
    assert np.count_nonzero(right[::-1] != right) > 5


def test_means_over_several_samples_are_refused() -> None:
    scene = small("asymmetric", (4, 3), (4, 4))
    sampled = replace(scene, sampling=Sampling(supersample=2))
    tile = whole_plate(scene)
    with pytest.raises(InputError, match="several samples"):
        next(Reference(sampled).by_directions(tile, [(0, 0)]))
    next(Reference(sampled).by_directions(tile, [(0, 0)], colored=False))


@pytest.mark.parametrize(
    ("name", "resolution"),
    [
        ("asymmetric", (9, 8)),
        ("asymmetric-recentered", (9, 8)),
        ("hard/duplicates", (9, 8)),
        ("hard/surface-through-aperture", (8, 8)),
        pytest.param("hard/edge-through-aperture", (64, 64), marks=pytest.mark.slow),
    ],
)
def test_hogels_of_a_decided_tile_keep_every_bit_of_truth_and_gaps(
    name: str, resolution: tuple[int, int]
) -> None:
    scene = small(name, (6, 5), resolution)
    scene = replace(scene, frustum=replace(scene.frustum, resolution=resolution))
    hogels = scene.plate.hogels
    tile = PlateTile(plate=scene.plate, columns=range(hogels[0]), rows=range(hogels[1] // 2, 4))
    reference = Reference(scene)
    decided = reference.with_tile(tile, gaps=True)
    for column in tile.columns[::2]:
        for row in tile.rows:
            aperture = scene.plate.aperture(column, row)
            truth, ours = reference.trace(aperture), decided.trace(aperture)
            gaps = [reference.gaps(aperture, before) for before in (None, truth)]
            own = [decided.gaps(aperture, before) for before in (None, ours)]
            pairs = [(getattr(truth, n), getattr(ours, n)) for n in (*CHANNELS, "overruled")]
            for expected, value in [*pairs, *zip(gaps, own, strict=True)]:
                assert_same_bytes(value, expected)
            ties = [set(map(tuple, image.tied_triangles.tolist())) for image in (truth, ours)]
            assert ties[0] == ties[1]


def test_hogels_beside_a_decided_tile_are_decided_alone() -> None:
    scene = small("asymmetric", (6, 5), (9, 8))
    tile = PlateTile(plate=scene.plate, columns=range(6), rows=range(2))
    aside, reference = scene.plate.aperture(1, 3), Reference(scene)
    decided = reference.with_tile(tile)
    assert (decided.trace(aside).triangle == reference.trace(aside).triangle).all()
    inside = scene.plate.aperture(1, 1)
    assert (decided.gaps(inside) == reference.gaps(inside)).all(), "a tile without gaps"


def aimed_triangles(lines: PixelLines, random: np.random.Generator, side: int) -> np.ndarray:
    """Return a triangle for each line, with an extreme corner on the line up to rounding.

    The other two corners lie toward larger (`side` 1) or smaller (-1) x and y, so that the first
    corner ends the triangle's projection.
    """
    points, directions = lines.points().reshape(-1, 3), lines.directions().reshape(-1, 3)
    nearest, farthest = lines.s_range
    s = random.uniform(nearest / 2, farthest / 2, len(points))
    first = points + s[:, None] * directions
    reach = 0.4 * np.array(lines.pitch)
    corners = np.repeat(first[:, None], 3, axis=1)
    corners[:, 1, :2] += side * reach * random.uniform(0.2, 1.0, (len(points), 2))
    corners[:, 2, 0] += side * reach[0] * random.uniform(0.2, 1.0, len(points))
    return corners


@pytest.mark.parametrize("screen", [None, 77.0, -77.0])
def test_corners_on_lines_are_decided_as_in_rationals(screen: float | None) -> None:
    """Boxes and rows need margins: else a corner one rounding off a line loses its pixel."""
    frustum = Frustum(
        resolution=(7, 5),
        reach=(40.0, 40.0),
        fov=(0.7, 0.6) if screen is None else None,
        screen=None if screen is None else Screen(height=screen, center=(3.0, 1.0), size=(50, 40)),
    )
    plate = Plate(size=(39.0, 31.0), hogels=(26, 21))
    tile = PlateTile(plate=plate, columns=range(26), rows=range(21))
    met = 0
    for seed, (pixel, side) in enumerate([((0, 1), 1), ((5, 4), -1), ((2, 0), -1)]):
        lines = TileLines(frustum, tile).of_pixel(pixel)
        triangles = aimed_triangles(lines, np.random.default_rng(seed), side)
        decided = Certifier(Triangles(triangles), lines).decide(range(21))
        exact = ExactGrid(triangles, lines)
        # Other triangles lie within a cell of their own lines, in the line's row and column.
        for number in range(len(triangles)):
            place = np.unravel_index(number, decided.triangle.shape)
            meets = exact.meets(number, number) is not None
            met += meets
            assert (decided.triangle[place] == number) == meets
    assert 100 < met < 3 * len(triangles) - 100
