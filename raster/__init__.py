"""The second answer: the paper's double frustum, drawn with OpenGL.

cameras/    The two cameras as matrices, their passes, and their depth formats
device/     The OpenGL device: context, room, targets, programs, meshes, time
plate/      Many hogels at once: the same pictures in fewer submissions
accumulate  Means over the pixel's box and over the aperture, drawn in tiles (paper, section 6: band
            limiting)
drawing     A scene on the GPU, drawn by the passes of an image into a target (paper, sections 3 and 6)
light       Materials, lights, textures and reflections on the GPU
rasterizer  The paper's double frustum: C, then C* over it (paper, sections 3 to 6)
"""

import os

# PyOpenGL chooses its platform when it is first imported, and must look where moderngl does.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.device.capacity import require_room
from xfrustum.raster.rasterizer import Drawn, Rasterizer

__all__ = ["Drawn", "Rasterizer", "require_room"]
