"""The look of surfaces: materials, lights, and the sampling of color.

appearance  Materials, lights and an environment, and the defaults where a scene names none; sRGB
sampling    Numbers of samples over pixels and over the aperture, and light transport; off by default
"""
