"""Changes of the scene that a renderer drew: axes exchanged or negated, one object left out.

A model of a renderer names them (`RendererModel.changes`); its pictures and claims are those of the
changed scene, in which triangles keep their numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from xfrustum.reference import Reference
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
    """One change: an object is left out, or all points are multiplied by a matrix."""

    missing: int | None = None  # number of the object that is left out
    matrix: Matrix = UNCHANGED

    def of(self, scene: Scene) -> Scene:
        """Return the scene that is drawn."""
        parts = list(scene.objects)
        if self.missing is not None:
            # Out of reach it is not drawn, and its triangles keep their numbers.
            part = parts[self.missing]
            depth = float(np.ptp(part.vertices[:, 2])) + 4 * scene.frustum.longest_reach
            away = part.vertices - (0.0, 0.0, float(part.vertices[:, 2].max()) + depth)
            parts[self.missing] = replace(part, vertices=away)
            return replace(scene, objects=tuple(parts))
        matrix = np.array(self.matrix).T
        for number, part in enumerate(parts):
            normals = None if part.vertex_normals is None else part.vertex_normals @ matrix
            parts[number] = replace(part, vertices=part.vertices @ matrix, vertex_normals=normals)
        return replace(scene, objects=tuple(parts))


@lru_cache(maxsize=KEPT_REFERENCES)
def changed(reference: Reference, changes: Sequence[SceneChange]) -> Reference:
    """Return the reference of a scene after some changes, a tuple of them."""
    scene = reference.scene
    for change in changes:
        scene = change.of(scene)
    # To decide which effects each changed scene calls for takes longer than to evaluate all.
    return Reference(scene, reference.tracer_name, ALL_EFFECTS) if changes else reference
