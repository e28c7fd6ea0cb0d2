"""Scenes for tests: reduced scenes, scenes beside the checkout, and loose triangles."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from xfrustum.scenes import (
    Aperture,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Frustum,
    Plate,
    Scene,
    SceneObject,
    open_scene,
)
from xfrustum.scenes.arrays import Floats

SHARED = Path(__file__).resolve().parents[3] / "shared"
SHARED_SCENES = ("beetle", "bunny-transfer", "teapot-recentered", "truck")


def view(name: str, resolution: tuple[int, int] | None = None) -> Scene:
    """Open a built-in scene, or one of `SHARED_SCENES`, at some resolution; skip missing scenes."""
    if name in SHARED_SCENES:
        path = SHARED / "scenes" / f"{name}.toml"
        if not path.exists():
            pytest.skip(
                f"needs ../shared/scenes/{name}.toml, in the folder of test data beside the "
                f"checkout"
            )
        name = str(path)
    scene = open_scene(name)
    if resolution is None:
        return scene
    return replace(scene, frustum=replace(scene.frustum, resolution=resolution))


def reversed_d32f(near: float) -> DoubleFrustum:
    """Return settings with reversed float depth, whose depth errors are negligible."""
    return DoubleFrustum(near=near, depth=DepthFormat.D32F, mapping=DepthMapping.REVERSED)


def soup(triangles: Floats, frustum: Frustum, size: float = 16.0) -> Scene:
    """Return a scene of loose triangles (F, 3, 3) as one object, with a plate of some size."""
    part = SceneObject(
        name="soup",
        vertices=triangles.reshape(-1, 3),
        faces=np.arange(3 * len(triangles)).reshape(-1, 3),
    )
    return Scene(
        name="soup",
        plate=Plate(size=(size, size), hogels=(16, 16)),
        frustum=frustum,
        objects=(part,),
    )


def at(x: float, y: float) -> Aperture:
    """Return an aperture at any position; its index has no meaning."""
    return Aperture(column=0, row=0, x=x, y=y)


def lines_by_definition(scene: Scene, aperture: Aperture) -> Floats:
    """Return the direction d of every pixel, (H, W, 3), by CONVENTIONS.md, "Frames"."""
    width, height = scene.frustum.resolution
    u = (2 * np.arange(width) + 1) / width - 1
    v = 1 - (2 * np.arange(height) + 1) / height
    screen = scene.frustum.screen
    if screen is None:
        k, t = (0.0, 0.0), tuple(math.tan(angle / 2) for angle in scene.frustum.fov)
    else:
        ss = -screen.height
        k = ((screen.center[0] - aperture.x) / ss, (screen.center[1] - aperture.y) / ss)
        t = (screen.size[0] / 2 / abs(ss), screen.size[1] / 2 / abs(ss))
    d = np.empty((height, width, 3))
    d[..., 0], d[..., 1], d[..., 2] = k[0] + u * t[0], (k[1] + v * t[1])[:, None], -1.0
    return d
