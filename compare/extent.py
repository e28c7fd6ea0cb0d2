"""Where a scene lies, before anything is drawn: what reach and frusta hold of each object.

Hidden surfaces are not considered: an object behind another one is in sight.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.model.region import Region
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, Scene, SceneObject
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

Point = tuple[float, float, float]

PLATE_ROUNDING = 2.0**-24
"""Distance from the plate, as a share of an object's largest coordinate, that rounding makes of 0: half a
unit in the last place of the single precision in which rasterizers and mesh files hold coordinates."""

FILM_MARGIN_PX = 1e-6
"""Margin around the area that a triangle covers on the film. Film coordinates have a dozen roundings of
doubles, an error below 1e-12 px on films of any size; a triangle nearer than the margin to a pixel's center
counts as in sight."""

IN_SIGHT_CHUNK_TRIANGLES = 1 << 14
"""Triangles examined together to find any one in sight: most meshes have one among the first."""

MAX_SPLIT_TRIANGLES = 50_000
"""Largest number of triangles that a coarse mesh is split into before its apertures are counted. The
apertures that see a triangle are counted by the rectangle around them, which is too large for large ones."""

HALVINGS = 6
"""Number of halvings of the reach at which bins of depth end. The innermost bin, from the plate to 1/64 of
the reach, has every error that grows as 1/|z|."""


# Objects -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Sight:
    """The apertures of a plate whose crossed frusta hold some part of an object, whatever hides it.

    Attributes
    ----------
    apertures, of
        Number of these apertures, and number of all.
    columns, rows
        First and last column and row of these apertures; None where there are none.
    corners
        Whether the apertures at the top left, top right, bottom left and bottom right are among them.
    """

    apertures: int
    of: int
    columns: tuple[int, int] | None
    rows: tuple[int, int] | None
    middle: bool
    corners: tuple[bool, bool, bool, bool]

    @classmethod
    def of_flags(cls, flags: Mask, plate: Plate) -> Sight:
        """Count the (rows, columns) flags of a plate's apertures."""
        rows, columns = np.nonzero(flags)
        column, row = plate.middle.index
        return cls(
            apertures=len(rows),
            of=flags.size,
            columns=(int(columns.min()), int(columns.max())) if len(rows) else None,
            rows=(int(rows.min()), int(rows.max())) if len(rows) else None,
            middle=bool(flags[row, column]),
            corners=(bool(flags[0, 0]), bool(flags[0, -1]), bool(flags[-1, 0]), bool(flags[-1, -1])),
        )


@dataclass(frozen=True, kw_only=True)
class ObjectExtent:
    """The place and the size of one object.

    Attributes
    ----------
    low, high
        Corners of its bounding box, scene units; its heights run from low[2] to high[2].
    share_in_reach
        Share of its surface between the ends of the reach; None where the surface has no area.
    """

    number: int
    name: str
    triangles: int
    low: Point
    high: Point
    share_in_reach: float | None
    sight: Sight

    @property
    def size(self) -> Point:
        """Lengths of the bounding box along x, y and z, scene units."""
        x, y, z = (high - low for low, high in zip(self.low, self.high, strict=True))
        return x, y, z


def extents(scene: Scene) -> tuple[ObjectExtent, ...]:
    """Return the place and the size of each object of a scene."""
    return tuple(
        ObjectExtent(
            number=number,
            name=part.name,
            triangles=len(part.faces),
            low=box(part)[0],
            high=box(part)[1],
            share_in_reach=share_in_reach(part, scene.frustum),
            sight=Sight.of_flags(apertures_in_sight(part, scene.frustum, scene.plate), scene.plate),
        )
        for number, part in enumerate(scene.objects)
    )


def triangles_in_chunks(part: SceneObject, at_once: int = TRIANGLES_AT_ONCE // 4) -> Iterator[Floats]:
    """Yield (F, 3, 3) corners of an object's triangles, some at a time, for cutting takes memory."""
    for start in range(0, len(part.faces), at_once):
        yield part.vertices[part.faces[start : start + at_once]]


def box(part: SceneObject) -> tuple[Point, Point]:
    """Return the lowest and the highest coordinates of an object's triangles."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for triangles in triangles_in_chunks(part):
        low = np.minimum(low, triangles.min(axis=(0, 1)))
        high = np.maximum(high, triangles.max(axis=(0, 1)))
    (x0, y0, z0), (x1, y1, z1) = low.tolist(), high.tolist()
    return (x0, y0, z0), (x1, y1, z1)


def in_plate(part: SceneObject) -> int:
    """Return how many triangles of an object lie in the plate, within `PLATE_ROUNDING`."""
    allowed = PLATE_ROUNDING * float(np.abs(part.vertices).max(initial=0.0))
    return sum(
        int(np.count_nonzero((np.abs(one[..., 2]) <= allowed).all(axis=1)))
        for one in triangles_in_chunks(part)
    )


def share_in_reach(part: SceneObject, frustum: Frustum) -> float | None:
    """Return the share of an object's surface between the ends of the reach; None where it has no area."""
    toward, back = frustum.reach
    whole = within = 0.0
    # Coordinates are scaled to at most one, so that areas neither underflow nor overflow.
    size = max(float(np.abs(part.vertices).max()), np.finfo(np.float64).tiny)
    for triangles in triangles_in_chunks(part):
        area = areas(triangles / size)
        whole += float(area.sum())
        within += float((area * share_between(triangles, -back, toward)).sum())
    return within / whole if whole > 0 else None


def areas(triangles: Floats) -> Floats:
    """Return the (F,) areas of triangles (F, 3, 3), square scene units."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2)


def share_between(triangles: Floats, low: float, high: float) -> Floats:
    """Return the (F,) share of each triangle's area that lies between two heights, both ends included."""
    z = np.sort(triangles[..., 2], axis=1)
    flat = z[:, 0] == z[:, 2]
    share = _share_below(z, high) - _share_below(z, low)
    return np.where(flat, (z[:, 0] >= low) & (z[:, 0] <= high), np.clip(share, 0.0, 1.0))


def _share_below(z: Floats, height: float) -> Floats:
    """Return the (F,) share of each triangle's area below a height, from (F, 3) ascending heights.

    The length of a triangle's section grows linearly from its lowest corner to its middle one, and
    shrinks linearly from there: the area below is quadratic in the height on either side.
    """
    lowest, middle, highest = z.T

    def quotient(part: Floats, whole: Floats) -> Floats:
        # Quotients outside 0 to 1 are not used, and might overflow.
        usable = (whole > 0) & (part >= 0) & (part <= whole)
        return np.divide(part, whole, out=np.ones(len(z)), where=usable)

    rise, fall = height - lowest, highest - height
    rising = quotient(rise, highest - lowest) * quotient(rise, middle - lowest)
    falling = quotient(fall, highest - lowest) * quotient(fall, highest - middle)
    within = np.where(height < middle, rising, 1.0 - falling)
    return np.where(height <= lowest, 0.0, np.where(height >= highest, 1.0, within))


# In sight ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class _Layer:
    """The parts of some triangles between two heights that lie on one side of the plate.

    Within it the film coordinate of a point, and the range of apertures that see it, are functions of the
    point's height without a pole: over a convex part they are extreme at its corners.

    Attributes
    ----------
    corners, valid
        (F, 9, 3) corners of each part in no order, and (F, 9) whether each exists.
    behind
        Whether the layer lies behind the plate, z <= 0.
    """

    corners: Floats
    valid: Mask
    behind: bool

    def ends(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return the (F,) extremes of (F, 9) values at the corners; infinite where they are undefined."""
        low = np.where(self.valid, np.where(np.isnan(low), -np.inf, low), np.inf)
        high = np.where(self.valid, np.where(np.isnan(high), np.inf, high), -np.inf)
        return low.min(axis=1), high.max(axis=1)


def _layers(triangles: Floats, frustum: Frustum) -> Iterator[_Layer]:
    """Cut triangles (F, 3, 3) by the reach, the plate, and the height of the projection screen."""
    toward, back = frustum.reach
    heights = [-back, 0.0, toward]
    if frustum.screen is not None and -back < frustum.screen.height < toward:
        heights.append(frustum.screen.height)
    z, ends = triangles[..., 2], np.roll(triangles, -1, axis=1)
    for low, high in pairwise(sorted(heights)):
        corners, valid = [triangles], [(z >= low) & (z <= high)]
        for height in (low, high):
            above, below = ends[..., 2] - height, z - height
            crossing = (above > 0) != (below > 0)
            share = np.divide(below, below - above, out=np.zeros_like(z), where=crossing)
            points = triangles + share[..., None] * (ends - triangles)
            points[..., 2] = height
            corners.append(points)
            valid.append(crossing)
        yield _Layer(
            corners=np.concatenate(corners, axis=1), valid=np.concatenate(valid, axis=1), behind=high <= 0
        )


def _slopes(frustum: Frustum, aperture: Aperture, axis: int) -> tuple[float, float]:
    """Return shear and half-extent of the lines through an aperture, along one axis (CONVENTIONS.md)."""
    if frustum.screen is None:
        assert frustum.fov is not None
        return 0.0, float(np.tan(frustum.fov[axis] / 2))
    depth = -frustum.screen.height
    center = (aperture.x, aperture.y)[axis]
    return (frustum.screen.center[axis] - center) / depth, frustum.screen.size[axis] / 2 / abs(depth)


def in_sight(part: SceneObject, frustum: Frustum, aperture: Aperture) -> bool:
    """Return whether the image of an aperture can show any of an object, whatever hides it.

    False is certain: no pixel's center lies in the rectangle about any triangle on the film, or the film
    lies wholly beyond one of its edges. True may be wrong by slivers between two pixels' centers.
    """
    return any(
        bool(_can_be_shown(triangles, layer, frustum, aperture).any())
        for triangles in triangles_in_chunks(part, IN_SIGHT_CHUNK_TRIANGLES)
        for layer in _layers(triangles, frustum)
    )


def _can_be_shown(triangles: Floats, layer: _Layer, frustum: Frustum, aperture: Aperture) -> Mask:
    """Return (F,) whether a pixel's center may lie in the image of each triangle's part in a layer."""
    shown: Mask = np.asarray(layer.valid.any(axis=1))
    s = -layer.corners[..., 2]
    for axis, pixels in enumerate(frustum.resolution):
        shear, half = _slopes(frustum, aperture, axis)
        across = layer.corners[..., axis] - (aperture.x, aperture.y)[axis] - shear * s
        # The sign is that of the layer: in the plate s is zero, or minus zero, on either side of it. A point
        # in the aperture itself lies on every line, and has no film coordinate.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            u = (across if layer.behind else -across) / (half * np.abs(s))
        low, high = layer.ends(u, u)
        # The centers of pixels 0 to n - 1 lie at film coordinates (2 k + 1)/n - 1, whichever way k counts.
        first = np.ceil(np.clip((low + 1) * pixels / 2 - 0.5 - FILM_MARGIN_PX, 0, pixels))
        last = np.floor(np.clip((high + 1) * pixels / 2 - 0.5 + FILM_MARGIN_PX, -1, pixels - 1))
        shown &= first <= last
    if shown.any():
        shown[shown] = ~_film_beyond_an_edge(triangles[shown], layer.behind, frustum, aperture)
    return shown


def _film_beyond_an_edge(triangles: Floats, behind: bool, frustum: Frustum, aperture: Aperture) -> Mask:
    """Return (F,) whether all corners of the film lie beyond one and the same edge of a triangle.

    A line of direction d through the aperture meets a triangle P0 P1 P2 in P = a + s d only if the three
    determinants det(d, Pi - a, Pj - a), i and j the ends of an edge, have the sign of s times that of
    det(P0 - a, P1 - a, P2 - a). They are linear in d, so four corners speak for the film.
    """
    (kx, tx), (ky, ty) = (_slopes(frustum, aperture, axis) for axis in (0, 1))
    corner = np.array([(kx + u * tx, ky + v * ty, -1.0) for u in (-1, 1) for v in (-1, 1)])
    from_aperture = triangles - (aperture.x, aperture.y, 0.0)
    # Coordinates are scaled to at most one, so that products of three neither underflow nor overflow.
    size = np.abs(from_aperture).max(axis=(1, 2), keepdims=True)
    from_aperture = from_aperture / np.where(size > 0, size, 1.0)
    edge_normals = np.cross(from_aperture, np.roll(from_aperture, -1, axis=1))
    whole = (edge_normals[:, 0] * from_aperture[:, 2]).sum(axis=1)
    side = np.sign(whole) * (1.0 if behind else -1.0)
    # A determinant is a sum of products of numbers of at most one and the slope, a dozen roundings each.
    doubt = 64 * np.finfo(np.float64).eps * np.abs(corner).max()
    beyond = side[:, None, None] * (edge_normals @ corner.T) < -doubt
    return np.asarray((np.abs(whole) > doubt) & beyond.all(axis=2).any(axis=1))


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
        for layer in _layers(_split_coarse(triangles, len(part.faces)), frustum):
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


def _aperture_range(layer: _Layer, frustum: Frustum, plate: Plate, axis: int) -> tuple[Indices, Indices]:
    """Return the (F,) first and last column, or row counted upward, whose lines may meet each part.

    A point is on a line of the aperture at a where abs(x - s m/S - a (1 - s/S)) <= t abs(s). The screen is at
    s = S and has its middle at m; without a screen 1/S is zero. In a layer 1 - s/S keeps its sign.
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
        low, high = layer.ends((x - half * np.abs(s)) / toward_a, (x + half * np.abs(s)) / toward_a)
    count, pitch = plate.hogels[axis], plate.size[axis] / plate.hogels[axis]
    first = np.ceil(np.clip((low + plate.size[axis] / 2) / pitch - 0.5 - FILM_MARGIN_PX, 0, count))
    last = np.floor(np.clip((high + plate.size[axis] / 2) / pitch - 0.5 + FILM_MARGIN_PX, -1, count - 1))
    return first.astype(np.int64), last.astype(np.int64)


def aside_of_frusta(
    frustum: Frustum, apertures: Sequence[Aperture], axis: int, ends: tuple[float, float]
) -> tuple[float, float]:
    """Return the least and the largest x (axis 0) or y (1) of the lines of apertures between two heights.

    Lines are straight: the extremes lie at the two heights or, where these are on both sides of the plate, in
    the apertures.
    """
    between = [z for z in (*ends, 0.0) if min(ends) <= z <= max(ends)]
    places = []
    for aperture in apertures:
        shear, half = _slopes(frustum, aperture, axis)
        middle = (aperture.x, aperture.y)[axis]
        places += [middle - z * shear + side * half * abs(z) for z in between for side in (-1, 1)]
    return min(places), max(places)


# By depth ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DepthBin:
    """The content of the frusta between two distances from the plate, on one side of it.

    Attributes
    ----------
    heights
        Distances |z| between which the bin lies, scene units.
    nearest, farthest
        Range of |z| of the content, scene units, from the bounding boxes of its triangles.
    triangles
        Number of triangles that reach into the bin, inside the frusta.
    share
        Share of their surface, by area, of that of all bins; 0 where all of it has no area.
    """

    behind: bool
    heights: tuple[float, float]
    nearest: float
    farthest: float
    triangles: int
    share: float


def depth_bins(scene: Scene, apertures: Iterable[Aperture] | None = None) -> tuple[DepthBin, ...]:
    """Return the bins that have content, from the farthest behind the plate to the farthest before it.

    Apertures count with their whole cells; None for all of the plate.
    """
    region = Region.true(scene, apertures)
    toward, back = scene.frustum.reach
    found = []
    for behind, reach in ((True, back), (False, toward)):
        for heights in pairwise([0.0, *(reach / 2**k for k in range(HALVINGS, -1, -1))]):
            low, high, count, area = np.inf, 0.0, 0, 0.0
            for part in scene.objects:
                for triangles in triangles_in_chunks(part):
                    ends, one = _held(triangles, region, behind, heights)
                    low, high = min(low, ends.min(initial=np.inf)), max(high, ends.max(initial=0.0))
                    count, area = count + len(ends), area + one
            if count:
                found.append((behind, heights, float(low), float(high), count, area))
    whole = sum(area for *_, area in found)
    bins = [
        DepthBin(
            behind=behind,
            heights=heights,
            nearest=low,
            farthest=high,
            triangles=count,
            share=area / whole if whole > 0 else 0.0,
        )
        for behind, heights, low, high, count, area in found
    ]
    return tuple(sorted(bins, key=lambda one: one.heights[1] * (-1 if one.behind else 1)))


def _held(
    triangles: Floats, region: Region, behind: bool, heights: tuple[float, float]
) -> tuple[Floats, float]:
    """Return (N, 2) distances of those triangles (F, 3, 3) that reach into a bin and a region, and the area.

    One that lies between two bins belongs to the inner one; one in the plate, to both sides.
    """
    near, far = heights
    low_z, high_z = (-far, -near) if behind else (near, far)
    distances = triangles[..., 2] * (-1 if behind else 1)
    least, most = distances.min(axis=1), distances.max(axis=1)
    outer_end = np.where(least == most, least <= far, least < far)
    inner_end = (most > near) | ((least == most) & (most == 0) & (near == 0))
    inside = triangles[outer_end & inner_end]
    low, high = inside.min(axis=1), inside.max(axis=1)
    low[:, 2], high[:, 2] = np.maximum(low[:, 2], low_z), np.minimum(high[:, 2], high_z)
    held = region.holds(low, high) if len(inside) else np.zeros(0, dtype=np.bool_)
    kept = inside[held]
    area = float((areas(kept) * share_between(kept, low_z, high_z)).sum())
    return np.abs(np.stack((low[held, 2], high[held, 2]), axis=1)), area
