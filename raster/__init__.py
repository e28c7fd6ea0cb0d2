"""The second answer: the paper's double frustum, drawn with OpenGL.

* cameras: the two cameras as matrices, their passes, and their depth formats
* device: contexts, limits, targets, programs, meshes and fingerprints of OpenGL devices
* plate: many hogels at once, the same pictures in fewer submissions
* shaders: the shaders, in GLSL
* drawing: materials, lights, textures and reflections of a scene, and its drawing by passes
* rasterizer: C, then C* over it (paper, sections 3 to 6), and means of color
"""

import os

# PyOpenGL chooses its platform on import, the same as moderngl.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.device.context import require_room
from xfrustum.raster.rasterizer import Drawn, Rasterizer

__all__ = ["Drawn", "Rasterizer", "require_room"]
