"""Scene data: plate, frustum, meshes, settings, and the image that every renderer returns.

* appearance: materials, lights, the sampling of color, and light transport
* conformance_suite: frozen test cases for hogel renderers, in the folder `conformance`
* disk: bounded reading and atomic writing of files
* files: scene files, maps and images
* library: built-in scenes, and scenes opened by name or path
* meshes: mesh files as objects; each feature is read, listed as unread, or refused
* model: scene, images, device and eye
* plate: plate, apertures, their crossed frustum, and the settings of the two cameras
* shapes: shapes of size one; placing, refining and smoothing of meshes
* arguments: arguments of the public dataclasses, and the error for the user
* arrays: types of arrays, named by their content
* representation: short strings for numbers and objects, labelled arrays, and sRGB colors

Words: see the glossary in CONVENTIONS.md.
"""

import lazy_loader

# Names are imported on first use, because the command line imports this package and must answer
# `--help` without loading meshes.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
