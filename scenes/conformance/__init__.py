"""Conformance suite: frozen test cases for hogel renderers.

suite  Cases of `1.0`, and their scenes

`1.0/cases.toml` lists the cases; `1.0/scenes` and `1.0/meshes` hold the scenes that are not built
in. A released suite never changes: the next one corrects errors
(scripts/freeze_conformance_suite.py).
"""
