"""What a scene says of itself: in words, in tables, and as silhouettes from the viewer and from the side."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import PurePath

import numpy as np

from xfrustum.scenes.appearance.display import LEVELS
from xfrustum.scenes.arrays import Bytes, Floats
from xfrustum.scenes.model.scene import Scene, SceneObject
from xfrustum.scenes.notebook.numbers import counted, digits, sides
from xfrustum.scenes.notebook.pictures import MOVED, SHADES, levels, png
from xfrustum.scenes.notebook.shown import Figure, Table
from xfrustum.scenes.plate.frustum import Frustum

SILHOUETTE_PX = 280
"""Longest side of a silhouette."""

MARGIN = 0.04
"""Share of a silhouette's longest side that stays free about what is shown."""

FARTHEST = 1.5
"""Half-extent of what a silhouette shows, over the larger of plate and reach: one mesh in other units must
not shrink all others to a dot."""

MAX_POLYGONS = 20_000
"""Largest number of triangles that are filled one by one, a second's work; of more only centers are drawn."""

PLATE_PX = 2
"""Width of the line that is the plate."""

Sight = tuple[int, int, tuple[float, float, float]]
"""Coordinates that point to the right and upward in a picture, and the direction to whoever looks."""

FRONT: Sight = (0, 1, (0.0, 0.0, 1.0))
"""The sight of the viewer: x to the right, y up."""

SIDE: Sight = (2, 1, (-1.0, 0.0, 0.0))
"""The sight from the viewer's left, in which the viewer is at the right."""


def said_of_scene(scene: Scene) -> str:
    """Return the plate, its frusta and the number of objects and triangles."""
    plate, units = scene.plate, scene.units
    toward, back = map(digits, scene.frustum.reach)
    triangles = sum(len(part.faces) for part in scene.objects)
    return (
        f"{scene.name!r}, a plate of {sides(plate.size)} {units} with {sides(plate.hogels)} hogels of "
        f"{sides(scene.frustum.resolution)} pixels, {_frustum_words(scene.frustum, units)}, "
        f"reach {toward} {units} toward the viewer and {back} {units} behind; "
        f"{counted(len(scene.objects), 'object')}, {counted(triangles, 'triangle')}"
    )


def _frustum_words(frustum: Frustum, units: str) -> str:
    if frustum.screen is not None:
        screen = frustum.screen
        height = digits(screen.height)
        return f"recentered on a screen of {sides(screen.size)} {units} at height {height} {units}"
    assert frustum.fov is not None
    return f"each {sides(math.degrees(angle) for angle in frustum.fov)} degrees"


def said_of_object(part: SceneObject) -> str:
    """Return the counts and the extent of an object."""
    low, high = _heights(part)
    return (
        f"{PurePath(part.name).name!r}, {counted(len(part.faces), 'triangle')}, "
        f"{_size(part)} scene units, heights {digits(low)} to {digits(high)}"
    )


def tables_of_scene(scene: Scene) -> Iterator[Table]:
    """Yield the objects, and what else is known of a scene."""
    if scene.objects:
        yield Table(
            head=("object", "triangles", f"size, {scene.units}", f"heights, {scene.units}", "material"),
            rows=[
                (
                    PurePath(part.name).name,
                    f"{len(part.faces):,}",
                    _size(part),
                    " to ".join(map(digits, _heights(part))),
                    part.material or "default",
                )
                for part in scene.objects
            ],
        )
    sampling, transport = scene.sampling, scene.transport
    light = [name for name in ("shadows", "interreflection") if getattr(transport, name)]
    yield Table(
        rows=[
            ("source", scene.source or "made in memory"),
            ("lights", counted(len(scene.appearance.lights), "light") + (
                " and an environment" if scene.appearance.environment is not None else "")),
            ("samples", f"{sampling.aperture} of the aperture, {sampling.supersample} of a pixel"),
            ("light transport", " and ".join(light) or "none"),
            *(("warning", line) for line in scene.warnings),
        ]
    )  # fmt: skip


def _size(part: SceneObject) -> str:
    points = part.vertices[part.faces.ravel()]
    return " x ".join(map(digits, (points.max(axis=0) - points.min(axis=0)).tolist()))


def _heights(part: SceneObject) -> tuple[float, float]:
    z = part.vertices[part.faces.ravel(), 2]
    return float(z.min()), float(z.max())


def silhouettes(scene: Scene) -> Iterator[Figure]:
    """Yield the scene as the viewer sees it and from the side, the plate in blue.

    Lighter surfaces are nearer: to the viewer, and to whoever looks from the side.
    """
    half = np.array(scene.plate.size) / 2
    yield Figure(
        caption="as the viewer sees it: x to the right, y up",
        content=png(_silhouette(scene, FRONT, np.array([-half, half]))),
    )
    toward, back = scene.frustum.reach
    edge = np.array([[0.0, -half[1]], [0.0, half[1]]])
    ends = f"{digits(-back)} to {digits(toward)} {scene.units}"
    yield Figure(
        caption=f"from the viewer's left: the viewer is at the right, and the reach is z = {ends}",
        content=png(_silhouette(scene, SIDE, edge, (-back, toward))),
    )


def _silhouette(scene: Scene, sight: Sight, plate: Floats, ends: tuple[float, ...] = ()) -> Bytes:
    """Return a picture (H, W, 3) of a scene.

    Parameters
    ----------
    scene
        Scene that is drawn.
    sight
        Coordinates of the picture, and the direction to whoever looks.
    plate
        (2, 2) opposite corners of the plate, or both its ends.
    ends
        Places of the ends of the reach, to the right; none where they are not seen.
    """
    from PIL import Image, ImageDraw  # noqa: PLC0415 - scenes are opened without it

    corners = scene.triangles[:, :, list(sight[:2])]
    reach = np.array([(end, 0.0) for end in ends]).reshape(-1, 2)
    low, high = _shown(scene, corners, np.concatenate((plate, reach)))
    scale = SILHOUETTE_PX / float((high - low).max()) / (1 + 2 * MARGIN)
    size = np.maximum(1, np.rint((high - low) * scale + 2 * MARGIN * SILHOUETTE_PX))

    def placed(points: Floats) -> Floats:
        return np.asarray((points - (low + high) / 2) * scale * np.array([1.0, -1.0]) + size / 2)

    width, height = (int(side) for side in size)
    picture = Image.new("RGB", (width, height))
    draw = ImageDraw.Draw(picture)
    for x in placed(reach)[:, 0].tolist():
        draw.line([(x, 0), (x, height)], fill=(round(LEVELS * SHADES[0]),) * 3)
    gray = _shades(scene.triangles.mean(axis=1) @ np.array(sight[2]))
    triangles = placed(corners)
    # What is smaller than a pixel is a pixel.
    small = np.ptp(triangles, axis=1).max(axis=1) <= 1.0
    if np.count_nonzero(~small) > MAX_POLYGONS:
        small[:] = True
    for number in np.flatnonzero(~small)[np.argsort(gray[~small], kind="stable")].tolist():
        draw.polygon([tuple(point) for point in triangles[number].tolist()], fill=(int(gray[number]),) * 3)
    found = np.array(picture)
    order = np.flatnonzero(small)[np.argsort(gray[small], kind="stable")]
    columns, rows = np.floor(triangles[order].mean(axis=1)).astype(np.int64).T
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found[rows[inside], columns[inside]] = gray[order][inside, None]
    left, top = np.floor(placed(plate)).min(axis=0).clip(0).astype(int)
    last_column, last_row = np.floor(placed(plate)).max(axis=0).astype(int)
    for place in range(PLATE_PX):
        found[top : last_row + 1, [min(left + place, width - 1), max(last_column - place, 0)]] = MOVED
        found[[min(top + place, height - 1), max(last_row - place, 0)], left : last_column + 1] = MOVED
    return found


def _shades(nearness: Floats) -> Bytes:
    """Return gray levels by nearness (F,): the farthest dark, the nearest light."""
    low, high = nearness.min(initial=np.inf), nearness.max(initial=-np.inf)
    share = (nearness - low) / (high - low if high > low else 1.0)
    return levels(SHADES[0] + share * (SHADES[1] - SHADES[0]))


def _shown(scene: Scene, corners: Floats, fixed: Floats) -> tuple[Floats, Floats]:
    """Return the rectangle that shows the plate, the ends of the reach, and the objects if they are near."""
    far = FARTHEST * max(*scene.plate.size, *scene.frustum.reach)
    points = np.concatenate((corners.reshape(-1, 2), fixed))
    low, high = np.clip(points.min(axis=0), -far, far), np.clip(points.max(axis=0), -far, far)
    return np.minimum(low, fixed.min(axis=0)), np.maximum(high, fixed.max(axis=0))
