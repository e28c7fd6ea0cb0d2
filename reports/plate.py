"""A plate as a stream: any of its apertures drawn into a store, a few at a time, and never twice."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from xfrustum.raster.plate_renderer import PlateRenderer
from xfrustum.reports.plate_store import PlateStore, open_store
from xfrustum.reports.progress import progress_bar
from xfrustum.reports.tables import json_ready
from xfrustum.scenes.double_frustum import DoubleFrustum
from xfrustum.scenes.effects import needed
from xfrustum.scenes.look import look_hash
from xfrustum.scenes.plate import Aperture, Plate
from xfrustum.scenes.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.scene import Scene

WRITTEN_BEHIND = 4
"""Hogels that may wait for the disk while others are drawn."""

Span = tuple[int, int] | None
"""First and last index; None for all."""


@dataclass(frozen=True, kw_only=True)
class PlateFiles:
    """What became of the apertures that were asked for.

    Attributes
    ----------
    out
        The Zarr group.
    drawn, found
        How many hogels were drawn, and how many had been finished before.
    """

    out: Path
    drawn: int
    found: int


def write_plate(
    scene: Scene,
    settings: DoubleFrustum,
    out: Path,
    apertures: Iterable[Aperture] | None = None,
    content: PlateContent | None = None,
    *,
    progress: bool = False,
) -> PlateFiles:
    """Draw apertures of a plate that have not been drawn yet, each into a chunk of its own.

    Killed at any moment it loses no finished hogel; called again it goes on with the others and ends
    with the bytes of a run that was not disturbed.

    Parameters
    ----------
    scene, settings
        What is drawn, and how.
    out
        Folder of a Zarr group, made where it does not exist.
    apertures
        In which order; None for the whole plate.
    content
        Type of color, whether triangle numbers come along, and what is simulated.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        See `PlateRenderer` and `open_store`.
    """
    content = content or PlateContent()
    chosen = list(dict.fromkeys(all_apertures(scene.plate) if apertures is None else apertures))
    with PlateRenderer(scene, settings, content) as renderer:
        description = described(renderer)
        store = open_store(out, scene, content, description)
        missing = [aperture for aperture in chosen if not store.finished(aperture)]
        found = len(chosen) - len(missing)
        with progress_bar(len(chosen), "plate", "hogel", shown=progress) as bar:
            bar.update(found)
            for _ in _written(renderer.hogels(missing), store):
                bar.update()
    return PlateFiles(out=out, drawn=len(missing), found=found)


def _written(hogels: Iterable[PlateHogel], store: PlateStore) -> Iterator[None]:
    """Write hogels while the next ones are drawn; yield once for each that is finished."""
    waiting: deque[Future[None]] = deque()
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="plate") as writer:
        for hogel in hogels:
            if len(waiting) == WRITTEN_BEHIND:
                yield waiting.popleft().result()
            waiting.append(writer.submit(store.write, hogel))
        while waiting:
            yield waiting.popleft().result()


def described(renderer: PlateRenderer) -> dict[str, Any]:
    """Return everything that decides a plate's pixels, as JSON: what must agree to go on with it."""
    scene = renderer.scene
    # More than the scene calls for changes no pixel.
    simulated = renderer.effects & needed(scene, renderer.settings.camera)
    ready: dict[str, Any] = json_ready(
        {
            "scene": {
                "name": scene.name,
                "source": scene.source,
                "units": scene.units,
                "hash": scene.content_hash,
                "look": look_hash(scene),
            },
            "plate": asdict(scene.plate),
            "frustum": asdict(scene.frustum),
            "settings": asdict(renderer.settings),
            "effects": sorted(simulated),
            "content": {"color": renderer.content.color, "ids": renderer.content.ids},
            "renderer": {"device": renderer.device["renderer"], "xfrustum": metadata.version("xfrustum")},
        }
    )
    return ready


def all_apertures(plate: Plate) -> Iterator[Aperture]:
    """Yield every aperture, row by row from the top left."""
    return blocks_of_apertures(plate, [(None, None)])


def blocks_of_apertures(plate: Plate, blocks: Sequence[tuple[Span, Span]]) -> Iterator[Aperture]:
    """Yield the apertures of some blocks, each row by row.

    Parameters
    ----------
    plate
        The plate.
    blocks
        Columns and rows of each.

    Raises
    ------
    InputError
        A block reaches beyond the plate.
    """
    for block in blocks:
        (left, right), (top, bottom) = (
            (0, count - 1) if span is None else span for span, count in zip(block, plate.hogels, strict=True)
        )
        # Both corners first: a mistake is not found in the middle of the work.
        plate.aperture(left, top), plate.aperture(right, bottom)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                yield plate.aperture(column, row)
