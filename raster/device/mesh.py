"""Triangles of a scene on the GPU in float32: corners, attributes, numbers in vertices."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Indices, Singles
from xfrustum.scenes.model.scene import Scene, read_only

_Scalar = TypeVar("_Scalar", bound=np.generic)


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedMesh:
    """A mesh's triangles over more vertices, in the same order and with the same first corners.

    `gl_PrimitiveID` starts again with every draw, and costs Mesa's software pipeline three vertices
    a triangle. A flat varying comes from the last corner of a triangle: if this corner has its own
    vertex, the vertex's number is the triangle's.
    """

    #: (N,) number of the scene's vertex whose attributes each vertex copies. The first F vertices
    #: are the triangles' last corners.
    source: Indices
    faces: NDArray[np.uint32]  #: (F, 3) uint32 into `source`

    def ends(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return values of triangles (F, ..) at their last vertices (N, ..); zero at others."""
        others = np.zeros((len(self.source) - len(values), *values.shape[1:]), values.dtype)
        return np.concatenate((values, others))


def number_triangles(faces: Indices) -> NumberedMesh:
    """Return the mesh of some faces (F, 3) in which triangle t ends with vertex t.

    Each of the other two corners takes the copy of its vertex with the largest number up to its own
    triangle's, or else the next larger one, so that neighboring triangles go on sharing vertices
    that the vertex stage still holds. A vertex that is the last corner of no triangle has one copy,
    after the copies of all others.
    """
    count = len(faces)
    last = faces[:, 2]
    # List all copies by vertex and then by triangle; the stable sort keeps the order by triangle.
    copies = np.argsort(last, kind="stable")
    owner = last[copies]
    numbered = np.empty((count, 3), dtype=np.int64)
    numbered[:, 2] = np.arange(count)
    # Vertex and triangle of each copy as one ascending number: a search for (vertex, triangle)
    # finds the copy that follows.
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
        source=read_only(np.concatenate([last, without_copy])),
        faces=read_only(numbered.astype(np.uint32)),
    )


#: binding of the triangles' own normals, as in surface.glsl
NORMALS = 0

#: Numbers per vertex of each attribute of hogel.vert
ATTRIBUTES = {"in_position": 3, "in_normal": 3, "in_color": 3, "in_uv": 2}

#: Tolerance of heights, relative to the largest length along z, up to which a triangle still counts
#: as on one side of the plate only. Clip depth is a sum of two products in float32, each within
#: some 2^-22 of that length, and grows with the same factor as the distance to the near plane. Any
#: device clips a whole triangle if all its corners are this far in front of the near plane, which
#: is the plate or lies beyond it.
SIDE_SLACK = 2.0**-10


class Mesh:
    """Corners, indices and normals of triangles, uploaded once; other attributes on first use.

    In float32, a texture of W texels is looked up at coordinate U to within about U W 2^-24 of a
    texel.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._scene = scene
        self._indices = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._normals = context.buffer(scene.normals.astype(np.float32).tobytes())
        self._attributes: dict[str, moderngl.Buffer] = {}
        self._sides: dict[int, moderngl.Buffer | None] = {}

    def drawn_by(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the mesh for a program, with the attributes that it reads."""
        read = [name for name in ATTRIBUTES if name in program]
        content = [(self._attribute(name), f"{ATTRIBUTES[name]}f", name) for name in read]
        return self._context.vertex_array(program, content, index_buffer=self._indices)

    @staticmethod
    def side_of(heights: tuple[float, float]) -> int:
        """Return the side of the plate between two z: 1 in front of it, -1 behind, 0 for both."""
        return -1 if heights[1] <= 0 else 1 if heights[0] >= 0 else 0

    def numbered(self, program: moderngl.Program, side: int) -> moderngl.VertexArray | None:
        """Return a mesh of positions whose triangles have the numbers of their last vertices.

        Triangles on the other side of the plate (`side_of`) are left out; None if no triangle is
        left.
        """
        if side not in self._sides:
            lowest, highest = self._scene.height_ranges
            largest = max(
                self._scene.frustum.longest_reach, -float(lowest.min()), float(highest.max())
            )
            slack = SIDE_SLACK * largest
            kept = {
                -1: lowest <= slack,
                0: np.ones(len(lowest), dtype=np.bool_),
                1: highest >= -slack,
            }[side]
            faces = self._numbered.faces[kept]
            # A buffer cannot be empty.
            self._sides[side] = self._context.buffer(faces.tobytes()) if len(faces) else None
        indices = self._sides[side]
        if indices is None:
            return None
        return self._context.vertex_array(
            program, [(self._numbered_positions, "3f", "in_position")], index_buffer=indices
        )

    @cached_property
    def _numbered(self) -> NumberedMesh:
        return number_triangles(self._scene.faces)

    @cached_property
    def _numbered_positions(self) -> moderngl.Buffer:
        positions = attribute_of(self._scene, "in_position")[self._numbered.source]
        return self._context.buffer(positions.tobytes())

    def bind(self) -> None:
        """Bind the normals for the shaders."""
        self._normals.bind_to_storage_buffer(NORMALS)

    def _attribute(self, name: str) -> moderngl.Buffer:
        if name not in self._attributes:
            self._attributes[name] = self._context.buffer(attribute_of(self._scene, name).tobytes())
        return self._attributes[name]


def attribute_of(scene: Scene, name: str) -> Singles:
    """Return one of `ATTRIBUTES` of all vertices; zero at vertices without it, which are unused."""
    if name == "in_position":
        return scene.vertices.astype(np.float32)
    surface = scene.surface
    arrays = {
        "in_normal": surface.vertex_normals,
        "in_color": surface.vertex_colors,
        "in_uv": surface.uv,
    }
    values = arrays[name]
    if values is None:
        return np.zeros((len(scene.vertices), ATTRIBUTES[name]), dtype=np.float32)
    return np.ascontiguousarray(np.nan_to_num(values, nan=0.0).astype(np.float32))
