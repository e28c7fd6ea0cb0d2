"""Materials, lights and reflections on the GPU.

materials   Materials, lights and textures on the GPU, and which of them each triangle has
reflection  Reflection mapping: passes of its own, one per camera, over what the cameras drew (paper,
            section 6)
"""
