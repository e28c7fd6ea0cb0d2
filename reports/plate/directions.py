"""Plates by directions, and the choice between drawing by directions and by hogels.

Each image by direction has one pixel of all hogels of a tile. A tile is as large as memory permits.
A block of work is a rectangle of pixels of a tile and fills whole shards, so that every file is
written once and no data are transposed on the disk. A block is finished when all its files exist.
The arrays are the same as by hogels. `plan` and `cost` print error and time of both ways, or the
reason against directions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import groupby, islice
from pathlib import Path
from typing import Any

from xfrustum.compare.planning.ways import (
    COMPARED_PASSES,
    COMPARED_SIDE,
    DirectionErrors,
    WaySpeeds,
    direction_errors,
    measure_plate,
    spread_pixels,
    tile_about,
)
from xfrustum.raster.plate.directions import DirectionRenderer, Pixel
from xfrustum.raster.plate.renderer import plate_direction
from xfrustum.reference import Reference
from xfrustum.reports.blocks import open_workers
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.common.templates_environment import sentence
from xfrustum.reports.plate.arrays import LAYOUT, Block, PlateArrays, Tile, description_of
from xfrustum.reports.plate.plate import (
    MOST_WORKERS,
    PlateFiles,
    PlateOptions,
    PlateSession,
    StoreJob,
    arrays_of,
    damage_notes,
    described_as,
    filled,
)
from xfrustum.reports.plate.store import open_store
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Scene
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.disk import in_words
from xfrustum.scenes.model.effects import needed
from xfrustum.scenes.model.images import Channel, PlateContent, PlateDirection
from xfrustum.scenes.plate import DepthFormat, PlateTile

#: default memory for the images of a tile, bytes
MEMORY = 1 << 30
#: largest number of columns and of rows of a tile: the image size that OpenGL 4.5 guarantees
MAX_SIDE = 1 << 14
#: Working memory of an image, bytes per hogel of the tile. A drawn image has attachments and
#: read-back of two rounds; a traced image has positions, normals, colors and error bounds.
DRAWN_BYTES, TRACED_BYTES = 100, 400


def arrays_by_directions(
    scene: Scene,
    content: PlateContent,
    block: tuple[int, int] | None,
    memory: int,
    *,
    drawn: bool,
) -> PlateArrays:
    """Return the arrays of a new store by directions; parameters as for `write_directions`.

    Tiles consist of whole shards. Two blocks of pixels fit into the memory, because a block is
    written while the next is drawn. Raises InputError if the memory is too small for a tile, or a
    shard is too large.
    """
    arrays = arrays_of(scene, content, block, directions=True)
    (columns, rows), (width, height) = arrays.plate.hogels, arrays.side
    if max(width, height) > MAX_SIDE:
        raise InputError(
            f"--block {width}x{height}: a tile has at most {MAX_SIDE:,} columns and rows of "
            "hogels; give a smaller --block"
        )
    assert arrays.film is not None
    share = math.prod(arrays.film) / math.prod(arrays.frustum.resolution)
    hogel_bytes = 2 * arrays.hogel_bytes * share + (DRAWN_BYTES if drawn else TRACED_BYTES)
    room = int(memory / hogel_bytes)
    if room < width * height:
        raise InputError(
            f"--memory {in_words(memory)}: a tile of {width} x {height} hogels takes "
            f"{in_words(int(width * height * hogel_bytes))}; give more, or a smaller --block"
        )

    def longest(count: int, side: int, most: int) -> int:
        return count if count <= most else most // side * side

    across = longest(columns, width, min(MAX_SIDE, room // height))
    down = longest(rows, height, min(MAX_SIDE, room // across))
    return replace(arrays, tile=(across, down))


def blocks_by_directions(arrays: PlateArrays) -> Iterator[Block]:
    """Yield the blocks of a plate, tile by tile."""
    assert arrays.film is not None and arrays.tile is not None
    number = itertools.count()
    for rows, columns in _rectangles(arrays.plate.hogels, arrays.tile):
        for down, across in _rectangles(arrays.frustum.resolution, arrays.film):
            yield Block(number=next(number), columns=columns, rows=rows, film=(across, down))


def _rectangles(counts: tuple[int, int], sides: tuple[int, int]) -> Iterator[tuple[range, range]]:
    """Yield rows and columns of rectangles that fill (columns, rows), row by row."""
    across, down = (
        [range(first, min(first + side, count)) for first in range(0, count, side)]
        for count, side in zip(counts, sides, strict=True)
    )
    return itertools.product(down, across)


@dataclass(frozen=True, kw_only=True)
class DirectionSource:
    """Renderer of images by direction."""

    #: function that yields images of pixels of a tile, in order
    images: Callable[[PlateTile, Iterable[Pixel]], Iterator[PlateDirection]]
    #: all inputs that determine the pixels
    description: dict[str, Any]

    def tiles(
        self, blocks: Iterable[Block], arrays: PlateArrays, done: Callable[[int], object]
    ) -> Iterator[Tile]:
        """Yield the images of blocks; `done` takes the number of new images."""
        for (columns, rows), some in groupby(blocks, lambda block: block.tile):
            tile = PlateTile(plate=arrays.plate, columns=columns, rows=rows)
            requested = ((block, block.pixels) for block in some)
            yield from filled(requested, arrays, partial(self.images, tile), done)


@contextmanager
def open_directions(
    scene: Scene, depth: DepthFormat | None, content: PlateContent, tile: PlateTile
) -> Iterator[DirectionSource]:
    """Open the rasterizer for a first tile; without a depth format open the reference."""
    colored = Channel.COLOR in content.channels
    if depth is None:
        reference = Reference(scene, effects=content.effects)

        def traced(tile: PlateTile, pixels: Iterable[Pixel]) -> Iterator[PlateDirection]:
            normals = Channel.NORMAL in content.channels
            images = reference.by_directions(tile, pixels, normals=normals, colored=colored)
            return (plate_direction(image, content) for image in images)

        effects = frozenset(reference.rendering().effects) & needed(scene)
        described = described_as(scene, content, "reference, certified", effects, None)
        yield DirectionSource(images=traced, description=described)
        return
    renderer = DirectionRenderer(scene, tile, content, depth)

    def drawn(tile: PlateTile, pixels: Iterable[Pixel]) -> Iterator[PlateDirection]:
        nonlocal renderer
        if tile != renderer.tile:
            renderer.release()
            renderer = DirectionRenderer(scene, tile, content, depth)
        return renderer.images(pixels)

    try:
        device = str(renderer.device["renderer"])
        described = described_as(scene, content, device, renderer.effects & needed(scene), None)
        described["directions"] = {"depth": depth.value}
        yield DirectionSource(images=drawn, description=described)
    finally:
        renderer.release()


@dataclass(frozen=True, kw_only=True)
class DirectionJob(StoreJob):
    """Plate that is drawn by directions; parameters as for `write_directions`."""

    unit = "view"
    depth: DepthFormat | None  #: depth format; None for truths

    def finished(self, block: Block) -> bool:
        """Return whether the store has a block."""
        return self.store.has_files(block)

    def size(self, block: Block) -> int:
        """Return the number of images of a block."""
        return len(block.pixels)

    @contextmanager
    def open(self) -> Iterator[PlateSession]:
        """Open the renderer, and open or create the store; InputError if another device drew it."""
        # An existing store keeps its tiles; open the renderer with the first tile.
        stored = self.arrays.laid_out((description_of(self.out) or {}).get(LAYOUT)) or self.arrays
        first = next(blocks_by_directions(stored))
        tile = PlateTile(plate=stored.plate, columns=first.columns, rows=first.rows)
        with open_directions(self.scene, self.depth, self.options.content, tile) as source:
            free = self.options.block is None
            store = open_store(self.out, self.arrays, source.description, free=free)
            yield PlateSession(source, store)


def write_directions(
    scene: Scene,
    depth: DepthFormat | None,
    out: Path | str,
    options: PlateOptions | None = None,
    memory: int = MEMORY,
    begun: Callable[[], object] = lambda: None,
) -> PlateFiles:
    """Draw a whole plate by directions, or trace it with a depth of None; see `write_plate`.

    Parameters
    ----------
    memory
        Bytes for the images of a tile in each process; an existing plate keeps its tiles.

    Raises
    ------
    InputError
        As in `write_plate`; the content or the sampling has no images by direction; surfaces reach
        the screen of a recentered frustum; the memory is too small for a tile.
    """
    options, out = options or PlateOptions(), Path(out)
    if problem := no_directions(scene, options, drawn=depth is not None):
        raise InputError(problem)
    part, drawn = options.engine.part, depth is not None
    arrays = arrays_by_directions(scene, options.content, options.block, memory, drawn=drawn)
    job = DirectionJob(scene=scene, depth=depth, out=out, arrays=arrays, options=options)
    count = sum(1 for _ in islice(part.of(blocks_by_directions(arrays)), MOST_WORKERS))
    with open_workers(options.engine, count, draws=drawn) as workers:
        workers.ask(job, PlateSession.place)
        begun()
        store = job.store
        blocks = list(part.of(blocks_by_directions(store.arrays)))
        missing = [block for block in blocks if not store.has_files(block)]
        broken: dict[tuple[range, range], Any] = {}
        if options.check:
            for block in set(blocks).difference(missing):
                if (damaged := store.damaged(block)).any():
                    missing.append(block)
                    broken[block.tile] = broken.get(block.tile, False) | damaged
        missing.sort(key=lambda block: block.number)
        views, passes = (sum(map(job.size, some)) for some in (blocks, missing))
        with progress_bar(views, job.name, job.unit, shown=options.progress) as bar:
            if workers.count == 1 and not workers.elsewhere:
                bar.update(views - passes)
                workers.ask(job, PlateSession.draw, iter(missing), bar.update)
            else:
                workers.make(job, blocks, bar)
        # A process killed after its last block has not marked its hogels.
        last = {block.tile: block for block in blocks}
        finished_tiles = {tile for tile, block in last.items() if store.mark(block)}
    begun_tiles = {block.tile for block in missing}
    hogels, present = (
        sum(len(columns) * len(rows) for columns, rows in tiles)
        for tiles in (begun_tiles, finished_tiles - begun_tiles)
    )
    damaged_hogels = sum(int(hogel.sum()) for hogel in broken.values())
    return PlateFiles(
        out=out,
        drawn=hogels,
        present=present,
        damaged=damaged_hogels,
        notes=damage_notes(out, damaged_hogels),
        passes=passes,
        kept=views - passes,
        tiles=len(begun_tiles),
    )


def no_directions(scene: Scene, options: PlateOptions, *, drawn: bool) -> str:
    """Return the reason why a plate cannot be drawn or traced by directions; "" if it can."""
    channels = options.content.channels
    if options.judge:
        return "--judge compares hogels with their truths: add --by hogels and --near"
    if Channel.COLOR in channels and scene.sampling != Sampling():
        return (
            f"{scene.name}: has several samples a pixel, and images by direction have one: add "
            "--by hogels, or --supersample 1 --multisample 1 --aperture-samples 1"
        )
    if drawn and Channel.CERTAINTY in channels:
        return "certainty is the truth's alone: leave it out of the channels, or add --truth"
    if not drawn and scene.transport.simulated:
        return (
            "light paths are traced hogel by hogel: add --by hogels, or --no-shadows and the like"
        )
    return ""


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
    #: path of the Zarr group, which may exist
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


#: Images of the timed plates: color in the type that plates are stored in, and triangle numbers.
CONTENT = PlateContent(ids=True)


@dataclass(frozen=True, kw_only=True)
class DirectionsResult:
    """Measures of a plate drawn by directions: without a near plane, and without an offset."""

    #: both None if refused
    errors: DirectionErrors | None = None
    speeds: WaySpeeds | None = None
    #: reason why the scene cannot be drawn by directions; empty if it can
    refused: str = ""

    def summary(self) -> dict[str, Any]:
        """Return the JSON object."""
        speeds = self.speeds and {**asdict(self.speeds), "crossover_hogels": self.speeds.crossover}
        return {"refused": self.refused or None, "speeds": speeds}

    def words(self, scene: Scene) -> str:
        """Return the result for the plate of a scene, in one or two sentences."""
        hogels = math.prod(scene.plate.hogels)
        return sentence("ways.txt.j2", "by_directions", result=self, hogels=hogels)


def measure_directions(
    reference: Reference, apertures: Sequence[Aperture], settings: DoubleFrustum
) -> DirectionsResult:
    """Measure wrong surfaces around the worst of some apertures, and the speed of both ways.

    The two cameras are timed with `settings`.
    """
    scene = reference.scene
    pixels = spread_pixels(scene.frustum, COMPARED_PASSES)
    tiles = dict.fromkeys(tile_about(scene.plate, a, COMPARED_SIDE) for a in apertures)
    try:
        every = [direction_errors(reference, tile, pixels, DEPTH) for tile in tiles]
        errors = max(every, key=lambda some: some.fraction)
        speeds = measure_plate(scene, [settings], CONTENT).speeds
    except InputError as error:
        return DirectionsResult(refused=str(error))
    return DirectionsResult(errors=errors, speeds=speeds)
