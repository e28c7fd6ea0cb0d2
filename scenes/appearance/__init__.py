"""What surfaces look like: materials, lights, and how finely color is sampled.

appearance  What a scene looks like: its materials and lights, and the default where it names none
light       Lights: directional, and an environment around everything
material    Phong materials: what a surface does with light (paper, section 3, figure 3)
sampling    How finely a picture is sampled over pixels and over the aperture; all of it off unless asked
            for
"""
