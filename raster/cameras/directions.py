"""Views of a plate by one pixel of all hogels: the plate is the film, an aperture a pixel.

In a centered frustum, the lines of one pixel are parallel, and the camera is affine, with depth
linear in z. In a recentered frustum, the lines pass through a point of the screen, the center of a
perspective camera. There is no near offset and no second camera.
"""

from __future__ import annotations

import math

import numpy as np

from xfrustum.raster.cameras.cameras import Pass
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import PlateTile, Screen


def window(tile: PlateTile) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return center and half extent of the cells of a tile's hogels, scene units."""
    center, half = [], []
    for hogels, size, side, cells in zip(
        tile.plate.hogels, tile.plate.size, (1, -1), (tile.columns, tile.rows), strict=True
    ):
        # Rows count down.
        ends = [side * (size * (end / hogels - 0.5)) for end in (cells.start, cells.stop)]
        center.append(sum(ends) / 2)
        half.append(abs(ends[1] - ends[0]) / 2)
    return (center[0], center[1]), (half[0], half[1])


def film_point(frustum_resolution: tuple[int, int], pixel: tuple[int, int]) -> tuple[float, float]:
    """Return u and v of a pixel (column, row) of a hogel."""
    (width, height), (column, row) = frustum_resolution, pixel
    return (2 * column + 1) / width - 1, 1 - (2 * row + 1) / height


def direction_pass(scene: Scene, tile: PlateTile, pixel: tuple[int, int]) -> Pass:
    """Return the camera of a pixel (column, row) of all hogels of a tile.

    Raises InputError if surfaces within the reach cross the screen or lie beyond it.
    """
    u, v = film_point(scene.frustum.resolution, pixel)
    screen = scene.frustum.screen
    if screen is not None:
        return _perspective(scene, tile, screen, (u, v))
    assert scene.frustum.fov is not None
    slopes = u * math.tan(scene.frustum.fov[0] / 2), v * math.tan(scene.frustum.fov[1] / 2)
    (x, y), (half_width, half_height) = window(tile)
    top, back = scene.frustum.reach
    matrix = np.array(
        [
            [1 / half_width, 0, slopes[0] / half_width, -x / half_width],
            [0, 1 / half_height, slopes[1] / half_height, -y / half_height],
            [0, 0, -1 / (top + back), top / (top + back)],
            [0, 0, 0, 1],
        ]
    )
    return _toward_the_back(matrix, (0.0, top + back), (-back, top))


def _toward_the_back(
    matrix: Floats, planes: tuple[float, float], heights: tuple[float, float]
) -> Pass:
    return Pass(
        clip_from_scene=matrix,
        planes=planes,
        heights=heights,
        clear=1.0,
        depth_function="<",
        front_face="ccw",
        culled_face=None,
        orthoscopic=True,
    )


def _perspective(scene: Scene, tile: PlateTile, screen: Screen, film: tuple[float, float]) -> Pass:
    """Return the camera at the point of the screen on a pixel's lines in all hogels."""
    lowest, highest = scene.bounds[0][2], scene.bounds[1][2]
    low, high = max(lowest, -scene.frustum.reach[1]), min(highest, scene.frustum.reach[0])
    before = screen.height > 0
    if high >= screen.height if before else low <= screen.height:
        raise InputError(
            f"surfaces between z = {low:.6g} and {high:.6g} reach the screen at z = "
            f"{screen.height:.6g}, in which a view by direction has its camera; "
            "draw the plate by hogels"
        )
    # A screen in front of the plate shows its image mirrored in both axes.
    side = -1 if before else 1
    at = [screen.center[k] + side * film[k] * screen.size[k] / 2 for k in range(2)]
    distance = abs(screen.height)
    center, half = window(tile)
    # w is the distance from the screen: zs - z for a screen in front of the plate, z - zs behind
    # it.
    sign = -1.0 if before else 1.0
    w = np.array([0.0, 0.0, sign, distance])
    rows = []
    for axis in range(2):
        across = np.zeros(4)
        across[axis], across[3] = distance, -distance * at[axis]
        rows.append((across + (at[axis] - center[axis]) * w) / half[axis])
    # The near plane is at the end of the reach, or slightly in front of the nearest surface: as far
    # from the camera as possible, because depth is hyperbolic here. The far plane is at the other
    # end of the reach.
    heights = (-scene.frustum.reach[1], scene.frustum.reach[0])
    first, last = reversed(heights) if before else heights
    surface = high if before else low
    near, far = distance + sign * surface, distance + sign * last
    if surface != first:
        near *= 1 - 2.0**-10
    depth = far / (far - near) * (w - np.array([0.0, 0.0, 0.0, near]))
    matrix = np.stack([*rows, depth, w])
    if before:
        return _toward_the_back(matrix, (near, far), heights)
    # This camera looks to the viewer, as C* does: the farthest surface wins.
    return Pass(
        clip_from_scene=matrix,
        planes=(near, far),
        heights=heights,
        clear=0.0,
        depth_function=">",
        front_face="cw",
        culled_face=None,
        orthoscopic=False,
    )
