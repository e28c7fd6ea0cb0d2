"""The draws of one program: the triangles that each camera draws with it, for many hogels at once."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from xfrustum.raster.plate.clusters import WHOLE_FILM
from xfrustum.raster.plate.geometry import FORMATS, PassGeometry, PlateGeometry
from xfrustum.raster.plate.program import HOGELS_BINDING
from xfrustum.scenes.arrays import Floats, Singles


class PlateDrawing:
    """The triangles of a scene that one program draws.

    Parameters
    ----------
    context
        The current context.
    program
        Program made by `plate.program` for this number of hogels.
    geometry
        The scene on the GPU.
    cameras
        The triangles that each camera draws: all surfaces, or the reflective ones.
    hogels
        Largest number of hogels in one submission.
    """

    def __init__(
        self,
        context: moderngl.Context,
        program: moderngl.Program,
        geometry: PlateGeometry,
        cameras: Sequence[PassGeometry],
        hogels: int,
    ) -> None:
        self.program = program
        self._geometry, self._cameras = geometry, cameras
        numbers = np.arange(hogels, dtype=np.uint32)
        content = [
            (geometry.attribute(name), form, name) for name, form in FORMATS.items() if name in program
        ]
        # This attribute advances with the instance; every draw names its first instance.
        content.append((context.buffer(numbers.tobytes()), "1u4/i", "in_hogel"))
        self._mesh = context.vertex_array(program, content, index_buffer=geometry.indices)

    def triangles(self, number: int, matrices: Singles) -> int:
        """Return the number of triangles that a camera draws for some hogels."""
        return int(self._geometry.commands(self._cameras[number], matrices)["count"].sum()) // 3

    def upload(
        self, number: int, matrices: Singles, commands: moderngl.Buffer, windows: Floats = WHOLE_FILM
    ) -> int:
        """Write the draws of a camera for some hogels, and return their number.

        Parameters
        ----------
        number
            Number of the camera.
        matrices
            (L, 4, 4) clip-from-scene matrix of each hogel.
        commands
            Buffer that the draws are written to; it grows as needed.
        windows
            (L, 4) the part of each film that is wanted; see `clusters.clip_planes`.
        """
        draws = self._geometry.commands(self._cameras[number], matrices, windows)
        if len(draws):
            commands.orphan(max(commands.size, draws.nbytes))
            commands.write(draws.tobytes())
        return len(draws)

    def draw(self, hogels: moderngl.Buffer, commands: moderngl.Buffer, draws: int) -> None:
        """Draw what was uploaded.

        Parameters
        ----------
        hogels
            Buffer with the matrices of each hogel, see `program.hogel_block`.
        commands, draws
            The draws that `upload` wrote, and their number, which it returned.
        """
        if draws:
            hogels.bind_to_uniform_block(HOGELS_BINDING)
            self._mesh.render_indirect(commands, count=draws)
