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
    """A mesh's triangles over more vertices, in the same order and with the same first corners.

    A shader that asks for `gl_PrimitiveID` gets a number that starts again with every draw, and costs
    Mesa's software pipeline three vertices a triangle. The last corner of a triangle is the one that a
    flat varying comes from: with a vertex of its own there, the vertex's number is the triangle's.

    Attributes
    ----------
    source
        (N,) number of the scene's vertex that each vertex is a copy of, with all its attributes. The
        first F are the triangles' last corners.
    faces
        (F, 3) uint32 into `source`.
    """

    source: Indices
    faces: NDArray[np.uint32]

    def ends(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return values of triangles (F, ..) as values of the vertices that end them (N, ..), others zero."""
        others = np.zeros((len(self.source) - len(values), *values.shape[1:]), values.dtype)
        return np.concatenate((values, others))


def number_triangles(faces: Indices) -> NumberedMesh:
    """Return the mesh of some faces (F, 3) in which triangle t ends with vertex t.

    Each of the other two corners takes the copy of its vertex with the largest number up to its own
    triangle's, or else the next larger one, so that neighboring triangles go on sharing vertices that the
    vertex stage still holds. A vertex that ends no triangle has one copy, behind the others.
    """
    count = len(faces)
    last = faces[:, 2]
    # List all copies by vertex and then by triangle; the stable sort keeps the order by triangle.
    copies = np.argsort(last, kind="stable")
    owner = last[copies]
    numbered = np.empty((count, 3), dtype=np.int64)
    numbered[:, 2] = np.arange(count)
    # Vertex and triangle of each copy as one ascending number: a search for (vertex, triangle) finds the
    # copy that follows.
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
