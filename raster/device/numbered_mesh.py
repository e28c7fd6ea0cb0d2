"""A mesh whose triangles know their numbers: each has the number of its last vertex."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Indices
from xfrustum.scenes.model.scene import read_only

_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedMesh:
    """The same triangles, in the same order and from the same corner on, over more vertices.

    A shader that asks for `gl_PrimitiveID` gets a number that starts again with every draw, and costs
    Mesa's software pipeline three vertices a triangle. The last corner of a triangle is the one that a
    flat varying comes from: with a vertex of its own there, the vertex's number is the triangle's.

    Attributes
    ----------
    source
        (N,) number of the scene's vertex that each vertex is a copy of; all that a vertex carries
        follows it. The first F are the triangles' last corners.
    faces
        (F, 3) uint32 into `source`.
    """

    source: Indices
    faces: NDArray[np.uint32]

    def ends(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return (N, ..) at the vertices that end triangles what belongs to these, (F, ..); others zero."""
        others = np.zeros((len(self.source) - len(values), *values.shape[1:]), values.dtype)
        return np.concatenate((values, others))


def number_triangles(faces: Indices) -> NumberedMesh:
    """Return the mesh of some faces (F, 3) in which triangle t ends with vertex t.

    The other corners take the copy of their vertex that was made last, so that neighbors go on
    sharing what the vertex stage has at hand, or the next one. A vertex that ends no triangle keeps one
    copy, behind the others.
    """
    count = len(faces)
    last = faces[:, 2]
    # All copies, by vertex and then by triangle; the stable sort keeps the second order.
    copies = np.argsort(last, kind="stable")
    owner = last[copies]
    numbered = np.empty((count, 3), dtype=np.int64)
    numbered[:, 2] = np.arange(count)
    # A copy's place in that list, as one number: searching for (vertex, triangle) finds the next.
    keys = owner * count + copies
    without_copy = np.setdiff1d(faces[:, :2], last)
    for corner in (0, 1):
        vertex = faces[:, corner]
        following = np.searchsorted(keys, vertex * count + np.arange(count), side="right")
        before, after = np.maximum(following - 1, 0), np.minimum(following, count - 1)
        chosen = np.where(owner[before] == vertex, copies[before], copies[after])
        has_copy = (owner[before] == vertex) | (owner[after] == vertex)
        extra = count + np.searchsorted(without_copy, vertex)
        numbered[:, corner] = np.where(has_copy, chosen, extra)
    return NumberedMesh(
        source=read_only(np.concatenate([last, without_copy])), faces=read_only(numbered.astype(np.uint32))
    )
