"""Conformance run of xfrustum's rasterizer; run from this folder.

    xfrustum conformance run --python rasterizer:draw
    xfrustum conformance run --python rasterizer:d24_standard

`draw` uses the cameras of each case. `d24_standard` draws cases without a stated offset with the
depth buffer of most programs, and with the offset that this buffer needs, 1e-3 of the reach: its
verdicts show the cost.
"""

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from lines import check_two_cameras

from xfrustum import DepthFormat, DepthMapping, DoubleFrustum, Rasterizer
from xfrustum.scenes.conformance_suite import chosen


@lru_cache(maxsize=1)
def opened(name: str) -> tuple[Any, Any, Rasterizer]:
    """Return case, scene and rasterizer by the name of the case; the latest result is cached."""
    (case,) = chosen(names=(name,))
    scene = case.open()
    return case, scene, Rasterizer(scene).__enter__()


def draw(
    folder: Path,
    asked: dict[str, Any],
    hogel: tuple[int, int],
    settings: DoubleFrustum | None = None,
) -> Any:
    """Draw a hogel with the two cameras of the case, or with other settings."""
    check_two_cameras(
        np.load(folder / "scene.npz"), asked, json.loads((folder / "cameras.json").read_text())
    )
    case, scene, rasterizer = opened(asked["name"])
    settings = settings or case.settings(scene)
    image = rasterizer.render(scene.plate.aperture(*hogel), settings)
    if case.colored:
        return image.color
    return (image.triangle if case.encoding == "triangle-id" else image.object) + 1


def d24_standard(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Any:
    """Draw a hogel with D24; the offset is 1e-3 of the reach if the case states none."""
    near = asked["near"] or 1e-3 * max(asked["reach"])
    usual = DoubleFrustum(near=near, depth=DepthFormat.D24, mapping=DepthMapping.STANDARD)
    return draw(folder, asked, hogel, None if asked["near"] else usual)
