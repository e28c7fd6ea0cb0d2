"""A model of how somebody drew a plate: conventions, geometry, and which camera wins where.

Every quantity has the value at which nothing is wrong as its default. The lines of a model's cameras are made
by `xfrustum.reference.lines.lines`, with the model's numbers in place of the scene's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from xfrustum.compare.renderer_model import parameters
from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation
from xfrustum.reference.lines.lines import Pencil, crossed_frustum, pixel_places, stepped_back
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Fit, Pivot
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture


class Front(StrEnum):
    """What became of the half on the viewer's side, which C* draws: the farthest surface must win."""

    FARTHEST = "farthest"
    NEAREST = "nearest"
    MISSING = "missing"


class Culled(StrEnum):
    """Which faces are left out: those whose corners run around in this sense along the lines of the pencil.

    Both cameras of a crossed frustum look along the same lines in one direction, from the viewer's side to
    the back.
    """

    NONE = "none"
    COUNTERCLOCKWISE = "counterclockwise"
    CLOCKWISE = "clockwise"


class Recentering(StrEnum):
    """How the cameras of a recentered frustum are sheared; a centered frustum has no shear."""

    RIGHT = "right"  # in opposite directions with respect to the plate (paper, figure 6): both have shear k
    NONE = "none"  # each aperture looks straight ahead, and the film keeps its extent
    C_STAR_REVERSED = "C*"  # C* has -k: it is sheared the way of C
    C_REVERSED = "C"  # C has -k: it is sheared the way of C*
    BOTH_REVERSED = "C and C*"  # both have -k, as for a screen on the other side of the plate

    def factor(self, side: int) -> float:
        """Return the factor of the shear k of C (side 1 or 0) or of C* (side -1)."""
        if self is Recentering.NONE:
            return 0.0
        alone = Recentering.C_STAR_REVERSED if side < 0 else Recentering.C_REVERSED
        return -1.0 if self in (Recentering.BOTH_REVERSED, alone) else 1.0


@dataclass(frozen=True)
class OneCamera:
    """The camera that alone draws otherwise than asked; it may be mirrored left to right and upside down."""

    side: int  # 1 for C, which draws what lies behind the plate; -1 for C*, which draws what lies before it
    flip_x: bool = False
    flip_y: bool = False
    other_near: float = 0.0  # near offset of the other camera, scene units


FLIPPED = tuple(
    OneCamera(side, flip_x=x, flip_y=y)
    for side in (-1, 1)
    for x, y in ((True, True), (True, False), (False, True))
)
"""Cameras whose film alone is mirrored; C* that is not turned by 180 degrees comes first."""


@dataclass(frozen=True, kw_only=True)
class DrawnModel:
    """How a plate was drawn. Lengths are in scene units, pairs and triples along x, y and z."""

    # What brings its images upright, and its apertures in order.
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    # Where in an upright image's pixels it samples: px to the right and down from the pixel's center.
    shift: tuple[float, float] = (0.0, 0.0)
    # Half-extents of its film, and distances between its apertures, over those of the scene.
    fov: tuple[float, float] = (1.0, 1.0)
    pitch: tuple[float, float] = (1.0, 1.0)
    # Offset of both cameras; 0 for cameras in the aperture itself.
    near: float = 0.0
    # By how much all apertures are moved; a point p of the scene is drawn where scale p + offset belongs.
    aperture_offset: tuple[float, float] = (0.0, 0.0)
    scene_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene_scale: float = 1.0
    # By how much the projection screen's center is moved, and its height over that of the scene's; a screen
    # at another height keeps its size. They and the shear mean nothing for a centered frustum.
    screen_center: tuple[float, float] = (0.0, 0.0)
    screen_height: float = 1.0
    recentering: Recentering = Recentering.RIGHT
    # As in the design; they mean nothing at near 0.
    pivot: Pivot = Pivot.APERTURE
    fit: Fit = Fit.ANGLE
    # How the halves are put together: whether the viewer's covers the other, and what is left out.
    front: Front = Front.FARTHEST
    overlaid: bool = True
    culled: Culled = Culled.NONE
    back_missing: bool = False
    # The camera to which alone shift, fov and near apply; None where they apply to both.
    one_camera: OneCamera | None = None
    # Whether the lights of the viewer's half are conjugated.
    conjugated: bool = True

    @property
    def plain(self) -> bool:
        """Whether all faces are drawn, and the farthest surface of the viewer's half wins over the other."""
        whole = not self.back_missing and self.culled is Culled.NONE
        return whole and self.front is Front.FARTHEST and self.overlaid

    @property
    def one_pencil(self) -> bool:
        """Whether C and C* share their lines: both stand in the aperture, with the same film and shear."""
        if self.near or self.one_camera is not None:
            return False
        return self.recentering.factor(1) == self.recentering.factor(-1)

    @property
    def alone(self) -> bool:
        """Whether one camera alone has other numbers, its film being mirrored nowhere."""
        one = self.one_camera
        return one is not None and not (one.flip_x or one.flip_y)

    def camera(self, side: int) -> DrawnModel:
        """Return the model whose shift, fov and near are those of C (side 1 or 0) or of C* (side -1)."""
        one = self.one_camera
        if one is None or one.side == side:
            return self
        return replace(self, shift=(0.0, 0.0), fov=(1.0, 1.0), near=one.other_near, one_camera=None)

    @property
    def parameters(self) -> Floats:
        """All numbers as one vector (P,), in the order of `parameters.FAULT_NAMES`."""
        return np.concatenate([np.ravel(getattr(self, group.field)) for group in parameters.GROUPS])

    @property
    def plate_height(self) -> float:
        """Where along z the plate lies in the scene's own coordinates, before it is moved."""
        return -self.scene_offset[2] / self.scene_scale

    def with_parameters(self, values: Floats) -> DrawnModel:
        """Return the same guess with other numbers, in the order of `parameters`."""
        fields: dict[str, float | tuple[float, ...]] = {}
        for group in parameters.GROUPS:
            numbers = tuple(float(values[place]) for place in parameters.places(group.name))
            fields[group.field] = numbers if len(numbers) > 1 else numbers[0]
        return replace(self, **fields)  # type: ignore[arg-type]

    def answers(self, scene: Scene, aperture: Aperture) -> Aperture:
        """Return the aperture of the scene that a file named after one aperture shows."""
        return scene.plate.aperture(*self.order.index(aperture.index, scene.plate.hogels))

    def placed(self, aperture: Aperture) -> Aperture:
        """Return an aperture where the guess has it."""
        x, y = np.multiply((aperture.x, aperture.y), self.pitch) + self.aperture_offset
        return replace(aperture, x=float(x), y=float(y))

    def frustum(self, scene: Scene) -> Frustum:
        """Return the scene's frustum with the projection screen where the guess has it."""
        screen, (x, y) = scene.frustum.screen, self.screen_center
        if screen is None or (x, y, self.screen_height) == (0.0, 0.0, 1.0):
            return scene.frustum
        center, height = (screen.center[0] + x, screen.center[1] + y), screen.height * self.screen_height
        return replace(scene.frustum, screen=replace(screen, height=height, center=center))

    def pencil(self, scene: Scene, aperture: Aperture, side: int) -> Pencil:
        """Return the lines of C (side 1), of C* (side -1), or of both where they share them (side 0).

        They are lines of the scene as it was asked for: where a renderer has moved it or made it larger,
        the cameras are moved and made smaller instead. The half-extents of a mirrored film are negative.
        """
        camera, frustum = self.camera(side), self.frustum(scene)
        crossed = crossed_frustum(frustum, self.placed(aperture))
        factor, one, near = self.recentering.factor(side), camera.one_camera, camera.near
        signs = (-1.0 if one and one.flip_x else 1.0, -1.0 if one and one.flip_y else 1.0)
        crossed = replace(
            crossed,
            shear=_products(crossed.shear, (factor, factor)),
            half_extent=_products(_products(crossed.half_extent, camera.fov), signs),
        )
        fitted = abs(frustum.screen.height) if self.fit is Fit.SCREEN and frustum.screen else None
        drawn = stepped_back(crossed, side * near, pivot=self.pivot, fitted=fitted)
        viewer, back = frustum.reach
        first, last = {1: (near, near + back), -1: (-near - viewer, -near), 0: (-viewer, back)}[side]
        # A shifted sampling point is a shear of the film: u grows to the right, v up.
        (width, height), shift = frustum.resolution, camera.shift
        sheared = _products((2 * shift[0] / width, -2 * shift[1] / height), drawn.half_extent)
        x, y, z = (
            (place - moved) / self.scene_scale
            for place, moved in zip(drawn.center, self.scene_offset, strict=True)
        )
        return replace(
            drawn,
            center=(x, y, z),
            shear=(drawn.shear[0] + sheared[0], drawn.shear[1] + sheared[1]),
            s_range=(first / self.scene_scale, last / self.scene_scale),
        )

    def project(self, scene: Scene, aperture: Aperture, points: Floats) -> Floats:
        """Return column and row (.., 2) where surface points are drawn; NaN in the plane of the plate."""
        found = np.full((*points.shape[:-1], 2), np.nan)
        plate = self.plate_height
        for side, here in ((1, points[..., 2] < plate), (-1, points[..., 2] > plate)):
            found[here] = pixel_places(points[here], self.pencil(scene, aperture, side))
        return found


def unflipped(pencil: Pencil) -> Pencil:
    """Return the same lines on a film that is not mirrored: its pixels are in another order."""
    tx, ty = pencil.half_extent
    return replace(pencil, half_extent=(abs(tx), abs(ty)))


def _products(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return one[0] * other[0], one[1] * other[1]
