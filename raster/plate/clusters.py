"""Culling of triangle clusters outside a hogel's frusta, before drawing.

Culling must not change a pixel. A cluster is left out only if its whole box is outside one clip
plane by more than the rounding errors of the device's float32 arithmetic. OpenGL would clip all
triangles of such a cluster completely. The remaining clusters are drawn in the scene's order, so
that ties of depth have the same winner as without culling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import Pass
from xfrustum.raster.device.mesh import ATTRIBUTES, NumberedMesh, attribute_of, number_triangles
from xfrustum.scenes.arrays import Floats, Indices, Mask, Singles
from xfrustum.scenes.model.scene import TRIANGLES_AT_ONCE, Scene, read_only

#: Number of consecutive triangles in a cluster. Smaller clusters cull more triangles, but need more
#: draws.
TRIANGLES_PER_CLUSTER = 16

#: Error bound of x, y, z, w of a vertex in clip coordinates, relative to sum |m_j| |p_j|. The error
#: of four products and three sums in float32, in any order, fused or not, is at most 4 u (1 + 3 u)
#: of this sum, with u = 2^-24 (Higham, Accuracy and Stability of Numerical Algorithms, section
#: 3.1). Twice this bound also covers the double-precision roundings of this module, which are 2^29
#: times smaller.
TRANSFORM_ROUNDING = 8 * 2.0**-24

#: Linear forms of (x, y, z, w) that are at least zero inside the left, right, bottom and top clip
#: plane, and inside the two ends of the depth range
_PLANES = np.array(
    [(1, 0, 0, 1), (-1, 0, 0, 1), (0, 1, 0, 1), (0, -1, 0, 1), (0, 0, 1, 0), (0, 0, -1, 1)],
    dtype=np.float64,
)

#: Clip planes that differ between hogels, and clip planes that all hogels share
SIDES, DEPTHS = slice(0, 4), slice(4, 6)

#: Term added to `_PLANES` for OpenGL's default depth range, which starts at -w instead of 0
_OPENGL_NEAR = np.array([[0.0], [0.0], [0.0], [0.0], [1.0], [0.0]]) * (0, 0, 0, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxes:
    """Axis-parallel boxes, laid out for `reached`."""

    #: (11, N) rows 0 to 3: center and 1; 4 to 6: half extent; 7 to 10: largest absolute coordinates
    #: and 1
    columns: Floats

    @classmethod
    def from_bounds(cls, lowest: Floats, highest: Floats) -> Boxes:
        """Return the boxes with given corners, (N, 3) each, scene units."""
        # Halve first: the sum of two huge coordinates may overflow.
        center, extent = lowest / 2 + highest / 2, highest / 2 - lowest / 2
        ones = np.ones((len(center), 1))
        columns = np.hstack([center, ones, extent, np.abs(center) + extent, ones]).T
        return cls(columns=read_only(np.ascontiguousarray(columns)))


#: smallest and largest u, then v, of a whole film
WHOLE_FILM = np.array([-1.0, 1.0, -1.0, 1.0])


def clip_planes(
    matrices: Singles, clip_control: int, windows: Floats = WHOLE_FILM
) -> tuple[Floats, Floats]:
    """Return the clip planes of clip-from-scene matrices (.., 4, 4) and magnitudes for rounding.

    `clip_control` is OpenGL's range of clip depth. `windows` (.., 4) are the smallest and largest u
    and v inside the side planes of each film. Both results are (.., 6, 4): left, right, bottom,
    top, and the two ends of the depth range. A vertex is inside if plane . (x, y, z, 1) >= 0.
    Magnitudes are the same sums with the absolute value of every term: the float32 rounding error
    of plane . (x, y, z, 1) is at most `TRANSFORM_ROUNDING` times magnitude . (abs(x), abs(y),
    abs(z), 1).
    """
    # Multiplying a plane in clip coordinates by the matrix gives the plane in scene coordinates.
    combined = _PLANES + (_OPENGL_NEAR if clip_control == GL.GL_NEGATIVE_ONE_TO_ONE else 0)
    combined = np.broadcast_to(combined, (*windows.shape[:-1], *combined.shape)).copy()
    # Inside, u = x / w is between the window's ends: x - smallest w >= 0 and largest w - x >= 0.
    combined[..., SIDES, 3] = windows * (-1.0, 1.0, -1.0, 1.0)
    exact = matrices.astype(np.float64)
    return combined @ exact, np.abs(combined) @ np.abs(exact)


def reached(planes: Floats, magnitudes: Floats, boxes: Boxes) -> Mask:
    """Return a mask (.., N) of boxes that may have a vertex inside every plane (.., P, 4).

    It is False only if the whole box is outside one of the planes, including rounding errors.
    """
    # The bound is a sum of three terms, one for each group of rows in `Boxes.columns`:
    # 1. plane . (center, 1), the value at the middle of the box;
    # 2. abs(plane) . half extent, the increase to the corner that is farthest inside;
    # 3. TRANSFORM_ROUNDING magnitude . (largest coordinates, 1), the largest rounding error.
    rows = np.concatenate(
        [planes, np.abs(planes[..., :3]), TRANSFORM_ROUNDING * magnitudes], axis=-1
    )
    return np.asarray((rows @ boxes.columns >= 0).all(axis=-2))


def triangles_in_depth(
    vertices: Singles, faces: Indices, planes: Floats, magnitudes: Floats
) -> Indices:
    """Return the numbers of triangles between a camera's near and far plane, ascending."""
    numbers = [np.zeros(0, dtype=np.int64)]
    for start in range(0, len(faces), TRIANGLES_AT_ONCE):
        boxes = boxes_of(vertices, faces[start : start + TRIANGLES_AT_ONCE], 1)
        numbers.append(start + np.flatnonzero(reached(planes, magnitudes, boxes)))
    return np.concatenate(numbers)


def boxes_of(vertices: Singles, faces: Indices, size: int) -> Boxes:
    """Return one box for every `size` consecutive faces."""
    lowest, highest = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for start in range(0, len(faces), TRIANGLES_AT_ONCE // size * size):
        part = faces[start : start + TRIANGLES_AT_ONCE // size * size]
        corners = vertices[part]
        firsts = np.arange(0, len(part), size)
        lowest.append(np.minimum.reduceat(corners.min(axis=1), firsts).astype(np.float64))
        highest.append(np.maximum.reduceat(corners.max(axis=1), firsts).astype(np.float64))
    return Boxes.from_bounds(np.concatenate(lowest), np.concatenate(highest))


def runs(visible: Mask) -> tuple[Indices, Indices, Indices]:
    """Return row, first column and end column of every run in a mask of visible clusters (L, N).

    A single hidden cluster between two visible clusters is drawn too, because it costs less than
    another draw.
    """
    # Pad with a hidden column on either side, so that every run begins and ends inside the array.
    padded = np.pad(visible, ((0, 0), (1, 1)))
    # Fill gaps of one cluster.
    padded[:, 1:-1] |= padded[:, :-2] & padded[:, 2:]
    # A run begins where hidden turns visible, and ends before visible turns hidden.
    edges = np.diff(padded.astype(np.int8), axis=1)
    row, first = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    return row, first, end


#: moderngl format of each vertex attribute of hogel.vert, except the number of the hogel
FORMATS = {
    **{name: f"{count}f" for name, count in ATTRIBUTES.items()},
    "in_flat_normal": "3f",
    "in_flat_surface": "2u4",
}

#: Layout of an indirect draw in OpenGL; the base instance is the number of the hogel
DRAW_COMMAND = np.dtype(
    [("count", "u4"), ("instances", "u4"), ("first", "u4"), ("base_vertex", "i4"), ("hogel", "u4")]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PassGeometry:
    """Triangles that may be visible to one camera from any aperture of the plate."""

    #: first, count: Position of the first triangle's first index in the index buffer, and the
    #: number of triangles
    first: int
    count: int
    boxes: Boxes  #: Boxes of the clusters of triangles


class PlateGeometry:
    """Vertices, indices and normals on the GPU, and the triangles that each camera draws.

    `passes` are the cameras of any aperture; only properties shared by all apertures are used.
    `of_triangles` has the materials (F, 2), see `drawing.surfaces`, and a mask of reflective
    triangles (F,). `surfaces` are the triangles that each camera draws, and `reflections` the
    reflective triangles among them.
    """

    def __init__(
        self,
        context: moderngl.Context,
        scene: Scene,
        passes: Sequence[Pass],
        clip_control: int,
        of_triangles: tuple[NDArray[np.uint32], Mask],
    ) -> None:
        self._context, self._scene, self._clip_control = context, scene, clip_control
        self._mesh = mesh = number_triangles(scene.faces)
        vertices = attribute_of(scene, "in_position")
        materials, reflective = of_triangles
        # A buffer cannot be empty: it begins with three indices that are never drawn.
        indices = [np.zeros((1, 3), dtype=np.uint32)]

        def seen_by_each(triangles: Indices) -> list[PassGeometry]:
            """Return the triangles that each camera may show from any aperture of the plate."""
            geometries = []
            for camera in passes:
                matrix = camera.clip_from_scene.astype(np.float32)
                planes, magnitudes = clip_planes(matrix, clip_control)
                within = triangles_in_depth(
                    vertices, scene.faces[triangles], planes[DEPTHS], magnitudes[DEPTHS]
                )
                seen = triangles[within]
                boxes = boxes_of(vertices, scene.faces[seen], TRIANGLES_PER_CLUSTER)
                first = 3 * sum(len(part) for part in indices)
                geometries.append(PassGeometry(first=first, count=len(seen), boxes=boxes))
                indices.append(mesh.faces[seen])
            return geometries

        self.surfaces = seen_by_each(np.arange(len(scene.faces)))
        self.reflections = seen_by_each(np.flatnonzero(reflective))
        self.indices = context.buffer(np.concatenate(indices).tobytes())
        self._attributes = {
            name: context.buffer(values.tobytes())
            for name, values in flat_attributes(scene, mesh, materials).items()
        }

    def attribute(self, name: str) -> moderngl.Buffer:
        """Return the buffer of a vertex attribute of `mesh.attribute_of` or `flat_attributes`."""
        if name not in self._attributes:
            values = attribute_of(self._scene, name)[self._mesh.source]
            self._attributes[name] = self._context.buffer(values.tobytes())
        return self._attributes[name]

    def commands(
        self, geometry: PassGeometry, matrices: Singles, windows: Floats = WHOLE_FILM
    ) -> NDArray[np.void]:
        """Return the draws of one pass for hogels: runs of clusters that may be visible."""
        planes, magnitudes = clip_planes(matrices, self._clip_control, windows)
        visible = reached(planes[:, SIDES], magnitudes[:, SIDES], geometry.boxes)
        hogel, begin, end = runs(visible)
        begin, end = (
            np.minimum(TRIANGLES_PER_CLUSTER * edge, geometry.count) for edge in (begin, end)
        )
        commands = np.zeros(len(hogel), dtype=DRAW_COMMAND)
        commands["count"], commands["instances"] = 3 * (end - begin), 1
        commands["first"], commands["hogel"] = geometry.first + 3 * begin, hogel
        return commands


def flat_attributes(
    scene: Scene, mesh: NumberedMesh, surfaces: NDArray[np.uint32]
) -> dict[str, Singles | NDArray[np.uint32]]:
    """Return normals and materials of triangles at their last vertices (surface.glsl)."""
    normals = scene.normals.astype(np.float32)
    return {"in_flat_normal": mesh.ends(normals), "in_flat_surface": mesh.ends(surfaces)}
