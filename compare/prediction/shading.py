"""The effect of a bent eye vector on highlights and reflections, to first order (docs/method.md, "Light").

With E the unit eye vector and d a line, E = -d / |d|. A bend D of the line (`eye_vector.bend`) turns E by

    dE = - (D - (D.E) E) / |d|

and turns the reflection of the eye vector across N, R = 2 (N.E) N - E, by dR = 2 (N.dE) N - dE, of the same
length. The specular term of a light from L then changes by

    dC = I specular exponent (R.L)^(exponent - 1) (dR.L)      where N.L > 0 and R.L > 0

and a mirror shows what lies at R + dR. Diffuse and ambient light do not depend on the eye.
"""

from __future__ import annotations

import numpy as np

from xfrustum.reference.shading.surroundings import radiance_toward
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.scene import Scene


def bent_eye(line: Floats, bend: Floats) -> tuple[Floats, Floats]:
    """Return E and dE, (N, 3) each.

    Parameters
    ----------
    line, bend
        (N, 3) direction d of the true line, of any length, and the drawn minus the true direction.
    """
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    eye = -line / length
    return eye, -(bend - _dot(bend, eye) * eye) / length


def specular_change(scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]) -> Floats:
    """Return how much brighter highlights are drawn than they are, (N, 3) linear RGB.

    Parameters
    ----------
    triangle
        (N,) numbers of the triangles that the points are on.
    normal
        (N, 3) unit normals used for shading, turned to the viewer.
    eye
        E and dE as `bent_eye` returns them.
    """
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    material = scene.object_of_triangle[triangle]
    exponent = np.array([m.exponent for m in scene.materials])[material][:, None]
    specular = np.array([m.specular for m in scene.materials])[material]
    change = np.zeros_like(normal)
    for light in scene.appearance.lights:
        toward = np.asarray(light.direction)
        along = (mirrored @ toward)[:, None]
        lit = ((normal @ toward)[:, None] > 0) & (along > 0)
        # With an exponent below one the slope is infinite at the end of the highlight: unlit points take 1.
        slope = exponent * np.where(lit, along, 1.0) ** (exponent - 1)
        change += np.where(lit, slope * (turned @ toward)[:, None], 0.0) * specular * light.color
    return change


def mirror_change(scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]) -> Floats:
    """Return how much brighter reflections are drawn than they are, (N, 3) linear RGB.

    The parameters are those of `specular_change`.
    """
    environment = scene.appearance.environment
    if environment is None:
        return np.zeros_like(normal)
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    reflectivity = np.array([m.reflectivity for m in scene.materials])[scene.object_of_triangle[triangle]]
    moved = radiance_toward(environment, mirrored + turned) - radiance_toward(environment, mirrored)
    return np.asarray(reflectivity * moved)


def _reflected(normal: Floats, vector: Floats) -> Floats:
    return 2 * _dot(normal, vector) * normal - vector


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("...i,...i->...", a, b)[..., None])
