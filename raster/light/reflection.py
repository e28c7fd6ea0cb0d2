"""Reflection mapping, in passes of its own over the cameras' pictures, one per camera (paper, section 6)."""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np

from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

IDENTITIES, ENVIRONMENT = 0, 1
"""Texture units, as in reflection.frag and environment.glsl."""


class Identified(Protocol):
    """A target that keeps the triangle that each pixel shows, and the camera that drew it."""

    def bind_identity(self, unit: int) -> None:
        """Make the identities a texture for a shader."""


class Environment:
    """The environment map on the GPU, and the triangles that reflect it.

    Parameters
    ----------
    context
        The current context.
    scene
        Scene whose environment is uploaded; one without an environment reflects black.

    Raises
    ------
    InputError
        The map is larger than the device's largest texture.
    """

    def __init__(self, context: moderngl.Context, scene: Scene) -> None:
        environment = scene.appearance.environment
        radiance = np.zeros((1, 1, 3), np.float32) if environment is None else environment.radiance
        height, width = radiance.shape[:2]
        limit = int(context.info["GL_MAX_TEXTURE_SIZE"])
        if max(width, height) > limit:
            raise InputError(
                f"{context.info['GL_RENDERER']} holds environment maps of at most {limit} x {limit}, "
                f"not {width} x {height}; use a smaller one"
            )
        # The first row is the top one: the shader fetches texels by number and counts rows from the top.
        self._map = context.texture((width, height), 3, radiance.tobytes(), dtype="f4", alignment=4)
        self._map.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.reflecting = reflecting(scene)

    def bind(self, target: Identified) -> None:
        """Bind the map and the target's identities for the shader."""
        target.bind_identity(IDENTITIES)
        self._map.use(ENVIRONMENT)


def reflecting(scene: Scene) -> list[tuple[int, int]]:
    """Return the first triangle and the length of each run of triangles whose material reflects."""
    mirrors = np.array([max(material.reflectivity) > 0 for material in scene.materials], dtype=np.bool_)
    reflects = np.concatenate(([False], mirrors[scene.object_of_triangle], [False]))
    (changes,) = np.nonzero(reflects[1:] != reflects[:-1])
    return [(int(start), int(end - start)) for start, end in changes.reshape(-1, 2)]
