"""Images of the golden corpus: small truths and rasters of every scene."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from xfrustum import (
    Aperture,
    DepthFormat,
    DepthMapping,
    DoubleFrustum,
    Rasterizer,
    Reference,
    Scene,
    open_scene,
)
from xfrustum.scenes.library import hard_cases as cases

SHARED = Path(__file__).resolve().parents[3] / "shared" / "scenes"
RESOLUTION = (96, 72)
BUILT_IN = (
    "car", "car-recentered", "car-transfer", "asymmetric", "asymmetric-recentered", "sheets",
    "crossing",
    "large-triangles", "car-studio", "mirror-sphere", "grating", "empty",
)  # fmt: skip
DEPTHS = (
    (DepthFormat.D16, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.STANDARD),
    (DepthFormat.D24, DepthMapping.REVERSED),
    (DepthFormat.D24, DepthMapping.LOGARITHMIC),
    (DepthFormat.D32F, DepthMapping.REVERSED),
)
NEARS = (1e-2, 1e-5)
"""Near offsets relative to the reach: one displaces points visibly, one starves depth buffers."""

Arrays = dict[str, NDArray[Any]]


def scenes() -> Iterator[tuple[str, Scene]]:
    """Yield names and scenes: built-in scenes, hard cases except giants, and shared scenes."""
    for name in (*BUILT_IN, *cases.names(giants=False)):
        yield name, open_scene(name)
    for path in sorted(SHARED.glob("*.toml")):
        yield f"shared/{path.stem}", open_scene(str(path))


def small(scene: Scene) -> Scene:
    """Return the scene with few pixels; hard cases keep their films with exact targets."""
    if scene.name.startswith("hard/"):
        return scene
    return replace(scene, frustum=replace(scene.frustum, resolution=RESOLUTION))


def apertures(scene: Scene) -> list[Aperture]:
    """Return the middle aperture, the top left one, and an arbitrary one between them."""
    columns, rows = scene.plate.hogels
    places = dict.fromkeys([(columns // 2, rows // 2), (0, 0), (columns // 5, (2 * rows) // 3)])
    return [scene.plate.aperture(column, row) for column, row in places]


def truths(chosen: Iterable[tuple[str, Scene]] | None = None) -> Arrays:
    """Return the truths of scenes (None: all) as `scene|column,row|channel`, reals as float32."""
    arrays: Arrays = {}
    for name, whole in tqdm(list(chosen or scenes()), desc="truths"):
        scene = small(whole)
        reference = Reference(scene)
        for aperture in apertures(scene):
            image = reference.trace(aperture)
            key = f"{name}|{aperture.column},{aperture.row}"
            arrays |= {
                f"{key}|triangle": image.triangle,
                f"{key}|object": image.object.astype(np.int16),
                f"{key}|certainty": np.asarray(image.certainty),
                f"{key}|position": np.asarray(image.position, dtype=np.float32)[..., 2],
                f"{key}|normal": np.asarray(image.normal, dtype=np.float32),
            }
            if image.color is not None:
                arrays[f"{key}|color"] = image.color
    return arrays


def rasters(chosen: Iterable[tuple[str, Scene]] | None = None) -> Arrays:
    """Return raster triangles by `scene|near/reach|depth|mapping|column,row`; D32F has colors."""
    arrays: Arrays = {}
    for name, whole in tqdm(list(chosen or scenes()), desc="rasters"):
        if name.startswith("hard/"):
            continue
        scene = small(whole)
        with Rasterizer(scene) as rasterizer:
            for share in NEARS:
                for depth, mapping in DEPTHS:
                    settings = DoubleFrustum(
                        near=share * max(scene.frustum.reach), depth=depth, mapping=mapping
                    )
                    aperture = apertures(scene)[-1]
                    image = rasterizer.render(aperture, settings)
                    where = f"{aperture.column},{aperture.row}"
                    key = f"{name}|{share}|{depth.value}|{mapping.value}|{where}"
                    arrays[f"{key}|triangle"] = image.triangle
                    if depth is DepthFormat.D32F and image.color is not None:
                        arrays[f"{key}|color"] = image.color
    return arrays
