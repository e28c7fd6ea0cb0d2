"""The names of the built-in shapes, for the checks of a scene file, which need no arrays."""

from __future__ import annotations

SHAPE_NAMES = ("box", "square", "sphere", "cylinder", "cone", "torus")
"""Names in the order in which messages list them; `shapes.SHAPES` makes a mesh of each."""
