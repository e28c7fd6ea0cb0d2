"""OpenGL without a display: contexts, framebuffers, shaders, and a scene's triangles on the GPU.

* context: the EGL context, device names, and checks of its limits
* targets: framebuffers with depth formats that moderngl does not offer, with one layer or several
* mesh: shaders for a choice of effects, triangles in float32, and surface points of pixels
* fingerprint: test pictures that reveal the rounding of a device
"""
