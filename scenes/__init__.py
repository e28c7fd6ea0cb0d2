"""The question: plate, frustum, meshes, settings, and the image that every renderer returns.

appearance/  The look of surfaces: materials, lights, and the sampling of color
disk/        Files on the disk: read within bounds, written whole or not at all
files/       Scenes from files: tables, meshes, maps and images
geometry/    Surfaces as triangles: shapes, patches, placement, refinement, normals
library/     The built-in scenes, made by code
model/       The scene that is asked about, and the image that every renderer returns
plate/       The plate, its apertures, their crossed frustum, and the settings of the two cameras
arguments    Arguments of the public dataclasses, taken as numbers and names, or not at all
arrays       Arrays by what they hold: the one place that names their types
errors       The one exception that means "the user can fix this"
notebook     What objects say of themselves, and how a notebook shows them
opening      Scenes by name or path

Words: see the glossary in CONVENTIONS.md.
"""

from importlib import import_module

#: Public names by the module that has them; type checkers read `__init__.pyi`. They are imported when first
#: used: the command line, which must not load meshes to answer `--help`, imports this package.
_NAMES = {
    "errors": "InputError",
    "model.hogel_image": "NOTHING Certainty HogelCamera HogelImage",
    "model.scene": "Scene SceneObject",
    "opening": "open_scene",
    "plate.double_frustum": "Camera Cull DepthFormat DepthMapping DoubleFrustum Fit Offset Pivot",
    "plate.frustum": "Frustum Screen",
    "plate.plate": "Aperture Plate",
}

_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_MODULES)  # noqa: PLE0605 - a list, of what is above


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'xfrustum.scenes' has no attribute {name!r}")
    return getattr(import_module(f"xfrustum.scenes.{_MODULES[name]}"), name)
