"""The OpenGL device: context, targets, programs, meshes, textures, time.

context        The one place that makes an OpenGL context: moderngl over EGL, without a display
devices        The EGL devices of this machine: which of them are GPUs, by the index that chooses a device
facing         Which way faces are turned, as OpenGL is told for a camera, and which of them it leaves out
mesh           A scene's triangles on the GPU, in float32: corners, and what is interpolated between them
numbered_mesh  A mesh whose triangles know their numbers: each has the number of its last vertex
positions      The surface point that each pixel shows, found by a compute pass over the triangle numbers
programs       Shaders of the folder `shaders`, put together for the effects that are asked for
capacity       The largest images and meshes that a device has room for, asked before anything is uploaded
targets        Framebuffers with the depth formats that moderngl does not offer, made, bound and freed
               through PyOpenGL
textures       Textures of any number and size in one block of storage, decoded and filtered by the shader
timer          Timer queries of the GPU beside wall time, stage by stage
triangles      Draw calls during which other threads run Python
"""
