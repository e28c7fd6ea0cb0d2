"""The look of surfaces: materials, lights, and the sampling of color.

appearance  Materials, lights and an environment, and the defaults where a scene names none display
How pictures are shown on every page and in notebooks: clipped to what a screen has, sRGB, 8 bits
sampling    Numbers of samples over pixels and over the aperture, and light transport; off by
default
"""
