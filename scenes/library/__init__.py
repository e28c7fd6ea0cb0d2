"""Built-in scenes, the same on every machine.

builtin     Catalogue of the built-in scenes
car         A car of about 42,000 triangles: plain, and in a studio
hard_cases Scenes on which renderers of crossed frusta fail
targets     Objects for orientation, depth order, clipping, reflection, and bars
"""
