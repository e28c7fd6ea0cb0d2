"""Cameras for OpenGL: C and C* of an aperture, and the views of a plate by direction.

Matrices are named target-from-source and multiply column vectors. Matrices are computed in double
precision and rounded once, to the float32 of OpenGL.

**C and C*** (figures 4 to 6). C keeps the nearest surface, and its depth buffer is cleared to the
far value. C* keeps the farthest surface, and its buffer is cleared to the near value (paper,
section 3). Depth tests are strict: of two surfaces at equal depth, the surface drawn first stays.

**By direction**, one pixel of all hogels is drawn: the plate is the film, and an aperture is a
pixel. In a centered frustum, the lines of one pixel are parallel, and the camera is affine, with
depth linear in z. In a recentered frustum, the lines pass through a point of the screen: a
perspective camera is at this point. There is no near offset and no second camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from OpenGL import GL

from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import (
    Aperture,
    Camera,
    Cull,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    Offset,
    Pivot,
    PlateTile,
    Screen,
)

#: OpenGL constant of each depth buffer format
INTERNAL_FORMAT: dict[DepthFormat, int] = {
    DepthFormat.D16: GL.GL_DEPTH_COMPONENT16,
    DepthFormat.D24: GL.GL_DEPTH_COMPONENT24,
    DepthFormat.D32F: GL.GL_DEPTH_COMPONENT32F,
}


#: clip depth divided by w, at a camera's near plane and far plane
Ends = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """OpenGL state and shader expression of a depth mapping."""

    ends: Ends
    clip_control: int = GL.GL_ZERO_TO_ONE  #: Range of clip depth inside the frustum
    #: Expression for the shader's `FRAGMENT_DEPTH`; empty if the hardware interpolates depth
    fragment_depth: str = ""
    #: stored_near, stored_far: Values of the depth buffer at the near and at the far plane
    stored_near: float = 0.0
    stored_far: float = 1.0


_HYPERBOLIC = 0.0, 1.0

#: Clip depth of the reversed mapping. It is also used if fragments write depth: clip depth then
#: serves only for clipping. `_HYPERBOLIC` would be worse: f / (f - n) rounded to float32 clips some
#: surfaces in front of the far plane, or keeps some surfaces behind it.
_REVERSED = 1.0, 0.0


#: OpenGL state of each depth mapping
MAPPINGS = {
    DepthMapping.STANDARD: Mapping(ends=_HYPERBOLIC),
    DepthMapping.GL: Mapping(ends=(-1.0, 1.0), clip_control=GL.GL_NEGATIVE_ONE_TO_ONE),
    DepthMapping.REVERSED: Mapping(ends=_REVERSED, stored_near=1.0, stored_far=0.0),
    DepthMapping.LOGARITHMIC: Mapping(
        ends=_REVERSED, fragment_depth="log(w / near) / log(far / near)"
    ),
    DepthMapping.LINEAR: Mapping(ends=_REVERSED, fragment_depth="(w - near) / (far - near)"),
}


@dataclass(frozen=True, kw_only=True)
class FilmWindow:
    """Rectangle that an aperture's film spans at unit distance from the plate."""

    #: dx/dz and dy/dz of the frustum's axis; the shear shifts a plane by these slopes times its
    #: height
    axis: tuple[float, float]
    #: half_width, half_height: Half the film's extent per unit of distance
    half_width: float
    half_height: float

    @classmethod
    def from_frustum(cls, frustum: Frustum, aperture: Aperture) -> FilmWindow:
        """Return the window of fixed angles, or of the fixed screen seen from the aperture."""
        screen = frustum.screen
        if screen is None:
            assert frustum.fov is not None
            half_width, half_height = (math.tan(angle / 2) for angle in frustum.fov)
            return cls(axis=(0.0, 0.0), half_width=half_width, half_height=half_height)
        left, right = (
            screen.center[0] + side * screen.size[0] / 2 - aperture.x for side in (-1, 1)
        )
        bottom, top = (
            screen.center[1] + side * screen.size[1] / 2 - aperture.y for side in (-1, 1)
        )
        return cls(
            axis=((left + right) / 2 / screen.height, (bottom + top) / 2 / screen.height),
            half_width=abs((right - left) / 2 / screen.height),
            half_height=abs((top - bottom) / 2 / screen.height),
        )


@dataclass(frozen=True, kw_only=True)
class SlabCamera:
    """Position and depth range of one camera."""

    #: True for C, which looks away from the viewer; False for C*, which looks back
    orthoscopic: bool
    #: Distance of the camera from the plate, opposite to the camera's direction of view
    step: float
    #: near, far: Distances of the near and the far plane from the camera
    near: float
    far: float
    heights: tuple[float, float]  #: |z| of the two planes
    #: Factor of the film window: below one if a plane at finite height is fitted
    scale: float


def slab_cameras(
    frustum: Frustum, settings: DoubleFrustum, *, orthoscopic: bool
) -> list[SlabCamera]:
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
                # At the fitted height, the scaled window of the offset camera spans the true
                # frustum.
                scale=1.0 if fitted is None or not touches_plate else fitted / (fitted + step),
            )
        )
    return cameras


def clip_from_scene(
    frustum: Frustum, aperture: Aperture, camera: SlabCamera, pivot: Pivot, ends: Ends
) -> Floats:
    """Return the matrix of one camera."""
    window = FilmWindow.from_frustum(frustum, aperture)
    projection = clip_from_eye(window, camera, ends)
    eye = eye_from_sheared(camera)
    stands_at = camera.step if camera.orthoscopic else -camera.step
    # The shear leaves one plane fixed: the plate (paper, figure 6), or the plane of constant z
    # through the camera.
    return (
        projection
        @ eye
        @ sheared_from_scene(window, aperture, 0.0 if pivot is Pivot.APERTURE else stands_at)
    )


def sheared_from_scene(window: FilmWindow, aperture: Aperture, fixed_height: float) -> Floats:
    """Return the shear about z = fixed_height that straightens the frustum's axis (figure 6)."""
    matrix = np.eye(4)
    for row, (slope, origin) in enumerate(zip(window.axis, (aperture.x, aperture.y), strict=True)):
        matrix[row, 2] = -slope
        matrix[row, 3] = slope * fixed_height - origin
    return matrix


def eye_from_sheared(camera: SlabCamera) -> Floats:
    """Return the matrix to eye coordinates, with the camera at the origin looking to -z.

    Relative to C, the viewport of C* is flipped left-to-right and up-to-down (paper, section 3),
    because lines cross at the aperture: beyond it they are on the other side of the axis. These two
    flips and the opposite direction of view are three reflections. An odd number of reflections
    reverses window winding: faces turned to C* are clockwise.
    """
    matrix = np.eye(4) if camera.orthoscopic else np.diag([-1.0, -1.0, -1.0, 1.0])
    matrix[2, 3] = -camera.step
    return matrix


def clip_from_eye(window: FilmWindow, camera: SlabCamera, ends: Ends) -> Floats:
    """Return the perspective projection of a camera that looks to -z; clip w is -z."""
    near, far = camera.near, camera.far
    slope = (ends[1] * far - ends[0] * near) / (far - near)
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 1 / (window.half_width * camera.scale)
    matrix[1, 1] = 1 / (window.half_height * camera.scale)
    matrix[2, 2] = -slope
    matrix[2, 3] = near * (ends[0] - slope)
    matrix[3, 2] = -1.0
    return matrix


@dataclass(frozen=True, kw_only=True)
class Pass:
    """Camera and OpenGL state with which one pass of an image is drawn."""

    clip_from_scene: Floats  #: The camera's matrix, in double precision
    planes: tuple[float, float]  #: Distances of the near and far plane from the camera
    heights: tuple[float, float]  #: Lowest and highest z between these planes
    clear: float  #: Clear value of the depth buffer
    depth_function: str  #: Comparison of the depth test
    front_face: str  #: Window winding of faces that are turned to the camera
    #: Culled faces in OpenGL's terms: `back` faces are turned away from the camera, `front` faces
    #: toward it; None if all faces are drawn
    culled_face: str | None
    #: True for C, False for C*, whose image is pseudoscopic (paper, section 3, figure 3)
    orthoscopic: bool

    @property
    def line_of_pixel(self) -> Floats:
        """(3, 3) map of film points (u, v, 1), v up, to directions from the camera, scene axes."""
        return lines_of_pixels(self.clip_from_scene)


def lines_of_pixels(clip_from_scene: Floats) -> Floats:
    """Return maps (.., 3, 3) of film points (u, v, 1) to directions away from cameras (.., 4, 4).

    Clip x, y and w are zero at the camera's position. A point at depth w along a direction d has
    (x, y, w) = w (u, v, 1). Therefore the inverse of the 3 x 3 part of the matrix for x, y and w
    maps (u, v, 1) to d. An affine camera, with w = 1, has one direction (dx, dy, -1), along which
    clip x and y are constant.
    """
    rows = clip_from_scene[..., (0, 1, 3), :3]
    if rows[..., 2, :].any():
        return np.asarray(np.linalg.inv(rows), np.float64)
    rows[..., 2, 2] = -1.0
    return np.asarray(np.linalg.inv(rows) * (0.0, 0.0, 1.0), np.float64)


def drawing_order(
    scene: Scene,
    aperture: Aperture,
    settings: DoubleFrustum,
    effects: frozenset[Effect] = ALL_EFFECTS,
) -> list[Pass]:
    """Return the passes of an image from back to front.

    The slabs of C come first, from the outermost inward, then the slabs of C*, from the innermost
    outward. Slabs without triangles are left out. So are C and C* unless `effects` include them.
    """
    cameras = cameras_in_order(scene, settings, effects)
    return [pass_of(scene, aperture, settings, camera) for camera in cameras]


def cameras_in_order(
    scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] = ALL_EFFECTS
) -> list[SlabCamera]:
    """Return the cameras of an image from back to front; they are the same for all apertures."""
    frustum = scene.frustum
    c = slab_cameras(frustum, settings, orthoscopic=True)
    c_star = slab_cameras(frustum, settings, orthoscopic=False)
    chosen = {Camera.BOTH: [*reversed(c), *c_star], Camera.C: [*reversed(c)], Camera.C_STAR: c_star}
    cameras = [
        x
        for x in chosen[settings.camera]
        if (Effect.C if x.orthoscopic else Effect.C_STAR) in effects
    ]
    # Leave out slabs without triangles.
    lowest, highest = scene.height_ranges
    ranges = [(camera, *kept_heights(camera)) for camera in cameras]
    return [camera for camera, low, high in ranges if np.any((highest >= low) & (lowest <= high))]


def kept_heights(camera: SlabCamera) -> tuple[float, float]:
    """Return the lowest and highest z between a camera's near and far plane."""
    low, high = camera.heights
    return (-high, -low) if camera.orthoscopic else (low, high)


def pass_of(scene: Scene, aperture: Aperture, settings: DoubleFrustum, camera: SlabCamera) -> Pass:
    """Return the pass of one camera for an aperture."""
    mapping = MAPPINGS[settings.mapping]
    # Faces turned away from the viewer are culled. C* looks toward the viewer: for C* these are
    # front faces.
    away = "back" if camera.orthoscopic else "front"
    smaller_wins = camera.orthoscopic == (mapping.stored_near < mapping.stored_far)
    return Pass(
        clip_from_scene=clip_from_scene(
            scene.frustum, aperture, camera, settings.pivot, mapping.ends
        ),
        planes=(camera.near, camera.far),
        heights=kept_heights(camera),
        clear=mapping.stored_far if camera.orthoscopic else mapping.stored_near,
        depth_function="<" if smaller_wins else ">",
        front_face="ccw" if camera.orthoscopic else "cw",
        culled_face=None if settings.cull is Cull.NONE else away,
        orthoscopic=camera.orthoscopic,
    )


def window(tile: PlateTile) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return center and half extent of the cells of a tile's hogels, scene units."""
    center, half = [], []
    for hogels, size, side, cells in zip(
        tile.plate.hogels, tile.plate.size, (1, -1), (tile.columns, tile.rows), strict=True
    ):
        # Rows are numbered downward.
        ends = [side * (size * (end / hogels - 0.5)) for end in (cells.start, cells.stop)]
        center.append(sum(ends) / 2)
        half.append(abs(ends[1] - ends[0]) / 2)
    return (center[0], center[1]), (half[0], half[1])


def film_point(frustum_resolution: tuple[int, int], pixel: tuple[int, int]) -> tuple[float, float]:
    """Return u and v of a pixel (column, row) of a hogel."""
    (width, height), (column, row) = frustum_resolution, pixel
    return (2 * column + 1) / width - 1, 1 - (2 * row + 1) / height


def direction_pass(scene: Scene, tile: PlateTile, pixel: tuple[int, int]) -> Pass:
    """Return the camera of a pixel (column, row) of all hogels of a tile.

    Raises InputError if surfaces within the reach cross the screen or lie beyond it.
    """
    u, v = film_point(scene.frustum.resolution, pixel)
    screen = scene.frustum.screen
    if screen is not None:
        return _perspective(scene, tile, screen, (u, v))
    assert scene.frustum.fov is not None
    slopes = u * math.tan(scene.frustum.fov[0] / 2), v * math.tan(scene.frustum.fov[1] / 2)
    (x, y), (half_width, half_height) = window(tile)
    top, back = scene.frustum.reach
    matrix = np.array(
        [
            [1 / half_width, 0, slopes[0] / half_width, -x / half_width],
            [0, 1 / half_height, slopes[1] / half_height, -y / half_height],
            [0, 0, -1 / (top + back), top / (top + back)],
            [0, 0, 0, 1],
        ]
    )
    return _toward_the_back(matrix, (0.0, top + back), (-back, top))


def _toward_the_back(
    matrix: Floats, planes: tuple[float, float], heights: tuple[float, float]
) -> Pass:
    return Pass(
        clip_from_scene=matrix,
        planes=planes,
        heights=heights,
        clear=1.0,
        depth_function="<",
        front_face="ccw",
        culled_face=None,
        orthoscopic=True,
    )


def _perspective(scene: Scene, tile: PlateTile, screen: Screen, film: tuple[float, float]) -> Pass:
    """Return the camera at the point of the screen where a pixel's lines of all hogels meet."""
    lowest, highest = scene.bounds[0][2], scene.bounds[1][2]
    low, high = max(lowest, -scene.frustum.reach[1]), min(highest, scene.frustum.reach[0])
    before = screen.height > 0
    if high >= screen.height if before else low <= screen.height:
        raise InputError(
            f"surfaces between z = {low:.6g} and {high:.6g} reach the screen at z = "
            f"{screen.height:.6g}, in which a view by direction has its camera; "
            "draw the plate by hogels"
        )
    # A screen in front of the plate shows its image mirrored in both axes.
    side = -1 if before else 1
    at = [screen.center[k] + side * film[k] * screen.size[k] / 2 for k in range(2)]
    distance = abs(screen.height)
    center, half = window(tile)
    # w is the distance from the screen: zs - z for a screen in front of the plate, z - zs behind
    # it.
    sign = -1.0 if before else 1.0
    w = np.array([0.0, 0.0, sign, distance])
    rows = []
    for axis in range(2):
        across = np.zeros(4)
        across[axis], across[3] = distance, -distance * at[axis]
        rows.append((across + (at[axis] - center[axis]) * w) / half[axis])
    # The near plane is at the end of the reach, or slightly in front of the nearest surface: as far
    # from the camera as possible, because depth is hyperbolic here. The far plane is at the other
    # end of the reach.
    heights = (-scene.frustum.reach[1], scene.frustum.reach[0])
    first, last = reversed(heights) if before else heights
    surface = high if before else low
    near, far = distance + sign * surface, distance + sign * last
    if surface != first:
        near *= 1 - 2.0**-10
    depth = far / (far - near) * (w - np.array([0.0, 0.0, 0.0, near]))
    matrix = np.stack([*rows, depth, w])
    if before:
        return _toward_the_back(matrix, (near, far), heights)
    # This camera looks to the viewer, as C* does: the farthest surface wins.
    return Pass(
        clip_from_scene=matrix,
        planes=(near, far),
        heights=heights,
        clear=0.0,
        depth_function=">",
        front_face="cw",
        culled_face=None,
        orthoscopic=False,
    )
