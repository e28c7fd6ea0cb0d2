"""The color of what a guess about a renderer makes of a scene: the reference's own light on its surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xfrustum.compare.renderer_model.drawn_model import DrawnModel
from xfrustum.reference.shading.shading import Hits, Shader
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.hogel_image import NOTHING, HogelImage
from xfrustum.scenes.model.scene import Scene


def colored(scene: Scene, model: DrawnModel, answer: HogelImage) -> HogelImage:
    """Return a prediction with the color of each pixel's own surface point; nothing is averaged.

    Each half is seen along the lines of its own camera. Where lights are not conjugated, C* shares them with
    C, and needs L* = -L.
    """
    right = _radiance(Shader(scene), scene, model, answer)
    if model.conjugated:
        return replace(answer, color=right)
    # C* turns normals to itself, away from the viewer. To reverse them all is to reverse the lights.
    lights = [
        replace(light, direction=(-light.direction[0], -light.direction[1], -light.direction[2]))
        for light in scene.appearance.lights
    ]
    other = replace(scene, appearance=replace(scene.appearance, lights=tuple(lights)))
    front = answer.height > model.plate_height
    wrong = _radiance(Shader(other), scene, model, answer)
    return replace(answer, color=np.where(front[..., None], wrong, right))


def _radiance(shader: Shader, scene: Scene, model: DrawnModel, answer: HogelImage) -> Singles:
    color = np.zeros((*answer.triangle.shape, 3), dtype=np.float32)
    covered = answer.triangle != NOTHING
    number = answer.triangle[covered]
    directions, of_c_star = (
        model.pencil(scene, answer.camera.aperture, side).directions() for side in (1, -1)
    )
    front = answer.height > model.plate_height
    directions[front] = of_c_star[front]
    hits = Hits(
        triangle=number,
        normal=scene.normals[number],
        position=answer.position[covered].astype(np.float64),
        direction=directions[covered],
    )
    color[covered] = shader.radiance(hits)
    return color
