"""The OpenGL device: context, room, targets, programs, meshes, time.

context    The one place that makes an OpenGL context: which devices there are, what fits, and times
fingerprint  Draws triangles, writes depths and filters a texture: how the device rounds mesh
A scene's triangles on the GPU, in float32, with their numbers positions  The surface point that
each pixel shows, found by a compute pass over the triangle numbers programs   Shaders of the folder
`shaders`, put together, and what they are told of a camera targets    Framebuffers with the depth
formats that moderngl does not offer
"""
