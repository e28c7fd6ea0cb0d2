"""The look of a scene: whether it says anything of it, and a hash beside that of its geometry."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np

from xfrustum.scenes.appearance.light import DEFAULT_LIGHT
from xfrustum.scenes.model.scene import Scene


def look_hash(scene: Scene) -> str:
    """Return the SHA-256 of everything that color depends on beside `Scene.content_hash`.

    It covers the material of each object, normals, colors and textures of its surface, lights, and the
    environment. Names are left out, for no pixel depends on them.
    """
    appearance, surface = scene.appearance, scene.surface
    environment = appearance.environment
    digest = hashlib.sha256()
    parameters = {
        "materials": [asdict(material) for material in scene.materials],
        "lights": [asdict(light) for light in appearance.lights],
        "strength": None if environment is None else environment.strength,
    }
    digest.update(json.dumps(parameters, sort_keys=True).encode())
    arrays: list[np.ndarray[Any, Any] | None] = [
        None if environment is None else environment.radiance,
        surface.vertex_normals,
        surface.vertex_colors,
        surface.uv,
        surface.texture_of_triangle,
        *surface.textures,
    ]
    for array in arrays:
        # The shape goes before the content, so that different lists of arrays never give the same bytes.
        digest.update(json.dumps(None if array is None else array.shape).encode())
        digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def is_shaded(scene: Scene) -> bool:
    """Return whether a scene says how it looks: materials, lights, environment, colors, textures, shadows."""
    looks, surface = scene.appearance, scene.surface
    if scene.transport.simulated:
        return True
    named = bool(looks.materials) or looks.environment is not None or looks.lights != (DEFAULT_LIGHT,)
    return named or surface.vertex_colors is not None or surface.texture_of_triangle is not None
