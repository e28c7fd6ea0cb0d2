"""The built-in scenes: the same every time, and each fit for what it says it is for."""

import itertools
import math

import numpy as np
import pytest

from xfrustum.reference.lines.lines import film_window
from xfrustum.scenes import InputError, open_scene
from xfrustum.scenes.appearance.appearance import DEFAULT_LIGHT, DEFAULT_MATERIAL
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.geometry.shapes import SHAPES, build_shape, refine
from xfrustum.scenes.library import builtin
from xfrustum.scenes.library.car import surroundings
from xfrustum.scenes.library.targets import (
    BACKDROP_HEIGHT,
    COARSE,
    FINE,
    GLOBE_REACH,
    GLOBES,
    GRATING_HEIGHT,
    GRATING_LEAN,
    MIRROR_SPHERES,
    SHEET_HEIGHTS,
    SHEET_SEPARATIONS,
    globes,
)
from xfrustum.scenes.model.effects import Effect, needed

OVER_PLATE = 1e-9
"""Heights below this count as in the plate: far below any feature, far above rounding of lengths of 1e4."""


def areas(triangles: Floats) -> Floats:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


@pytest.mark.parametrize("name", builtin.names())
def test_a_built_in_scene_is_the_same_every_time_and_says_what_it_is_for(name: str) -> None:
    scene = open_scene(name)
    assert scene.source == scene.name == name
    builtin.build.cache_clear()
    assert open_scene(name).content_hash == scene.content_hash
    [entry] = [e for e in builtin.listing() if e.name == name]
    assert entry.triangles == len(scene.faces)
    assert entry.purpose and "\n" not in entry.purpose


@pytest.mark.parametrize("name", [n for n in builtin.names() if n not in ("empty", "car-transfer")])
def test_a_built_in_scene_lies_on_both_sides_of_the_plate_without_flat_triangles(name: str) -> None:
    scene = open_scene(name)
    assert scene.vertices[:, 2].min() < 0 < scene.vertices[:, 2].max()
    assert areas(scene.triangles).min() > 0
    if name != "large-triangles":
        assert np.abs(scene.vertices[:, 2]).max() < scene.frustum.longest_reach


def test_no_flip_or_swap_of_axes_maps_the_asymmetric_scene_near_itself() -> None:
    """Each of the 47 other signed permutations moves some vertex by more than a millimeter."""
    vertices = open_scene("asymmetric").vertices
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            image = vertices[:, order] * signs
            gaps = np.linalg.norm(image[::29, None] - vertices[None, ::3], axis=2).min(axis=1)
            assert gaps.max() > 1.0, (order, signs)


def test_sheets_are_parallel_as_far_apart_as_said_and_imaged_in_the_same_cell() -> None:
    scene = open_scene("sheets")
    upper, lower = scene.objects
    reach = scene.frustum.reach[0]
    assert len(upper.faces) == len(lower.faces) == 4 * len(SHEET_HEIGHTS) * len(SHEET_SEPARATIONS)
    columns = 2 * len(SHEET_SEPARATIONS)
    cells = itertools.product((0, 6), range(len(SHEET_HEIGHTS)), range(len(SHEET_SEPARATIONS)))
    pairs = zip(upper.vertices.reshape(-1, 4, 3), lower.vertices.reshape(-1, 4, 3), strict=True)
    for (first_column, row, column), pair in zip(cells, pairs, strict=True):
        # The line from the aperture through the middle of the film cell, slopes within +-0.55.
        line = [-0.55 + 1.1 * (first_column + column + 0.5) / columns, -0.55 + 1.1 * (row + 0.5) / 6, -1.0]
        normals = [np.cross(sheet[1] - sheet[0], sheet[3] - sheet[0]) for sheet in pair]
        units = [normal / np.linalg.norm(normal) for normal in normals]
        np.testing.assert_allclose(units[0], units[1], atol=1e-9)
        high, low = (-(unit @ sheet[0]) / (unit @ line) for unit, sheet in zip(units, pair, strict=True))
        assert high - low == pytest.approx(SHEET_SEPARATIONS[column] * reach, rel=1e-6)
        assert min(abs(high), abs(low)) == pytest.approx(SHEET_HEIGHTS[row] * reach)
        assert (high < 0) == (first_column == 0), "behind the plate in the left half of the film"
        slopes = [sheet[:, 0] / -sheet[:, 2] for sheet in pair]
        overlap = min(slopes[0].max(), slopes[1].max()) - max(slopes[0].min(), slopes[1].min())
        assert overlap > 0.3 * 0.9 * 1.1 / columns
    half_angle = math.tan(math.radians(30))
    for part in scene.objects:
        assert np.abs(part.vertices[:, :2] / part.vertices[:, 2:]).max() < half_angle


def test_the_crossing_surface_contains_the_middle_aperture_inside_one_triangle() -> None:
    scene = open_scene("crossing")
    assert (scene.plate.middle.x, scene.plate.middle.y) == (0, 0)
    wave = scene.triangles[scene.object_of_triangle == 0]
    spans = (wave[..., :2].min(axis=1) < 0).all(axis=1) & (wave[..., :2].max(axis=1) > 0).all(axis=1)
    through = []
    for a, b, c in wave[spans]:
        weights = np.linalg.solve(np.array([[*p[:2], 1.0] for p in (a, b, c)]).T, [0, 0, 1])
        if weights.min() > 0.05:
            through.append(float(weights @ [a[2], b[2], c[2]]))
    assert len(through) == 1
    assert abs(through[0]) < OVER_PLATE


def test_large_triangles_cross_the_plate_within_it_and_beside_the_aperture() -> None:
    scene = open_scene("large-triangles")
    width, height = scene.plate.size
    for corners in scene.triangles[:3]:
        assert np.abs(corners).max() > 50 * width
        assert corners[:, 2].min() < 0 < corners[:, 2].max()
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        distance = abs(normal @ corners[0]) / np.linalg.norm(normal[:2])
        assert 5 < distance < math.hypot(width, height) / 2


def test_the_transfer_has_all_content_behind_the_plate_and_the_transfer_plane_through_it() -> None:
    """The master lies in the view zone; every corner of its plate images the transfer."""
    scene = open_scene("car-transfer")
    heights, screen = scene.vertices[:, 2], scene.frustum.screen
    assert screen is not None
    assert heights.max() < 0 and -scene.frustum.reach[1] < heights.min()
    assert heights.min() < screen.height < heights.max()
    car = open_scene("car").vertices
    np.testing.assert_allclose(scene.vertices - car, np.tile([0, 0, -133.0], (len(car), 1)), atol=1e-12)
    for aperture in scene.plate.corners:
        shear, half_extent = film_window(scene.frustum, aperture)
        for axis, place in enumerate((aperture.x, aperture.y)):
            low, high = (
                place + -screen.height * (shear[axis] + side * half_extent[axis]) for side in (-1, 1)
            )
            assert high - low == pytest.approx(screen.size[axis])
            assert (low + high) / 2 == pytest.approx(screen.center[axis])


@pytest.mark.parametrize("name", ["asymmetric", "large-triangles"])
def test_refining_splits_every_triangle_in_four_on_the_same_surface(name: str) -> None:
    scene = open_scene(name)
    fine = refine(scene, 2)
    assert len(fine.faces) == 16 * len(scene.faces)
    parents = np.repeat(np.arange(len(scene.faces)), 16)
    np.testing.assert_array_equal(fine.object_of_triangle, scene.object_of_triangle[parents])
    np.testing.assert_allclose(areas(fine.triangles), areas(scene.triangles)[parents] / 16, rtol=1e-6)
    # A middle is rounded once per level: half an ulp per coordinate, two levels, sqrt(3) for the length.
    rounding = 2 * math.sqrt(3) * np.spacing(np.abs(scene.vertices).max())
    offsets = fine.triangles - scene.triangles[parents, :1]
    assert np.abs(np.einsum("tcx,tx->tc", offsets, scene.normals[parents])).max() < 8 * rounding


@pytest.mark.parametrize("name", [n for n in SHAPES if n != "square"])
def test_shapes_are_closed_and_face_outward(name: str) -> None:
    shape = build_shape(name)
    corners = shape.vertices[shape.faces]
    volume = np.einsum("tx,tx->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume > 0
    keys = np.unique(shape.vertices, axis=0, return_inverse=True)[1].reshape(-1)[shape.faces]
    directed = {tuple(edge) for face in keys.tolist() for edge in zip(face, face[1:] + face[:1], strict=True)}
    assert all((b, a) in directed for a, b in directed), "every edge is walked once in each direction"


# The shaded built-in scenes: closed forms that hold, and nothing symmetric that could hide a flip.

SHADED = ("car-studio", "mirror-sphere", "grating")

ONE_MICROMETER = 1e-3
"""Vertices of lathes are rounded to a micrometer in scenes of millimeters: half of it along each axis."""


def directions(radiance: Singles) -> Floats:
    """Return (H, W, 3) where each pixel of a map lies, by CONVENTIONS.md: the middle -z, up +y, right +x."""
    height, width = radiance.shape[:2]
    up = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    right = 2 * np.pi * (np.arange(width) + 0.5) / width - np.pi
    y, along = np.broadcast_arrays(np.sin(up)[:, None], right[None, :])
    level = np.cos(up)[:, None]
    return np.stack([level * np.sin(along), y, -level * np.cos(along)], axis=-1)


@pytest.mark.parametrize("name", [name for name in builtin.names() if name not in SHADED])
def test_the_other_scenes_have_the_default_look_and_ask_for_nothing(name: str) -> None:
    scene = open_scene(name)
    assert scene.appearance.lights == (DEFAULT_LIGHT,)
    assert scene.appearance.environment is None
    assert (scene.sampling, scene.transport) == (Sampling(), Transport())
    assert set(scene.materials) <= {DEFAULT_MATERIAL}
    assert scene.surface.vertex_normals is None


def test_no_flip_or_swap_of_axes_leaves_the_surroundings_as_they_are() -> None:
    """Each of the 47 other signed permutations of the axes changes the radiance of some directions."""
    radiance = surroundings(64).radiance
    towards = directions(radiance)
    height, width = radiance.shape[:2]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            if order == (0, 1, 2) and signs == (1, 1, 1):
                continue
            x, y, z = np.moveaxis(towards[..., order] * signs, -1, 0)
            row = np.clip((0.5 - np.arcsin(y) / np.pi) * height, 0, height - 1).astype(int)
            column = ((np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width).astype(int) % width
            changed = np.abs(radiance[row, column] - radiance).max(axis=2) > 0.1
            assert changed.mean() > 0.01, (order, signs)


def test_the_mirror_spheres_are_spheres_with_normals_along_their_radii() -> None:
    scene = open_scene("mirror-sphere")
    assert needed(scene) >= {Effect.C, Effect.C_STAR, Effect.REFLECTION, Effect.SMOOTH_NORMALS}
    assert not needed(scene) & {Effect.AMBIENT, Effect.DIFFUSE, Effect.SPECULAR}
    for part, (center, radius) in zip(scene.objects, MIRROR_SPHERES, strict=True):
        assert part.vertex_normals is not None
        outward = part.vertices - np.array(center)
        assert np.abs(np.linalg.norm(outward, axis=1) - radius).max() < ONE_MICROMETER
        # Sums of coordinates of up to 84: half a unit in the last place of those.
        np.testing.assert_allclose(part.vertex_normals, outward, atol=np.spacing(128.0))
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        agree = np.einsum("fx,fcx->fc", np.cross(b - a, c - a), part.vertex_normals[part.faces])
        assert (agree > 0).all(), "the winding faces outward"


def test_no_mirror_sphere_hides_the_other_from_the_middle_aperture() -> None:
    (back, back_radius), (front, front_radius) = ((np.array(c), r) for c, r in MIRROR_SPHERES)
    assert back[2] + back_radius < 0 < front[2] - front_radius
    # Lines through the origin: the angle between the axes of the two cones, one of them turned around.
    cosine = -(back @ front) / np.linalg.norm(back) / np.linalg.norm(front)
    cones = sum(math.asin(r / np.linalg.norm(c)) for c, r in ((back, back_radius), (front, front_radius)))
    assert math.acos(cosine) > cones


def test_the_grating_is_finer_than_the_pitch_in_one_half_and_coarser_in_the_other() -> None:
    scene = open_scene("grating")
    assert scene.appearance.lights == ()
    assert needed(scene) == {Effect.C, Effect.C_STAR, Effect.VERTEX_COLORS, Effect.AMBIENT}
    pitches = [extent / count for extent, count in zip(scene.plate.size, scene.plate.hogels, strict=True)]
    for part, axis, height in zip(scene.objects, (0, 1), (GRATING_HEIGHT, BACKDROP_HEIGHT), strict=True):
        assert part.vertex_colors is not None
        assert (part.vertices[:, 2] == height).all()
        # Two ends of a bar follow each other; coordinates of sheets are rounded to 1e-6.
        leaning = part.vertices[:, axis] - GRATING_LEAN * part.vertices[:, 1 - axis]
        ends, shades = leaning.reshape(-1, 2), part.vertex_colors.reshape(-1, 2, 3)
        np.testing.assert_allclose(ends[:, 0], ends[:, 1], atol=3e-6)
        order = np.argsort(ends[:, 0])
        along, turns = ends[order].mean(axis=1), shades[order, 0, 0]
        assert (shades == shades[:, :1, :1]).all(), "gray, and one shade along a bar"
        assert (np.abs(np.diff(turns)) == 1).all(), "black and white in turn"
        middle = int(np.argmin(np.abs(along)))
        assert abs(along[middle]) < 3e-6
        assert turns[middle] == 0
        halves = along[: middle + 1], along[middle:]
        for half, period in zip(halves, (FINE, COARSE) if axis == 0 else (COARSE, FINE), strict=True):
            np.testing.assert_allclose(np.diff(half), period * pitches[axis] / 2, atol=6e-6)


@pytest.mark.parametrize("triangles", [1000, 100_000])
def test_globes_have_exactly_as_many_triangles_as_they_say_on_the_same_ellipsoids(triangles: int) -> None:
    scene = globes(triangles, (8, 8))
    assert len(scene.faces) == triangles
    # There are neither slivers without area nor triangles beyond the reach.
    assert (np.linalg.norm(scene.normals, axis=1) > 0.5).all()
    assert np.abs(scene.vertices[:, 2]).max() < GLOBE_REACH
    ends = [np.sign([one.vertices[:, 2].min(), one.vertices[:, 2].max()]).tolist() for one in scene.objects]
    assert ends == [[1, 1], [1, 1], [-1, 1], [-1, -1], [-1, -1]], "before, across and behind the plate"
    for part, (center, semi_axes) in zip(scene.objects, GLOBES, strict=True):
        radius = np.linalg.norm((part.vertices - np.array(center)) / np.array(semi_axes), axis=1)
        # The unit globe's coordinates are rounded to 1e-6 of its diameter.
        np.testing.assert_allclose(radius, 1, atol=2 * math.sqrt(3) * 0.5e-6)


@pytest.mark.parametrize("triangles", [0, 10, 9999, 10_010, 10_000_001])
def test_a_number_that_globes_cannot_share_evenly_is_refused(triangles: int) -> None:
    with pytest.raises(InputError, match="cannot be shared"):
        globes(triangles, (8, 8))
