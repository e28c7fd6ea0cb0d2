"""What a hogel's frusta cannot see: clusters of triangles, tested before anything is drawn.

Culling may cost time but no pixel. A cluster is left out only if every vertex in its box lies outside one
and the same clip plane, in the device's own float32 arithmetic: then OpenGL would have clipped all
its triangles away. What stays is drawn in the scene's order, so that equal depths are decided as ever.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OpenGL import GL

from xfrustum.scenes.arrays import Floats, Indices, Mask, Singles
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, read_only

TRIANGLES_PER_CLUSTER = 16
"""Consecutive triangles that are drawn or left out together. Fewer cull more, and cost more draws."""

TRANSFORM_ROUNDING = 8 * 2.0**-24
"""Relative error allowed to x, y, z, w of a vertex in clip coordinates, in units of sum |m_j| |p_j|.

Four products and three sums in float32, in any order, fused or not, are off by at most 4 u (1 + 3 u) of
that sum, u = 2^-24 (Higham, Accuracy and Stability of Numerical Algorithms, section 3.1). Twice that
also covers the double precision of the test itself, whose own roundings are 2^29 times smaller.
"""


_PLANES = np.array(
    [(1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 0, 1), (0, -1, 0, 1), (0, 0, 1, 0), (0, 0, -1, 1)], dtype=np.float64
)
"""What of (x, y, z, w) must not be negative: for the left, right, bottom, top, start and end of the range."""
_OPENGL_NEAR = np.array([[0.0], [0.0], [0.0], [0.0], [1.0], [0.0]]) * (0, 0, 0, 1)
"""What OpenGL's own range, which starts at -w, adds to that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Axis-parallel boxes, laid out for `reached`.

    Attributes
    ----------
    columns
        (11, N): center and 1, half extent, largest absolute coordinates and 1.
    """

    columns: Floats

    @classmethod
    def of(cls, lowest: Floats, highest: Floats) -> Boxes:
        """Return the boxes with given corners, (N, 3) each, scene units."""
        # Halves first: the sum of two huge coordinates may overflow.
        center, extent = lowest / 2 + highest / 2, highest / 2 - lowest / 2
        one = np.ones((len(center), 1))
        columns = np.hstack([center, one, extent, np.abs(center) + extent, one]).T
        return cls(columns=read_only(np.ascontiguousarray(columns)))


def clip_planes(matrices: Singles, clip_control: int) -> tuple[Floats, Floats]:
    """Return the clip planes of some matrices, and what roundings at them are relative to.

    Parameters
    ----------
    matrices
        (.., 4, 4) clip-from-scene as the device has them.
    clip_control
        The range of clip depth that OpenGL keeps.

    Returns
    -------
    planes
        (.., 6, 4): left, right, bottom, top, and the start and end of the range of depth. A vertex is
        kept where plane . (x, y, z, 1) >= 0.
    magnitudes
        (.., 6, 4): sums of the absolute values that each plane's float32 arithmetic goes through.
    """
    combined = _PLANES + (_OPENGL_NEAR if clip_control == GL.GL_NEGATIVE_ONE_TO_ONE else 0)
    exact = matrices.astype(np.float64)
    return combined @ exact, np.abs(combined) @ np.abs(exact)


def reached(planes: Floats, magnitudes: Floats, boxes: Boxes) -> Mask:
    """Return which boxes the device may find something of inside every plane.

    Parameters
    ----------
    planes, magnitudes
        (.., P, 4), see `clip_planes`.
    boxes
        N of them.

    Returns
    -------
    reached
        (.., N).
    """
    # The vertex that reaches farthest inside, and what roundings may add to it, in one product.
    rows = np.concatenate([planes, np.abs(planes[..., :3]), TRANSFORM_ROUNDING * magnitudes], axis=-1)
    return np.asarray((rows @ boxes.columns >= 0).all(axis=-2))


def triangles_in_depth(vertices: Singles, faces: Indices, planes: Floats, magnitudes: Floats) -> Indices:
    """Return the ascending numbers of the triangles between a camera's near and far plane.

    These depend on heights alone: they belong to the plate, and are found once for all its apertures.
    """
    found = [np.zeros(0, dtype=np.int64)]
    for start in range(0, len(faces), TRIANGLES_AT_ONCE):
        boxes = boxes_of(vertices, faces[start : start + TRIANGLES_AT_ONCE], 1)
        found.append(start + np.flatnonzero(reached(planes, magnitudes, boxes)))
    return np.concatenate(found)


def boxes_of(vertices: Singles, faces: Indices, size: int) -> Boxes:
    """Return the boxes of every `size` consecutive faces."""
    lowest, highest = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for start in range(0, len(faces), TRIANGLES_AT_ONCE // size * size):
        part = faces[start : start + TRIANGLES_AT_ONCE // size * size]
        corners = vertices[part]
        firsts = np.arange(0, len(part), size)
        lowest.append(np.minimum.reduceat(corners.min(axis=1), firsts).astype(np.float64))
        highest.append(np.maximum.reduceat(corners.max(axis=1), firsts).astype(np.float64))
    return Boxes.of(np.concatenate(lowest), np.concatenate(highest))


def runs(visible: Mask) -> tuple[Indices, Indices, Indices]:
    """Return row, first column and end column of every run of visible clusters, row by row.

    A single cluster between two visible ones joins them: to draw it costs less than to draw twice.

    Parameters
    ----------
    visible
        (L, N) hogels by clusters.
    """
    padded = np.pad(visible, ((0, 0), (1, 1)))
    padded[:, 1:-1] |= padded[:, :-2] & padded[:, 2:]
    edges = np.diff(padded.astype(np.int8), axis=1)
    row, first = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    return row, first, end
