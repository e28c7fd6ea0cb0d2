"""Bounding volume hierarchy of the triangles of a mesh, built level by level without recursion.

Parallel locally-ordered clustering (Meister and Bittner, "Parallel Locally-Ordered Clustering for
Bounding Volume Hierarchy Construction", 2018): triangles are sorted along a Morton curve. In each
round every cluster chooses, among its neighbors on the curve, the partner for which the joint box
has the least area; clusters that choose each other merge. Each round consists of NumPy operations
on whole arrays.

Nodes are numbered depth first: the first child of a node is the next node, and `skip` is the number
after its last descendant. A walk without a stack goes to the next node at a hit, and to `skip` at a
miss.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Floats, Indices, Singles

#: Number of neighbors on either side among which a cluster chooses. With 8, the sum of the areas
#: of all boxes, which determines the time of a walk, is 12 % larger to 1 % smaller (car, truck, car
#: body).
RADIUS = 3

#: Smallest share of clusters that a round must merge; else neighbors are merged pairwise. If areas
#: decrease along the curve, every cluster chooses the next and hardly any would merge.
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
