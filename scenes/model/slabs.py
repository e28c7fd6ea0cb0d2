"""Which slabs of both frusta the scene has something in: what is drawn, and what is skipped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum


@dataclass(frozen=True, kw_only=True)
class Slab:
    """One section of one camera's frustum.

    Attributes
    ----------
    camera
        C or C*.
    heights
        |z| from which to which it extends.
    triangles
        How many reach into it.
    """

    camera: Camera
    heights: tuple[float, float]
    triangles: int


def slabs(scene: Scene, settings: DoubleFrustum) -> tuple[Slab, ...]:
    """Return the slabs of the cameras that are asked for, from the back: C's inward, C*'s outward."""
    reach_viewer, reach_back = scene.frustum.reach
    behind = [slab(scene, Camera.C, heights) for heights in reversed(settings.sections(reach_back))]
    before = [slab(scene, Camera.C_STAR, heights) for heights in settings.sections(reach_viewer)]
    chosen = {Camera.BOTH: [*behind, *before], Camera.C: behind, Camera.C_STAR: before}
    return tuple(chosen[settings.camera])


def slab(scene: Scene, camera: Camera, heights: tuple[float, float]) -> Slab:
    """Return what lies in one section of C, behind the plate, or of C*, before it."""
    near, far = heights
    low, high = (-far, -near) if camera is Camera.C else (near, far)
    lowest, highest = scene.height_ranges
    return Slab(
        camera=camera, heights=heights, triangles=int(np.count_nonzero((highest >= low) & (lowest <= high)))
    )
