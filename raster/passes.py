"""Which cameras draw, in which order, and how OpenGL is set for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.raster.cameras import Matrix, SlabCamera, clip_from_scene, slab_cameras
from xfrustum.raster.depth_formats import MAPPINGS, DepthTest, farthest_wins, nearest_wins
from xfrustum.scenes.double_frustum import Camera, DoubleFrustum
from xfrustum.scenes.light import DEFAULT_LIGHT
from xfrustum.scenes.plate import Aperture
from xfrustum.scenes.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Pass:
    """One camera's share of an image.

    Attributes
    ----------
    clip_from_scene
        Its matrix, in double precision.
    planes
        Distances of its near and far plane.
    heights
        Lowest and highest z between them.
    test
        Which of two surfaces wins.
    front_face
        Which window winding faces the camera.
    light
        Toward the light: L for C, the pseudoscopic L* for C* (paper, section 3, figure 3).
    """

    clip_from_scene: Matrix
    planes: tuple[float, float]
    heights: tuple[float, float]
    test: DepthTest
    front_face: str
    light: tuple[float, float, float]


def drawing_order(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> list[Pass]:
    """Return the passes of an image, from the back.

    C from its outermost slab inward, then C* from its innermost outward: what comes later is nearer
    to the viewer and overlays. Slabs in which the scene has nothing are left out.
    """
    return [pass_of(scene, aperture, settings, camera) for camera in cameras_in_order(scene, settings)]


def cameras_in_order(scene: Scene, settings: DoubleFrustum) -> list[SlabCamera]:
    """Return the cameras of every image, from the back: what belongs to the plate and to no aperture."""
    frustum = scene.frustum
    c = slab_cameras(frustum, settings, orthoscopic=True)
    c_star = slab_cameras(frustum, settings, orthoscopic=False)
    chosen = {Camera.BOTH: [*reversed(c), *c_star], Camera.C: [*reversed(c)], Camera.C_STAR: c_star}
    return [camera for camera in chosen[settings.camera] if _occupied(scene, kept_heights(camera))]


def kept_heights(camera: SlabCamera) -> tuple[float, float]:
    """Return the lowest and highest z between a camera's near and far plane."""
    low, high = camera.heights
    return (-high, -low) if camera.orthoscopic else (low, high)


def pass_of(scene: Scene, aperture: Aperture, settings: DoubleFrustum, camera: SlabCamera) -> Pass:
    """Return one camera's share of an aperture's image."""
    mapping = MAPPINGS[settings.mapping]
    x, y, z = DEFAULT_LIGHT.direction
    return Pass(
        clip_from_scene=clip_from_scene(scene.frustum, aperture, camera, settings.pivot, mapping.ends),
        planes=(camera.near, camera.far),
        heights=kept_heights(camera),
        test=nearest_wins(mapping) if camera.orthoscopic else farthest_wins(mapping),
        front_face="ccw" if camera.orthoscopic else "cw",
        light=(x, y, z) if camera.orthoscopic else (-x, -y, -z),
    )


def _occupied(scene: Scene, heights: tuple[float, float]) -> bool:
    """Return whether some triangle reaches between two heights."""
    lowest, highest = scene.height_ranges
    return bool(np.any((highest >= heights[0]) & (lowest <= heights[1])))
