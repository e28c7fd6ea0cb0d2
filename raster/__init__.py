"""The second answer: the paper's double frustum, drawn with OpenGL.

* cameras: the two cameras as matrices, their passes, and their depth formats
* device: the OpenGL device: context, room, targets, programs, meshes, time
* plate: many hogels in one submission, with the same bits
* shaders: the shaders, in GLSL
* drawing: a scene on the GPU: materials, lights, textures, reflections, and its passes
* rasterizer: the double frustum: C, then C* over it (paper, sections 3 to 6), and means of color
"""

import os

# PyOpenGL chooses its platform when it is first imported, and must look where moderngl does.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.device.context import require_room
from xfrustum.raster.rasterizer import Drawn, Rasterizer

__all__ = ["Drawn", "Rasterizer", "require_room"]
