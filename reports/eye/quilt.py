"""Quilts: what eyes on an arc before the plate see, as tiles of one picture for lenticular displays."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.eye.page import NAMES, images
from xfrustum.reports.eye.pictures import png, shown
from xfrustum.reports.eye.view import Source, ViewRecord, view
from xfrustum.scenes.arrays import Bytes
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.eye import Eye
from xfrustum.scenes.model.scene import Scene

CONE_DEGREES = 40.0
"""Angle between the outermost views of a quilt, which is that of the displays that show quilts."""

MAX_TILES = 1 << 10
"""Largest number of tiles of a quilt."""

DATA = "view.json"


def quilt_eyes(eye: Eye, tiles: tuple[int, int]) -> tuple[Eye, ...]:
    """Return the eyes of a quilt, from the left: on a line parallel to the plate, at equal steps of angle.

    The given eye is in the middle. InputError where there are no tiles, columns by rows, or too many.
    """
    count = tiles[0] * tiles[1]
    if min(tiles) < 1 or count > MAX_TILES:
        raise InputError(f"a quilt needs 1 to {MAX_TILES} tiles, such as 8x6, not {tiles[0]}x{tiles[1]}")
    x, y, height = eye.position
    turns = [0.0] if count == 1 else [number / (count - 1) - 0.5 for number in range(count)]
    shifts = [height * math.tan(math.radians(CONE_DEGREES) * turn) for turn in turns]
    return tuple(replace(eye, position=(x + shift, y, height)) for shift in shifts)


def quilt_names(scene: Scene, tiles: tuple[int, int], *, drawn: bool) -> tuple[str, ...]:
    """Return the names of a quilt's files: columns, rows and the aspect of a tile are in them."""
    aspect = scene.plate.size[0] / scene.plate.size[1]
    pictures = list(NAMES)[: 3 if drawn else 2]
    return (DATA, *(f"{name}_qs{tiles[0]}x{tiles[1]}a{aspect:.4g}.png" for name in pictures))


def write_quilt(  # noqa: PLR0913 - one parameter per option of the command
    scene: Scene,
    eye: Eye,
    tiles: tuple[int, int],
    source: Source | None,
    out: Path,
    *,
    effects: frozenset[Effect] | None = None,
    progress: bool = False,
) -> ViewRecord:
    """Write quilts of the scene, of its replayed truth and of a renderer's hogels, and their numbers.

    Each row of tiles is made by itself, so that memory does not grow with the number of rows. See `view`.
    """
    eyes, names = quilt_eyes(eye, tiles), quilt_names(scene, tiles, drawn=source is not None)
    with Staging(out, names) as staging:
        # Rows of tiles by picture: the first tile is at the bottom left, then to the right, then up.
        rows: dict[str, list[Bytes]] = {}
        records = []
        for first in range(0, len(eyes), tiles[0]):
            some = eyes[first : first + tiles[0]]
            found = view(scene, some, source, effects=effects, progress=progress)
            records.append(found.record)
            tiled = [images(found, number) for number in range(len(some))]
            for name in tiled[0]:
                row = np.concatenate([shown(tile[name]) for tile in tiled], axis=1)
                rows.setdefault(name, []).append(row)
        for name, file in zip(rows, names[1:], strict=True):
            (staging.folder / file).write_bytes(png(np.concatenate(rows[name][::-1], axis=0)))
        record = replace(
            records[0],
            eyes=tuple(one for part in records for one in part.eyes),
            hogels=max(part.hogels for part in records),
        )
        write_json(staging.folder / DATA, record)
        staging.commit()
    return record
