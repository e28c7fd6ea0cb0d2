"""The slabs of both frusta, and the number of the scene's triangles in each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class SlabContent:
    """The content of one slab of one camera; a slab without triangles is not drawn.

    Attributes
    ----------
    camera
        C or C*.
    heights
        Heights |z| between which the slab lies.
    triangles
        Number of triangles that reach into the slab.
    """

    camera: Camera
    heights: tuple[float, float]
    triangles: int


def slab_contents(scene: Scene, settings: DoubleFrustum) -> tuple[SlabContent, ...]:
    """Return the content of every slab that is asked for, from the back: C's inward, C*'s outward."""
    reach_viewer, reach_back = scene.frustum.reach
    behind = [slab_content(scene, Camera.C, heights) for heights in reversed(settings.sections(reach_back))]
    before = [slab_content(scene, Camera.C_STAR, heights) for heights in settings.sections(reach_viewer)]
    chosen = {Camera.BOTH: [*behind, *before], Camera.C: behind, Camera.C_STAR: before}
    return tuple(chosen[settings.camera])


def slab_content(scene: Scene, camera: Camera, heights: tuple[float, float]) -> SlabContent:
    """Return the content of one slab of C, behind the plate, or of C*, before it."""
    near, far = heights
    low, high = (-far, -near) if camera is Camera.C else (near, far)
    lowest, highest = scene.height_ranges
    return SlabContent(
        camera=camera, heights=heights, triangles=int(np.count_nonzero((highest >= low) & (lowest <= high)))
    )
