"""Comparison of truths by direction with truths by hogels, and with integers.

A tile of hogels is traced hogel by hogel, and some of its pixels are traced by direction as well.
All bits must be equal, and the integer arithmetic must give the same result for every line. Half of
the pixels are spread over the film. The other half are pixels that needed exact arithmetic in the
aperture's own hogel: ties, edges, close surfaces.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from xfrustum.compare.selfcheck.comparison import Disagreement, ImageLines, disagreements
from xfrustum.compare.selfcheck.rational import ExactRows, first_on_lines
from xfrustum.reference import Reference
from xfrustum.reference.lines import PixelLines, TileLines
from xfrustum.scenes import Aperture, Scene
from xfrustum.scenes.arrays import Mask
from xfrustum.scenes.model.images import Certainty, DirectionImage, HogelImage
from xfrustum.scenes.plate import PlateTile

TILE = (5, 3)  #: largest numbers of columns and rows of hogels about an aperture

DIRECTIONS, QUICK_DIRECTIONS = 12, 3
"""Largest number of pixels per scene that are spread over the film, and of open pixels."""

CHANNELS = ("triangle", "position", "normal", "certainty")
"""Arrays that must be equal, bit by bit, by direction and by hogel."""


@dataclass(frozen=True, kw_only=True)
class DirectionCheck:
    """Comparison of images by direction of one tile."""

    scene: str
    columns: tuple[int, int]  #: first and last column of the tile
    rows: tuple[int, int]
    directions: int  #: number of images
    pixels: int
    open: int  #: pixels that the filter did not prove: decided exactly, or ties
    differing: int  #: pixels whose bits differ from the images of their hogels
    wrong: int  #: pixels with another result in integer arithmetic
    disagreements: tuple[Disagreement, ...]  #: the first few; rows and columns are hogels
    seconds: float


def check_directions(
    name: str, scene: Scene, aperture: Aperture, reference: type[Reference], *, quick: bool
) -> DirectionCheck:
    """Compare images by direction of a tile with its hogels and with integer arithmetic."""
    started = time.perf_counter()
    tile = _tile_about(aperture, scene)
    truth = reference(scene)
    hogels = [
        [truth.trace(scene.plate.aperture(column, row), colored=False) for column in tile.columns]
        for row in tile.rows
    ]
    own = hogels[tile.rows.index(aperture.row)][tile.columns.index(aperture.column)]
    pixels = _pixels(own, QUICK_DIRECTIONS if quick else DIRECTIONS)
    lines = TileLines(scene.frustum, tile)
    listed: list[Disagreement] = []
    compared, still_open, differing, wrong = 0, 0, 0, 0
    for image in truth.by_directions(tile, pixels, colored=False):
        grid = lines.of_pixel(image.pixel)
        exact = _turned(first_on_lines(scene.triangles, grid), grid)
        disagree, described = disagreements(image, exact, _image_lines(grid), scene.triangles)
        compared += image.triangle.size
        still_open += int(np.count_nonzero(image.certainty != Certainty.PROVEN))
        differing += int(np.count_nonzero(differs(image, hogels)))
        wrong += int(np.count_nonzero(disagree))
        listed += described
    return DirectionCheck(
        scene=name,
        columns=(tile.columns[0], tile.columns[-1]),
        rows=(tile.rows[0], tile.rows[-1]),
        directions=len(pixels),
        pixels=compared,
        open=still_open,
        differing=differing,
        wrong=wrong,
        disagreements=tuple(listed[:5]),
        seconds=time.perf_counter() - started,
    )


def differs(image: DirectionImage, hogels: Sequence[Sequence[HogelImage]]) -> Mask:
    """Return the hogels (rows, columns) whose pixel differs in a bit from an image by direction."""
    place = image.pixel[::-1]
    mask = np.zeros(image.triangle.shape, dtype=np.bool_)
    tied = {tuple(hogel): set[int]() for hogel in image.tied_triangles[:, :2].tolist()}
    for row, column, triangle in image.tied_triangles.tolist():
        tied[row, column].add(triangle)
    for (row, column), _ in np.ndenumerate(mask):
        hogel = hogels[row][column]
        assert hogel.tied_triangles is not None
        here = (hogel.tied_triangles[:, :2] == place).all(axis=1)
        mask[row, column] = set(hogel.tied_triangles[here, 2].tolist()) != tied.get(
            (row, column), set()
        ) or any(
            # As bytes, -0 and 0 differ, and a NaN equals itself.
            getattr(image, name)[row, column].tobytes() != getattr(hogel, name)[place].tobytes()
            for name in CHANNELS
        )
    return mask


def _tile_about(aperture: Aperture, scene: Scene) -> PlateTile:
    """Return the tile around an aperture, shifted or cut to lie within the plate."""
    ranges = []
    for at, size, hogels in zip(aperture.index, TILE, scene.plate.hogels, strict=True):
        count = min(size, hogels)
        first = min(max(at - size // 2, 0), hogels - count)
        ranges.append(range(first, first + count))
    return PlateTile(plate=scene.plate, columns=ranges[0], rows=ranges[1])


def _pixels(image: HogelImage, count: int) -> list[tuple[int, int]]:
    """Return up to `count` pixels (column, row) spread over a film, and up to `count` open ones."""
    assert image.certainty is not None
    numbers = []
    for some in (np.arange(image.triangle.size), np.flatnonzero(image.certainty)):
        step = len(some) / max(count, 1)
        # The middles of equal parts.
        places = ((np.arange(min(count, len(some))) + 0.5) * max(step, 1.0)).astype(np.int64)
        numbers += some[places].tolist()
    width = image.triangle.shape[1]
    return [divmod(number, width)[::-1] for number in dict.fromkeys(numbers)]


def _turned(exact: ExactRows, lines: PixelLines) -> ExactRows:
    """Return results in the order of the tile; lines are in this order or reversed."""
    if lines.step > 0:
        return exact
    width, height = lines.resolution
    ties = exact.ties.copy()
    ties[:, :2] = [height - 1, width - 1] - ties[:, :2]
    return ExactRows(triangle=exact.triangle[::-1, ::-1], s=exact.s[::-1, ::-1], ties=ties)


def _image_lines(lines: PixelLines) -> ImageLines:
    turned = (slice(None, None, lines.step),) * 2
    return ImageLines(points=lines.points()[turned], directions=lines.directions()[turned])
