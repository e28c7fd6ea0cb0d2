"""Surface points that the true frustum does not see, because another surface hides them.

The answer is decided, as the truth is. A point's own line is that of the doubles (x - a_x)/s and (y - a_y)/s.
A triangle hides the point if this line meets it before the point by more than half of the tolerance within
which the point is known, and if the point lies farther from the triangle than this tolerance. Whether and
where the line meets it is known within the bounds of double precision (`walk`); what they leave open is
decided in integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module

import numpy as np

from xfrustum.reference.certify.arbitrary_lines import ExactLines
from xfrustum.reference.certify.processors import compiled
from xfrustum.reference.lines.lines import Pencil
from xfrustum.reference.sight import walk_numpy
from xfrustum.reference.sight.boxes import Queries, lanes
from xfrustum.reference.sight.distance import apart
from xfrustum.reference.sight.walk import Before
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfacePoints:
    """Surface points that an image shows.

    Attributes
    ----------
    position
        (N, 3) scene units, z not 0.
    triangle
        (N,) number of the triangle that each point lies on, `NOTHING` where that is not known.
    tolerance
        (N,) distance within which each point is known, scene units: a surface that passes within this
        distance of a point is the point's own. Thus a mesh's tessellation makes no difference.
    """

    position: Floats
    triangle: Numbers
    tolerance: Floats


def hidden(scene: Scene, pencil: Pencil, points: SurfacePoints) -> Mask:
    """Return which points lie behind another surface on their own true line.

    Parameters
    ----------
    scene
        Scene with the triangles.
    pencil
        Crossed frustum; each point's line passes through its center.
    points
        Points that are asked about.
    """
    behind = np.zeros(len(points.position), dtype=np.bool_)
    if not len(behind) or not len(scene.faces):
        return behind
    queries = Queries.of(points.position, points.triangle, points.tolerance, pencil)
    search = walk_numpy.search
    if compiled():
        # Imported only here, because Dr.Jit's arrays need the LLVM that `compiled` has chosen.
        search = import_module("xfrustum.reference.sight.walk_jit").search
    for found in search(lanes(scene.triangles, queries), queries):
        point = queries.order[found.query]
        far = apart(points.position[point], scene.triangles[found.triangle], points.tolerance[point])
        far[~found.sure & far] = _met(scene.triangles, queries, found, np.flatnonzero(~found.sure & far))
        behind[point[far]] = True
    return behind


def _met(triangles: Floats, queries: Queries, found: Before, some: Indices) -> Mask:
    """Return which of some pairs meet before the point, decided in integers."""
    if not len(some):
        return np.zeros(0, dtype=np.bool_)
    query, pencil = found.query[some], queries.pencil
    directions = np.stack((queries.dx[query], queries.dy[query], np.full(len(some), -1.0)), axis=1)
    numbers, which = np.unique(found.triangle[some], return_inverse=True)
    ends = queries.end[query].tolist()
    lines = ExactLines(triangles[numbers], pencil.center, directions, (pencil.s_range[0], max(ends)))
    met = [lines.meets(line, triangle) for line, triangle in enumerate(which.tolist())]
    return np.array([s is not None and s < Fraction(end) for s, end in zip(met, ends, strict=True)])
