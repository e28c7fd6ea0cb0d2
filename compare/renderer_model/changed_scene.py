"""Changes of the scene that a renderer drew: axes exchanged or negated, one object left out or moved.

A model of a renderer names them (`RendererModel.changes`); its pictures and claims are those of the
changed scene, in which triangles keep their numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from xfrustum.reference import Reference
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import ALL_EFFECTS
from xfrustum.scenes.model.scene import Scene

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]
UNCHANGED: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

KEPT_REFERENCES = (
    4  #: largest number of changed scenes that are kept: one guess at a time draws some hogels
)


@dataclass(frozen=True, kw_only=True)
class SceneChange:
    """One change: points of an object, or of all, are multiplied by a matrix and then moved."""

    part: int | None = (
        None  # number of the object, multiplied about its middle; None: all, about the origin
    )
    matrix: Matrix = UNCHANGED
    offset: Triple = (0.0, 0.0, 0.0)
    missing: bool = False  # whether the object is left out

    def applied(self, points: Floats, middle: Floats) -> Floats:
        """Return points (.., 3) where they are drawn."""
        return np.asarray((points - middle) @ np.array(self.matrix).T + middle + self.offset)

    def of(self, scene: Scene) -> Scene:
        """Return the scene that is drawn."""
        first = np.zeros(3)
        parts = list(scene.objects)
        for number, part in enumerate(scene.objects):
            if self.part not in (None, number):
                continue
            if self.missing:
                # Out of reach it is not drawn, and its triangles keep their numbers.
                depth = float(np.ptp(part.vertices[:, 2])) + 4 * scene.frustum.longest_reach
                away = part.vertices - (0.0, 0.0, float(part.vertices[:, 2].max()) + depth)
                parts[number] = replace(part, vertices=away)
                continue
            about = first if self.part is None else middle_of(scene, number)
            normals = part.vertex_normals
            turned = None if normals is None else normals @ np.array(self.matrix).T
            vertices = self.applied(part.vertices, about)
            parts[number] = replace(part, vertices=vertices, vertex_normals=turned)
        return replace(scene, objects=tuple(parts))


def middle_of(scene: Scene, number: int) -> Floats:
    """Return the middle (3,) of an object's bounding box."""
    points = scene.objects[number].vertices
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


@lru_cache(maxsize=KEPT_REFERENCES)
def changed(reference: Reference, changes: Sequence[SceneChange]) -> Reference:
    """Return the reference of a scene after some changes, a tuple of them."""
    scene = reference.scene
    for change in changes:
        scene = change.of(scene)
    # To decide which effects each changed scene calls for takes longer than to evaluate all.
    return Reference(scene, reference.tracer_name, ALL_EFFECTS) if changes else reference
