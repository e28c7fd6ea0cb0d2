"""The question: plate, frustum, meshes, settings, and the image that every renderer returns.

appearance/  What surfaces look like: materials, lights, and how finely color is sampled
disk/        Files on the disk: read within bounds, written whole or not at all
files/       Scenes from files: tables, meshes, maps and images
geometry/    Surfaces as triangles: shapes, patches, placement, refinement, normals
library/     The built-in scenes, made by code
model/       The scene that is asked about, and the image that every renderer returns
opening/     Scenes by what people type
plate/       The plate, its apertures, their crossed frustum, and the settings of the two cameras
arguments    Arguments of the public dataclasses, taken as numbers and names, or not at all
arrays       Arrays by what they hold: the one place that names their types
errors       The one exception that means "the user can fix this"
"""

from __future__ import annotations

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.opening.catalogue import open_scene
from xfrustum.scenes.plate.double_frustum import (
    Camera,
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
