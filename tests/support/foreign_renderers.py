"""The own rasterizer with deliberate defects, as another renderer could have them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

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
from xfrustum.scenes.appearance.appearance import DEFAULT_LIGHT, DEFAULT_MATERIAL
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.plate.double_frustum import Fit, Pivot
from xfrustum.scenes.plate.plate import Screen

INVISIBLE = 1e-5
"""Near offset, share of the reach, too small to displace pixels of these scenes noticeably."""


def small(name: str = "asymmetric-recentered", size: int = 64) -> Scene:
    """Return a scene with square images and a square number of hogels: all symmetries hold."""
    scene = view(name, (size, size))
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(5, 5)))


def oblong(name: str = "asymmetric", width: int = 32) -> Scene:
    """Return a scene whose film and plate have four symmetries each, a quarter of `small`'s."""
    scene = view(name, (width, width * 3 // 4))
    return replace(scene, plate=Plate(size=scene.plate.size, hogels=(5, 4)))


def saying(image: HogelImage, *channels: str) -> HogelImage:
    """Return an image with nothing but its `triangle`, `object` or `color`."""
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
    """A renderer in Python: `verify` calls it. The faults are the arguments."""

    scene: Scene
    orientation: Orientation = UPRIGHT
    order: Orientation = UPRIGHT
    shift: tuple[float, float] = (0.0, 0.0)
    fov: tuple[float, float] = (1.0, 1.0)
    pitch: float = 1.0

    near: float | None = None
    pivot: str = "aperture"
    fit: str = "angle"
    front: str = "farthest"
    overlaid: bool = True
    conjugated: bool = True
    shown: str = "triangle"
    rasterizer: Rasterizer = field(init=False)

    def __post_init__(self) -> None:
        self.rasterizer = Rasterizer(self.scene)

    def __enter__(self) -> Faulty:
        return self

    def __exit__(self, *_: object) -> None:
        self.rasterizer.release()

    def __call__(self, scene: Scene, aperture: Aperture) -> HogelImage:
        """Draw the image that this renderer takes for the hogel of an aperture."""
        columns, rows = scene.plate.hogels
        index = self.order.index(aperture.index, (columns, rows))
        reordered = scene.plate.aperture(*index)
        image = self._drawn(
            replace(reordered, x=reordered.x * self.pitch, y=reordered.y * self.pitch)
        )
        turned = self.orientation.applied
        arrays: dict[str, Any] = {
            name: turned(getattr(image, name)) for name in ("triangle", "object", "color")
        }
        channels = (self.shown,) if self.conjugated else (self.shown, "color")
        return saying(replace(image, **arrays), *channels)

    def _drawn(self, aperture: Aperture) -> HogelImage:
        near = self.near or INVISIBLE * self.scene.frustum.longest_reach
        settings = DoubleFrustum(
            near=near,
            depth=DepthFormat.D32F,
            mapping=DepthMapping.REVERSED,
            pivot=Pivot(self.pivot),
            fit=Fit(self.fit),
        )

        def drawn(camera: Camera) -> HogelImage:
            self.rasterizer.scene = replace(self.scene, frustum=self._film(aperture))
            return self.rasterizer.render(aperture, replace(settings, camera=camera))

        if self.front == "missing":
            return drawn(Camera.C)
        back, front = drawn(Camera.C), drawn(Camera.C_STAR)
        if self.front == "nearest":
            front = nearest_wins(self.rasterizer.scene, front, near)
        if not self.conjugated:
            front = replace(front, color=unconjugated(front))
        lower, upper = (back, front) if self.overlaid else (front, back)
        covers = upper.triangle != NOTHING
        arrays = {
            name: np.where(
                covers if getattr(upper, name).ndim == 2 else covers[..., None],
                getattr(upper, name),
                getattr(lower, name),
            )
            for name in ("triangle", "object", "color")
        }
        return replace(back, **arrays)

    def _film(self, aperture: Aperture) -> Frustum:
        """Return the frustum whose pixels lie where this renderer samples."""
        frustum = self.scene.frustum
        height = -1.0 if frustum.screen is None else frustum.screen.height
        if frustum.screen is None:
            center: tuple[float, float] = (aperture.x, aperture.y)
            size = tuple(2 * math.tan(angle / 2) for angle in frustum.fov)
        else:
            center, size = frustum.screen.center, frustum.screen.size
        size = (size[0] * self.fov[0], size[1] * self.fov[1])
        # Behind the plate the film's u runs with the screen's x, in front of it against it.
        sign = math.copysign(1.0, -height)
        width, rows = frustum.resolution
        moved = (
            center[0] + sign * self.shift[0] * size[0] / width,
            center[1] - sign * self.shift[1] * size[1] / rows,
        )
        if self.shift == (0.0, 0.0) and frustum.screen is None and self.fov == (1.0, 1.0):
            return frustum
        return replace(
            frustum, fov=None, screen=Screen(height=height, center=moved, size=(size[0], size[1]))
        )


def nearest_wins(scene: Scene, front: HogelImage, near: float) -> HogelImage:
    """Return C*'s picture with the surface nearest to the plate, lines against all triangles."""
    camera = front.camera
    (ax, ay), (kx, ky), (tx, ty) = (
        (camera.aperture.x, camera.aperture.y),
        camera.shear,
        camera.half_extent,
    )
    width, height = camera.resolution
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    # Lines run from C*'s center at z = -near along -d, toward the viewer.
    d = np.stack(
        np.broadcast_arrays(-(kx + u * tx), -(ky + v * ty)[:, None], 1.0), axis=-1
    ).reshape(-1, 3)
    center = np.array([ax + near * kx, ay + near * ky, -near])
    best, number = np.full(len(d), np.inf), np.full(len(d), NOTHING, dtype=np.int32)
    for index, (p, q, r) in enumerate(scene.triangles - center):
        sides = np.stack([np.cross(q, r) @ d.T, np.cross(r, p) @ d.T, np.cross(p, q) @ d.T])
        inside = (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.dot(p, np.cross(q, r)) / sides.sum(axis=0)
        # Only surfaces between the plate and the reach count.
        met = inside & (s > near) & (s <= near + scene.frustum.reach[0]) & (s < best)
        best[met], number[met] = s[met], index
    triangle = number.reshape(height, width)
    objects = np.append(scene.object_of_triangle, np.int32(NOTHING))
    return replace(front, triangle=triangle, object=objects[triangle])


def unconjugated(front: HogelImage) -> Singles:
    """Return the viewer's half under L where C* needs L* = -L: the side off the light is lit."""
    camera, light = front.camera, np.asarray(DEFAULT_LIGHT.direction)
    normal = np.nan_to_num(front.normal).astype(np.float64)
    toward = front.position.astype(np.float64) - (camera.aperture.x, camera.aperture.y, 0.0)
    with np.errstate(invalid="ignore"):
        eye = -np.nan_to_num(toward / np.linalg.norm(toward, axis=-1, keepdims=True))
    # The normal is turned to C*, at the plate.
    normal *= np.where(np.einsum("...i,...i->...", normal, eye) < 0, -1.0, 1.0)[..., None]
    cosine = normal @ light
    mirrored = 2 * np.einsum("...i,...i->...", normal, eye)[..., None] * normal - eye
    highlight = np.where(
        cosine > 0, np.maximum(mirrored @ light, 0.0) ** DEFAULT_MATERIAL.exponent, 0.0
    )
    ambient, diffuse, specular = (
        getattr(DEFAULT_MATERIAL, term)[0] for term in ("ambient", "diffuse", "specular")
    )
    gray = ambient + diffuse * np.maximum(cosine, 0.0) + specular * highlight
    gray = np.where(front.triangle == NOTHING, 0.0, gray)
    return np.repeat(gray[..., None], 3, axis=-1).astype(np.float32)
