"""A scene as all hogels of a plate share it: on the GPU once, sorted by the cameras that can see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.mesh import ATTRIBUTES, NumberedMesh, attribute_of, number_triangles
from xfrustum.raster.plate.clusters import (
    DEPTHS,
    SIDES,
    TRIANGLES_PER_CLUSTER,
    WHOLE_FILM,
    Boxes,
    boxes_of,
    clip_planes,
    reached,
    runs,
    triangles_in_depth,
)
from xfrustum.scenes.arrays import Floats, Indices, Mask, Singles
from xfrustum.scenes.model.scene import Scene

FORMATS = {
    **{name: f"{count}f" for name, count in ATTRIBUTES.items()},
    "in_flat_normal": "3f",
    "in_flat_surface": "2u4",
}
"""moderngl's format of each vertex attribute of hogel.vert, but for the number of the hogel."""

DRAW_COMMAND = np.dtype(
    [("count", "u4"), ("instances", "u4"), ("first", "u4"), ("base_vertex", "i4"), ("hogel", "u4")]
)
"""Layout of an indirect draw as OpenGL reads it; the base instance is the number of its hogel."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PassGeometry:
    """The triangles that one camera can see from anywhere on the plate."""

    #: first, count: Place of the triangles' first index in the index buffer, and the number of triangles
    first: int
    count: int
    boxes: Boxes  #: Boxes of the clusters of triangles


class PlateGeometry:
    """Vertices, indices and normals on the GPU, and the triangles that each camera draws.

    Parameters
    ----------
    context, scene
        The current context, and a scene with at least one triangle.
    passes
        The cameras as they are for any one aperture; only what all apertures share is used.
    clip_control
        The range of clip depth that OpenGL keeps.
    of_triangles
        (F, 2) the materials of triangles, see `materials.surfaces`, and (F,) whether a triangle reflects.

    Attributes
    ----------
    surfaces, reflections
        The triangles that each camera draws, and the reflective ones among them.
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
        # A buffer cannot be empty; nothing draws the first three indices.
        indices = [np.zeros((1, 3), dtype=np.uint32)]

        def seen_by_each(triangles: Indices) -> list[PassGeometry]:
            """Sort triangles by the cameras that may see them from anywhere on the plate."""
            found = []
            for camera in passes:
                matrix = camera.clip_from_scene.astype(np.float32)
                planes, magnitudes = clip_planes(matrix, clip_control)
                within = triangles_in_depth(
                    vertices, scene.faces[triangles], planes[DEPTHS], magnitudes[DEPTHS]
                )
                seen = triangles[within]
                boxes = boxes_of(vertices, scene.faces[seen], TRIANGLES_PER_CLUSTER)
                first = 3 * sum(len(part) for part in indices)
                found.append(PassGeometry(first=first, count=len(seen), boxes=boxes))
                indices.append(mesh.faces[seen])
            return found

        self.surfaces = seen_by_each(np.arange(len(scene.faces)))
        self.reflections = seen_by_each(np.flatnonzero(reflective))
        self.indices = context.buffer(np.concatenate(indices).tobytes())
        self._attributes = {
            name: context.buffer(values.tobytes())
            for name, values in flat_attributes(scene, mesh, materials).items()
        }

    def attribute(self, name: str) -> moderngl.Buffer:
        """Return the buffer of a vertex attribute, see `mesh.attribute_of` and `flat_attributes`."""
        if name not in self._attributes:
            values = attribute_of(self._scene, name)[self._mesh.source]
            self._attributes[name] = self._context.buffer(values.tobytes())
        return self._attributes[name]

    def commands(
        self, geometry: PassGeometry, matrices: Singles, windows: Floats = WHOLE_FILM
    ) -> NDArray[np.void]:
        """Return the draws of one pass for some hogels: runs of clusters that their frusta may reach.

        Parameters
        ----------
        geometry
            The triangles of the pass.
        matrices
            (L, 4, 4) clip-from-scene matrix of each hogel, as the device has it.
        windows
            (L, 4) the part of each film that is wanted; see `clusters.clip_planes`.
        """
        planes, magnitudes = clip_planes(matrices, self._clip_control, windows)
        visible = reached(planes[:, SIDES], magnitudes[:, SIDES], geometry.boxes)
        hogel, begin, end = runs(visible)
        begin, end = (np.minimum(TRIANGLES_PER_CLUSTER * edge, geometry.count) for edge in (begin, end))
        commands = np.zeros(len(hogel), dtype=DRAW_COMMAND)
        commands["count"], commands["instances"] = 3 * (end - begin), 1
        commands["first"], commands["hogel"] = geometry.first + 3 * begin, hogel
        return commands


def flat_attributes(
    scene: Scene, mesh: NumberedMesh, surfaces: NDArray[np.uint32]
) -> dict[str, Singles | NDArray[np.uint32]]:
    """Return the normals and materials of triangles, carried by the vertices that end them.

    surface.glsl says how the shaders read them.
    """
    normals = scene.normals.astype(np.float32)
    return {"in_flat_normal": mesh.ends(normals), "in_flat_surface": mesh.ends(surfaces)}
