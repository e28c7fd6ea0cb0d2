"""Appearance of surfaces: materials, lights, and the sampling of color.

appearance  Materials, lights and an environment, and their defaults
display Radiance for display: clipped, sRGB, 8 bits
sampling    Numbers of samples over pixels and aperture, and light transport
"""
