"""The passes of an image: its cameras in drawing order, and how OpenGL is set for each."""

from dataclasses import dataclass

import numpy as np

from xfrustum.raster.cameras.cameras import SlabCamera, clip_from_scene, slab_cameras
from xfrustum.raster.cameras.depth_formats import MAPPINGS, DepthTest, farthest_wins, nearest_wins
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One camera's share of an image."""

    clip_from_scene: Floats  #: The camera's matrix, in double precision
    planes: tuple[float, float]  #: Distances of its near and far plane
    heights: tuple[float, float]  #: Lowest and highest z between these planes
    test: DepthTest  #: The depth test, which decides between two surfaces
    front_face: str  #: The window winding of faces that are turned to the camera
    #: The faces that are left out, as OpenGL names them: `back` are turned away from the camera, `front`
    #: toward it; None where all are drawn
    culled_face: str | None
    orthoscopic: bool  #: True for C, False for C*, whose lights are pseudoscopic (paper, section 3, figure 3)

    @property
    def line_of_pixel(self) -> Floats:
        """(3, 3) direction away from the camera, scene axes, of film coordinates (u, v, 1) upward."""
        return lines_of_pixels(self.clip_from_scene)


def lines_of_pixels(clip_from_scene: Floats) -> Floats:
    """Return (.., 3, 3) directions away from cameras (.., 4, 4), scene axes, of film points (u, v, 1) upward.

    Clip x, y and w are zero at the camera's position, and a point at depth w along a direction d from it has
    (x, y, w) = w (u, v, 1): the inverse of the matrix's 3 x 3 part for x, y and w takes (u, v, 1) to d.
    """
    return np.asarray(np.linalg.inv(clip_from_scene[..., (0, 1, 3), :3]), np.float64)


def drawing_order(
    scene: Scene, aperture: Aperture, settings: DoubleFrustum, effects: frozenset[Effect] = ALL_EFFECTS
) -> list[Pass]:
    """Return the passes of an image, from the back: each is nearer to the viewer than those before it.

    The slabs of C come first, from the outermost inward, then those of C*, from the innermost outward. Slabs
    in which the scene has nothing are left out, and so are cameras that are not among the effects.
    """
    cameras = cameras_in_order(scene, settings, effects)
    return [pass_of(scene, aperture, settings, camera) for camera in cameras]


def cameras_in_order(
    scene: Scene, settings: DoubleFrustum, effects: frozenset[Effect] = ALL_EFFECTS
) -> list[SlabCamera]:
    """Return the cameras of every image, from the back; they are the same for all apertures of the plate."""
    frustum = scene.frustum
    c = slab_cameras(frustum, settings, orthoscopic=True)
    c_star = slab_cameras(frustum, settings, orthoscopic=False)
    chosen = {Camera.BOTH: [*reversed(c), *c_star], Camera.C: [*reversed(c)], Camera.C_STAR: c_star}
    cameras = [
        x for x in chosen[settings.camera] if (Effect.C if x.orthoscopic else Effect.C_STAR) in effects
    ]
    # Slabs that no triangle reaches into are left out.
    lowest, highest = scene.height_ranges
    ranges = [(camera, *kept_heights(camera)) for camera in cameras]
    return [camera for camera, low, high in ranges if np.any((highest >= low) & (lowest <= high))]


def kept_heights(camera: SlabCamera) -> tuple[float, float]:
    """Return the lowest and highest z between a camera's near and far plane."""
    low, high = camera.heights
    return (-high, -low) if camera.orthoscopic else (low, high)


def pass_of(scene: Scene, aperture: Aperture, settings: DoubleFrustum, camera: SlabCamera) -> Pass:
    """Return one camera's share of an aperture's image."""
    mapping = MAPPINGS[settings.mapping]
    # Faces that are turned away from the viewer are left out; C* faces him.
    away = "back" if camera.orthoscopic else "front"
    return Pass(
        clip_from_scene=clip_from_scene(scene.frustum, aperture, camera, settings.pivot, mapping.ends),
        planes=(camera.near, camera.far),
        heights=kept_heights(camera),
        test=nearest_wins(mapping) if camera.orthoscopic else farthest_wins(mapping),
        front_face="ccw" if camera.orthoscopic else "cw",
        culled_face=None if settings.cull is Cull.NONE else away,
        orthoscopic=camera.orthoscopic,
    )
