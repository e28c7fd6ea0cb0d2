"""The surface point that each pixel shows, found by a compute pass over the triangle numbers."""

from collections.abc import Sequence
from typing import Protocol

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.raster.cameras.cameras import Pass
from xfrustum.raster.device.programs import shader
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.scene import Scene

GROUP = 16  #: pixels per side of a work group, as in position.comp

BYTES_PER_POINT = 12
"""Bytes of a point, three float32. An image is read in as many bands as its points need storage blocks."""


class Identified(Protocol):
    """A picture whose triangle and camera numbers a shader can look up."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H in pixels."""

    def bind_identity(self, unit: int) -> None:
        """Make the identities a texture for a shader."""


class Positions:
    """A scene's triangles, at least one, in double precision on the GPU, and the pass that finds points."""

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._largest_block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._points: dict[tuple[int, int], moderngl.Buffer] = {}
        self._program = context.compute_shader(shader("position.comp"))
        self._program["nothing"] = float("nan")

    def read(self, target: Identified, drawn: Sequence[Pass]) -> Singles:
        """Return surface points (H, W, 3) of what was drawn, in scene units, NaN where nothing was."""
        width, height = target.size
        rows = max(1, min(height, self._largest_block // BYTES_PER_POINT // width))
        if target.size not in self._points:
            self._points[target.size] = self._context.buffer(reserve=BYTES_PER_POINT * rows * width)
        points = self._points[target.size]
        matrices = np.stack([camera.clip_from_scene.T for camera in drawn])
        cameras = self._context.buffer(matrices.tobytes())
        cuts = self._context.buffer(np.array([camera.heights for camera in drawn]).tobytes())
        target.bind_identity(0)
        for binding, buffer in enumerate((self._vertices, self._faces, points, cameras, cuts), start=1):
            buffer.bind_to_storage_buffer(binding)
        found = np.empty((height, width, 3), np.float32)
        coordinates = np.moveaxis(found, -1, 0)
        program = self._program
        for start in range(0, height, rows):
            band = coordinates[:, start : start + rows]
            high = band.shape[1]
            program["first_row"], program["last_row"] = start, start + high - 1
            program["count"] = high * width
            program.run(-(-width // GROUP), -(-high // GROUP), 1)
            # The pass writes one coordinate of all points after the other.
            GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
            read = np.frombuffer(points.read(size=band.nbytes), dtype=np.float32)
            band[:] = read.reshape(band.shape)
        cameras.release()
        cuts.release()
        return found
