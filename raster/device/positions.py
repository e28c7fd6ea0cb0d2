"""The surface point that each pixel shows, found by a compute pass over the triangle numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Protocol

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.scenes.arrays import Floats, Singles
from xfrustum.scenes.model.scene import Scene

GROUP = 16
"""Pixels per side of a work group, as in position.comp."""

BYTES_PER_POINT = 12
"""Bytes of a point, three float32. An image is read in as many bands as its points need storage blocks."""


@dataclass(frozen=True, kw_only=True)
class DrawnBy:
    """A camera as the compute pass sees it: its matrix, and the lowest and highest z that it keeps."""

    clip_from_scene: Floats
    heights: tuple[float, float]


class Identified(Protocol):
    """A picture whose triangle and camera numbers a shader can look up."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H in pixels."""

    def bind_identity(self, unit: int) -> None:
        """Make the identities a texture for a shader."""


class Positions:
    """A scene's triangles in double precision on the GPU, and the pass that finds points on them.

    Parameters
    ----------
    context, scene
        The current context, and a scene with at least one triangle.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        self._context = context
        source = (files("xfrustum.raster") / "shaders" / "position.comp").read_text()
        self._program = context.compute_shader(source)
        self._program["nothing"] = float("nan")
        self._largest_block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._points: dict[tuple[int, int], moderngl.Buffer] = {}

    def read(self, target: Identified, drawn: Sequence[DrawnBy], some: range | None = None) -> Singles:
        """Return surface points in scene units, (rows, W, 3), NaN where nothing was drawn.

        Parameters
        ----------
        target
            Picture with the triangle and camera numbers that were drawn.
        drawn
            The cameras, in the order of their numbers.
        some
            Rows that are read, counted from the top; all where None.
        """
        width, height = target.size
        rows = max(1, min(height, self._largest_block // (BYTES_PER_POINT * width)))
        if target.size not in self._points:
            self._points[target.size] = self._context.buffer(reserve=BYTES_PER_POINT * width * rows)
        points = self._points[target.size]
        matrices = np.stack([camera.clip_from_scene.T for camera in drawn])
        cameras = self._context.buffer(matrices.tobytes())
        cuts = self._context.buffer(np.array([camera.heights for camera in drawn]).tobytes())
        target.bind_identity(0)
        buffers = (self._vertices, self._faces, points, cameras, cuts)
        for binding, buffer in enumerate(buffers, start=1):
            buffer.bind_to_storage_buffer(binding)
        wanted = range(height) if some is None else some
        found = np.empty((len(wanted), width, 3), dtype=np.float32)
        for start in range(0, len(wanted), rows):
            band = found[start : start + rows]
            first = wanted.start + start
            self._program["first_row"], self._program["last_row"] = first, first + len(band) - 1
            self._program.run(-(-width // GROUP), -(-len(band) // GROUP), 1)
            GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
            read = points.read(size=BYTES_PER_POINT * width * len(band))
            band[:] = np.frombuffer(read, dtype=np.float32).reshape(band.shape)
        cameras.release()
        cuts.release()
        return found
