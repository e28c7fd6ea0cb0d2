"""Surfaces cut into triangles: Bezier patches and polygons.

**Patches** (`.bpt` files) are tessellated within a chord tolerance and without cracks. A control
net (n + 1, m + 1, 3) defines a surface of degree n along u (first index) and degree m along v, both
from 0 to 1 (Farin, "Curves and surfaces for CAGD", 5th ed., chapters 4 and 14).

**Polygons** are triangulated in their own plane. Libraries (mapbox_earcut) drop corners on straight
edges, which would cause cracks between neighbors. Here a polygon of n corners always gives n - 2
triangles.

For any triangulation of a polygon, the signed areas of the triangles add up to the polygon's area
by Newell's formula. The triangulation of an outline that does not cross itself is therefore correct
if no triangle faces against Newell's normal: no area is covered twice or left out. A fan also needs
an outline with a total turn of 360 degrees. Wrong ears of an outline that crosses itself are not
always detected: its ends may overlap, like the ends of a split ring.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xfrustum.scenes import InputError, SceneObject
from xfrustum.scenes.arrays import Floats, Indices, Mask
from xfrustum.scenes.disk import bounded_memory, check_mesh_file, read_input
from xfrustum.scenes.shapes import drop_flat, grid_faces

#: Distance from 1 to the next larger double, 2^-52: twice the largest relative rounding error.
EPSILON = float(np.finfo(np.float64).eps)
#: Upper limit of the steps along a patch, because the computed number may be infinite.
MAX_STEPS = 1e18
#: Largest number of triangles: a finer tolerance is probably a mistake in the unit.
MAX_TRIANGLES = 20_000_000
Steps = Sequence[tuple[int, int]]  #: numbers of steps of each patch along u and v


def evenly(count: int) -> Floats:
    """Return the count + 1 parameters that divide 0..1 into equal steps."""
    return np.asarray(np.arange(count + 1) / count)


def casteljau(controls: Floats, at: Floats) -> Floats:
    """Return points (T, ..., 3) of Bezier curves by De Casteljau; identical on all machines."""
    at = at.reshape(-1, *(1 for _ in controls.shape))
    points = np.broadcast_to(controls, (len(at), *controls.shape))
    while points.shape[1] > 1:
        points = points[:, :-1] * (1 - at) + points[:, 1:] * at
    return points[:, 0]


def surface(net: Floats, u: Floats, v: Floats) -> Floats:
    """Return the points (U, V, 3) of a patch on a grid of parameters (U,) and (V,)."""
    return np.ascontiguousarray(casteljau(casteljau(net, u).swapaxes(0, 1), v).swapaxes(0, 1))


def derivative(net: Floats, axis: int) -> Floats:
    """Return the control net of the derivative along u (axis 0) or v (axis 1), one degree lower."""
    degree = net.shape[axis] - 1
    return np.asarray(degree * np.diff(net, axis=axis)) if degree else np.zeros_like(net)


def second_derivatives(net: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the control nets of f_uu, f_uv and f_vv."""
    along_u, along_v = derivative(net, 0), derivative(net, 1)
    return derivative(along_u, 0), derivative(along_u, 1), derivative(along_v, 1)


def second_derivative_bounds(net: Floats) -> list[float]:
    """Return upper bounds of |f_uu|, |f_uv| and |f_vv| over a patch."""
    # A Bezier surface lies in the convex hull of its control points, and derivatives of a Bezier
    # surface are Bezier surfaces.
    return [float(np.linalg.norm(part, axis=-1).max()) for part in second_derivatives(net)]


def normals(net: Floats, u: Floats, v: Floats) -> Floats:
    """Return the unit normals (U, V, 3) along f_u x f_v; NaN where there is none.

    If f_u x f_v is zero on a border, for example on a border that is a single point, the normal is
    the limit from the inside along the other parameter, computed from the derivative of f_u x f_v.
    """
    # Step 1: compute f_u x f_v, and test if it is zero within rounding. The rounding error of De
    # Casteljau's interpolation of degree n is at most 2 n epsilon of the largest control point, the
    # error of a difference of control points is epsilon of the difference, and the error of a cross
    # product is 4 epsilon of the product of the lengths.
    nets = derivative(net, 0), derivative(net, 1)
    f_u, f_v = (surface(part, u, v) for part in nets)
    cross = np.cross(f_u, f_v)
    length_u, length_v = np.linalg.norm(f_u, axis=-1), np.linalg.norm(f_v, axis=-1)
    off_u, off_v = (
        2 * sum(net.shape) * EPSILON * np.linalg.norm(part, axis=-1).max() for part in nets
    )
    rounding = length_u * off_v + length_v * off_u + 4 * EPSILON * length_u * length_v
    zero = np.linalg.norm(cross, axis=-1) <= rounding
    if zero.any():
        # Step 2: the derivatives of f_u x f_v along v and along u, by the product rule. Toward the
        # inside, a parameter increases from 0 and decreases from 1.
        f_uu, f_uv, f_vv = (surface(part, u, v) for part in second_derivatives(net))
        from_v = np.sign(0.5 - v)[:, None] * (np.cross(f_uv, f_v) + np.cross(f_u, f_vv))
        from_u = np.sign(0.5 - u)[:, None, None] * (np.cross(f_uu, f_v) + np.cross(f_u, f_uv))
        # Step 3: on a border, the derivative toward the inside is the direction of the limit; v is
        # used first.
        at_v, at_u = np.isin(v, (0, 1))[None, :, None], np.isin(u, (0, 1))[:, None, None]
        limit = np.where(
            at_v & from_v.any(axis=-1, keepdims=True), from_v, np.where(at_u, from_u, 0.0)
        )
        cross = np.where(zero[..., None], limit, cross)
    # Step 4: unit length, and NaN where even the limit is zero.
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    return np.asarray(np.divide(cross, length, out=np.full(cross.shape, np.nan), where=length > 0))


def steps_for(net: Floats, chord_tolerance: float) -> tuple[int, int]:
    """Return the fewest steps along u and v that keep a chord tolerance.

    Flat right triangles with legs 1/a and 1/b in the parameters lie within (M_uu/a^2 + 2 M_uv/(a
    b) + M_vv/b^2) / 8 of the surface, point by point, where M are the largest second derivatives
    (Filip, Magedson and Markot, "Surface algorithms using bounds on derivatives", CAGD 3, 1986).
    Because 2/(a b) <= 1/a^2 + 1/b^2, this is at most ((M_uu + M_uv)/a^2 + (M_uv + M_vv)/b^2) / 8.
    The number of triangles is smallest if each of the two terms is half of the tolerance.
    """
    m_uu, m_uv, m_vv = second_derivative_bounds(net)
    along_u, along_v = m_uu + m_uv, m_uv + m_vv
    # Each direction gets half of the tolerance, or all of it if the other direction is straight.
    halves = 2 if along_u > 0 and along_v > 0 else 1
    # bound / (8 a^2) = tolerance / halves, solved for a.
    needed = (math.sqrt(halves * (bound / chord_tolerance) / 8) for bound in (along_u, along_v))
    steps_u, steps_v = (max(1, math.ceil(min(steps, MAX_STEPS))) for steps in needed)
    return steps_u, steps_v


def tessellate(
    nets: Sequence[Floats], chord_tolerance: float, *, name: str, material: str | None = None
) -> SceneObject:
    """Return triangles whose two-sided distance from the patches is at most the tolerance.

    Patches that share an edge (the same control points) divide the edge at the same points, bit for
    bit. Raises InputError if more than `MAX_TRIANGLES` are needed, or if no patch has an area.
    """

    def triangles(steps: Steps) -> int:
        return sum(2 * along_u * along_v for along_u, along_v in steps)

    steps = [steps_for(net, chord_tolerance) for net in nets]
    # Matching only adds steps. It counts them in 64 bits, and a tiny tolerance would overflow the
    # count.
    if triangles(steps) <= MAX_TRIANGLES:
        steps = matched_steps(nets, steps)
    if (count := triangles(steps)) > MAX_TRIANGLES:
        number = f"{count:,}" if count < 10**15 else f"{float(count):.0e}"
        raise InputError(
            f"a chord tolerance of {chord_tolerance:.3g} takes {number} triangles, more than "
            f"{MAX_TRIANGLES:,}; choose a larger chord_tolerance"
        )
    return cut(nets, steps, name=name, material=material)


def cut(
    nets: Sequence[Floats], steps: Steps, *, name: str, material: str | None = None
) -> SceneObject:
    """Return patches cut into steps, with exact normals; the winding follows f_u x f_v."""
    vertices, directions, faces = [], [], []
    start = 0
    for net, (along_u, along_v) in zip(nets, steps, strict=True):
        u, v = evenly(along_u), evenly(along_v)
        points = surface(net, u, v)
        points[:, 0], points[:, -1] = _edge(net[:, 0], along_u), _edge(net[:, -1], along_u)
        points[0], points[-1] = _edge(net[0], along_v), _edge(net[-1], along_v)
        faces.append(start + grid_faces(*points.shape[:2]))
        vertices.append(points.reshape(-1, 3))
        directions.append(normals(net, u, v).reshape(-1, 3))
        start += len(vertices[-1])
    kept, with_area = drop_flat(np.concatenate(vertices), np.concatenate(faces))
    directed = np.concatenate(directions)
    return SceneObject(
        name=name, vertices=kept, faces=with_area, material=material, vertex_normals=directed
    )


def matched_steps(nets: Sequence[Floats], least: Steps) -> list[tuple[int, int]]:
    """Return the smallest numbers of steps that agree on all shared edges."""
    # A graph links the directions of patches that share an edge: node 2 p is patch p along u, node
    # 2 p + 1 along v. The first patch with an edge owns it.
    owners: dict[bytes, int] = {}
    links = []
    for patch, net in enumerate(nets):
        for side, axis in ((net[:, 0], 0), (net[:, -1], 0), (net[0], 1), (net[-1], 1)):
            if _is_point(side):
                continue
            node = 2 * patch + axis
            links.append((node, owners.setdefault(_oriented(side)[0].tobytes(), node)))
    # All directions of a strip, a connected component of the graph, use the largest number of steps
    # in the strip.
    needed = np.array(least, dtype=np.int64).reshape(-1)
    pairs = np.array(links, dtype=np.int64).reshape(-1, 2)
    graph = coo_array(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(needed), len(needed))
    )
    strips, strip = connected_components(graph, directed=False)
    of_strip = np.zeros(strips, dtype=np.int64)
    np.maximum.at(of_strip, strip, needed)
    return [(int(u), int(v)) for u, v in of_strip[strip].reshape(-1, 2)]


def _edge(controls: Floats, steps: int) -> Floats:
    """Return the points of a border: the same bits for both patches that share it."""
    if _is_point(controls):
        return np.repeat(controls[:1], steps + 1, axis=0)
    oriented, turned = _oriented(controls)
    points = casteljau(oriented, evenly(steps))
    return points[::-1] if turned else points


def _oriented(controls: Floats) -> tuple[Floats, bool]:
    """Return control points in the lexicographically smaller order, and whether it is reversed."""
    controls = (
        controls + 0.0
    )  # turns negative zeros positive, so that equal points have equal bytes
    turned = controls[::-1].tolist() < controls.tolist()
    return np.ascontiguousarray(controls[::-1] if turned else controls), turned


def _is_point(controls: Floats) -> bool:
    return bool((controls == controls[0]).all())


#: Default chord tolerance as a share of the diagonal of the box about the control points: half a
#: pixel if the patches fill an image of 512 x 512 pixels.
RELATIVE_CHORD = 1e-3
#: Largest coordinate of a control point: squares and products with degrees stay far from overflow,
#: 1e308.
LARGEST_COORDINATE = 1e100
#: Largest number of words in a file: more would not fit into memory as Python's own objects.
_MAX_WORDS = 1 << 27


def load_patches(
    path: Path, *, chord_tolerance: float | None = None, material: str | None = None
) -> SceneObject:
    """Read a patch file as one object, in its own coordinates.

    The file is a text: the number of patches, then for each patch its degrees n m and its (n + 1)
    (m + 1) points x y z, with consecutive points along m. The tolerance is the largest distance
    between surface and triangles, in the file's unit. Raises InputError if the file is missing or
    damaged, or there are too many triangles.
    """
    nets = read_patches(path)
    if chord_tolerance is None:
        points = np.concatenate([net.reshape(-1, 3) for net in nets])
        chord_tolerance = RELATIVE_CHORD * float(np.linalg.norm(np.ptp(points, axis=0)))
        if chord_tolerance == 0:
            raise InputError(f"{path}: all control points are the same; write the patches again")
    try:
        return tessellate(nets, chord_tolerance, name=str(path), material=material)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_patches(path: Path) -> list[Floats]:
    """Return the control nets (n + 1, m + 1, 3) of a patch file; InputError for other files."""
    check_mesh_file(path)
    with bounded_memory(path):
        try:
            words = read_input(path, "patch file").decode("ascii").split(maxsplit=_MAX_WORDS)
        except ValueError as error:
            raise InputError(
                f"{path}: is not a text of Bezier patches; write the file again"
            ) from error
        count, at = _count(path, words, 0, "the number of patches"), 1
        nets = []
        for number in range(count):
            n, m = (_count(path, words, at + k, f"a degree of patch {number}") for k in (0, 1))
            end = at + 2 + (n + 1) * (m + 1) * 3
            if end > len(words):
                raise InputError(
                    f"{path}: ends within the control points of patch {number}; write the "
                    "file again"
                )
            point = f"{path}: a control point of patch {number}"
            try:
                net = np.array(words[at + 2 : end], dtype=np.float64).reshape(n + 1, m + 1, 3)
            except ValueError as error:
                raise InputError(f"{point} is not a number ({error})") from error
            if not (np.abs(net) <= LARGEST_COORDINATE).all():
                raise InputError(f"{point} is NaN, or beyond {LARGEST_COORDINATE:.0e}; repair it")
            nets.append(net)
            at = end
    if at < len(words):
        raise InputError(
            f"{path}: goes on after {count} patches; correct their number in the first line"
        )
    return nets


def _count(path: Path, words: list[str], at: int, what: str) -> int:
    if at >= len(words):
        raise InputError(f"{path}: ends before {what}; write the file again")
    digits = words[at].lstrip("0")
    if not (digits.isascii() and digits.isdigit()):
        raise InputError(
            f"{path}: {what} must be a whole number of at least 1, not {words[at][:40]!r}"
        )
    # Larger numbers cannot be right, and Python refuses to convert thousands of digits.
    if len(digits) > len(str(_MAX_WORDS)):
        raise InputError(f"{path}: {what} must be at most {_MAX_WORDS:,}, not {words[at][:40]}..")
    return int(digits)


#: Largest number of corners of a polygon that the fan does not cut; time grows with its square.
MAX_CONCAVE_CORNERS = 4_000
#: Rounding error of a cross product of coordinates of at most one, in units of the coordinates'
#: rounding error.
_ROUNDINGS = 16
_SPIKE = 1e-6  # radians; if an outline goes back on itself, rounding decides the sign of the turn


def cut_polygons(
    points: Floats, corners: Indices, counts: Indices, refuse: Callable[[int, str], InputError]
) -> Indices:
    """Return (T, 3) indices into `corners` of the triangles of polygons, polygon by polygon.

    The fan from a polygon's first corner is used if it is correct; the second triangle of a
    quadrilateral then begins at its third corner, as in trimesh. Polygons that are not flat are
    projected along Newell's normal; their fan is used if all its triangles face along this normal.

    Parameters
    ----------
    points
        (V, 3) coordinates.
    corners
        (K,) indices into `points`, polygon after polygon.
    counts
        (P,) number of corners of each polygon, at least 3.
    refuse
        Function of a polygon number and a reason that returns the error.
    """
    first = np.cumsum(counts) - counts
    before = np.cumsum(counts - 2) - (counts - 2)  # triangles of earlier polygons
    triangles = np.empty((int((counts - 2).sum()), 3), np.int64)
    # Polygons of equal size are processed together: most files have one or two sizes.
    for count in np.unique(counts).tolist():
        which = np.flatnonzero(counts == count)
        local = np.repeat(_fan(count)[None], len(which), axis=0)
        if count > 3:
            polygons = points[corners[first[which, None] + np.arange(count)]]
            _mend(polygons, local, which, refuse)
        triangles[before[which, None] + np.arange(count - 2)] = first[which, None, None] + local
    return triangles


def sizes_together(counts: Indices) -> Indices:
    """Return the indices, in polygon order, of triangles in trimesh's order.

    Triangles come first, then first halves of quadrilaterals, then their second halves, then fans.
    """
    size = np.repeat(np.minimum(counts, 5), counts - 2)
    within = np.arange(len(size)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    return np.lexsort((np.where(size == 4, within, 0), size))


def _fan(count: int) -> Indices:
    if count == 4:
        return np.array([[0, 1, 2], [2, 3, 0]])
    second = np.arange(1, count - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def _mend(
    polygons: Floats, local: Indices, numbers: Indices, refuse: Callable[[int, str], InputError]
) -> None:
    """Replace the triangles (P, n - 2, 3) of each polygon (P, n, 3) whose fan is wrong."""
    count = polygons.shape[1]
    size = np.ptp(polygons, axis=1).max(axis=1)
    doubt = np.abs(polygons).max(axis=(1, 2))  # coordinates are rounded in proportion to themselves
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        shape = (polygons - polygons[:, :1]) / size[:, None, None]
        doubt = _ROUNDINGS * np.finfo(np.float64).eps * (1 + doubt / size)
    crosses = np.cross(shape[:, 1:-1], shape[:, 2:])
    newell = crosses.sum(axis=1)
    area = np.linalg.norm(newell, axis=1)
    flat = (np.linalg.norm(crosses, axis=2) <= doubt[:, None]).all(axis=1)  # corners on one line
    # Skip sizes that are zero or not finite: the checks that all formats share refuse them.
    normals = newell / np.where(area > 0, area, 1.0)[:, None]
    wrong = np.isfinite(doubt) & ~flat & ((area <= doubt) | ~_all_face(crosses, normals, doubt))
    # A concave quadrilateral has exactly one correct diagonal.
    if count == 4:  # the other diagonal
        halves = np.stack(
            [
                np.cross(shape[:, b] - shape[:, a], shape[:, c] - shape[:, a])
                for a, b, c in ((1, 2, 3), (3, 0, 1))
            ],
            axis=1,
        )
        other = wrong & (area > doubt) & _all_face(halves, normals, doubt)
        local[other] = [[1, 2, 3], [3, 0, 1]]
        wrong &= ~other
    twice = np.zeros(len(local), np.bool_)
    if count > 4:  # a quadrilateral cannot go around twice
        twice = np.isfinite(doubt) & (area > doubt) & (_turning(shape, normals, doubt) > 3 * np.pi)
    for place in np.flatnonzero(wrong | twice).tolist():
        if count > MAX_CONCAVE_CORNERS and not twice[place]:
            limit = f"is concave and has {count:,} corners, more than {MAX_CONCAVE_CORNERS:,}"
            raise refuse(int(numbers[place]), f"{limit}; cut it into triangles")
        ears = None
        if area[place] > doubt[place] and not twice[place]:
            ears = _clip_ears(shape[place] @ _plane(normals[place]).T, float(doubt[place]))
        if ears is None:
            raise refuse(
                int(numbers[place]),
                "crosses or covers itself, and has no surface; mend the mesh",
            )
        local[place] = ears


def _all_face(crosses: Floats, normals: Floats, doubt: Floats) -> Mask:
    """Return a mask (P,): True if all triangles of a polygon face along its normal."""
    facing = np.einsum("ptx,px->pt", crosses, normals)
    return np.asarray((facing >= -doubt[:, None]).all(axis=1))


def _turning(shape: Floats, normals: Floats, doubt: Floats) -> Floats:
    """Return the total turns (P,) of outlines about the normals, radians; a spike counts as -pi.

    An outline that does not meet itself turns by 360 degrees, an outline that goes around twice by
    720.
    """
    count = shape.shape[1]
    edges = np.roll(shape, -1, axis=1) - shape
    edges -= np.einsum("ptx,px->pt", edges, normals)[..., None] * normals[:, None]
    edges = np.concatenate([edges, edges], axis=1)
    long = np.linalg.norm(edges, axis=2) > doubt[:, None]
    last = np.maximum.accumulate(
        np.where(long, np.arange(2 * count), 0), axis=1
    )  # skip edges between coincident corners
    edges = np.take_along_axis(edges, last[..., None], axis=1)[:, count - 1 :]
    sines = np.einsum("ptx,px->pt", np.cross(edges[:, :-1], edges[:, 1:]), normals)
    turns = np.arctan2(sines, np.einsum("ptx,ptx->pt", edges[:, :-1], edges[:, 1:]))
    return np.asarray(np.where(np.abs(turns) > np.pi - _SPIKE, -np.pi, turns).sum(axis=1))


def _plane(normal: Floats) -> Floats:
    """Return (2, 3) axes of the plane of a unit normal; the normal points to the viewer."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(normal, across)])


def _clip_ears(corners: Floats, doubt: float) -> list[tuple[int, int, int]] | None:
    """Return counterclockwise triangles of a polygon (n, 2); None if it crosses itself."""
    count = len(corners)
    left_over = corners.copy()  # NaN where a corner is cut off
    before, after = (np.roll(np.arange(count), step).tolist() for step in (1, -1))

    def triangle(tip: int) -> tuple[int, int, int]:
        return before[tip], tip, after[tip]

    def is_ear(tip: int) -> bool:
        a, b, c = three = corners[list(triangle(tip))]
        if _turn(a, b, c) <= doubt:
            return False
        inside = _turn(a, b, left_over) >= -doubt
        inside &= (_turn(b, c, left_over) >= -doubt) & (_turn(c, a, left_over) >= -doubt)
        # Bridges to holes pass through a corner twice: other corners in the same place are not
        # obstacles.
        return bool((corners[inside, None] == three).all(axis=2).any(axis=1).all())

    ears = np.array([is_ear(tip) for tip in range(count)])
    clipped: list[tuple[int, int, int]] = []
    while len(clipped) < count - 3:
        tips = np.flatnonzero(ears).tolist()
        if not tips:
            alone = np.flatnonzero(~np.isnan(left_over[:, 0])).tolist()
            tips = [
                tip
                for tip in alone
                if is_ear(tip) or abs(_turn(*corners[list(triangle(tip))])) <= doubt
            ]
            if not tips:
                return None
        tip = tips[0]
        clipped.append(triangle(tip))
        left_over[tip], ears[tip] = np.nan, False
        left, right = before[tip], after[tip]
        after[left], before[right] = right, left
        ears[left], ears[right] = is_ear(left), is_ear(right)
    last = triangle(int(np.nanargmax(left_over[:, 0])))
    return [*clipped, last] if _turn(*corners[list(last)]) >= -doubt else None


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return twice the areas of triangles a b c, positive for left turns; c is (..., 2)."""
    c = np.asarray(c)
    return np.asarray((b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0]))
