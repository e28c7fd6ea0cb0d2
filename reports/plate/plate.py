"""Plates drawn block by block into a store by one or several processes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib import metadata
from itertools import chain, islice
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import pyarrow as pa

from xfrustum.compare.comparison import ComparisonNumbers, transported
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame
from xfrustum.raster.plate.renderer import OneByOne, PlateRenderer, plate_hogel
from xfrustum.raster.rasterizer import normals_of
from xfrustum.reference import Reference
from xfrustum.reports.blocks import HERE, Engine, Job, open_workers
from xfrustum.reports.common.outputs import json_ready, progress_bar
from xfrustum.reports.common.records import columns_of
from xfrustum.reports.plate.arrays import (
    SHARD_HOGELS,
    SHARD_PIXELS,
    Block,
    JudgedPlateHogel,
    PlateArrays,
    Tile,
    default_side,
)
from xfrustum.reports.plate.store import SOURCE, PlateStore, open_store
from xfrustum.scenes import Certainty, DoubleFrustum, HogelImage, InputError
from xfrustum.scenes.appearance import Sampling
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, needed
from xfrustum.scenes.model.images import Channel, PlateContent, PlateDirection, PlateHogel
from xfrustum.scenes.model.scene import Scene, is_shaded, look_hash
from xfrustum.scenes.plate import Aperture, ApertureBlocks, Plate

Item = TypeVar("Item")


@dataclass(frozen=True, kw_only=True)
class PlateOptions:
    """Images, storage and work of a plate."""

    content: PlateContent = field(default_factory=PlateContent)
    #: columns and rows of hogels in a shard, 1 x 1 for chunks without shards. None selects the
    #: blocks of an existing store, else blocks of at most `BLOCK_BYTES`.
    block: tuple[int, int] | None = None
    #: whether to trace every hogel too, and store its measures as arrays
    judge: bool = False
    #: whether to read every stored hogel in full, and draw damaged hogels again
    check: bool = False
    engine: Engine = HERE
    #: whether to show a progress bar on standard error
    progress: bool = False


def measures(numbers: ComparisonNumbers) -> dict[str, float]:
    """Return the measures of a comparison by array name, NaN if undefined."""
    return {
        column.name: np.nan if column.values[0] is None else column.values[0]
        for column in columns_of(ComparisonNumbers, [numbers])
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    }


def measures_of(scene: Scene) -> dict[str, str]:
    """Return the unit of each measure of hogels; radiance only for scenes with an appearance."""
    numbers: dict[str, Any] = dict.fromkeys(ComparisonNumbers.__dataclass_fields__)
    numbers["certainty"] = {kind.name.lower(): 0 for kind in Certainty}
    units = {"height": scene.units, "displacement": "px"}
    return {
        name: units.get(name.partition("_")[0], "1")
        for name in measures(ComparisonNumbers(**numbers))
        if is_shaded(scene) or not name.startswith("radiance")
    }


@dataclass(frozen=True, kw_only=True)
class HogelSource:
    """Renderer of a plate, hogel by hogel."""

    #: function that yields hogels in the order of the apertures
    hogels: Callable[[Iterable[Aperture]], Iterator[PlateHogel]]
    #: all inputs that determine the pixels
    description: dict[str, Any]

    def tiles(
        self, blocks: Iterable[Block], arrays: PlateArrays, done: Callable[[int], object]
    ) -> Iterator[Tile]:
        """Yield the requested hogels of blocks; `done` takes the number of new hogels."""
        return filled(((block, block.apertures) for block in blocks), arrays, self.hogels, done)


class Source(Protocol):
    """Renderer of blocks of a plate."""

    def tiles(
        self, blocks: Iterable[Block], arrays: PlateArrays, done: Callable[[int], object]
    ) -> Iterator[Tile]:
        """Yield the images of blocks; `done` takes the number of new images."""


def filled(
    blocks: Iterable[tuple[Block, Sequence[Item]]],
    arrays: PlateArrays,
    images: Callable[[Iterable[Item]], Iterator[PlateHogel | PlateDirection]],
    done: Callable[[int], object],
) -> Iterator[Tile]:
    """Yield blocks with the images of their items (apertures or pixels).

    All blocks form one stream of items, so that the renderer is never idle between blocks.
    """
    # The renderer requests items ahead of time: their blocks wait here until the images arrive.
    begun: deque[tuple[Block, int]] = deque()

    def items() -> Iterator[Item]:
        for block, some in blocks:
            begun.append((block, len(some)))
            yield from some

    stream = iter(images(items()))
    for image in stream:
        # Images arrive in the order of requests: they belong to the oldest open block.
        block, count = begun.popleft()
        tile = Tile.empty(block, arrays)
        for some in chain([image], islice(stream, count - 1)):
            tile.put(some)
            done(1)
        yield tile


@contextmanager
def open_source(
    scene: Scene, settings: DoubleFrustum | None, content: PlateContent, *, judge: bool = False
) -> Iterator[HogelSource]:
    """Open the renderer of a plate: a rasterizer if settings are given, else the reference."""
    if settings is None:
        if judge:
            raise InputError(
                "--judge compares what is drawn with the truth: leave out --truth, or --judge"
            )
        yield _traced(scene, content)
        return
    # Drawn pixels have no proof of visibility.
    if Channel.CERTAINTY in content.channels:
        raise InputError(
            "certainty is the truth's alone: leave it out of the channels, or add --truth"
        )
    # Effects that the scene does not need would change no pixel.
    visible = needed(scene, question=Question(camera=settings.camera, settings=(settings,)))
    if not judge:
        # The plate renderer has one sample per pixel: finer sampling is drawn hogel by hogel.
        fine = scene.sampling != Sampling(aperture=scene.sampling.aperture)
        with (OneByOne if fine else PlateRenderer)(scene, settings, content) as drawing:
            device = str(drawing.device["renderer"])
            described = described_as(scene, content, device, drawing.effects & visible, settings)
            yield HogelSource(hogels=drawing.hogels, description=described)
        return
    # Raise InputError before the first block is written.
    settings.check_against(scene.frustum)
    with Evaluator(scene, effects=content.effects) as evaluator:
        evaluator.rasterizer.check_sampling(scene.sampling)
        effects = evaluator.rasterizer.effects_for(settings) & visible
        described = described_as(scene, content, evaluator.device["renderer"], effects, settings)
        # The key keeps a judged plate from continuing a plate without measures.
        described["content"]["judged"] = True
        hogels = partial(_judged, evaluator, content, settings)
        yield HogelSource(hogels=hogels, description=described)


def _traced(scene: Scene, content: PlateContent) -> HogelSource:
    """Return the source of certified truths; light paths give colors if the scene requests them."""
    by_paths = scene.transport.simulated
    tracer = "mitsuba" if by_paths else "embree"
    reference = Reference(scene, tracer=tracer, effects=content.effects)

    def colored(aperture: Aperture) -> HogelImage:
        # Light paths replace only the color; geometry comes from certified lines, one per pixel.
        image = reference.trace(aperture, Sampling())
        mean = transported(scene, aperture, scene.transport).mean
        return replace(image, color=mean.astype(np.float32))

    def hogels(apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        images = map(colored, apertures) if by_paths else reference.stream(apertures)
        return (plate_hogel(image, content) for image in images)

    effects = ALL_EFFECTS
    if not by_paths:
        effects = frozenset(reference.rendering().effects) & needed(scene)
    renderer = f"reference, {'colored by Mitsuba' if by_paths else 'certified'}"
    described = described_as(scene, content, renderer, effects, None)
    return HogelSource(hogels=hogels, description=described)


def _judged(
    evaluator: Evaluator,
    content: PlateContent,
    settings: DoubleFrustum,
    apertures: Iterable[Aperture],
) -> Iterator[PlateHogel]:
    """Draw and judge hogels; images are bitwise equal to a plate's without judging."""
    scene = evaluator.scene
    # Store color even if the scene has no colors to compare.
    request = FrameRequest(color=True, colored_truths=is_shaded(scene), radiance=is_shaded(scene))

    def stored(frame: JudgedFrame) -> JudgedPlateHogel:
        image = frame.image
        if Channel.NORMAL in content.channels:
            image = replace(image, normal=normals_of(scene, image.triangle))
        channels: dict[str, Any] = vars(plate_hogel(image, content))
        return JudgedPlateHogel(**channels, measures=measures(frame.comparison.numbers))

    with closing(evaluator.frames(apertures, [settings], request)) as frames:
        yield from map(stored, frames)


def described_as(
    scene: Scene,
    content: PlateContent,
    renderer: str,
    simulated: frozenset[Effect],
    settings: DoubleFrustum | None,
) -> dict[str, Any]:
    """Return all inputs that determine the pixels of hogels, in JSON types.

    Plates of truths have no `settings`. Plates with one sample per pixel, through the middle of the
    aperture, have no `sampling`. Plates without light paths have no `transport`.
    """
    sampling, transport = scene.sampling, scene.transport
    finer = {"supersample": sampling.supersample, "multisample": sampling.multisample}
    # Leave out defaults: equal content must have equal descriptions.
    finer = {name: samples for name, samples in finer.items() if samples > 1}
    described: dict[str, Any] = {
        "scene": {
            "name": scene.name,
            SOURCE: scene.source,
            "units": scene.units,
            "hash": scene.content_hash,
            "look": look_hash(scene),
        },
        "plate": scene.plate,
        "frustum": scene.frustum,
        "settings": settings,
        "effects": sorted(simulated),
        "content": {"color": content.color, "ids": content.ids},
        "renderer": {"device": renderer, "xfrustum": metadata.version("xfrustum")},
    }
    if content.channels != PlateContent(color=content.color, ids=content.ids).channels:
        described["content"]["channels"] = content.channels
    if sampling.aperture > 1 or finer:
        described["sampling"] = {"aperture": sampling.aperture, **finer}
    if settings is None and transport.simulated:
        names = ("shadows", "interreflection", "samples")
        described["transport"] = {name: getattr(transport, name) for name in names}
    return {key: value for key, value in json_ready(described).items() if value is not None}


#: first and last index; None for all
Span = tuple[int, int] | None
#: largest number of blocks that are counted to limit the number of processes
MOST_WORKERS = 1024


@dataclass(frozen=True, kw_only=True)
class PlateFiles:
    """Result of drawing some apertures of a plate."""

    out: Path
    #: number of drawn hogels
    drawn: int
    #: number of hogels that were already stored
    present: int
    #: number of drawn hogels that had been stored, but were damaged
    damaged: int
    #: sentences for the user
    notes: tuple[str, ...]
    #: number of images: drawn hogels, or views of a tile by direction
    passes: int
    #: number of images that were already stored
    kept: int
    #: number of drawn tiles, or of drawn blocks of hogels
    tiles: int


@dataclass(frozen=True, kw_only=True)
class StoreJob(Job):
    """Job of the blocks of a plate; each process opens the store."""

    name = "plate"
    scene: Scene
    out: Path
    arrays: PlateArrays
    options: PlateOptions

    @cached_property
    def store(self) -> PlateStore:
        """Store of the plate, opened by this process after a session has created it."""
        return PlateStore(self.out, self.arrays)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "store"}

    def words(self, block: Block) -> str:
        """Return the number of a block and its store."""
        return f"block {block.number} of {self.out}"


@dataclass(frozen=True, kw_only=True)
class PlateJob(StoreJob):
    """Plate that is drawn block by block; parameters as for `write_plate`."""

    settings: DoubleFrustum | None  #: None for truths

    def finished(self, block: Block) -> bool:
        """Return whether the store has all requested hogels of a block."""
        return not self.store.missing(block, check=self.options.check)[0]

    def size(self, block: Block) -> int:
        """Return the number of requested hogels of a block."""
        return len(block.apertures)

    @contextmanager
    def open(self) -> Iterator[PlateSession]:
        """Open the renderer, and open or create the store; InputError if another device drew it."""
        options = self.options
        with open_source(self.scene, self.settings, options.content, judge=options.judge) as source:
            free = options.block is None
            store = open_store(self.out, self.arrays, source.description, free=free)
            yield PlateSession(source, store, options.check)


@dataclass(frozen=True)
class PlateSession:
    """Renderer and store of a job in one process."""

    source: Source
    store: PlateStore
    check: bool = False

    def place(self) -> Path:
        """Return the folder of the store; the call ensures that the store is open."""
        return self.store.out

    def make(self, block: Block) -> None:
        """Draw the missing hogels of a block or, by directions, all of its pixels."""
        if block.film is None:
            missing = self.store.missing(block, check=self.check)[0]
            block = replace(block, apertures=missing)
        self.draw([block])

    def draw(
        self, blocks: Iterable[Block], done: Callable[[int], object] = lambda hogels: None
    ) -> None:
        """Draw blocks; each is written while the next one is drawn."""
        with ThreadPoolExecutor(1, thread_name_prefix="plate") as pool:
            writing = pool.submit(lambda: None)
            for tile in self.source.tiles(blocks, self.store.arrays, done):
                writing.result()
                writing = pool.submit(self.store.write, tile)
            writing.result()


def write_plate(
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path | str,
    apertures: Iterable[Aperture] | None = None,
    options: PlateOptions | None = None,
    begun: Callable[[], object] = lambda: None,
) -> PlateFiles:
    """Draw the missing hogels of a plate into its store, block by block, one shard per block.

    Without settings, truths are traced; without apertures, the whole plate is drawn. Blocks are
    drawn in the order of their apertures. A killed process loses no finished block: the next call
    draws the other blocks, and the arrays equal those from an undisturbed run. `begun` is called
    when the store is open, before the first hogel is drawn.

    Raises InputError as `open_source` and `open_store` do; also if the size of blocks is invalid,
    the scheduler does not respond, or the device of a worker differs from the plate's device.
    """
    options, out = options or PlateOptions(), Path(out)
    engine, part, check = options.engine, options.engine.part, options.check
    requested = scene.plate.apertures() if apertures is None else apertures
    if not isinstance(requested, ApertureBlocks):
        requested = list(dict.fromkeys(requested))
    arrays = arrays_of(scene, options.content, options.block, judged=options.judge)
    job = PlateJob(scene=scene, settings=settings, out=out, arrays=arrays, options=options)
    drawn = broken = tiles = 0
    count = sum(1 for _ in islice(part.of(arrays.blocks(requested)), MOST_WORKERS))
    with open_workers(engine, count, draws=settings is not None) as workers:
        workers.ask(job, PlateSession.place)
        begun()

        def blocks() -> Iterator[Block]:
            # Make a new iterator for each use: a plate has millions of hogels.
            return part.of(job.store.arrays.blocks(requested))

        def unfinished(done: Callable[[int], object] = lambda hogels: None) -> Iterator[Block]:
            nonlocal drawn, broken, tiles
            for some in blocks():
                missing, damaged = job.store.missing(some, check=check)
                drawn, broken = drawn + len(missing), broken + damaged
                done(len(some.apertures) - len(missing))
                tiles += bool(missing)
                if missing:
                    yield replace(some, apertures=missing)

        total = len(requested) if part.everything else sum(map(job.size, blocks()))
        with progress_bar(total, job.name, job.unit, shown=options.progress) as bar:
            if workers.count == 1 and not workers.elsewhere:
                workers.ask(job, PlateSession.draw, unfinished(bar.update), bar.update)
            else:
                deque(unfinished(), maxlen=0)
                workers.make(job, blocks(), bar)
    return PlateFiles(
        out=out,
        drawn=drawn,
        present=total - drawn,
        damaged=broken,
        notes=damage_notes(out, broken),
        passes=drawn,
        kept=total - drawn,
        tiles=tiles,
    )


def damage_notes(out: Path, hogels: int) -> tuple[str, ...]:
    """Return a sentence with the number of damaged hogels; empty without damage."""
    return (f"{out}: {hogels} damaged hogels were drawn again",) if hogels else ()


def arrays_of(
    scene: Scene,
    content: PlateContent,
    block: tuple[int, int] | None,
    *,
    judged: bool = False,
    directions: bool = False,
) -> PlateArrays:
    """Return the arrays of a new store; parameters as for `write_plate`."""
    columns, rows = scene.plate.hogels
    if block is not None and min(block) < 1:
        raise InputError(
            f"a block must have at least one column and one row, not {block[0]} x {block[1]}"
        )
    usual = SHARD_HOGELS if directions else default_side(scene.plate, scene.frustum, content)
    side = block or usual
    pixels = [min(most, n) for most, n in zip(SHARD_PIXELS, scene.frustum.resolution, strict=True)]
    return PlateArrays(
        plate=scene.plate,
        frustum=scene.frustum,
        units=scene.units,
        content=content,
        side=(min(side[0], columns), min(side[1], rows)),
        film=(pixels[0], pixels[1]) if directions else None,
        measures=tuple(measures_of(scene).items()) if judged else (),
    )


def blocks_of_apertures(plate: Plate, blocks: Sequence[tuple[Span, Span]]) -> ApertureBlocks:
    """Return the apertures of rectangles, given by columns and rows of the plate."""
    rectangles = []
    for block in blocks:
        spans = zip(block, plate.hogels, strict=True)
        (left, right), (top, bottom) = (
            (0, count - 1) if span is None else span for span, count in spans
        )
        # Refuse corners outside the plate here, before the work starts.
        plate.aperture(left, top), plate.aperture(right, bottom)
        rectangles.append((range(left, right + 1), range(top, bottom + 1)))
    return ApertureBlocks(plate, tuple(rectangles))
