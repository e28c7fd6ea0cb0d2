"""The error of the bent eye vector at an image's surface points, predicted and measured.

See docs/method.md, "Light".
"""

from __future__ import annotations

import numpy as np

from xfrustum.compare.prediction.eye_vector import bend, radiance_along, shading_normals, true_lines
from xfrustum.compare.prediction.shading import bent_eye, mirror_change, specular_change
from xfrustum.reference.shading.shading import Shader
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene


def predicted_eye_error(scene: Scene, image: HogelImage, near: float) -> Floats:
    """Return, in closed form to first order, how much brighter the points of an image are drawn, (N, 3).

    Parameters
    ----------
    image
        Image of surface points, such as the truth; the points off the plate count.
    near
        Near offset of both cameras, scene units (pivot aperture, fit angle, no slabs).
    """
    where = image.off_plate
    triangle, position = image.triangle[where], image.position[where].astype(np.float64)
    lines = true_lines(position, image.camera.aperture)
    eye = bent_eye(lines, bend(position, image.camera, near))
    normal = shading_normals(scene, triangle, position, lines)
    return specular_change(scene, triangle, normal, eye) + mirror_change(scene, triangle, normal, eye)


def measured_eye_error(scene: Scene, shader: Shader, drawn: HogelImage) -> Floats:
    """Return how much brighter a device drew the points of its image than they truly are, (N, 3).

    Parameters
    ----------
    shader
        Shader of the scene.
    drawn
        Drawn image with color, sampled once per pixel. The difference between its float32 and the shader's
        double precision is part of the result.
    """
    assert drawn.color is not None
    where = drawn.off_plate
    position = drawn.position[where].astype(np.float64)
    lines = true_lines(position, drawn.camera.aperture)
    truly = radiance_along(scene, shader, drawn.triangle[where], position, lines)
    return np.asarray(drawn.color[where] - truly)
