"""The look of surfaces: materials, lights, and the sampling of color.

appearance  The appearance of a scene: its materials and lights, and the default where it names none
display     How pictures are shown on every page and in notebooks: clipped to what a screen has, sRGB, 8 bits
light       Lights: directional, and an environment around everything
material    Phong materials: how a surface reflects light (paper, section 3, figure 3)
sampling    Numbers of samples over pixels and over the aperture, and light transport; off by default
"""
