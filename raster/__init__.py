"""The second renderer: the paper's double frustum, drawn with OpenGL.

* cameras: the two cameras as matrices, their passes and depth formats, and views by direction
* description: cameras for other renderers, as JSON, glTF and Mitsuba sensors
* device: contexts, limits, targets, programs, meshes and fingerprints of OpenGL devices
* plate: many hogels per submission, with the same pictures
* shaders: the shaders, in GLSL
* drawing: materials, lights, textures and reflections on the GPU, and drawing by passes
* rasterizer: image of C, with C* drawn over it (paper, sections 3 to 6), and means of color
"""

import os

# PyOpenGL selects its platform on import; it must be EGL, as for moderngl.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.device.context import require_room
from xfrustum.raster.rasterizer import Drawn, Rasterizer

__all__ = ["Drawn", "Rasterizer", "require_room"]
