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

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from xfrustum.scenes.errors import InputError
    from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage
    from xfrustum.scenes.model.scene import Scene, SceneObject
    from xfrustum.scenes.opening import open_scene
    from xfrustum.scenes.plate.double_frustum import (
        Camera,
        Cull,
        DepthFormat,
        DepthMapping,
        DoubleFrustum,
        Fit,
        Offset,
        Pivot,
    )
    from xfrustum.scenes.plate.frustum import Frustum, Screen
    from xfrustum.scenes.plate.plate import Aperture, Plate

__all__ = [
    "NOTHING",
    "Aperture",
    "Camera",
    "Certainty",
    "Cull",
    "DepthFormat",
    "DepthMapping",
    "DoubleFrustum",
    "Fit",
    "Frustum",
    "HogelCamera",
    "HogelImage",
    "InputError",
    "Offset",
    "Pivot",
    "Plate",
    "Scene",
    "SceneObject",
    "Screen",
    "open_scene",
]

_MODULES = {
    "NOTHING": "model.hogel_image",
    "Aperture": "plate.plate",
    "Camera": "plate.double_frustum",
    "Certainty": "model.hogel_image",
    "Cull": "plate.double_frustum",
    "DepthFormat": "plate.double_frustum",
    "DepthMapping": "plate.double_frustum",
    "DoubleFrustum": "plate.double_frustum",
    "Fit": "plate.double_frustum",
    "Frustum": "plate.frustum",
    "HogelCamera": "model.hogel_image",
    "HogelImage": "model.hogel_image",
    "InputError": "errors",
    "Offset": "plate.double_frustum",
    "Pivot": "plate.double_frustum",
    "Plate": "plate.plate",
    "Scene": "model.scene",
    "SceneObject": "model.scene",
    "Screen": "plate.frustum",
    "open_scene": "opening",
}
"""Module of each name. They are imported when first used: the command line reads `tolerances` before it knows
whether any command runs, and must not load meshes and images for that."""


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'xfrustum.scenes' has no attribute {name!r}")
    return getattr(import_module(f"xfrustum.scenes.{_MODULES[name]}"), name)
