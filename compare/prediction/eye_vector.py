"""Lines on which a surface point is seen in truth and by its camera (docs/method.md, "Light").

At one *pixel* the drawn line is parallel to the true line (pivot aperture, fit angle), and meets
another surface point. At one *surface point* the directions of the two lines differ. With
E = -d / |d| the unit eye vector of a line d, a bend D of the line (`bend`) turns E by

    dE = - (D - (D.E) E) / |d|

and the reflection of the eye vector across N, R = 2 (N.E) N - E, by dR = 2 (N.dE) N - dE. To first
order the specular term of a light from L then changes by

    dC = I specular exponent (R.L)^(exponent - 1) (dR.L)      where N.L > 0 and R.L > 0

and a mirror shows the environment at R + dR. Diffuse and ambient light do not depend on the eye.
"""

import numpy as np
from numpy.typing import NDArray

from xfrustum.reference.lines import model_cameras
from xfrustum.reference.shading import Shader, radiance_toward, smooth_normals
from xfrustum.scenes.arrays import Floats, Numbers
from xfrustum.scenes.model.images import HogelCamera, HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, DoubleFrustum, Frustum


def true_lines(position: NDArray[np.floating], aperture: Aperture) -> Floats:
    """Return d = (.., .., -1) of the true line through each point, (..., 3); NaN in the plate."""
    return _through(position, (aperture.x, aperture.y, 0.0))


def drawn_lines(
    position: NDArray[np.floating], frustum: Frustum, aperture: Aperture, settings: DoubleFrustum
) -> Floats:
    """Return d = (.., .., -1) of the drawn line of each point, (..., 3); NaN where undrawn."""
    lines = np.full(position.shape, np.nan)
    for camera in model_cameras(frustum, aperture, settings):
        low, high = camera.heights
        # At a cut between two slabs, the slab drawn later covers the other.
        here = (position[..., 2] >= low) & (position[..., 2] <= high)
        lines[here] = _through(position[here], camera.bundle.center)
    return lines


def bend(position: NDArray[np.floating], camera: HogelCamera, near: float) -> Floats:
    """Return the drawn minus the true direction d of each point, in closed form, (..., 3).

    A point with true film coordinate u is drawn at u |z| / (|z| + n) (pivot aperture, fit angle).
    The line of film coordinate u has slope k + u t, so that the line bends by - u t n / (|z| + n).
    """
    position = np.asarray(position, dtype=np.float64)
    d = true_lines(position, camera.aperture)
    from_axis = d[..., :2] - np.asarray(camera.shear)
    height = np.abs(position[..., 2:])
    bent = np.zeros_like(d)
    bent[..., :2] = -from_axis * near / (height + near)
    return bent


def shading_normals(scene: Scene, triangle: Numbers, position: Floats, lines: Floats) -> Floats:
    """Return the unit normals that surface points are shaded with, turned to the viewer, (N, 3)."""
    flat = scene.normals[triangle]
    back = np.einsum("ij,ij->i", flat, lines) > 0
    smooth = scene.surface.vertex_normals is not None
    normal = smooth_normals(scene, triangle, position) if smooth else flat
    return np.where(back[:, None], -normal, normal)


def _through(position: NDArray[np.floating], center: tuple[float, float, float]) -> Floats:
    offset = position.astype(np.float64) - center
    depth = -offset[..., 2:]
    return np.asarray(offset / np.where(depth == 0, np.nan, depth))


def bent_eye(line: Floats, bend: Floats) -> tuple[Floats, Floats]:
    """Return E and dE, (N, 3), of true lines d and their bend (drawn minus true)."""
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    eye = -line / length
    return eye, -(bend - _dot(bend, eye) * eye) / length


def specular_change(
    scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]
) -> Floats:
    """Return the excess radiance of drawn highlights, (N, 3); `eye` is E and dE."""
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    material = scene.object_of_triangle[triangle]
    exponent = np.array([m.exponent for m in scene.materials])[material][:, None]
    specular = np.array([m.specular for m in scene.materials])[material]
    change = np.zeros_like(normal)
    for light in scene.appearance.lights:
        toward = np.asarray(light.direction)
        along = (mirrored @ toward)[:, None]
        lit = ((normal @ toward)[:, None] > 0) & (along > 0)
        # With an exponent below one the slope is infinite where R.L = 0, so unlit points use
        # R.L = 1.
        slope = exponent * np.where(lit, along, 1.0) ** (exponent - 1)
        change += np.where(lit, slope * (turned @ toward)[:, None], 0.0) * specular * light.color
    return change


def mirror_change(
    scene: Scene, triangle: Numbers, normal: Floats, eye: tuple[Floats, Floats]
) -> Floats:
    """Return the excess radiance of drawn reflections, (N, 3); see `specular_change`."""
    environment = scene.appearance.environment
    if environment is None:
        return np.zeros_like(normal)
    mirrored, turned = _reflected(normal, eye[0]), _reflected(normal, eye[1])
    reflectivity = np.array([m.reflectivity for m in scene.materials])[
        scene.object_of_triangle[triangle]
    ]
    moved = radiance_toward(environment, mirrored + turned) - radiance_toward(environment, mirrored)
    return np.asarray(reflectivity * moved)


def _reflected(normal: Floats, vector: Floats) -> Floats:
    return 2 * _dot(normal, vector) * normal - vector


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("...i,...i->...", a, b)[..., None])


def predicted_eye_error(scene: Scene, image: HogelImage, near: float) -> Floats:
    """Return the first-order excess radiance of points, (N, 3), for cameras offset by `near`."""
    where = image.off_plate
    triangle, position = image.triangle[where], image.position[where].astype(np.float64)
    lines = true_lines(position, image.camera.aperture)
    eye = bent_eye(lines, bend(position, image.camera, near))
    normal = shading_normals(scene, triangle, position, lines)
    return specular_change(scene, triangle, normal, eye) + mirror_change(
        scene, triangle, normal, eye
    )


def measured_eye_error(shader: Shader, drawn: HogelImage) -> Floats:
    """Return the excess radiance of drawn points over their true radiance, (N, 3)."""
    assert drawn.color is not None
    where = drawn.off_plate
    position = drawn.position[where].astype(np.float64)
    lines = true_lines(position, drawn.camera.aperture)
    return np.asarray(drawn.color[where] - shader.radiance(drawn.triangle[where], position, lines))
