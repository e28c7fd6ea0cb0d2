"""The conformance suite: frozen questions to renderers of hogels, each a scene, hogels and what is asked.

suite  Cases as they are frozen in `1.0`, and the scenes that they are asked of

`1.0/cases.toml` lists the cases; `1.0/scenes` and `1.0/meshes` have what no built-in scene has. A
released suite is never changed: what is found to be wrong in it is mended in the next one.
"""
