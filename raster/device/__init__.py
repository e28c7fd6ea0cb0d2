"""OpenGL without a display: contexts, framebuffers, shaders, and a scene's triangles on the GPU.

* context: the EGL context, device names, and checks of its limits
* programs: shaders of the folder `shaders` for a choice of effects, and camera uniforms
* targets: framebuffers with depth formats that moderngl does not offer
* mesh: triangles on the GPU in float32
* positions: surface points of pixels by a compute pass
* fingerprint: test pictures that reveal the rounding of a device
"""
