"""The question: plate, frustum, meshes, settings, and the image that every renderer returns."""

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
