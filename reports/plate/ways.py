"""Choice between drawing a plate by directions or by hogels; the arrays are the same."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from xfrustum.reports.plate.arrays import LAYOUT, description_of
from xfrustum.reports.plate.directions import arrays_by_directions, no_directions
from xfrustum.reports.plate.plate import PlateOptions
from xfrustum.scenes import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate import DepthFormat

#: depth format by directions unless another is chosen
DEPTH = DepthFormat.D32F


class By(StrEnum):
    """Unit of the images of a plate."""

    AUTO = "auto"
    DIRECTIONS = "directions"
    HOGELS = "hogels"


@dataclass(frozen=True, kw_only=True)
class Request:
    """Facts that determine the way to draw or trace a plate."""

    by: By
    #: place of the Zarr group, which may exist
    out: Path
    options: PlateOptions
    truth: bool
    #: whether the two cameras are given (--near)
    near: bool
    #: whether only some hogels are requested
    some: bool
    #: memory for a tile, bytes, > 0
    memory: int


def choose(scene: Scene, request: Request) -> tuple[By, str]:
    """Return the way to draw or trace a plate, and the reason as a sentence, "" for none.

    Raises InputError if the requested way contradicts other options or the existing plate.
    """
    problem = _contradiction(scene, request)
    stored = _stored_way(request.out)
    if request.by is By.HOGELS or request.near:
        chosen, reason = By.HOGELS, ""
    elif request.by is By.DIRECTIONS or not request.truth:
        if problem:
            raise InputError(problem)
        (columns, rows), (width, height) = scene.plate.hogels, scene.frustum.resolution
        chosen, reason = (
            By.DIRECTIONS,
            f"which need no near: {width * height:,} views of all hogels",
        )
        if width * height > columns * rows:
            reason += f"; --near draws {columns * rows:,} hogels instead, and plan times both"
    elif problem:
        chosen, reason = By.HOGELS, ""
    elif stored is not None:
        chosen, reason = stored, f"as {request.out} was begun"
    else:
        chosen, reason = _faster(scene, request)
    if stored not in (None, chosen):
        raise InputError(
            f"--out {request.out}: was begun by {stored}: add --by {stored}, or choose another "
            "place"
        )
    return chosen, f"by {chosen}, {reason}" if reason and request.by is By.AUTO else ""


def _contradiction(scene: Scene, request: Request) -> str:
    """Return the reason why directions are impossible, or ""."""
    if request.near:
        return "--near places two cameras, and --by directions has none: leave out one of them"
    if request.some:
        return "--by directions draws whole plates: leave out --apertures, or add --by hogels"
    return no_directions(scene, request.options, drawn=not request.truth)


def _stored_way(out: Path) -> By | None:
    description = description_of(out)
    if description is None:
        return None
    layout = description.get(LAYOUT)
    return By.DIRECTIONS if isinstance(layout, dict) and "film" in layout else By.HOGELS


def _faster(scene: Scene, request: Request) -> tuple[By, str]:
    """Return the faster way to trace truths.

    Each image takes a fixed time and a time per triangle; the time of pixels is the same both ways.
    So the way with fewer images is faster.
    """
    options = request.options
    arrays = arrays_by_directions(
        scene, options.content, options.block, request.memory, drawn=False
    )
    assert arrays.tile is not None
    (columns, rows), (width, height) = scene.plate.hogels, scene.frustum.resolution
    tiles = -(-columns // arrays.tile[0]) * -(-rows // arrays.tile[1])
    views, hogels = width * height * tiles, columns * rows
    chosen = By.DIRECTIONS if views < hogels else By.HOGELS
    return (
        chosen,
        f"for {views:,} views of a tile stand beside {hogels:,} hogels, and fewer are faster",
    )
