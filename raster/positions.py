"""Which surface point does each pixel show? A compute pass over the identities that were drawn."""

from __future__ import annotations

from importlib.resources import files

import moderngl
import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from xfrustum.raster.cameras import Matrix
from xfrustum.raster.targets import CAMERA_BIT, Target
from xfrustum.scenes.scene import Scene

GROUP = 16
"""Pixels per side of a work group, as in position.comp."""


class Positions:
    """A scene's corners in double precision on the GPU, and the pass that finds points on them.

    Parameters
    ----------
    context
        The current context.
    scene
        At least one triangle.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        source = (files("xfrustum.raster") / "shaders" / "position.comp").read_text()
        self._program = context.compute_shader(source)
        self._program["camera_bit"] = CAMERA_BIT
        self._program["nothing"] = float("nan")
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._points: dict[tuple[int, int], moderngl.Buffer] = {}

    def read(self, target: Target, c: Matrix, c_star: Matrix) -> NDArray[np.float32]:
        """Return surface points in scene units, (H, W, 3), NaN where nothing was drawn.

        Parameters
        ----------
        target
            What was drawn.
        c, c_star
            Clip-from-scene of the two cameras that drew it.
        """
        width, height = target.size
        if target.size not in self._points:
            self._points[target.size] = self._context.buffer(reserve=12 * width * height)
        points = self._points[target.size]
        target.bind_identity(0)
        for binding, buffer in enumerate((self._vertices, self._faces, points), start=1):
            buffer.bind_to_storage_buffer(binding)
        self._program["clip_from_scene"] = tuple(c.T.ravel().tolist())
        self._program["clip_from_scene_c_star"] = tuple(c_star.T.ravel().tolist())
        self._program.run(-(-width // GROUP), -(-height // GROUP), 1)
        GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
        return np.frombuffer(points.read(), dtype=np.float32).reshape(height, width, 3)
