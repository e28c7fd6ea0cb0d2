"""Embree as tracer: the first triangle of each ray, in single precision and robust mode.

The result is a proposal. Positions are computed from the triangle in double precision, and
`certify` tests the proposal.
"""

from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from xfrustum.reference.llvm import worker_count
from xfrustum.reference.tracers.tracer import unit_scale
from xfrustum.scenes.arrays import Floats, Indices, Numbers, Singles
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.model.scene import Scene

#: Rays of one call. Embree's binding traces a call on one thread and releases the interpreter lock:
#: several calls run on several threads.
RAYS_PER_CALL = 1 << 16


def embree_versions() -> dict[str, str]:
    """Return name and version of the tracer, for reports."""
    return {"embreex": version("embreex")}


class EmbreeMesh:
    """Acceleration structure of a mesh of about unit size, in Embree's robust mode.

    Parameters
    ----------
    vertices
        (V, 3) positions, rounded to float32.
    faces
        (F, 3) vertex numbers of each triangle.
    """

    def __init__(self, vertices: Floats, faces: Indices) -> None:
        self._embree = EmbreeScene(robust=True)
        self._empty = len(faces) == 0
        if not self._empty:
            TriangleMesh(self._embree, vertices.astype(np.float32), faces.astype(np.int32))
            # The structure is built on the first ray, and two threads must not build it at once.
            self._embree.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def first_hits(
        self, origins: Singles, directions: Singles, lengths: Singles | None = None
    ) -> Numbers:
        """Return the first triangle (N,) of rays (N, 3) up to lengths, `NOTHING` for none."""
        hits = np.full(len(origins), NOTHING, dtype=np.int32)
        if self._empty or not len(hits):
            return hits

        def fill(start: int) -> None:
            part = slice(start, start + RAYS_PER_CALL)
            ends = None if lengths is None else lengths[part]
            hits[part] = self._embree.run(origins[part], directions[part], ends)

        with ThreadPoolExecutor(worker_count()) as pool:
            list(pool.map(fill, range(0, len(hits), RAYS_PER_CALL)))
        return hits


class EmbreeTracer:
    """A scene in Embree, scaled by `scale`."""

    name = "embree"

    def __init__(self, scene: Scene) -> None:
        self.scale = unit_scale(scene.vertices)
        self._mesh = EmbreeMesh(scene.vertices * self.scale, scene.faces)

    def first_hits(self, origins: Floats, directions: Floats) -> Numbers:
        """Return the first triangle of each ray, (N,); see `Tracer.first_hits`."""
        scaled = (origins * self.scale).astype(np.float32)
        return self._mesh.first_hits(scaled, directions.astype(np.float32))
