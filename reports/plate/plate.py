"""Plates drawn block by block into a store, by this process or by others, and never twice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path

from xfrustum.reports.blocks import HERE, Engine, Job, open_workers
from xfrustum.reports.common.outputs import progress_bar
from xfrustum.reports.plate.sources import HogelSource, measures_of, source_of
from xfrustum.reports.plate.store import Block, Layout, PlateStore, default_side, open_store
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.model.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks, Plate

Span = tuple[int, int] | None  # first and last index; None for all
MOST_WORKERS = 1024  # number of blocks from which on they do not bound the number of processes


@dataclass(frozen=True, kw_only=True)
class PlateFiles:
    """What became of the apertures that were asked for."""

    out: Path
    drawn: int  # hogels
    found: int  # hogels that were there
    damaged: int  # of those that were drawn: they had been there, and were not whole
    notes: tuple[str, ...]  # say so in sentences
    table: Path | None = None  # folder of the table of measures, where hogels are judged


@dataclass(frozen=True, kw_only=True)
class PlateJob(Job):
    """A plate that is drawn block by block; parameters as for `write_plate`. Settings are None for truths."""

    name = "plate"
    scene: Scene
    settings: DoubleFrustum | None
    content: PlateContent
    out: Path
    layout: Layout
    free: bool
    judge: bool
    check: bool

    def finished(self, block: Block) -> bool:
        """Return whether all hogels of a block that are asked for are there."""
        return not _opened(self.out, self.layout).missing(block, check=self.check)[0]

    def size(self, block: Block) -> int:
        """Return the number of hogels of a block that are asked for."""
        return len(block.apertures)

    def words(self, block: Block) -> str:
        """Return a block in words."""
        return f"block {block.number} of {self.out}"

    @contextmanager
    def open(self) -> Iterator[PlateSession]:
        """Open what makes the hogels, and the store, or make it; a store of another device is refused."""
        with source_of(self.scene, self.settings, self.content, judge=self.judge) as source:
            store = open_store(self.out, self.layout, source.description, free=self.free)
            yield PlateSession(source, store, self.check)


_opened = lru_cache(1)(PlateStore)  # store of the last job, which this process asks about many blocks


@dataclass(frozen=True)
class PlateSession:
    """What draws the hogels of a job in one process, and where they go."""

    source: HogelSource
    store: PlateStore
    check: bool

    def layout(self) -> Layout:
        """Return the layout of the store; the question makes a worker open the store, or make it."""
        return self.store.layout

    def make(self, block: Block) -> None:
        """Draw what is missing of a block."""
        self.draw([replace(block, apertures=self.store.missing(block, check=self.check)[0])])

    def draw(self, blocks: Iterable[Block], done: Callable[[int], object] = lambda hogels: None) -> None:
        """Draw blocks as one stream of hogels; each block is written while the next one is drawn."""
        begun: deque[Block] = deque()

        def asked() -> Iterator[Aperture]:
            for block in blocks:
                begun.append(block)
                yield from block.apertures

        drawn: dict[Aperture, PlateHogel] = {}
        with ThreadPoolExecutor(1, thread_name_prefix="plate") as pool:
            writing = pool.submit(lambda: None)
            for hogel in self.source.hogels(asked()):
                drawn[hogel.aperture] = hogel
                if len(drawn) == len(begun[0].apertures):
                    writing.result()
                    writing, drawn = pool.submit(self.store.write, begun.popleft(), drawn), {}
                done(1)
            writing.result()


def write_plate(  # noqa: PLR0913 - one keyword for each option of the command
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path | str,
    apertures: Iterable[Aperture] | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
    check: bool = False,
    engine: Engine = HERE,
    progress: bool = False,
) -> PlateFiles:
    """Draw apertures of a plate that have not been drawn yet, block by block, each into a shard of its own.

    Without settings the plate is one of truths; without apertures, the whole one. Blocks are drawn in the
    order in which their apertures are named, by `engine`. Killed at any moment it loses no finished block;
    called again it goes on with the others and ends with the arrays of a run that was not disturbed.

    A `block` is the columns and rows of hogels that are stored together, 1 x 1 for chunks without shards;
    None for those of a store that exists, and for a new one as many as `BLOCK_BYTES` hold. `judge` says
    whether every hogel is traced too, and its measures are stored beside its pixels; `check`, whether every
    hogel that is there is read in full, and drawn again where it is damaged.

    InputError: see `source_of` and `open_store`; or the block is none, no scheduler answers, or a worker has
    another device than the one that began the plate.
    """
    content, out, part = content or PlateContent(), Path(out), engine.part
    asked = scene.plate.apertures() if apertures is None else apertures
    chosen = asked if isinstance(asked, ApertureBlocks) else list(dict.fromkeys(asked))
    layout = layout_of(scene, content, block, judged=judge)
    job = PlateJob(
        scene=scene,
        settings=settings,
        content=content,
        out=out,
        layout=layout,
        free=block is None,
        judge=judge,
        check=check,
    )
    drawn = broken = 0
    some = sum(1 for _ in islice(part.of(layout.blocks(chosen)), MOST_WORKERS))
    with open_workers(engine, some, draws=settings is not None) as workers:
        layout = workers.ask(job, PlateSession.layout)
        store = PlateStore(out, layout)

        def blocks() -> Iterator[Block]:
            # Made anew for each use: a plate has millions of hogels.
            return part.of(layout.blocks(chosen))

        def unfinished(done: Callable[[int], object] = lambda hogels: None) -> Iterator[Block]:
            nonlocal drawn, broken
            for one in blocks():
                missing, damaged = store.missing(one, check=check)
                drawn, broken = drawn + len(missing), broken + damaged
                done(len(one.apertures) - len(missing))
                if missing:
                    yield replace(one, apertures=missing)

        total = len(chosen) if part.everything else sum(len(one.apertures) for one in blocks())
        if workers.count == 1 and not workers.elsewhere:
            with progress_bar(total, job.name, job.unit, shown=progress) as bar:
                workers.ask(job, PlateSession.draw, unfinished(bar.update), bar.update)
        else:
            deque(unfinished(), maxlen=0)
            workers.run(job, blocks(), total, progress=progress)
    return PlateFiles(
        out=out,
        drawn=drawn,
        found=total - drawn,
        damaged=broken,
        notes=(f"{out}: {broken} damaged hogels were drawn again",) if broken else (),
        table=out.with_suffix(".parquet") if judge else None,
    )


def layout_of(
    scene: Scene, content: PlateContent, block: tuple[int, int] | None, *, judged: bool = False
) -> Layout:
    """Return the layout of a new store; parameters as for `write_plate`."""
    columns, rows = scene.plate.hogels
    if block is not None and min(block) < 1:
        raise InputError(f"a block must have at least one column and one row, not {block[0]} x {block[1]}")
    side = block or default_side(scene.plate, scene.frustum, content)
    return Layout(
        plate=scene.plate,
        frustum=scene.frustum,
        units=scene.units,
        content=content,
        side=(min(side[0], columns), min(side[1], rows)),
        measures=tuple(measures_of(scene).items()) if judged else (),
    )


def blocks_of_apertures(plate: Plate, blocks: Sequence[tuple[Span, Span]]) -> ApertureBlocks:
    """Return the apertures of some rectangles, each given by its columns and rows on the plate."""
    found = []
    for block in blocks:
        spans = zip(block, plate.hogels, strict=True)
        (left, right), (top, bottom) = ((0, count - 1) if span is None else span for span, count in spans)
        # Both corners first: a mistake is not found in the middle of the work.
        plate.aperture(left, top), plate.aperture(right, bottom)
        found.append((range(left, right + 1), range(top, bottom + 1)))
    return ApertureBlocks(plate, tuple(found))
