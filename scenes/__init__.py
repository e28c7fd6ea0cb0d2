"""The question: plate, frustum, meshes, settings, and the image that every renderer returns.

appearance/  The look of surfaces: materials, lights, and the sampling of color
conformance/ The conformance suite: frozen questions to renderers of hogels
disk/        Files on the disk: read within bounds, written whole or not at all
files/       Scenes from files: tables, maps and images
geometry/    Surfaces as triangles: shapes, patches, placement, refinement, normals
library/     The built-in scenes, made by code
meshes/      Mesh files as objects: read right, listed as unread, or refused
model/       The scene that is asked about, and the image that every renderer returns
plate/       The plate, its apertures, their crossed frustum, and the settings of the two cameras
arguments    Arguments of the public dataclasses, taken as numbers and names, or not at all
arrays       Arrays by what they hold: the one place that names their types
errors       The one exception that means "the user can fix this"
notebook     What objects say of themselves, and how a notebook shows them
opening      Scenes by name or path

Words: see the glossary in CONVENTIONS.md.
"""

import lazy_loader

# Names are imported when first used: the command line, which answers `--help` without meshes,
# imports this.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
