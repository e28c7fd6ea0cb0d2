"""A guess at how somebody drew a plate: conventions, geometry, and which camera wins where.

Every quantity has the value at which nothing is wrong as its default. What a guess says about lines is
what `xfrustum.reference.lines` says, with the guessed numbers in place of the scene's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.orientations import UPRIGHT, Orientation
from xfrustum.reference.lines import Pencil, film_window
from xfrustum.scenes.double_frustum import Fit, Pivot
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene

Floats = NDArray[np.float64]


class Front(StrEnum):
    """What became of the half on the viewer's side, which C* draws."""

    FARTHEST = "farthest"
    """The farthest surface wins, as it must."""
    NEAREST = "nearest"
    MISSING = "missing"


@dataclass(frozen=True, kw_only=True)
class DrawnModel:
    """How a plate was drawn.

    Attributes
    ----------
    orientation, order
        What brings its images upright, and its apertures in order.
    shift
        Where in an upright image's pixels it samples: columns to the right and rows down from the
        pixel's center, in pixels.
    fov
        Half-extents of its film over those of the scene, in x and y.
    pitch
        Distances between its apertures over those of the scene, in x and y.
    near
        Offset of both cameras in scene units; 0 for cameras in the aperture itself.
    pivot, fit
        As in the design; they mean nothing at near 0.
    front, overlaid
        What became of the viewer's half, and whether it covers the other.
    """

    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    shift: tuple[float, float] = (0.0, 0.0)
    fov: tuple[float, float] = (1.0, 1.0)
    pitch: tuple[float, float] = (1.0, 1.0)
    near: float = 0.0
    pivot: Pivot = Pivot.APERTURE
    fit: Fit = Fit.ANGLE
    front: Front = Front.FARTHEST
    overlaid: bool = True

    @property
    def plain(self) -> bool:
        """Whether the viewer's half wins as it must: the farthest surface, over the other half."""
        return self.front is Front.FARTHEST and self.overlaid

    @property
    def parameters(self) -> Floats:
        """Shift, fov, pitch and near as one vector (7,)."""
        return np.array([*self.shift, *self.fov, *self.pitch, self.near])

    def with_parameters(self, values: Floats) -> DrawnModel:
        """Return the same guess with other numbers, in the order of `parameters`."""
        x, y, fov_x, fov_y, pitch_x, pitch_y, near = (float(value) for value in values)
        return replace(self, shift=(x, y), fov=(fov_x, fov_y), pitch=(pitch_x, pitch_y), near=near)

    def answers(self, scene: Scene, aperture: Aperture) -> Aperture:
        """Return the aperture of the scene that a file named after one aperture shows."""
        return scene.plate.aperture(*self.order.index(aperture.index, scene.plate.hogels))

    def placed(self, aperture: Aperture) -> Aperture:
        """Return an aperture where the guess has it."""
        return replace(aperture, x=aperture.x * self.pitch[0], y=aperture.y * self.pitch[1])

    def pencil(self, scene: Scene, aperture: Aperture, side: int) -> Pencil:
        """Return the lines of C (side 1), of C* (side -1), or of both where near is 0 (side 0)."""
        frustum, there = scene.frustum, self.placed(aperture)
        shear, half = film_window(frustum, there)
        step = 0.0 if side == 0 else side * self.near
        aside = step if self.pivot is Pivot.APERTURE else 0.0
        fit = 1.0
        if self.fit is Fit.SCREEN and frustum.screen is not None:
            fit = abs(frustum.screen.height) / (abs(frustum.screen.height) + self.near)
        half = (half[0] * self.fov[0] * fit, half[1] * self.fov[1] * fit)
        width, height = frustum.resolution
        # A shifted sampling point is a shear of the film: u grows to the right, v up.
        sampled = (
            shear[0] + 2 * self.shift[0] / width * half[0],
            shear[1] - 2 * self.shift[1] / height * half[1],
        )
        viewer, back = frustum.reach
        ranges = {
            1: (self.near, self.near + back),
            -1: (-self.near - viewer, -self.near),
            0: (-viewer, back),
        }
        return Pencil(
            center=(there.x - aside * shear[0], there.y - aside * shear[1], step),
            shear=sampled,
            half_extent=half,
            resolution=frustum.resolution,
            s_range=ranges[side],
        )

    def project(self, scene: Scene, aperture: Aperture, points: Floats) -> Floats:
        """Return column and row (.., 2) where surface points are drawn; NaN in the plane of the plate."""
        found = np.full((*points.shape[:-1], 2), np.nan)
        for side, here in ((1, points[..., 2] < 0), (-1, points[..., 2] > 0)):
            pencil = self.pencil(scene, aperture, side)
            relative = points[here] - np.asarray(pencil.center)
            film = (relative[:, :2] / -relative[:, 2:] - np.asarray(pencil.shear)) / pencil.half_extent
            width, height = pencil.resolution
            found[here] = (film * (1, -1) + 1) * (width / 2, height / 2) - 0.5
        return found
