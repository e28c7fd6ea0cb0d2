"""Exact queries of a mesh: ray hits, as in trimesh's two ray classes, and location of points.

A point is located inside, on or outside a surface by parity of crossings along +z. It is moved by
an infinitesimal amount, (h, h^2, 0) with h > 0 as small as needed (simulation of simplicity,
Edelsbrunner and Muecke, 1990). The ray of the moved point passes through no vertex, no edge and no
triangle parallel to +z; it crosses any other triangle in its interior or not at all. Points on the
surface are recognized before they are moved.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from trimesh import Trimesh

from xfrustum.reference.backend import cross, difference, dot
from xfrustum.reference.rays.filter import Integers, coordinates, integers
from xfrustum.reference.rays.rays import AllHits, ExactMesh, FirstHits, RayBatch
from xfrustum.scenes import InputError
from xfrustum.scenes.arrays import Floats, Indices, Mask


class Location(IntEnum):
    """Location of a point relative to a surface."""

    OUTSIDE = -1
    ON = 0
    INSIDE = 1


def locate(mesh: ExactMesh, points: Floats) -> Indices:
    """Return the `Location` (N,) of points (N, 3) by the parity of surfaces above them."""
    location = np.full(len(points), Location.OUTSIDE, dtype=np.int64)
    low, high = mesh.triangles.min(axis=(0, 1)), mesh.triangles.max(axis=(0, 1))
    within = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    inside = points[within]
    up = np.zeros_like(inside)
    up[:, 2] = 1.0
    ends = np.tile([0.0, np.inf], (len(inside), 1))
    pairs = mesh.candidates(RayBatch(origins=inside, directions=up, ends=ends))
    # At a certain hit, the ray crosses the triangle's interior before and after the point's move.
    crossings = np.bincount(pairs.ray[pairs.sure], minlength=len(inside))
    doubtful = pairs[~pairs.sure]
    on, crossed = crossings_above(mesh.triangles[doubtful.triangle], inside[doubtful.ray])
    crossings += np.bincount(doubtful.ray[crossed], minlength=len(inside))
    location[within[crossings % 2 == 1]] = Location.INSIDE
    location[within[doubtful.ray[on]]] = Location.ON
    return location


def crossings_above(triangles: Floats, points: Floats) -> tuple[Mask, Mask]:
    """Return masks of points on triangles (K, 3, 3), and of triangles above moved points.

    Points (K, 3) and triangles are paired; the decisions are made in integers.
    """
    (corners, start), _ = integers(triangles, points)
    p, origin = coordinates(corners), coordinates(start)
    q = [difference([axis[:, k] for axis in p], origin) for k in range(3)]
    sides = [cross(q[i], q[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    normal = [sum(side[axis] for side in sides) for axis in range(3)]
    offset = dot(q[0], normal)
    # A point is on a triangle with area if it is in the plane, on the inner side of all edges. It
    # is on a triangle without area if it is on the line of its corners, within their box.
    in_plane = (offset == 0) & _all([dot(side, normal) >= 0 for side in sides])
    flat = _all([part == 0 for part in normal])
    on_line = _all([part == 0 for side in sides for part in side])
    in_box = _all(
        [np.minimum.reduce([corner[axis] for corner in q]) <= 0 for axis in range(3)]
        + [np.maximum.reduce([corner[axis] for corner in q]) >= 0 for axis in range(3)]
    )
    on = np.where(flat, on_line & in_box, in_plane)
    # Sides of the moved point, projected along z: the sign of E - h (y_j - y_i) + h^2 (x_j - x_i)
    # is the sign of the first term that is not zero.
    signs = []
    for (i, j), side in zip(((0, 1), (1, 2), (2, 0)), sides, strict=True):
        x, y, _ = difference(q[j], q[i])
        signs.append(_first_sign([side[2], -y, x]))
    inside = (signs[0] == signs[1]) & (signs[1] == signs[2]) & (signs[0] != 0)
    above = (offset != 0) & ((offset > 0) == (normal[2] > 0))
    return on.astype(np.bool_), (inside & above).astype(np.bool_)


def open_edges(triangles: Floats) -> int:
    """Return the number of edges that belong to an odd number of triangles (F, 3, 3).

    Corners at the same position are one vertex. Zero means that the surface is closed.
    """
    # Adding 0.0 turns -0.0 into 0.0.
    _, vertex = np.unique(triangles.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    faces = vertex.reshape(-1, 3)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, counts = np.unique(edges[:, 0] * len(triangles) * 3 + edges[:, 1], return_counts=True)
    return int((counts % 2).sum())


def _all(conditions: Sequence[Any]) -> Any:
    return np.logical_and.reduce(
        [np.asarray(condition, dtype=np.bool_) for condition in conditions]
    )


def _first_sign(terms: Sequence[Integers]) -> Integers:
    """Return the sign of the first term that is not zero."""
    sign: Any = 0
    for term in reversed(terms):
        own = (term > 0).astype(np.int64) - (term < 0).astype(np.int64)
        sign = np.where(own != 0, own, sign)
    return np.asarray(sign)


class Range(TypedDict, total=False):
    """Closed range of t along each ray, numbers or arrays (N,); default 0 to infinity."""

    t_min: ArrayLike
    t_max: ArrayLike


class ExactIntersector:
    """Exact intersections of rays with a mesh; `mesh.ray = ExactIntersector(mesh)`.

    A ray is origin + t direction for the caller's doubles; it is neither normalized nor moved.
    Triangles and the range of t are closed: a ray that starts on a surface meets it at t = 0. A ray
    in the plane of a triangle does not meet the triangle.

    Structures are built on first use, and again after the mesh has changed.

    Parameters
    ----------
    geometry
        Mesh with triangles of any kind: open, degenerate, duplicate, or none.
    scale_to_box
        Keyword of trimesh's Embree class, which returns one triangle for each point along a ray.
        True or False: `intersects_id` also returns one triangle for each point, the one with the
        smallest number. None, as in trimesh's other class: `intersects_id` returns every triangle.
        The mesh is never scaled to a box.
    """

    def __init__(self, geometry: Trimesh, scale_to_box: bool | None = None) -> None:
        self.mesh = geometry
        self._scale_to_box = scale_to_box
        self._built: tuple[int, ExactMesh] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without structures, because these are in the memory of a device."""
        return {**vars(self), "_built": None}

    def first(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        *,
        t_min: ArrayLike = 0.0,
        t_max: ArrayLike = np.inf,
    ) -> FirstHits:
        """Return the first triangle of each ray, with t, certainty and ties.

        A ray that misses the mesh has triangle -1 and t NaN. See `FirstHits` for the error of t.

        Parameters
        ----------
        ray_origins, ray_directions
            (N, 3) finite numbers in the units of the mesh; directions of any length except zero.
        t_min, t_max
            Closed range of t, numbers or arrays (N,); either may be infinite.

        Raises
        ------
        InputError
            For arrays of other shapes, numbers that are not finite, and zero directions.
        """
        return self._exact.first(_checked_rays(ray_origins, ray_directions, t_min, t_max))

    def intersects_first(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike, **within: Unpack[Range]
    ) -> Indices:
        """Return the first triangle of each ray, (N,), -1 for a miss; parameters as for `first`."""
        return self.first(ray_origins, ray_directions, **within).triangle

    def intersects_any(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike, **within: Unpack[Range]
    ) -> Mask:
        """Return a mask (N,) of rays that meet the mesh; parameters as for `first`."""
        return self.intersects_first(ray_origins, ray_directions, **within) >= 0

    def intersects_id(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
        **within: Unpack[Range],
    ) -> tuple[NDArray[Any], ...]:
        """Return the hits, sorted by ray, then by t, then by triangle.

        Parameters
        ----------
        ray_origins, ray_directions, within
            As for `first`.
        multiple_hits
            False: only the first hit of each ray; for a tie, the triangle with the smallest number.
        max_hits
            Largest number of hits per ray, nearest first, >= 1.
        return_locations
            True: return the points of the hits as a third array.

        Returns
        -------
        tuple
            Numbers of triangles (K,), numbers of rays (K,), and on request the points (K, 3).
        """
        rays = _checked_rays(ray_origins, ray_directions, **within)
        each_place = self._scale_to_box is not None
        hits = self._hits(rays, multiple_hits, max_hits, each_place)
        numbers = hits.triangle, hits.ray
        return (*numbers, hits.position) if return_locations else numbers

    def intersects_location(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = 100,
        **within: Unpack[Range],
    ) -> tuple[Floats, Indices, Indices]:
        """Return points (K, 3), rays (K,) and triangles (K,) of the hits, each point once.

        Parameters are as for `intersects_id`. At a shared edge or vertex, the triangle with the
        smallest number is returned.
        """
        rays = _checked_rays(ray_origins, ray_directions, **within)
        hits = self._hits(rays, multiple_hits, max_hits, each_place=True)
        return hits.position, hits.ray, hits.triangle

    def contains_points(self, points: ArrayLike) -> Mask:
        """Return a mask (N,) of points (N, 3) strictly inside, without points on the surface.

        Open meshes are accepted: a point counts as inside if the number of surfaces above it, along
        +z, is odd, as in `locate_points` with closed=False.
        """
        return np.asarray(self.locate_points(points, closed=False) == Location.INSIDE)

    def locate_points(self, points: ArrayLike, *, closed: bool = True) -> Indices:
        """Return 1 for points (N, 3) inside the surface, 0 on it, -1 outside, (N,).

        Parameters
        ----------
        points
            Finite numbers in the units of the mesh.
        closed
            True: refuse a mesh that is not closed. False: a point is inside if the number of
            surfaces above it, along +z, is odd. Points on the surface are decided exactly in both
            cases.

        Raises
        ------
        InputError
            For points of another shape or not finite, and for a mesh with open edges. An edge is
            open if it belongs to an odd number of triangles, after corners at equal positions are
            merged.
        """
        places = _checked_vectors(points, "points", "point")
        if not len(self.mesh.faces):
            return np.full(len(places), Location.OUTSIDE, dtype=np.int64)
        if closed and (edges := open_edges(self._exact.triangles)):
            raise InputError(
                f"mesh: {edges:,} edges are open, so that it has no inside; close it, or pass "
                "closed=False for the parity along +z"
            )
        return locate(self._exact, places)

    @property
    def _exact(self) -> ExactMesh:
        """Structures of the mesh in its present state."""
        state = hash(self.mesh)
        if self._built is None or self._built[0] != state:
            # Copy the arrays, because the mesh may change in place.
            vertices = np.array(self.mesh.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(self.mesh.faces, dtype=np.int64).reshape(-1, 3)
            bad = np.flatnonzero(~np.isfinite(vertices)[faces].all(axis=(1, 2)))
            if len(bad):
                raise InputError(
                    f"mesh: triangle {bad[0]} has a corner that is not finite; remove it first"
                )
            if not len(faces):
                # Replace a mesh without triangles by a triangle without area, which no ray meets.
                vertices, faces = np.zeros((1, 3)), np.zeros((1, 3), dtype=np.int64)
            self._built = state, ExactMesh(vertices, faces)
        return self._built[1]

    def _hits(
        self, rays: RayBatch, multiple_hits: bool, max_hits: Any, each_place: bool
    ) -> AllHits:
        """Return the hits of rays, nearest first: every triangle, or one for each point."""
        # Callers without a type checker may pass other types.
        if not isinstance(max_hits, int | np.integer) or max_hits < 1:
            raise InputError(f"max_hits: {max_hits!r} is no positive integer; pass one")
        if not multiple_hits:
            return self._exact.first_points(rays)
        hits = self._exact.all(rays)
        number = np.arange(len(hits.ray)) - np.searchsorted(hits.ray, hits.ray, "left")
        if not each_place:
            return hits[number < max_hits]
        first_there = np.diff(hits.place, prepend=-1) != 0
        first_there |= number == 0
        return hits[first_there & (hits.place < max_hits)]


def _numbers(values: ArrayLike, name: str) -> Floats:
    """Return real numbers as doubles; InputError for strings, objects and complex numbers."""
    try:
        numbers = np.asarray(values)
    except ValueError:
        raise InputError(f"{name}: rows differ in length; pass an array of numbers") from None
    if numbers.dtype.kind not in "biuf":
        raise InputError(
            f"{name}: not an array of numbers but of {numbers.dtype}; pass integers or floats"
        )
    return numbers.astype(np.float64, copy=False)


def _checked_vectors(values: ArrayLike, name: str, each: str) -> Floats:
    """Return vectors as doubles (N, 3); InputError for other shapes and infinite numbers."""
    vectors = _numbers(values, name)
    if vectors.size == 0:
        vectors = vectors.reshape(0, 3)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise InputError(f"{name}: the shape is {vectors.shape}; pass an array of shape (N, 3)")
    finite = np.isfinite(vectors)
    # Test the whole array first: testing a million vectors row by row takes twenty times as long.
    if not finite.all():
        bad = int(np.argmin(finite.all(axis=1)))
        raise InputError(f"{name}: {each} {bad} is {vectors[bad].tolist()}; pass finite numbers")
    return vectors


def _checked_rays(
    origins: ArrayLike,
    directions: ArrayLike,
    t_min: ArrayLike = 0.0,
    t_max: ArrayLike = np.inf,
) -> RayBatch:
    """Return rays as doubles; InputError as `ExactIntersector.first` states."""
    starts = _checked_vectors(origins, "ray_origins", "ray")
    along = _checked_vectors(directions, "ray_directions", "ray")
    if len(starts) != len(along):
        raise InputError(
            f"ray_directions: {len(along):,} directions for {len(starts):,} origins; pass as many "
            "of either"
        )
    x, y, z = along.T
    still = np.flatnonzero((x == 0) & (y == 0) & (z == 0))
    if len(still):
        raise InputError(
            f"ray_directions: ray {still[0]} is [0, 0, 0], which is no direction; leave it out"
        )
    ends = np.empty((len(starts), 2))
    for column, (name, values) in enumerate((("t_min", t_min), ("t_max", t_max))):
        places = _numbers(values, name)
        try:
            ends[:, column] = places
        except ValueError:
            raise InputError(
                f"{name}: the shape is {places.shape}; pass a number, or one for each of "
                f"{len(starts):,} rays"
            ) from None
        bad = np.flatnonzero(np.isnan(ends[:, column]))
        if len(bad):
            raise InputError(f"{name}: ray {bad[0]} is NaN; pass a number or infinity")
    return RayBatch(origins=starts, directions=along, ends=ends)
