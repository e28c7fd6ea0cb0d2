"""A scene as all hogels of a plate share it: on the GPU once, sorted by the cameras that can see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.cameras.passes import Pass
from xfrustum.raster.device.mesh import ATTRIBUTES, attribute_of
from xfrustum.raster.device.numbered_mesh import NumberedMesh, number_triangles
from xfrustum.raster.plate.clusters import (
    TRIANGLES_PER_CLUSTER,
    Boxes,
    boxes_of,
    clip_planes,
    reached,
    runs,
    triangles_in_depth,
)
from xfrustum.scenes.arrays import Indices, Mask, Singles
from xfrustum.scenes.model.scene import Scene

SIDES, DEPTHS = slice(0, 4), slice(4, 6)
"""Of the clip planes: those that move from hogel to hogel, and those that stay."""

FORMATS = {
    **{name: f"{count}f" for name, count in ATTRIBUTES.items()},
    "in_flat_normal": "3f",
    "in_flat_surface": "2u4",
}
"""Of each attribute of hogel.vert but the hogel."""

DRAW_COMMAND = np.dtype(
    [("count", "u4"), ("instances", "u4"), ("first", "u4"), ("base_vertex", "i4"), ("hogel", "u4")]
)
"""What OpenGL reads of an indirect draw; the base instance says which hogel it is for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PassGeometry:
    """The triangles that one camera can see from anywhere on the plate.

    Attributes
    ----------
    first, count
        Where their indices begin in the index buffer, and how many triangles they are.
    boxes
        Of their clusters.
    """

    first: int
    count: int
    boxes: Boxes


class PlateGeometry:
    """Vertices, indices and normals on the GPU, and what each camera draws of them.

    Parameters
    ----------
    context
        The current context.
    scene
        At least one triangle.
    passes
        Of any aperture: what is used of them is the same for all.
    clip_control
        The range of clip depth that OpenGL keeps.
    reflective
        (F,) triangles that a second drawing is for; None for none.

    Attributes
    ----------
    surfaces, reflections
        What each camera draws of all triangles, and of the reflective ones.
    """

    def __init__(
        self,
        context: moderngl.Context,
        scene: Scene,
        passes: Sequence[Pass],
        clip_control: int,
        reflective: Mask | None = None,
    ) -> None:
        self._context, self._scene, self._clip_control = context, scene, clip_control
        self._scene_vertices = attribute_of(scene, "in_position")
        mesh = number_triangles(scene.faces)
        # A buffer cannot be empty; nothing draws the first three.
        self._indices = [np.zeros((1, 3), dtype=np.uint32)]
        self.surfaces = self._seen_by(passes, scene, mesh, np.arange(len(scene.faces)))
        chosen = np.flatnonzero(np.zeros(0) if reflective is None else reflective)
        self.reflections = self._seen_by(passes, scene, mesh, chosen)
        self._mesh, self._attributes = mesh, dict[str, moderngl.Buffer]()
        self.indices = context.buffer(np.concatenate(self._indices).tobytes())
        del self._indices, self._scene_vertices

    def attribute(self, name: str) -> moderngl.Buffer:
        """Return an attribute of all vertices, see `mesh.attribute_of`."""
        if name not in self._attributes:
            values = attribute_of(self._scene, name)[self._mesh.source]
            self._attributes[name] = self._context.buffer(values.tobytes())
        return self._attributes[name]

    def carry(self, surfaces: NDArray[np.uint32]) -> None:
        """Let vertices carry what belongs to the triangles that they end: normals, `materials.surfaces`."""
        for name, values in flat_attributes(self._scene, self._mesh, surfaces).items():
            self._attributes[name] = self._context.buffer(values.tobytes())

    def _seen_by(
        self, passes: Sequence[Pass], scene: Scene, mesh: NumberedMesh, triangles: Indices
    ) -> list[PassGeometry]:
        """Sort triangles by the cameras that may see them, from wherever on the plate."""
        found = []
        for camera in passes:
            planes, magnitudes = clip_planes(camera.clip_from_scene.astype(np.float32), self._clip_control)
            within = triangles_in_depth(
                self._scene_vertices, scene.faces[triangles], planes[DEPTHS], magnitudes[DEPTHS]
            )
            seen = triangles[within]
            boxes = boxes_of(self._scene_vertices, scene.faces[seen], TRIANGLES_PER_CLUSTER)
            first = 3 * sum(len(part) for part in self._indices)
            found.append(PassGeometry(first=first, count=len(seen), boxes=boxes))
            self._indices.append(mesh.faces[seen])
        return found

    def commands(self, geometry: PassGeometry, matrices: Singles) -> NDArray[np.void]:
        """Return the draws of one pass for some hogels: runs of clusters that their frusta may reach.

        Parameters
        ----------
        geometry
            Of the pass.
        matrices
            (L, 4, 4) clip-from-scene of each hogel, as the device has them.
        """
        planes, magnitudes = clip_planes(matrices, self._clip_control)
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
    """Return what vertices carry of the triangles that they end, see surface.glsl."""
    normals = scene.normals.astype(np.float32)
    return {"in_flat_normal": mesh.ends(normals), "in_flat_surface": mesh.ends(surfaces)}
