"""Whether an aperture's image can show any of an object, and which apertures of a plate can.

Hidden surfaces are not considered: an object behind another one is in sight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xfrustum.compare.extent.layers import Layer, layers, triangles_in_chunks
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.scene import SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

FILM_MARGIN_PX = 1e-6
"""Margin around the area that a triangle covers on the film. Film coordinates have a dozen roundings of
doubles, an error below 1e-12 px on films of any size; a triangle nearer than the margin to a pixel's center
counts as in sight."""

IN_SIGHT_CHUNK_TRIANGLES = 1 << 14
"""Triangles examined together to find any one in sight: most meshes have one among the first."""

MAX_SPLIT_TRIANGLES = 50_000
"""Largest number of triangles that a coarse mesh is split into before its apertures are counted. The
apertures that see a triangle are counted by the rectangle around them, which is too large for large ones."""


def in_sight(part: SceneObject, frustum: Frustum, aperture: Aperture) -> bool:
    """Return whether the image of an aperture can show any of an object, whatever hides it.

    False is certain: no pixel's center lies in the rectangle about any triangle on the film, or the film
    lies wholly beyond one of its edges. True may be wrong by slivers between two pixels' centers.
    """
    return any(
        bool(_can_be_shown(triangles, layer, frustum, aperture).any())
        for triangles in triangles_in_chunks(part, IN_SIGHT_CHUNK_TRIANGLES)
        for layer in layers(triangles, frustum)
    )


def _can_be_shown(triangles: Floats, layer: Layer, frustum: Frustum, aperture: Aperture) -> Mask:
    """Return (F,) whether a pixel's center may lie in the image of each triangle's part in a layer."""
    shown: Mask = np.asarray(layer.valid.any(axis=1))
    for axis, pixels in enumerate(frustum.resolution):
        low, high = _film_range(layer, frustum, aperture, axis)
        # The centers of pixels 0 to n - 1 lie at film coordinates (2 k + 1)/n - 1, whichever way k counts.
        first = np.ceil(np.clip((low + 1) * pixels / 2 - 0.5 - FILM_MARGIN_PX, 0, pixels))
        last = np.floor(np.clip((high + 1) * pixels / 2 - 0.5 + FILM_MARGIN_PX, -1, pixels - 1))
        shown &= first <= last
    if shown.any():
        shown[shown] = ~_film_beyond_an_edge(triangles[shown], layer.behind, frustum, aperture)
    return shown


def _film_range(layer: Layer, frustum: Frustum, aperture: Aperture, axis: int) -> tuple[Floats, Floats]:
    """Return the (F,) lowest and highest film coordinate of each part; +-inf for points in the plate.

    The film coordinate is a quotient of linear functions whose denominator keeps its sign in a layer: over a
    convex part its extremes lie at corners.
    """
    shear, half = _slopes(frustum, aperture, axis)
    s = -layer.corners[..., 2]
    across = layer.corners[..., axis] - (aperture.x, aperture.y)[axis] - shear * s
    # The sign is that of the layer: in the plate s is zero, or minus zero, on either side of it.
    across = across if layer.behind else -across
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u = across / (half * np.abs(s))
    # A point in the aperture itself lies on every line: its film coordinate is undefined.
    nowhere = np.isnan(u)
    low = np.where(layer.valid, np.where(nowhere, -np.inf, u), np.inf).min(axis=1)
    high = np.where(layer.valid, np.where(nowhere, np.inf, u), -np.inf).max(axis=1)
    return low, high


def _slopes(frustum: Frustum, aperture: Aperture, axis: int) -> tuple[float, float]:
    """Return shear and half-extent of the lines through an aperture, along one axis (CONVENTIONS.md)."""
    if frustum.screen is None:
        assert frustum.fov is not None
        return 0.0, float(np.tan(frustum.fov[axis] / 2))
    depth = -frustum.screen.height
    center = (aperture.x, aperture.y)[axis]
    return (frustum.screen.center[axis] - center) / depth, frustum.screen.size[axis] / 2 / abs(depth)


def _film_beyond_an_edge(triangles: Floats, behind: bool, frustum: Frustum, aperture: Aperture) -> Mask:
    """Return (F,) whether all corners of the film lie beyond one and the same edge of a triangle.

    A line of direction d through the aperture meets a triangle P0 P1 P2 in P = a + s d only if the three
    determinants det(d, Pi - a, Pj - a), i and j the ends of an edge, have the sign of s times that of
    det(P0 - a, P1 - a, P2 - a). They are linear in d, so four corners speak for the film.
    """
    (kx, tx), (ky, ty) = (_slopes(frustum, aperture, axis) for axis in (0, 1))
    corner = [(kx + u * tx, ky + v * ty, -1.0) for u in (-1, 1) for v in (-1, 1)]
    from_aperture = triangles - (aperture.x, aperture.y, 0.0)
    # Coordinates are scaled to at most one, so that products of three neither underflow nor overflow.
    size = np.abs(from_aperture).max(axis=(1, 2), keepdims=True)
    from_aperture = from_aperture / np.where(size > 0, size, 1.0)
    edge_normals = np.cross(from_aperture, np.roll(from_aperture, -1, axis=1))
    whole = (edge_normals[:, 0] * from_aperture[:, 2]).sum(axis=1)
    side = np.sign(whole) * (1.0 if behind else -1.0)
    on_lines = edge_normals @ np.array(corner).T
    # A determinant is a sum of products of numbers of at most one and the slope, a dozen roundings each.
    doubt = 64 * np.finfo(np.float64).eps * np.abs(corner).max()
    beyond = side[:, None, None] * on_lines < -doubt
    certain = np.abs(whole) > doubt
    return np.asarray(certain & beyond.all(axis=2).any(axis=1))


def apertures_in_sight(part: SceneObject, frustum: Frustum, plate: Plate) -> Mask:
    """Return (rows, columns) whether each aperture's crossed frustum holds any part of an object.

    No aperture that holds a part is missed. Beside these, apertures within the size of a triangle may be
    counted too, because the apertures that see a triangle are counted by the rectangle around them.
    """
    columns, rows = plate.hogels
    # Each rectangle adds +1 where it begins and -1 past its end, in rows and columns: cumulative sums along
    # both are the numbers of rectangles over each aperture.
    steps = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    for triangles in triangles_in_chunks(part):
        fine = _split_coarse(triangles, len(part.faces))
        for layer in layers(fine, frustum):
            (left, right), (low, high) = (_aperture_range(layer, frustum, plate, axis) for axis in (0, 1))
            # Rows are numbered downward, heights upward.
            top, bottom = rows - 1 - high, rows - 1 - low
            some = layer.valid.any(axis=1) & (left <= right) & (top <= bottom)
            for r, c, sign in (
                (top, left, 1),
                (top, right + 1, -1),
                (bottom + 1, left, -1),
                (bottom + 1, right + 1, 1),
            ):
                np.add.at(steps, (r[some], c[some]), sign)
    return np.asarray(steps.cumsum(axis=0).cumsum(axis=1)[:rows, :columns] > 0)


def _split_coarse(triangles: Floats, total: int) -> Floats:
    """Return the triangles, each split in four as long as all stay below `MAX_SPLIT_TRIANGLES`."""
    while 4 * total <= MAX_SPLIT_TRIANGLES:
        a, b, c = triangles.transpose(1, 0, 2)
        ab, bc, ca = a / 2 + b / 2, b / 2 + c / 2, c / 2 + a / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
        total *= 4
    return triangles


def _aperture_range(layer: Layer, frustum: Frustum, plate: Plate, axis: int) -> tuple[Indices, Indices]:
    """Return the (F,) first and last column, or row counted upward, whose lines may meet each part.

    A point is on a line of the aperture at a where abs(x - s m/S - a (1 - s/S)) <= t abs(s). The screen is at
    s = S and has its middle at m; without a screen 1/S is zero. In a layer 1 - s/S keeps its sign. Therefore
    both ends of the interval of a take their extremes at the part's corners.
    """
    s = -layer.corners[..., 2]
    _, half = _slopes(frustum, plate.middle, axis)
    x, toward_a = layer.corners[..., axis], np.ones_like(s)
    if frustum.screen is not None:
        depth = -frustum.screen.height
        x = x - s * (frustum.screen.center[axis] / depth)
        toward_a = 1.0 - s / depth
    sign = np.where(np.where(layer.valid, toward_a, 0.0).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    x, toward_a = x * sign, np.abs(toward_a)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low, high = (x - half * np.abs(s)) / toward_a, (x + half * np.abs(s)) / toward_a
    low = np.where(layer.valid, np.where(np.isnan(low), -np.inf, low), np.inf).min(axis=1)
    high = np.where(layer.valid, np.where(np.isnan(high), np.inf, high), -np.inf).max(axis=1)
    count, pitch = plate.hogels[axis], plate.size[axis] / plate.hogels[axis]
    first = np.ceil(np.clip((low + plate.size[axis] / 2) / pitch - 0.5 - FILM_MARGIN_PX, 0, count))
    last = np.floor(np.clip((high + plate.size[axis] / 2) / pitch - 0.5 + FILM_MARGIN_PX, -1, count - 1))
    return first.astype(np.int64), last.astype(np.int64)


def aside_of_frusta(
    frustum: Frustum, apertures: Sequence[Aperture], axis: int, ends: tuple[float, float]
) -> tuple[float, float]:
    """Return the least and the largest x or y of the lines of some apertures between two heights.

    Lines are straight: the extremes lie at the two heights or, where these are on both sides of the plate, in
    the apertures.

    Parameters
    ----------
    frustum
        Frustum of the scene.
    apertures
        Apertures whose lines count.
    axis
        Axis of the result: 0 for x, 1 for y.
    ends
        The two heights, scene units.
    """
    between = [z for z in (*ends, 0.0) if min(ends) <= z <= max(ends)]
    places = []
    for aperture in apertures:
        shear, half = _slopes(frustum, aperture, axis)
        middle = (aperture.x, aperture.y)[axis]
        places += [middle - z * shear + side * half * abs(z) for z in between for side in (-1, 1)]
    return min(places), max(places)
