"""Choice between truths decided hogel by hogel and direction by direction, with the same bits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from enum import StrEnum

from xfrustum.reference import Reference
from xfrustum.reference.truth import TILE_PIXELS, tile_rows
from xfrustum.scenes.arguments import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import Aperture, ApertureBlocks, Plate, PlateTile


class TruthBy(StrEnum):
    """Order in which the pixels of truths are decided."""

    AUTO = "auto"
    """The order with fewer passes over the scene."""
    DIRECTIONS = "directions"
    """A pass for each pixel of a hogel, over all hogels of a tile."""
    HOGELS = "hogels"
    """A pass for each hogel."""


def chosen_order(
    order: TruthBy, scene: Scene, *, refusal: str = "", rows: int | None = None
) -> TruthBy:
    """Return the order, directions or hogels, for a plate that is judged in tiles of whole rows.

    `refusal` is the reason why hogels must be judged one by one, if there is one; `rows` is the
    caller's limit of rows in a tile. Raises InputError if `order` is DIRECTIONS and there is a
    refusal, or a row of hogels exceeds a tile.
    """
    columns, plate_rows = scene.plate.hogels
    pixels = math.prod(scene.frustum.resolution)
    if order is TruthBy.DIRECTIONS:
        if refusal:
            raise InputError(f"--truth-by directions {refusal}")
        if columns * pixels > TILE_PIXELS:
            raise InputError(
                f"--truth-by directions decides whole rows of hogels: {columns:,} hogels of "
                f"{pixels:,} pixels are more than the {TILE_PIXELS:,} pixels that are held at "
                "once; use hogels, or fewer pixels"
            )
    if refusal or columns * pixels > TILE_PIXELS:
        return TruthBy.HOGELS
    if order is not TruthBy.AUTO:
        return order
    rows = min(tile_rows(scene.frustum, columns), plate_rows, rows or plate_rows)
    # A tile takes a pass for each pixel of a hogel, or one for each of its hogels.
    return TruthBy.DIRECTIONS if rows * columns >= pixels else TruthBy.HOGELS


def row_tile(plate: Plate, first: int, stop: int) -> PlateTile:
    """Return the tile of whole rows of a plate, from `first` to before `stop`."""
    return PlateTile(plate=plate, columns=range(plate.hogels[0]), rows=range(first, stop))


def with_references(
    reference: Reference, order: TruthBy, apertures: Iterable[Aperture]
) -> Iterator[tuple[Aperture, Reference]]:
    """Yield apertures with the reference of their truths; by directions, all of the plate's."""
    if order is not TruthBy.DIRECTIONS:
        yield from ((aperture, reference) for aperture in apertures)
        return
    plate = reference.scene.plate
    size = tile_rows(reference.scene.frustum, plate.hogels[0])
    for first in range(0, plate.hogels[1], size):
        tile = row_tile(plate, first, min(first + size, plate.hogels[1]))
        decided = reference.with_tile(tile)
        for aperture in ApertureBlocks(plate, ((tile.columns, tile.rows),)):
            yield aperture, decided
