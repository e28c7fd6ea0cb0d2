"""Model of a foreign renderer: conventions, geometry, and composition of its cameras.

The default of every field is its correct value. Parameters that tend to be wrong together form
a group. A new group needs a row in `GROUPS`, a field of the same name in `RendererModel`, an effect
on the lines in `RendererModel.bundle`, and a sentence in `reports.verification.words`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, StrEnum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation
from xfrustum.reference.lines import RayBundle, crossed_frustum, offset_camera, pixel_places
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, Fit, Frustum, Pivot

# Half of the resolution at which sampling points (0.1 px) and factors (0.1 %) are reported: smaller
# deviations are not reported as defects.
SMALLEST_SHIFT_PX, SMALLEST_FACTOR = 0.05, 5e-4

# Offsets of apertures and scenes are converted to pixels at this distance, a fraction of the reach,
# to decide whether they are large enough to be reported.
TOLD_APART_PER_REACH = 0.1


class Kind(Enum):
    """Kind of a parameter, which sets its unit and the step sizes of the search."""

    PIXELS = auto()  # a length on the film
    FACTOR = auto()  # a ratio about one
    SIZE = auto()  # a ratio of any magnitude
    OFFSET = auto()  # a length of the scene, of either sign
    SCREEN = auto()  # a length on the projection screen, of either sign
    NEAR = auto()  # a length of the scene, not negative, of any magnitude


Index = tuple[int, int]
RIGHT_AXES = "x, y, z"
COMPOSITION_FIELDS = ("front", "back", "overlaid", "culled", "conjugated", "normals")
"""Fields of `RendererModel` for the composition and lighting of the halves."""

OTHER_FIELDS = ("axes", "missing", "shows")
"""Fields of `RendererModel` for the scene and for single hogels."""

GROUPS: dict[str, tuple[str, Kind]] = {
    "shift": ("xy", Kind.PIXELS),
    "fov": ("xy", Kind.FACTOR),
    "pitch": ("xy", Kind.FACTOR),
    "near": ("", Kind.NEAR),
    "aperture-offset": ("xy", Kind.OFFSET),
    "scene-offset": ("xyz", Kind.OFFSET),
    "scene-scale": ("", Kind.SIZE),
    "screen-center": ("xy", Kind.SCREEN),
    "screen-height": ("", Kind.SIZE),
}
"""Axes and kind of each group of parameters, in the order of `RendererModel.parameters`."""

SCREEN_GROUPS = ("screen-center", "screen-height")  #: groups that exist only in recentered frusta
CAMERA_GROUPS = ("shift", "fov", "near")  #: groups that may be wrong in one camera only
NUMBERS = tuple(
    (name, axis, kind) for name, (axes, kind) in GROUPS.items() for axis in axes or ("",)
)
FAULT_NAMES = tuple(f"{name}-{axis}".removesuffix("-") for name, axis, _ in NUMBERS)
KINDS = tuple(kind for *_, kind in NUMBERS)

PREFERENCE = (
    *("shift", "screen-center", "fov", "screen-height", "near"),
    *("scene-offset", "aperture-offset", "pitch", "scene-scale"),
)
"""Order of preference among groups that explain images equally well."""


def field_of(group: str) -> str:
    """Return the name of a group's field of `RendererModel`."""
    return group.replace("-", "_")


def places(*groups: str) -> list[int]:
    """Return the indices in `RendererModel.parameters` of the parameters of some groups."""
    return [place for group in groups for place, (name, *_) in enumerate(NUMBERS) if name == group]


def screen_lengths(scene: Scene) -> Floats:
    """Return the lengths on the screen, (2,), of a shift by one pixel to the right, and down.

    On a screen in front of the plate the film is mirrored in both axes.
    """
    screen = scene.frustum.screen
    assert screen is not None
    behind = -np.sign(screen.height)
    return np.asarray(np.asarray(screen.size) / scene.frustum.resolution * behind * (1, -1))


@dataclass(frozen=True, eq=False)
class Table:
    """Step sizes and limits of the search for each parameter, (P,) each."""

    smallest: Floats  # smallest deviation from nominal that is reported
    scale: Floats  # scale of a small step of least squares
    step: Floats  # step of finite differences, small compared with reported deviations
    low: Floats
    high: Floats


def table(scene: Scene, values: Floats) -> Table:
    """Return the search table of a scene's parameters near values (P,)."""
    frustum, reach, inf = scene.frustum, scene.frustum.longest_reach, np.inf
    if frustum.screen is None:
        assert frustum.fov is not None
        width, on_screen = 2 * math.tan(frustum.fov[0] / 2), 1.0
    else:
        width = frustum.screen.size[0] / abs(frustum.screen.height)
        on_screen = frustum.screen.size[0] / frustum.resolution[0]
    px = TOLD_APART_PER_REACH * reach * width / frustum.resolution[0]
    smallest, screen_px = SMALLEST_SHIFT_PX * on_screen, 0.1 * on_screen

    def row(kind: Kind, value: float) -> tuple[float, ...]:
        near_scale, near_step = max(0.03 * value, 1e-6 * reach), max(1e-4 * value, 1e-9 * reach)
        return {
            Kind.PIXELS: (SMALLEST_SHIFT_PX, 0.1, 1e-4, -inf, inf),
            Kind.FACTOR: (SMALLEST_FACTOR, 1e-3, 1e-6, 0.01, inf),
            Kind.SIZE: (SMALLEST_FACTOR, 0.03 * value, 1e-6 * value, 1e-6, 1e6),
            Kind.OFFSET: (SMALLEST_SHIFT_PX * px, 1e-2 * reach, 1e-4 * px, -inf, inf),
            Kind.SCREEN: (smallest, screen_px, 1e-4 * on_screen, -inf, inf),
            Kind.NEAR: (0.0, near_scale, near_step, 0.0, 0.9 * reach),
        }[kind]

    return Table(*np.array([row(*pair) for pair in zip(KINDS, values.tolist(), strict=True)]).T)


def smallest_named(scene: Scene) -> Floats:
    """Return the smallest reported deviation of each parameter from its nominal value, (P,)."""
    return table(scene, np.ones(len(KINDS))).smallest


class Front(StrEnum):
    """Surface that wins on the viewer's side, drawn by C*; the farthest is correct."""

    FARTHEST = "farthest"
    NEAREST = "nearest"
    MISSING = "missing"


class Back(StrEnum):
    """Surface that wins behind the plate, drawn by C; the nearest is correct."""

    NEAREST = "nearest"
    FARTHEST = "farthest"
    MISSING = "missing"


class Culled(StrEnum):
    """Culled faces, by their winding order from the viewer's side."""

    NONE = "none"
    COUNTERCLOCKWISE = "counterclockwise"
    CLOCKWISE = "clockwise"


class Normals(StrEnum):
    """Normals by which triangles are shaded."""

    RIGHT = "right"
    FLAT = "flat"  # face normals in place of vertex normals
    INVERTED = "inverted"  # normals that point away from the viewer


class Recentering(StrEnum):
    """Shear of the cameras of a recentered frustum; a centered frustum has none."""

    # correct: both cameras have shear k; seen from the plate, they are sheared in opposite
    # directions (paper, figure 6)
    RIGHT = "right"
    NONE = "none"  # each aperture looks straight ahead, and the film keeps its extent
    C_STAR_REVERSED = "C*"  # C* has -k: it is sheared in the direction of C
    C_REVERSED = "C"  # C has -k: it is sheared in the direction of C*
    BOTH_REVERSED = "C and C*"  # C and C* have -k, as for a screen on the other side of the plate

    def factor(self, side: int) -> float:
        """Return the factor of the shear k of C (side 1 or 0) or of C* (side -1)."""
        if self is Recentering.NONE:
            return 0.0
        alone = Recentering.C_STAR_REVERSED if side < 0 else Recentering.C_REVERSED
        return -1.0 if self in (Recentering.BOTH_REVERSED, alone) else 1.0


@dataclass(frozen=True)
class OneCamera:
    """The only camera that deviates from nominal; its film may be mirrored along either axis."""

    # 1 for C, which draws surfaces behind the plate; -1 for C*, which draws surfaces before it
    side: int
    flip_x: bool = False
    flip_y: bool = False
    other_near: float = 0.0  # near offset of the other camera, scene units


FLIPPED = tuple(
    OneCamera(side, flip_x=x, flip_y=y)
    for side in (-1, 1)
    for x, y in ((True, True), (True, False), (False, True))
)
"""Single cameras with a mirrored film; the first is C* with a film turned by 180 degrees."""


class Film(StrEnum):
    """Spacing of pixels on a film: by equal tangents (correct), or by equal angles."""

    EVEN = "even"
    X = "x"  # equal angles along x, or y, or both
    Y = "y"
    XY = "xy"
    RADIUS = "radius"  # equal angles from the middle outward

    def bent(self, u: Floats, v: Floats, half: tuple[float, float]) -> tuple[Floats, Floats]:
        """Map positions -1 to 1 on this film to an even film; `half` are half-extents (slopes)."""
        (tx, ty), corner = half, math.hypot(*half)
        x, y = u * tx, v * ty
        if self in (Film.X, Film.XY):
            x = np.tan(u * math.atan(tx))
        if self in (Film.Y, Film.XY):
            y = np.tan(v * math.atan(ty))
        if self is Film.RADIUS:
            share = np.hypot(x, y) / corner
            factor = np.tan(share * math.atan(corner)) / np.maximum(share * corner, 1e-12)
            x, y = x * factor, y * factor
        return x / tx, y / ty

    def directions(self, bundle: RayBundle) -> Floats:
        """Return the direction (H, W, 3) of each pixel's line; see `RayBundle.directions`."""
        if self is Film.EVEN:
            return bundle.directions()
        u, v = np.meshgrid(*((2 * np.arange(count) + 1) / count - 1 for count in bundle.resolution))
        x, y = self.bent(u, -v, bundle.half_extent)
        (tx, ty), (kx, ky) = bundle.half_extent, bundle.shear
        return np.stack((kx + x * tx, ky + y * ty, np.full_like(x, -1.0)), axis=-1)


EVEN = Film.EVEN


@dataclass(frozen=True, kw_only=True)
class RendererModel:
    """Model of the renderer of a plate; lengths in scene units, pairs and triples along x, y, z."""

    #: transforms that turn stored images upright, and put apertures in order
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    #: sampling point in an upright image, px to the right and down from the pixel's center
    shift: tuple[float, float] = (0.0, 0.0)
    #: half-extents of the film, and aperture spacing, as ratios to the scene's, > 0
    fov: tuple[float, float] = (1.0, 1.0)
    pitch: tuple[float, float] = (1.0, 1.0)
    #: offset of both cameras, >= 0; 0 for cameras in the aperture itself
    near: float = 0.0
    #: offset of all apertures; a scene point p is drawn at scene_scale p + scene_offset
    aperture_offset: tuple[float, float] = (0.0, 0.0)
    scene_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene_scale: float = 1.0
    #: offset of the projection screen's center, and ratio of its height to the scene's; a screen at
    #: another height keeps its size. A centered frustum has no screen and no shear.
    screen_center: tuple[float, float] = (0.0, 0.0)
    screen_height: float = 1.0
    recentering: Recentering = Recentering.RIGHT
    #: as in `DoubleFrustum`; without effect at near 0
    pivot: Pivot = Pivot.APERTURE
    fit: Fit = Fit.ANGLE
    #: composition of the halves: winning surface of each half, whether the viewer's half is drawn
    #: over the other, culled faces
    front: Front = Front.FARTHEST
    overlaid: bool = True
    culled: Culled = Culled.NONE
    back: Back = Back.NEAREST
    #: the only camera to which shift, fov and near apply; None if they apply to both cameras
    one_camera: OneCamera | None = None
    #: whether the lights of the viewer's half are conjugated
    conjugated: bool = True
    normals: Normals = Normals.RIGHT
    #: axes drawn in place of x, y and z (`pictures.drawn_scene`)
    axes: str = RIGHT_AXES
    #: numbers of the objects that are not drawn
    missing: tuple[int, ...] = ()
    #: hogels, named as in the files, with the apertures that they may show: the assumed aperture
    #: first, then apertures with the same image
    shows: tuple[tuple[Index, tuple[Index, ...]], ...] = ()
    film: Film = EVEN
    #: largest drawn distances before and behind the plate; None for the scene's reach
    reach: tuple[float, float] | None = None

    @property
    def plain(self) -> bool:
        """True if all faces are drawn, and the right surface wins in and between the halves."""
        first = self.back is Back.NEAREST and self.front is Front.FARTHEST
        return first and self.culled is Culled.NONE and self.overlaid

    @property
    def one_pencil(self) -> bool:
        """True if C and C* have the same lines: both in the aperture, with equal film and shear."""
        if self.near or self.one_camera is not None:
            return False
        return self.recentering.factor(1) == self.recentering.factor(-1)

    def camera(self, side: int) -> RendererModel:
        """Return the model with the shift, fov and near of C (side 1 or 0) or of C* (side -1)."""
        entry = self.one_camera
        if entry is None or entry.side == side:
            return self
        return replace(
            self, shift=(0.0, 0.0), fov=(1.0, 1.0), near=entry.other_near, one_camera=None
        )

    @property
    def parameters(self) -> Floats:
        """All parameters as one vector (P,), in the order of `FAULT_NAMES`."""
        return np.concatenate([np.ravel(getattr(self, field_of(group))) for group in GROUPS])

    def with_parameters(self, values: Floats) -> RendererModel:
        """Return the model with other parameters (P,)."""
        numbers = {field_of(group): tuple(map(float, values[places(group)])) for group in GROUPS}
        fields = {name: some if len(some) > 1 else some[0] for name, some in numbers.items()}
        return replace(self, **fields)  # type: ignore[arg-type]

    @property
    def plate_height(self) -> float:
        """Height z of the plate in scene coordinates, before scaling and offset."""
        return -self.scene_offset[2] / self.scene_scale

    def answers(self, scene: Scene, aperture: Aperture) -> Aperture:
        """Return the scene's aperture whose image is in the file of `aperture`."""
        ordered = self.order.index(aperture.index, scene.plate.hogels)
        return scene.plate.aperture(*dict(self.shows).get(aperture.index, (ordered,))[0])

    def upright(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return a stored picture (H, W, ..) in upright orientation."""
        return self.orientation.upright(picture)

    def placed(self, aperture: Aperture) -> Aperture:
        """Return an aperture at its position in this model."""
        (px, py), (ox, oy) = self.pitch, self.aperture_offset
        return replace(aperture, x=aperture.x * px + ox, y=aperture.y * py + oy)

    def frustum(self, scene: Scene) -> Frustum:
        """Return the scene's frustum with the projection screen of this model."""
        screen, (x, y) = scene.frustum.screen, self.screen_center
        if screen is None or (x, y, self.screen_height) == (0.0, 0.0, 1.0):
            return scene.frustum
        center = screen.center[0] + x, screen.center[1] + y
        moved = replace(screen, height=screen.height * self.screen_height, center=center)
        return replace(scene.frustum, screen=moved)

    def bundle(self, scene: Scene, aperture: Aperture, side: int) -> RayBundle:
        """Return the lines of C (side 1), C* (side -1), or of both if shared (side 0).

        The lines are in coordinates of the nominal scene: if a renderer moves or enlarges the
        scene, the model moves and shrinks the cameras instead. The half-extents of a mirrored film
        are negative.
        """
        camera, frustum = self.camera(side), self.frustum(scene)
        crossed = crossed_frustum(frustum, self.placed(aperture))
        factor, entry = self.recentering.factor(side), camera.one_camera
        near = camera.near if side else 0.0
        (kx, ky), (tx, ty), fov = crossed.shear, crossed.half_extent, camera.fov
        tx, ty = tx * fov[0], ty * fov[1]
        if entry is not None:
            tx, ty = -tx if entry.flip_x else tx, -ty if entry.flip_y else ty
        crossed = replace(crossed, shear=(kx * factor, ky * factor), half_extent=(tx, ty))
        fitted = abs(frustum.screen.height) if self.fit is Fit.SCREEN and frustum.screen else None
        drawn = offset_camera(crossed, side * near, pivot=self.pivot, fitted=fitted)
        viewer, back = self.reach or frustum.reach
        first = near if side > 0 else -near - viewer
        last = -near if side < 0 else near + back
        # A shifted sampling point is a shear of the film: u grows to the right, v up.
        (width, height), (right, down) = frustum.resolution, camera.shift
        (kx, ky), (tx, ty) = drawn.shear, drawn.half_extent
        x, y, z = (
            (place - moved) / self.scene_scale
            for place, moved in zip(drawn.center, self.scene_offset, strict=True)
        )
        return replace(
            drawn,
            center=(x, y, z),
            shear=(kx + 2 * right / width * tx, ky + -2 * down / height * ty),
            s_range=(first / self.scene_scale, last / self.scene_scale),
        )

    def project(self, scene: Scene, aperture: Aperture, points: Floats) -> Floats:
        """Return column and row (.., 2) of drawn surface points; NaN in the plate's plane.

        NaN everywhere on an uneven film, for which only the inverse mapping is implemented.
        """
        result = np.full((*points.shape[:-1], 2), np.nan)
        if self.film != EVEN:
            return result
        plate = self.plate_height
        for side, here in ((1, points[..., 2] < plate), (-1, points[..., 2] > plate)):
            result[here] = pixel_places(points[here], self.bundle(scene, aperture, side))
        return result


def unflipped(bundle: RayBundle) -> RayBundle:
    """Return the same lines on a film that is not mirrored, with pixels in another order."""
    tx, ty = bundle.half_extent
    return replace(bundle, half_extent=(abs(tx), abs(ty)))
