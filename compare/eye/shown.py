"""The replayed image: pixels of hogels that an eye is shown, and the surface points that these show."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference.lines.lines import model_cameras
from xfrustum.scenes.arrays import Floats, Indices, Mask, Numbers
from xfrustum.scenes.model.eye import Eye, EyeImage, HogelPixels, Replay
from xfrustum.scenes.model.hogel_image import NOTHING
from xfrustum.scenes.model.plate_content import ColorType, FilmPart
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

LEVELS = 255
"""Value that stands for radiance one where color is stored in 8 bits."""

DEFAULT_COLOR = ColorType.FLOAT16
"""Type of color that hogels are drawn in: that of stored plates, so that both show the same pixels."""

HEIGHT_TOLERANCE = 2.0**-16
"""Distance beyond a camera's ends at which a point still counts as drawn by it, as a part of the reach: cuts
are made in float32, on slopes that make a rounding of 2^-24 some hundred times as large."""


def drawn_points(scene: Scene, settings: DoubleFrustum, pixels: HogelPixels, triangle: Numbers) -> Floats:
    """Return surface points (H, W, 3) of triangle numbers (H, W), scene units; NaN where nothing is shown.

    Each lies where the line of the camera that drew it meets the plane of its triangle. Of several cameras
    between whose ends that is, the one drawn last shows.
    """
    found = np.full((*triangle.shape, 3), np.nan)
    rows, columns = np.nonzero(triangle != NOTHING)
    if not len(rows):
        return found
    corners = scene.triangles[triangle[rows, columns]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    slack = HEIGHT_TOLERANCE * scene.frustum.longest_reach
    points = np.full((len(rows), 3), np.nan)
    across = _camera_lines(scene, settings, pixels.hogel_column, pixels.film_column, 0)
    down = _camera_lines(scene, settings, pixels.hogel_row, pixels.film_row, 1)
    for (x, dx, height, ends), (y, dy, _, _) in zip(across, down, strict=True):
        center = np.stack((x[columns], y[rows], np.full(len(rows), height)), axis=-1)
        direction = np.stack((dx[columns], dy[rows], np.full(len(rows), -1.0)), axis=-1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            s = np.einsum("ij,ij->i", corners[:, 0] - center, normal)
            s /= np.einsum("ij,ij->i", direction, normal)
            met = center + s[:, None] * direction
            drawn: Mask = (met[:, 2] >= ends[0] - slack) & (met[:, 2] <= ends[1] + slack)
        points[drawn] = met[drawn]
    found[rows, columns] = points
    return found


def _camera_lines(
    scene: Scene, settings: DoubleFrustum, hogel: Indices, pixel: Indices, axis: int
) -> list[tuple[Floats, Floats, float, tuple[float, float]]]:
    """Return for each camera in drawing order its place and slopes along an axis, its height and its ends."""
    used = np.unique(hogel[pixel >= 0]).tolist()
    lines: list[tuple[Floats, Floats, float, tuple[float, float]]] = []
    for number in used:
        aperture = scene.plate.aperture(*((number, 0) if axis == 0 else (0, number)))
        here = np.flatnonzero((hogel == number) & (pixel >= 0))
        for index, camera in enumerate(model_cameras(scene.frustum, aperture, settings)):
            pencil = camera.pencil
            if index == len(lines):
                none = np.full(len(hogel), np.nan)
                lines.append((none, none.copy(), pencil.center[2], camera.heights))
            lines[index][0][here] = pencil.center[axis]
            lines[index][1][here] = (pencil.dx, pencil.dy)[axis][pixel[here]]
    return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnHogel:
    """The image of one hogel by any renderer; None for what it does not say."""

    index: tuple[int, int]  #: column and row on the plate
    color: NDArray[Any] | None = None  #: (H, W, 3) linear RGB; integers of 8 bits are 255 times the radiance
    triangle: Numbers | None = None
    object: Numbers | None = None
    position: NDArray[np.floating] | None = None  #: (H, W, 3) surface points, scene units


class Collector:
    """What one eye is shown of its pixels of hogels, filled in hogel by hogel.

    `settings` are those of the cameras that drew the hogels, by which a triangle's pixel has its surface
    point; None where they are not known.
    """

    def __init__(self, scene: Scene, eye: Eye, taken: Replay, settings: DoubleFrustum | None) -> None:
        self._scene, self._eye, self._taken, self._settings = scene, eye, taken, settings
        width, height = eye.resolution
        self._triangle = np.full((height, width), NOTHING, dtype=np.int32)
        self._object = self._triangle.copy()
        self._position = np.full((height, width, 3), np.nan)
        self._color = np.zeros((height, width, 3))
        self._colored = False
        self.numbered = False  # whether any hogel said which triangle or object its pixels show

    def add(self, hogel: DrawnHogel) -> None:
        """Take the pixels of a hogel that the eye is shown."""
        here, there = _blocks(self._taken.shown, hogel.index)
        if hogel.triangle is not None:
            self._triangle[here] = hogel.triangle[there]
            self.numbered = True
        if hogel.object is not None:
            self._object[here] = hogel.object[there]
            self.numbered = True
        if hogel.position is not None:
            self._position[here] = hogel.position[there]
        if hogel.color is not None:
            self._colored = True
            scale = 1 / LEVELS if hogel.color.dtype == np.uint8 else 1.0
            for pixels in self._taken.colors:
                here, there = _blocks(pixels, hogel.index)
                weight = pixels.row_weight[here[0]] * pixels.column_weight[here[1]]
                self._color[here] += (scale * weight)[..., None] * hogel.color[there].astype(np.float64)

    def finish(self) -> EyeImage:
        """Return the picture of all hogels that were added."""
        known = np.append(self._scene.object_of_triangle, np.int32(NOTHING))
        named = self._triangle != NOTHING
        self._object[named] = known[self._triangle[named]]
        position: Floats = self._position
        if self._settings is not None:
            points = drawn_points(self._scene, self._settings, self._taken.shown, self._triangle)
            position = np.where(np.isfinite(position), position, points)
        return EyeImage(
            eye=self._eye,
            triangle=self._triangle,
            object=self._object,
            position=position,
            color=self._color.astype(np.float32) if self._colored else None,
        )


def _blocks(
    pixels: HogelPixels, index: tuple[int, int]
) -> tuple[tuple[Indices, Indices], tuple[Indices, Indices]]:
    """Return the places of a hogel's pixels in the eye's picture, and in the hogel's."""
    rows = np.flatnonzero((pixels.hogel_row == index[1]) & (pixels.film_row >= 0))
    columns = np.flatnonzero((pixels.hogel_column == index[0]) & (pixels.film_column >= 0))
    return (rows[:, None], columns[None]), (pixels.film_row[rows][:, None], pixels.film_column[columns][None])


def collected(hogels: Iterable[DrawnHogel], collectors: Sequence[Collector]) -> list[EyeImage]:
    """Return the pictures of some eyes, each hogel looked at once."""
    for hogel in hogels:
        for collector in collectors:
            collector.add(hogel)
    return [collector.finish() for collector in collectors]


def hogels_of(takes: Iterable[Replay]) -> list[tuple[int, int]]:
    """Return column and row of all hogels that any of some eyes is shown, row by row."""
    every = {index for taken in takes for index in taken.hogels}
    return sorted(every, key=lambda index: (index[1], index[0]))


def film_parts(takes: Iterable[Replay]) -> dict[tuple[int, int], FilmPart]:
    """Return the part of each hogel's film that holds all pixels that some eyes are shown."""
    columns: dict[int, tuple[int, int]] = {}
    rows: dict[int, tuple[int, int]] = {}
    every = list(takes)
    for pixels in (pixels for taken in every for pixels in (taken.shown, *taken.colors)):
        _widen(columns, pixels.hogel_column[pixels.columns], pixels.film_column[pixels.columns])
        _widen(rows, pixels.hogel_row[pixels.rows], pixels.film_row[pixels.rows])
    return {(i, j): FilmPart(columns=columns[i], rows=rows[j]) for i, j in hogels_of(every)}


def _widen(ranges: dict[int, tuple[int, int]], hogel: Indices, pixel: Indices) -> None:
    for number in np.unique(hogel).tolist():
        here = pixel[hogel == number]
        low, high = ranges.get(number, (int(here[0]), int(here[0])))
        ranges[number] = min(low, int(here.min())), max(high, int(here.max()))


def drawn_hogels(renderer: PlateRenderer, parts: Mapping[tuple[int, int], FilmPart]) -> Iterator[DrawnHogel]:
    """Draw parts of hogels and yield them in order; pixels outside of the parts mean nothing."""
    plate = renderer.scene.plate
    for hogel in renderer.hogels((plate.aperture(*index) for index in parts), parts):
        yield DrawnHogel(index=hogel.aperture.index, color=hogel.color, triangle=hogel.triangle)
