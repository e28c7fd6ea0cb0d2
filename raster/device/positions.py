"""The surface point that each pixel shows, found by a compute pass over the triangle numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import moderngl
import numpy as np
from OpenGL import GL

from xfrustum.raster.device.programs import shader
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
        self._largest_block = int(GL.glGetIntegerv(GL.GL_MAX_SHADER_STORAGE_BLOCK_SIZE))
        self._vertices = context.buffer(scene.vertices.tobytes())
        self._faces = context.buffer(scene.faces.astype(np.uint32).tobytes())
        self._points: dict[tuple[int, int], moderngl.Buffer] = {}
        self._program = context.compute_shader(shader("position.comp"))
        self._program["nothing"] = float("nan")

    def read(self, target: Identified, drawn: Sequence[DrawnBy]) -> Singles:
        """Return surface points in scene units, (H, W, 3), NaN where nothing was drawn.

        Parameters
        ----------
        target
            Picture with the triangle and camera numbers that were drawn.
        drawn
            The cameras, in the order of their numbers.
        """
        width, height = target.size
        rows = max(1, min(height, self._points_at_once(target) // width))
        found = np.empty((height, width, 3), np.float32)
        coordinates = np.moveaxis(found, -1, 0)
        with self._bound(target, drawn) as points:
            for start in range(0, height, rows):
                band = coordinates[:, start : start + rows]
                high = band.shape[1]
                program = self._program
                program["first_row"], program["last_row"] = start, start + high - 1
                program["count"] = high * width
                program.run(-(-width // GROUP), -(-high // GROUP), 1)
                _read_into(band, points)
        return found

    def _points_at_once(self, target: Identified) -> int:
        width, height = target.size
        return max(width, min(width * height, self._largest_block // BYTES_PER_POINT))

    @contextmanager
    def _bound(self, target: Identified, drawn: Sequence[DrawnBy]) -> Iterator[moderngl.Buffer]:
        """Bind what both programs read, and return the buffer that they write."""
        if target.size not in self._points:
            room = BYTES_PER_POINT * self._points_at_once(target)
            self._points[target.size] = self._context.buffer(reserve=room)
        points = self._points[target.size]
        matrices = np.stack([camera.clip_from_scene.T for camera in drawn])
        cameras = self._context.buffer(matrices.tobytes())
        cuts = self._context.buffer(np.array([camera.heights for camera in drawn]).tobytes())
        target.bind_identity(0)
        buffers = (self._vertices, self._faces, points, cameras, cuts)
        for binding, buffer in enumerate(buffers, start=1):
            buffer.bind_to_storage_buffer(binding)
        yield points
        cameras.release()
        cuts.release()


def _read_into(found: Singles, points: moderngl.Buffer) -> None:
    """Wait for the points of a program's run, and read them, coordinate by coordinate (3, ..)."""
    GL.glMemoryBarrier(GL.GL_BUFFER_UPDATE_BARRIER_BIT)
    found[:] = np.frombuffer(points.read(size=found.nbytes), dtype=np.float32).reshape(found.shape)
