"""The second answer: the paper's double frustum, drawn with OpenGL.

cameras/    The two cameras as matrices, their passes, and their depth formats device/     The
OpenGL device: context, room, targets, programs, meshes, time plate/      Many hogels at once: the
same pictures in fewer submissions shaders/    The shaders, in GLSL drawing     A scene on the GPU:
materials, lights, textures, reflections, and its drawing by the passes rasterizer  The paper's
double frustum: C, then C* over it (paper, sections 3 to 6), and means of color
"""

import os

# PyOpenGL chooses its platform when it is first imported, and must look where moderngl does.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.device.context import require_room
from xfrustum.raster.rasterizer import Drawn, Rasterizer

__all__ = ["Drawn", "Rasterizer", "require_room"]
