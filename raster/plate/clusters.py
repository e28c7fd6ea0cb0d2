"""Clusters of triangles that a hogel's frusta cannot see, found before anything is drawn.

Culling may cost time but no pixel. A cluster is left out only if every vertex in its box lies outside one
and the same clip plane, in the device's own float32 arithmetic: then OpenGL would have clipped all
its triangles away. The others are drawn in the scene's order, so that equal depths are decided as ever.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OpenGL import GL

from xfrustum.scenes.arrays import Floats, Indices, Mask, Singles
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, read_only

TRIANGLES_PER_CLUSTER = 16
"""Consecutive triangles that are drawn or left out together. Smaller clusters leave out more triangles,
and need more draws."""

TRANSFORM_ROUNDING = 8 * 2.0**-24
"""Relative error allowed to x, y, z, w of a vertex in clip coordinates, in units of sum |m_j| |p_j|.

Four products and three sums in float32, in any order, fused or not, are off by at most 4 u (1 + 3 u) of
that sum, u = 2^-24 (Higham, Accuracy and Stability of Numerical Algorithms, section 3.1). Twice that bound
also covers this module's own roundings in double precision, which are 2^29 times smaller.
"""

_PLANES = np.array(
    [(1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 0, 1), (0, -1, 0, 1), (0, 0, 1, 0), (0, 0, -1, 1)], dtype=np.float64
)
"""Linear forms of (x, y, z, w) that are not negative inside the left, right, bottom and top clip plane, and
inside the start and end of the range of depth."""

SIDES, DEPTHS = slice(0, 4), slice(4, 6)
"""Clip planes that move from hogel to hogel, and those that are the same for all."""

_OPENGL_NEAR = np.array([[0.0], [0.0], [0.0], [0.0], [1.0], [0.0]]) * (0, 0, 0, 1)
"""Term that OpenGL's own range of depth, which starts at -w instead of 0, adds to these forms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Axis-parallel boxes, laid out for `reached`."""

    #: (11, N) rows 0 to 3: center and 1; 4 to 6: half extent; 7 to 10: largest absolute coordinates and 1
    columns: Floats

    @classmethod
    def of(cls, lowest: Floats, highest: Floats) -> Boxes:
        """Return the boxes with given corners, (N, 3) each, scene units."""
        # Halves first: the sum of two huge coordinates may overflow.
        center, extent = lowest / 2 + highest / 2, highest / 2 - lowest / 2
        one = np.ones((len(center), 1))
        columns = np.hstack([center, one, extent, np.abs(center) + extent, one]).T
        return cls(columns=read_only(np.ascontiguousarray(columns)))


WHOLE_FILM = np.array([-1.0, 1.0, -1.0, 1.0])
"""Least and largest u, then v, of a whole film."""


def clip_planes(matrices: Singles, clip_control: int, windows: Floats = WHOLE_FILM) -> tuple[Floats, Floats]:
    """Return the clip planes of some matrices, and the magnitudes that bound rounding at them.

    Parameters
    ----------
    matrices
        (.., 4, 4) clip-from-scene matrices, as the device has them.
    clip_control
        The range of clip depth that OpenGL keeps.
    windows
        (.., 4) least and largest u and v that the planes at the sides of each film keep.

    Returns
    -------
    planes
        (.., 6, 4): left, right, bottom, top, and the start and end of the range of depth. A vertex is
        kept where plane . (x, y, z, 1) >= 0.
    magnitudes
        (.., 6, 4): the planes with the absolute value of every term: rounding errors of plane . (x, y, z, 1)
        in float32 are at most `TRANSFORM_ROUNDING` times magnitude . (abs(x), abs(y), abs(z), 1).
    """
    # A plane of clip coordinates becomes one of scene coordinates when multiplied by the matrix.
    combined = _PLANES + (_OPENGL_NEAR if clip_control == GL.GL_NEGATIVE_ONE_TO_ONE else 0)
    combined = np.broadcast_to(combined, (*windows.shape[:-1], *combined.shape)).copy()
    # Inside, u = x / w lies between the window's ends: x - least w and largest w - x are not negative.
    combined[..., SIDES, 3] = windows * (-1.0, 1.0, -1.0, 1.0)
    exact = matrices.astype(np.float64)
    return combined @ exact, np.abs(combined) @ np.abs(exact)


def reached(planes: Floats, magnitudes: Floats, boxes: Boxes) -> Mask:
    """Return which boxes may have a vertex that the device finds inside, for every plane.

    Parameters
    ----------
    planes, magnitudes
        (.., P, 4), see `clip_planes`.
    boxes
        N boxes.

    Returns
    -------
    reached
        (.., N) False only where all of a box lies outside one of the planes, roundings included.
    """
    # The bound is a sum of three terms, one for each group of rows in `Boxes.columns`:
    #  1. plane . (center, 1), the value at the middle of the box;
    #  2. abs(plane) . half extent, by which it rises to the corner that lies farthest inside;
    #  3. TRANSFORM_ROUNDING magnitude . (largest coordinates, 1), which rounding may add there.
    rows = np.concatenate([planes, np.abs(planes[..., :3]), TRANSFORM_ROUNDING * magnitudes], axis=-1)
    return np.asarray((rows @ boxes.columns >= 0).all(axis=-2))


def triangles_in_depth(vertices: Singles, faces: Indices, planes: Floats, magnitudes: Floats) -> Indices:
    """Return the ascending numbers of the triangles between a camera's near and far plane.

    Both planes are parallel to the plate and the same for all its apertures: this is asked once for a plate.
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

    A single hidden cluster between two visible ones joins them: drawing it costs less than a second draw.

    Parameters
    ----------
    visible
        (L, N) hogels by clusters.
    """
    # A hidden column on either side, so that every run begins and ends inside the array.
    padded = np.pad(visible, ((0, 0), (1, 1)))
    # Fill gaps of one cluster.
    padded[:, 1:-1] |= padded[:, :-2] & padded[:, 2:]
    # A run begins where hidden turns visible, and ends before visible turns hidden.
    edges = np.diff(padded.astype(np.int8), axis=1)
    row, first = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    return row, first, end
