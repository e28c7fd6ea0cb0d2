"""Materials, lights and reflections on the GPU.

materials   Materials, lights and textures on the GPU, and the material and texture of each triangle
reflection  Reflection mapping, in passes of its own over the cameras' pictures, one per camera (paper,
            section 6)
"""
