"""The project's rasterizer with deliberate defects of other renderers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.views import view
from xfrustum.compare.renderer_model.conventions import UPRIGHT, Orientation
from xfrustum.raster import Rasterizer
from xfrustum.scenes import (
    Aperture,
    Camera,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    HogelImage,
    Plate,
    Scene,
)
from xfrustum.scenes.model.images import NOTHING
from xfrustum.scenes.plate import Fit, Pivot, Screen

INVISIBLE = 1e-5
"""Near offset, share of the reach, too small to displace pixels of these scenes noticeably."""


def small(name: str = "asymmetric-recentered", size: int = 64) -> Scene:
    """Return a scene with square images and a square grid of hogels, for all symmetries."""
    scene = view(name, (size, size))
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(5, 5)))


def oblong(name: str = "asymmetric", width: int = 32) -> Scene:
    """Return a scene with four symmetries each of film and plate, a quarter of `small`'s."""
    scene = view(name, (width, width * 3 // 4))
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(5, 4)))


def saying(image: HogelImage, *channels: str) -> HogelImage:
    """Return an image with only its `triangle`, `object` or `color`."""
    nothing = np.full_like(image.triangle, NOTHING)
    return HogelImage(
        camera=image.camera,
        triangle=image.triangle if "triangle" in channels else nothing,
        object=image.object if "object" in channels else nothing,
        position=np.full((*nothing.shape, 3), np.nan),
        color=image.color if "color" in channels else None,
    )


@dataclass(kw_only=True, eq=False)
class Faulty:
    """A renderer in Python, called by `verify`; its arguments are its defects."""

    scene: Scene
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    shift: tuple[float, float] = (0.0, 0.0)
    fov: tuple[float, float] = (1.0, 1.0)
    pitch: float = 1.0
    near: float | None = None
    pivot: str = "aperture"
    fit: str = "angle"
    front: bool = True
    overlaid: bool = True
    shown: str = "triangle"
    rasterizer: Rasterizer = field(init=False)

    def __post_init__(self) -> None:
        self.rasterizer = Rasterizer(self.scene)

    def __enter__(self) -> Faulty:
        return self

    def __exit__(self, *_: object) -> None:
        self.rasterizer.release()

    def __call__(self, scene: Scene, aperture: Aperture) -> HogelImage:
        """Draw the image that this renderer returns for an aperture."""
        there = scene.plate.aperture(*self.order.index(aperture.index, scene.plate.hogels))
        image = self._drawn(replace(there, x=there.x * self.pitch, y=there.y * self.pitch))
        return saying(replace(image, **_arrays(image, self.orientation.applied)), self.shown)

    def _drawn(self, aperture: Aperture) -> HogelImage:
        near = self.near or INVISIBLE * self.scene.frustum.longest_reach
        settings = DoubleFrustum(
            near=near,
            depth=DepthFormat.D32F,
            mapping=DepthMapping.REVERSED,
            pivot=Pivot(self.pivot),
            fit=Fit(self.fit),
        )
        self.rasterizer.scene = replace(self.scene, frustum=self._film(aperture))
        back, front = (
            self.rasterizer.render(aperture, replace(settings, camera=camera))
            for camera in (Camera.C, Camera.C_STAR)
        )
        if not self.front:
            return back
        lower, upper = (back, front) if self.overlaid else (front, back)
        covers, below = upper.triangle != NOTHING, _arrays(lower)
        arrays = {
            name: np.where(covers if over.ndim == 2 else covers[..., None], over, below[name])
            for name, over in _arrays(upper).items()
        }
        return replace(back, **arrays)

    def _film(self, aperture: Aperture) -> Frustum:
        """Return the frustum whose pixel centers are the renderer's sampling points."""
        frustum = self.scene.frustum
        if (self.shift, self.fov, frustum.screen) == ((0.0, 0.0), (1.0, 1.0), None):
            return frustum
        screen = frustum.screen
        if screen is None:
            width, height = (2 * math.tan(angle / 2) for angle in frustum.fov)
            screen = Screen(height=-1.0, center=(aperture.x, aperture.y), size=(width, height))
        size = screen.size[0] * self.fov[0], screen.size[1] * self.fov[1]
        # The film's u runs with the screen's x behind the plate, and against it before the plate.
        (right, down), sign = self.shift, math.copysign(1.0, -screen.height)
        columns, rows = frustum.resolution
        x = screen.center[0] + sign * right * size[0] / columns
        y = screen.center[1] - sign * down * size[1] / rows
        return replace(frustum, fov=None, screen=replace(screen, center=(x, y), size=size))


def _arrays(
    image: HogelImage, change: Callable[[NDArray[Any]], NDArray[Any]] = np.asarray
) -> dict[str, Any]:
    """Return the triangles, objects and colors of an image, optionally changed."""
    return {name: change(getattr(image, name)) for name in ("triangle", "object", "color")}
