"""The matrices of C and C*, with the step back by near (paper, figures 4 to 6).

Matrices are named target-from-source and multiply column vectors. They are made in double
precision and rounded once, to the float32 that OpenGL computes with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from xfrustum.raster.cameras.depth_formats import ClipEnds
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.plate.double_frustum import DoubleFrustum, Offset, Pivot
from xfrustum.scenes.plate.plate import Aperture, Frustum


@dataclass(frozen=True, kw_only=True)
class FilmWindow:
    """The rectangle that an aperture's film spans at unit distance from the plate."""

    #: dx/dz and dy/dz of the frustum's axis: how far the shear moves a plane per unit of height
    axis: tuple[float, float]
    #: half_width, half_height: Half the film's extent per unit of distance
    half_width: float
    half_height: float

    @classmethod
    def of(cls, frustum: Frustum, aperture: Aperture) -> FilmWindow:
        """Return the window: fixed angles, or the fixed screen as seen from the aperture."""
        screen = frustum.screen
        if screen is None:
            assert frustum.fov is not None
            half_width, half_height = (math.tan(angle / 2) for angle in frustum.fov)
            return cls(axis=(0.0, 0.0), half_width=half_width, half_height=half_height)
        left, right = (screen.center[0] + side * screen.size[0] / 2 - aperture.x for side in (-1, 1))
        bottom, top = (screen.center[1] + side * screen.size[1] / 2 - aperture.y for side in (-1, 1))
        return cls(
            axis=((left + right) / 2 / screen.height, (bottom + top) / 2 / screen.height),
            half_width=abs((right - left) / 2 / screen.height),
            half_height=abs((top - bottom) / 2 / screen.height),
        )


@dataclass(frozen=True, kw_only=True)
class SlabCamera:
    """One camera: where it stands, and what it keeps."""

    orthoscopic: bool  #: True for C, which looks away from the viewer; False for C*, which looks back
    #: Distance by which the camera has stepped back from the plate, against its direction of view
    step: float
    #: near, far: Distances of the near and the far plane from the camera
    near: float
    far: float
    heights: tuple[float, float]  #: |z| of the two planes
    scale: float  #: Factor of the film window: below one where a plane other than infinity is drawn exactly


def slab_cameras(frustum: Frustum, settings: DoubleFrustum, *, orthoscopic: bool) -> list[SlabCamera]:
    """Return the cameras of C or of C*, innermost slab first (paper, section 4: splitting)."""
    cameras = []
    for low, high in settings.sections(frustum.reach[1 if orthoscopic else 0]):
        touches_plate = low == 0
        step = settings.near if touches_plate and settings.offset is Offset.PLATE else 0.0
        fitted = settings.fitted_height(frustum)
        cameras.append(
            SlabCamera(
                orthoscopic=orthoscopic,
                step=step,
                near=settings.near if touches_plate else low,
                far=step + high,
                heights=(low if step or not touches_plate else settings.near, high),
                # The window at the fitted height is that of the true frustum, seen from n farther away.
                scale=1.0 if fitted is None or not touches_plate else fitted / (fitted + step),
            )
        )
    return cameras


def clip_from_scene(
    frustum: Frustum, aperture: Aperture, camera: SlabCamera, pivot: Pivot, ends: ClipEnds
) -> Floats:
    """Return the matrix of one camera."""
    window = FilmWindow.of(frustum, aperture)
    projection = clip_from_eye(window, camera, ends)
    eye = eye_from_sheared(camera)
    stands_at = camera.step if camera.orthoscopic else -camera.step
    # The shear moves nothing in the plane of its pivot, which is the plate (paper, figure 6) or the
    # plane that the camera stands in.
    return (
        projection @ eye @ sheared_from_scene(window, aperture, 0.0 if pivot is Pivot.APERTURE else stands_at)
    )


def sheared_from_scene(window: FilmWindow, aperture: Aperture, fixed_height: float) -> Floats:
    """Return the shear about a plane z = fixed_height that straightens the frustum's axis (figure 6)."""
    matrix = np.eye(4)
    for row, (slope, origin) in enumerate(zip(window.axis, (aperture.x, aperture.y), strict=True)):
        matrix[row, 2] = -slope
        matrix[row, 3] = slope * fixed_height - origin
    return matrix


def eye_from_sheared(camera: SlabCamera) -> Floats:
    """Return the matrix to eye coordinates, in which the camera stands at the origin and looks to -z.

    Against C, the viewport of C* is flipped left-to-right and up-to-down (paper, section 3), because
    lines that cross at the aperture leave it on the other side of the axis. These two flips and the
    opposite direction of view are three mirrors, an odd number, which reverses window winding: faces
    turned to C* run clockwise.
    """
    matrix = np.eye(4) if camera.orthoscopic else np.diag([-1.0, -1.0, -1.0, 1.0])
    matrix[2, 3] = -camera.step
    return matrix


def clip_from_eye(window: FilmWindow, camera: SlabCamera, ends: ClipEnds) -> Floats:
    """Return the perspective projection of a camera that looks to -z; w is the distance from it."""
    near, far = camera.near, camera.far
    slope = (ends.far * far - ends.near * near) / (far - near)
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 1 / (window.half_width * camera.scale)
    matrix[1, 1] = 1 / (window.half_height * camera.scale)
    matrix[2, 2] = -slope
    matrix[2, 3] = near * (ends.near - slope)
    matrix[3, 2] = -1.0
    return matrix
