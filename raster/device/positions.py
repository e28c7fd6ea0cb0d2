"""Surface points of pixels, computed on the GPU from triangle numbers."""

from collections.abc import Sequence
from typing import Protocol

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.raster.cameras.cameras import Pass
from xfrustum.raster.device.programs import shader
from xfrustum.scenes.arrays import Indices, Singles
from xfrustum.scenes.model.scene import Scene

#: pixels of a work group, as in position.comp
GROUP = 256

#: number of work groups per dispatch that every device supports
MAX_GROUPS = 65535

#: Bytes of a point, three float32. Points are read in parts that fit one storage block.
BYTES_PER_POINT = 12


class Identified(Protocol):
    """Picture with triangle and camera numbers that a shader can look up."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H in pixels."""

    def bind_identity(self, unit: int) -> None:
        """Make the identities a texture for a shader."""


class Positions:
    """Triangles of a scene (at least one) in double precision on the GPU, and the compute pass."""

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        self._largest_block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._program = context.compute_shader(shader("position.comp"))
        self._program["nothing"] = float("nan")

    def read(self, target: Identified, drawn: Sequence[Pass], pixels: Indices) -> Singles:
        """Return surface points (3, N) of a picture, scene units, NaN without a surface.

        `pixels` (N,) are numbers of pixels, row by row from the top.
        """
        program = self._program
        most = min(self._largest_block // BYTES_PER_POINT, MAX_GROUPS * GROUP)
        target.bind_identity(0)
        result = np.empty((3, len(pixels)), np.float32)
        for start in range(0, len(pixels), most):
            part = pixels[start : start + most]
            numbers = self._context.buffer(part.astype(np.uint32).tobytes())
            points = self._context.buffer(reserve=BYTES_PER_POINT * len(part))
            for binding, buffer in enumerate(
                (self._vertices, self._faces, points, numbers), start=1
            ):
                buffer.bind_to_storage_buffer(binding)
            program["count"] = len(part)
            for number, camera in enumerate(drawn):
                program["camera"], program["cuts"] = number, camera.heights
                program["clip_from_scene"] = tuple(camera.clip_from_scene.T.ravel().tolist())
                program.run(-(-len(part) // GROUP))
            # The pass writes x of all points, then y, then z.
            GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
            read = np.frombuffer(points.read(), dtype=np.float32)
            result[:, start : start + most] = read.reshape(3, -1)
            points.release()
            numbers.release()
        return result
