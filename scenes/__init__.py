"""Scene data: plate, frustum, meshes, settings, and the image that every renderer returns.

appearance/     Materials, lights, and the sampling of color
conformance/    Conformance suite: frozen test cases for hogel renderers
disk/ Files on disk: bounded reading, atomic writing
files/          Scene files, maps and images
geometry/       Surfaces as triangles: shapes, patches, placement, refinement, normals
library/        Built-in scenes
meshes/ Mesh files as objects: each feature is read, listed as unread, or refused
model/          Scene, hogel image, device and eye
plate/          Plate, apertures, their crossed frustum, and the settings of the two cameras
arguments       Arguments of the public dataclasses: numbers, names and programs
arrays          Types of arrays, named by their content
errors Exception for mistakes that users can correct
representation  Short text of numbers and objects, and arrays with labels
opening         Scenes by name or path

Words: see the glossary in CONVENTIONS.md.
"""

import lazy_loader

# Names are imported on first use, because the command line imports this package and must answer
# `--help` without loading meshes.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
