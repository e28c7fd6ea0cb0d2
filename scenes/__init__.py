"""The question: plate, frustum, meshes, settings, and the image that every renderer returns."""

from __future__ import annotations

from xfrustum.scenes.catalogue import open_scene
from xfrustum.scenes.double_frustum import (
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Fit,
    Offset,
    Pivot,
)
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.frustum import Frustum, Screen
from xfrustum.scenes.hogel_image import NOTHING, Certainty, HogelCamera, HogelImage
from xfrustum.scenes.plate import Aperture, Plate
from xfrustum.scenes.scene import Scene, SceneObject

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
