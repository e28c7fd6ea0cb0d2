"""Broad phase: a tree of bounding boxes, and the conservative walk of rays through it.

**Tree**, built level by level without recursion. Parallel locally-ordered clustering (Meister and
Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", 2018):
triangles are sorted along a Morton curve. In each round every cluster chooses, among its neighbors
on the curve, the partner for which the joint box has the least area; clusters that choose each
other merge. Each round consists of NumPy operations on whole arrays. Nodes are numbered depth
first: the first child of a node is the next node, and `skip` is the number after its last
descendant. A walk without a stack goes to the next node at a hit, and to `skip` at a miss.

**Walk.** Boxes and rays are in float32. A ray is restarted at its point closest to the middle of
the mesh, so that a distant origin loses no precision. Each interval of a ray within the slab of a
box is widened by its rounding bound (docs/truth.md): a ray that meets a triangle visits its leaf.
Each lane walks one ray.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.backend import (
    Array4f,
    Float32,
    Float64,
    UInt32,
    difference,
    dot,
    dr,
    on_device,
    product,
    recording,
)
from xfrustum.reference.certify.cone import UNIT_ROUNDOFF
from xfrustum.scenes.arrays import Floats, Indices, Singles

#: Number of neighbors on either side among which a cluster chooses. The sum of the areas of all
#: boxes determines the time of a walk. With 8 neighbors, it is between 12 % larger and 1 % smaller
#: than with 3 (car, truck, car body).
RADIUS = 3

#: Smallest share of clusters that a round must merge; else neighbors are merged pairwise. If areas
#: decrease along the curve, every cluster chooses the next, and hardly any clusters merge.
MIN_SHARE = 1 / 8

#: bits of each coordinate in a Morton code
MORTON_BITS = 10

#: marker of inner nodes
INNER = -1


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """Boxes of M nodes, depth first; M = 2 F - 1 for F triangles."""

    low: Singles  #: (3, M) rounded down
    high: Singles  #: (3, M) rounded up
    skip: Indices  #: (M,) number after the last descendant
    triangle: Indices  #: (M,) triangle of a leaf, `INNER` for inner nodes


def build_tree(corners: Floats) -> Tree:
    """Build the tree of F >= 1 triangles (F, 3, 3) with coordinates of about unit size."""
    # Two minima of whole arrays are several times as fast as a minimum along an axis of length 3.
    first, second, third = corners.transpose(1, 0, 2)
    low, high = _outward(
        np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
    )
    order = np.argsort(_morton_codes((low + high) * np.float32(0.5)), kind="stable")
    boxes = np.concatenate((low[order].T, high[order].T))
    count = len(order)
    total = 2 * count - 1
    all_boxes = np.empty((6, total), dtype=np.float32)
    all_boxes[:, :count] = boxes
    children = np.zeros((2, total), dtype=np.int64)
    size = np.ones(total, dtype=np.int64)
    rounds = []
    cluster = np.arange(count)
    while len(cluster) > 1:
        first, second = _merging(boxes)
        merged = np.concatenate(
            (
                np.minimum(boxes[:3, first], boxes[:3, second]),
                np.maximum(boxes[3:, first], boxes[3:, second]),
            )
        )
        new = np.arange(count, count + len(first))
        count += len(first)
        rounds.append(new)
        children[:, new] = cluster[first], cluster[second]
        size[new] += size[cluster[first]] + size[cluster[second]]
        all_boxes[:, new] = merged
        boxes[:, first], cluster[first] = merged, new
        kept = np.ones(len(cluster), dtype=np.bool_)
        kept[second] = False
        boxes, cluster = boxes[:, kept], cluster[kept]
    # Parents are created after their children: number nodes from the last round to the first.
    place = np.zeros(total, dtype=np.int64)
    for parents in reversed(rounds):
        first, second = children[:, parents]
        place[first] = place[parents] + 1
        place[second] = place[first] + size[first]
    boxes = np.empty_like(all_boxes)
    boxes[:, place] = all_boxes
    skip, triangle = np.empty(total, dtype=np.int64), np.full(total, INNER)
    skip[place] = place + size
    triangle[place[: len(order)]] = order
    return Tree(low=boxes[:3], high=boxes[3:], skip=skip, triangle=triangle)


def _outward(low: Floats, high: Floats) -> tuple[Singles, Singles]:
    """Return the smallest float32 boxes that contain boxes in doubles."""
    down, up = low.astype(np.float32), high.astype(np.float32)
    down = np.where(down > low, np.nextafter(down, np.float32(-np.inf)), down)
    return down, np.where(up < high, np.nextafter(up, np.float32(np.inf)), up)


def _morton_codes(points: Singles) -> NDArray[np.uint32]:
    """Return the places of points (N, 3) along a Morton curve through their bounding cube."""
    lowest = points.min(axis=0)
    extent = float((points - lowest).max())
    code = np.zeros(len(points), dtype=np.uint32)
    for axis in range(3):
        share = (points[:, axis] - lowest[axis]) / (extent or 1.0)
        part = (share * (2**MORTON_BITS - 1)).astype(np.uint32)
        # Insert two zeros between adjacent bits.
        for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
            part = (part | (part << np.uint32(shift))) & np.uint32(mask)
        code |= part << np.uint32(axis)
    return code


def _merging(boxes: Singles) -> tuple[Indices, Indices]:
    """Return the pairs of clusters (indices on the curve) that merge; boxes (6, n)."""
    count = boxes.shape[1]
    places = np.arange(count)
    # The first of equal areas is chosen. Pairs of an even and the next index are tested first, so
    # that many equal boxes choose each other. For an odd count the last index has no such partner.
    partner = np.minimum(places ^ 1, count - 1)
    pairs = _joint_area(boxes[:, : count - 1 : 2], boxes[:, 1::2])
    best = np.full(count, np.inf, dtype=np.float32)
    best[: 2 * len(pairs)] = np.repeat(pairs, 2)
    for apart in range(1, min(RADIUS, count - 1) + 1):
        area = _joint_area(boxes[:, :-apart], boxes[:, apart:])
        for own, other in ((places[:-apart], places[apart:]), (places[apart:], places[:-apart])):
            part = slice(int(own[0]), int(own[-1]) + 1)
            closer = area < best[part]
            np.copyto(best[part], area, where=closer)
            np.copyto(partner[part], other, where=closer)
    first = np.flatnonzero((partner[partner] == places) & (partner > places))
    if len(first) < MIN_SHARE * count:
        first = np.arange(0, count - 1, 2)
        return first, first + 1
    return first, partner[first]


def _joint_area(a: Singles, b: Singles) -> Singles:
    """Return half the surface areas of the joint boxes of pairs of boxes (6, n)."""
    x, y, z = (np.maximum(a[3 + k], b[3 + k]) - np.minimum(a[k], b[k]) for k in range(3))
    area: Singles = x * (y + z) + y * z
    return area


#: unit roundoff of float32
SINGLE_ROUNDOFF = 2.0**-24

#: Rounding bound of the t of a plane of a box, in float32 roundings of the coordinates of box and
#: start: at least 3 for the box and 6 for the start (docs/truth.md)
SLAB_ROUNDINGS = 6

#: largest coordinate of a box: boxes lie in the unit cube, except for roundings
CUBE = 1.001

#: Smallest component of a direction used as a divisor. Within the tree, a smaller component moves a
#: ray by less than 2^-50, and the rounding bound covers this distance.
MIN_COMPONENT = 2.0**-60

#: Largest distance of the origin of a walked ray, in sizes of the mesh: the error of its point
#: closest to the middle is at most 1 % of the mesh.
MAX_DISTANCE = 2.0**40

#: Largest t: the hits of rays that start within `MAX_DISTANCE` are nearer
MAX_PLACE = 2.0**60

#: squared distance from the middle beyond which a ray certainly misses the cube: 3, with a margin
BESIDE = 4.0

#: no ray meets the cube before this t, relative to the ray's point closest to the middle
BEFORE_THE_CUBE = -4.0

#: Reserved number of pairs per ray; if there are more pairs, the walk is repeated with more space.
PAIRS_PER_RAY = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Rays on the device, scaled to a mesh of about unit size; directions are at most 1 long.

    `origin`, `direction` and `ends` (first and last t) are doubles, exact except for underflow.
    `start` is the point closest to the middle of the mesh, relative to the middle, at t =
    `restart`, with an error of at most `slack`. `far` marks rays whose origins are too distant for
    a walk; `missing` marks rays that certainly miss the mesh.
    """

    origin: list[Any]
    direction: list[Any]
    ends: list[Any]
    start: list[Any]
    restart: Any
    slack: Any
    far: Any
    missing: Any

    @classmethod
    def from_origins(
        cls, origin: list[Any], direction: list[Any], ends: list[Any], middle: list[Any]
    ) -> "Rays":
        """Return rays in the units of the mesh, restarted near its middle."""
        offset = difference(origin, middle)
        size = dr.maximum(dr.maximum(abs(offset[0]), abs(offset[1])), abs(offset[2]))
        far = ~(size <= MAX_DISTANCE)
        restart = dr.select(far, 0.0, -dot(offset, direction) / dot(direction, direction))
        start = [
            dr.select(far, 0.0, x + product(restart, d))
            for x, d in zip(offset, direction, strict=True)
        ]
        rays = cls(
            origin=origin,
            direction=direction,
            ends=ends,
            start=start,
            restart=restart,
            # Roundings of the offset, the product (at most as long as the offset), and the sum.
            slack=4 * UNIT_ROUNDOFF * (size + abs(restart)),
            far=far,
            missing=far | (dot(start, start) > BESIDE),
        )
        dr.eval(*vars(rays).values())
        return rays

    @classmethod
    def from_starts(cls, start: list[Any], direction: list[Any]) -> "Rays":
        """Return whole lines from their rounded points closest to the middle of the mesh."""
        nowhere = dr.zeros(Float64, dr.width(start[0]))
        rays = cls(
            origin=start,
            direction=direction,
            ends=[nowhere - np.inf, nowhere + np.inf],
            start=start,
            restart=nowhere,
            slack=nowhere + 4 * UNIT_ROUNDOFF,
            far=nowhere > 0,
            missing=dot(start, start) > BESIDE,
        )
        dr.eval(*vars(rays).values())
        return rays

    def from_restart(self, t: Any) -> Any:
        """Return t relative to `restart`, within `MAX_PLACE`, and its rounding bound."""
        t = dr.clip(t, -MAX_PLACE, MAX_PLACE)
        place = t - self.restart
        # Roundings of the difference and of the conversion to float32.
        error = product(2 * SINGLE_ROUNDOFF, abs(place))
        error = error + product(4 * UNIT_ROUNDOFF, abs(t) + abs(self.restart)) + 1e-30
        return place, error

    def proposed(self) -> tuple[Any, Any, Any]:
        """Return origins, directions and lengths of rays for a tracer in single precision."""
        first, last = (self.from_restart(end)[0] for end in self.ends)
        first = dr.maximum(first, BEFORE_THE_CUBE)
        origin = [x + first * d for x, d in zip(self.start, self.direction, strict=True)]
        single = [[Float32(part) for part in vector] for vector in (origin, self.direction)]
        return single[0], single[1], Float32(dr.select(self.missing, -1.0, last - first))


class Boxes:
    """Boxes of a tree on the device, 32 bytes each."""

    def __init__(self, tree: Tree) -> None:
        # Store boxes and numbers in rows of four, for the wide gathers of a walk.
        rows = np.zeros((len(tree.skip), 2, 4), dtype=np.float32)
        rows[:, 0, :3], rows[:, 1, :3] = tree.low.T, tree.high.T
        numbers = rows.view(np.int32)
        numbers[:, 0, 3], numbers[:, 1, 3] = tree.skip, tree.triangle
        with recording():
            self._rows = on_device(rows)
            self._count = dr.opaque(UInt32, len(rows))

    def pairs(self, rays: Rays, last: Any) -> tuple[Any, Any]:
        """Return numbers of rays and triangles that may meet up to the last t of each ray."""
        room = PAIRS_PER_RAY * dr.width(rays.restart)
        count, ray, triangle = self._walk(rays, last, room)
        if count > room:
            count, ray, triangle = self._walk(rays, last, count)
        # Kernels need at least one lane: without pairs, return ray 0 and triangle 0.
        at = dr.arange(UInt32, max(count, 1))
        return dr.gather(UInt32, ray, at), dr.gather(UInt32, triangle, at)

    def _walk(self, rays: Rays, last: Any, room: int) -> tuple[int, Any, Any]:
        """Return the number of pairs, and at most `room` pairs."""
        inverses, entering, leaving = zip(
            *(
                slab_shifts(x, d, rays.slack)
                for x, d in zip(rays.start, rays.direction, strict=True)
            ),
            strict=True,
        )
        (begin, early), (end, late) = (rays.from_restart(t) for t in (rays.ends[0], last))
        begin = dr.select(rays.missing, np.inf, Float32(begin - early))
        end = Float32(end + late)
        written, limit = dr.opaque(UInt32, 0), dr.opaque(UInt32, room)
        ray_of_pair, triangle_of_pair = dr.zeros(UInt32, room), dr.zeros(UInt32, room)
        dr.make_opaque(ray_of_pair, triangle_of_pair)
        lane = dr.arange(UInt32, dr.width(begin))

        def step(node: Any) -> tuple[Any]:
            low, high = (dr.gather(Array4f, self._rows, 2 * node + k) for k in range(2))
            enter, leave = begin, end
            for k in range(3):
                falling = inverses[k] < 0
                near = dr.select(falling, high[k], low[k])
                away = dr.select(falling, low[k], high[k])
                enter = dr.maximum(enter, dr.fma(near, inverses[k], entering[k]))
                leave = dr.minimum(leave, dr.fma(away, inverses[k], leaving[k]))
            hit = enter <= leave
            skip, triangle = (dr.reinterpret_array(UInt32, row[3]) for row in (low, high))
            leaf = hit & (skip == node + 1)
            slot = dr.scatter_inc(written, UInt32(0), leaf)
            fits = leaf & (slot < limit)
            dr.scatter(ray_of_pair, lane, slot, fits)
            dr.scatter(triangle_of_pair, triangle, slot, fits)
            return (dr.select(hit, node + 1, skip),)

        root = dr.zeros(UInt32, dr.width(begin))
        dr.while_loop((root,), lambda node: node < self._count, step)
        dr.eval(written, ray_of_pair, triangle_of_pair)
        return int(written[0]), ray_of_pair, triangle_of_pair


def slab_shifts(start: Any, component: Any, slack: Any) -> tuple[Any, Any, Any]:
    """Return factor and two shifts that bound t of the planes of an axis, in float32.

    The plane at x is at t = factor x + shift, with the first shift as a lower bound and the second
    as an upper bound. `start` and the direction's `component` are doubles; `slack` bounds the error
    of the start.
    """
    place, along = Float32(start), Float32(component)
    inverse = 1.0 / dr.select(abs(along) < MIN_COMPONENT, MIN_COMPONENT, along)
    error = SLAB_ROUNDINGS * SINGLE_ROUNDOFF * (CUBE + abs(place)) + Float32(slack)
    error = error * abs(inverse)
    return inverse, -place * inverse - error, -place * inverse + error
