"""Hard cases for tests: each scene and each of its true images is made once."""

from collections import defaultdict
from functools import cache

import numpy as np

from tests.support.views import lines_by_definition
from xfrustum.reference import Reference
from xfrustum.scenes import HogelImage, Scene, open_scene
from xfrustum.scenes.arrays import Floats, Indices
from xfrustum.scenes.library import hard_cases

Index = tuple[int, int]
MIDDLE: Index = (2, 2)
SMALL = hard_cases.names(giants=False)


@cache
def scene_of(name: str) -> Scene:
    """Return the scene of a hard case."""
    return open_scene(name)


@cache
def truth_of(name: str, aperture: Index = MIDDLE) -> HogelImage:
    """Return the true image of an aperture, column and row."""
    scene = scene_of(name)
    return Reference(scene).trace(scene.plate.aperture(*aperture))


def companions_of(image: HogelImage) -> dict[Index, list[int]]:
    """Return the triangles of every tie in ascending order, by row and column."""
    assert image.companions is not None
    found: dict[Index, list[int]] = defaultdict(list)
    for row, column, triangle in image.companions.tolist():
        found[row, column].append(triangle)
    return {index: sorted(triangles) for index, triangles in found.items()}


def pixel_grid(name: str) -> tuple[Indices, Indices]:
    """Return column and row of every pixel, (H, W) each."""
    width, height = scene_of(name).frustum.resolution
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    return columns, rows


def slopes(name: str, aperture: Index = MIDDLE) -> tuple[Floats, Floats]:
    """Return dx and dy of every pixel's line, (H, W) each."""
    scene = scene_of(name)
    d = lines_by_definition(scene, scene.plate.aperture(*aperture))
    return d[..., 0], d[..., 1]
