"""The second answer: the paper's double frustum, drawn with OpenGL."""

import os

# PyOpenGL chooses its platform when it is first imported, and must look where moderngl does.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

from xfrustum.raster.rasterizer import Rasterizer

__all__ = ["Rasterizer"]
