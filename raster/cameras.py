"""Clip coordinates from scene coordinates, for C and for C* (paper, sections 4 and 5, figures 4 to 6).

Matrices are named target-from-source and multiply column vectors. They are made in double
precision and rounded once, to the float32 that OpenGL computes with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.depth_formats import ENDS
from xfrustum.scenes.double_frustum import DepthMapping, DoubleFrustum
from xfrustum.scenes.frustum import Frustum
from xfrustum.scenes.plate import Aperture

Matrix = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FilmWindow:
    """What an aperture's film spans at unit distance from the plate.

    Attributes
    ----------
    axis
        dx/dz and dy/dz of the frustum's axis: how far the shear moves a plane per unit of height.
    half_width, half_height
        Half the film's extent per unit of distance.
    """

    axis: tuple[float, float]
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


def sheared_from_scene(window: FilmWindow, aperture: Aperture) -> Matrix:
    """Return the shear about the aperture plane that straightens the frustum's axis (figure 6)."""
    matrix = np.eye(4)
    matrix[0, 2], matrix[1, 2] = -window.axis[0], -window.axis[1]
    matrix[0, 3], matrix[1, 3] = -aperture.x, -aperture.y
    return matrix


def clip_from_eye(window: FilmWindow, near: float, far: float, mapping: DepthMapping) -> Matrix:
    """Return the perspective projection of a camera that looks to -z; clip depth runs 0..1.

    w is the distance from the camera; depth is `ENDS[mapping].near` at `near`, `.far` at `far`.
    """
    ends = ENDS[mapping]
    slope = (ends.far * far - ends.near * near) / (far - near)
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 1 / window.half_width
    matrix[1, 1] = 1 / window.half_height
    matrix[2, 2] = -slope
    matrix[2, 3] = near * (ends.near - slope)
    matrix[3, 2] = -1.0
    return matrix


def orthoscopic(frustum: Frustum, aperture: Aperture, settings: DoubleFrustum) -> Matrix:
    """Return clip-from-scene of C: n in front of the plate, looking away from the viewer."""
    window = FilmWindow.of(frustum, aperture)
    eye_from_sheared = np.eye(4)
    eye_from_sheared[2, 3] = -settings.near
    far = settings.near + frustum.reach[1]
    projection = clip_from_eye(window, settings.near, far, settings.mapping)
    return projection @ eye_from_sheared @ sheared_from_scene(window, aperture)


def pseudoscopic(frustum: Frustum, aperture: Aperture, settings: DoubleFrustum) -> Matrix:
    """Return clip-from-scene of C*: n behind the plate, looking back at the viewer.

    Against C, the viewport is flipped left-to-right and up-to-down (paper, section 3): lines that
    cross at the aperture come out on the other side of the axis. With the view turned around
    that makes an odd number of mirrors, so that window winding is reversed: faces turned to C*
    run clockwise.
    """
    window = FilmWindow.of(frustum, aperture)
    eye_from_sheared = np.diag([-1.0, -1.0, -1.0, 1.0])
    eye_from_sheared[2, 3] = -settings.near
    far = settings.near + frustum.reach[0]
    projection = clip_from_eye(window, settings.near, far, settings.mapping)
    return projection @ eye_from_sheared @ sheared_from_scene(window, aperture)
