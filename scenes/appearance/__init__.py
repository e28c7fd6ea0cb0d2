"""Look of surfaces: materials, lights, and the sampling of color.

appearance  Materials, lights and an environment, and their defaults
display     Radiance as pages show it: clipped, sRGB, 8 bits
sampling    Numbers of samples over pixels and aperture, and light transport
"""
