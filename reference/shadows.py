"""Shadows of lights, exact for the doubles of point and light (docs/truth.md).

A point is in shadow if its ray to the light meets a triangle at t > 0. Triangles in the plane of
the point's own triangle are excluded by number: the ray meets this plane only in the point, which
rounding has moved to either side. A triangle does not shadow lights below its own plane, toward
which smooth normals may point.
"""

import numpy as np

from xfrustum.reference.backend import cross, difference, dot
from xfrustum.reference.certify.cone import ROUNDING
from xfrustum.reference.rays.filter import UNDERFLOW_BOUND
from xfrustum.reference.rays.integers import coordinates, integers, meet
from xfrustum.reference.rays.rays import ExactMesh, RayBatch
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene

#: first t of a ray to a light: above zero, because a surface that touches the point hides nothing
FIRST = float(np.nextafter(0.0, 1.0))


class ShadowedShader:
    """The light model of a scene with at least one triangle, and the shadows of its lights."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._shader = Shader(scene)
        self._mesh = ExactMesh(scene.vertices, scene.faces)

    def picture(self, triangle: Numbers, position: Floats, direction: Floats) -> Floats:
        """Return linear RGB of points; see `Shader.picture`."""
        color = np.zeros(position.shape)
        covered = triangle != NOTHING
        points = triangle[covered].astype(np.int64), position[covered], direction[covered]
        hidden = [
            self.hidden(*points, np.asarray(light.direction))
            for light in self._scene.appearance.lights
        ]
        color[covered] = self._shader.radiance(triangle[covered], *points[1:], hidden)
        return color

    def hidden(self, triangle: Indices, position: Floats, direction: Floats, light: Floats) -> Mask:
        """Return which points (N, 3) of triangles (N,) are hidden from a light.

        `direction` (N, 3) leads from the viewer to each point; `light` (3,) leads to the light.
        """
        hidden = np.zeros(len(triangle), dtype=np.bool_)
        normal = self._scene.normals[triangle]
        # The visible side faces the light where viewer and light are on one side of the plane.
        facing = np.flatnonzero(np.einsum("ij,ij->i", normal, direction) * (normal @ light) < 0)
        rays = RayBatch(
            origins=position[facing],
            directions=np.tile(light, (len(facing), 1)),
            ends=np.tile([FIRST, np.inf], (len(facing), 1)),
        )
        pairs = self._mesh.candidates(rays)
        pairs = pairs[~self._coplanar(triangle[facing[pairs.ray]], pairs.triangle)]
        hidden[facing[pairs.ray[pairs.sure]]] = True
        doubtful = pairs[~pairs.sure & ~hidden[facing[pairs.ray]]]
        some = rays[doubtful.ray]
        decided = meet(
            self._mesh.triangles[doubtful.triangle], some.origins, some.directions, some.ends
        )
        hidden[facing[doubtful.ray[decided.met]]] = True
        return hidden

    def _coplanar(self, first: Indices, second: Indices) -> Mask:
        """Return which triangles lie in the planes of others (K,), decided in integers."""
        a, b = self._mesh.triangles[first], self._mesh.triangles[second]
        coplanar: Mask = first == second
        # Doubles rule out most: a corner farther from the plane than the bound of its determinant.
        edges = np.abs(a[:, 1:] - a[:, :1])
        offsets = b - a[:, :1]
        normal = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
        height = np.abs(np.einsum("kij,kj->ki", offsets, normal))
        magnitude = np.einsum("kij,kj->ki", np.abs(offsets), _unsigned_cross(edges))
        close = (height <= ROUNDING * magnitude + UNDERFLOW_BOUND).all(axis=1)
        possible = np.flatnonzero(close & ~coplanar)
        (own, other), _ = integers(a[possible], b[possible])
        p, q = coordinates(own), coordinates(other)
        corners, others = ([[axis[:, k] for axis in v] for k in range(3)] for v in (p, q))
        plane = cross(difference(corners[1], corners[0]), difference(corners[2], corners[0]))
        flat = [dot(plane, difference(corner, corners[0])) == 0 for corner in others]
        coplanar[possible] = np.logical_and.reduce([part.astype(np.bool_) for part in flat])
        return coplanar


def _unsigned_cross(edges: Floats) -> Floats:
    """Return cross products of unsigned vectors (K, 2, 3), products added instead of subtracted."""
    (ax, ay, az), (bx, by, bz) = edges[:, 0].T, edges[:, 1].T
    return np.stack((ay * bz + az * by, az * bx + ax * bz, ax * by + ay * bx), axis=1)
