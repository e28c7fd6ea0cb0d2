"""A plate as a stream: any of its apertures drawn into a store, a few at a time, and never twice."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.plate.description import described, document_of
from xfrustum.reports.plate.layout import Block, BlockPart, Layout, default_side
from xfrustum.reports.plate.measures import JudgedSource, measures_of
from xfrustum.reports.plate.sources import Drawn, HogelSource, Truths
from xfrustum.reports.plate.store import Encoded, PlateStore, open_store
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.plate_content import PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture, Plate

MAX_WAITING_HOGELS = 4
"""Hogels that may wait to be compressed while others are drawn: several take it little longer than one."""

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
        Number of hogels that were drawn, and of those that had been finished before or by others meanwhile.
    damaged
        Number of drawn hogels that had been there, and were not whole.
    notes
        What was damaged and has been mended, in sentences.
    table
        Folder of the table of measures; None where hogels are not judged.
    """

    out: Path
    drawn: int
    found: int
    damaged: int
    notes: tuple[str, ...]
    table: Path | None = None


def write_plate(  # noqa: PLR0913 - one parameter per option of the command
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path | str,
    apertures: Iterable[Aperture] | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
    check: bool = False,
    progress: bool = False,
) -> PlateFiles:
    """Draw apertures of a plate that have not been drawn yet, block by block, each into a shard of its own.

    Killed at any moment it loses no finished block; called again it goes on with the others and ends
    with the bytes of a run that was not disturbed. Any number of processes may draw one plate at once:
    each block is drawn by one of them, and each ends when all that it was asked for is finished.

    Parameters
    ----------
    scene, settings
        Scene that is drawn, and settings of its cameras; None for a plate of truths.
    out
        Folder of a Zarr group, made where it does not exist.
    apertures
        Apertures, whose blocks are drawn in the order in which they are named; None for the whole plate.
    content
        Type of color, the images that are stored, and what is simulated.
    block
        Columns and rows of hogels that are stored together; None for those of a store that exists, and for a
        new one as many as `BLOCK_BYTES` hold. A block of one hogel is a chunk and no shard.
    judge
        Whether every hogel is traced too, and its measures are stored beside its pixels.
    check
        Whether to read through every hogel that is there; without it, only its layout is looked at. What
        is damaged is drawn again.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        See `source_of` and `open_store`, or the block is none.
    """
    content = content or PlateContent()
    with source_of(scene, settings, content, judge=judge) as source:
        store = opened_store(source, Path(out), block)
        asked = scene.plate.apertures() if apertures is None else apertures
        chosen = asked if isinstance(asked, ApertureBlocks) else list(dict.fromkeys(asked))
        with store.claims() as claims, progress_bar(len(chosen), "plate", "hogel", shown=progress) as bar:
            work = BlockWork(store=store, claims=claims, check=check, bar=bar)
            draw_parts(source, work, store.layout.parts(chosen))
    return work.files()


def opened_store(source: HogelSource, out: Path, block: tuple[int, int] | None) -> PlateStore:
    """Open the store of what a source draws, or make it; see `open_store` and `write_plate`."""
    layout = layout_of(source.scene, source.content, block, judged=source.judged)
    return open_store(out, layout, document_of(described(source)), free=block is None)


def source_of(
    scene: Scene, settings: DoubleFrustum | None, content: PlateContent, *, judge: bool = False
) -> HogelSource:
    """Return what makes the hogels of a scene: with settings they are drawn, without they are traced.

    Raises
    ------
    InputError
        Truths are to be judged; or see `Drawn` and `Truths`.
    """
    if settings is None:
        if judge:
            raise InputError("--judge compares what is drawn with the truth: leave out --truth, or --judge")
        return Truths(scene, content)
    return (JudgedSource if judge else Drawn)(scene, settings, content)


def layout_of(
    scene: Scene, content: PlateContent, block: tuple[int, int] | None, *, judged: bool = False
) -> Layout:
    """Return the layout of a new store; parameters as for `write_plate`."""
    return Layout(
        plate=scene.plate,
        frustum=scene.frustum,
        units=scene.units,
        content=content,
        side=_side(scene, content, block),
        measures=tuple(measures_of(scene).items()) if judged else (),
    )


def _side(scene: Scene, content: PlateContent, block: tuple[int, int] | None) -> tuple[int, int]:
    """Return the columns and rows of a block of a new store."""
    if block is None:
        return default_side(scene.plate, scene.frustum, content)
    if min(block) < 1:
        raise InputError(f"a block must have at least one column and one row, not {block[0]} x {block[1]}")
    columns, rows = scene.plate.hogels
    return min(block[0], columns), min(block[1], rows)


def draw_parts(source: HogelSource, work: BlockWork, parts: Iterable[BlockPart]) -> None:
    """Draw what is missing of some blocks, and wait for what other processes are drawing of them."""
    waiting = parts
    while True:
        _draw(source.hogels(work.taken(waiting)), work)
        waiting, work.elsewhere = work.elsewhere, []
        if not waiting:
            return
        # Nothing of ours is under way: others may be waited for, as they wait for nobody.
        work.claims.wait(waiting[0].block.number)


@dataclass(kw_only=True)
class OpenBlock:
    """A block that this process is drawing: the hogels that are still to come, and those that are there."""

    block: Block
    missing: set[Aperture]
    encoded: dict[Aperture, Encoded] = field(default_factory=dict)


@dataclass(kw_only=True)
class BlockWork:
    """Which blocks this process draws, and what became of their hogels.

    Attributes
    ----------
    store, claims, check, bar
        The store, claims to its blocks, whether finished hogels are read, and the bar.
    elsewhere
        Blocks that another process is drawing.
    drawn, found, damaged
        As in `PlateFiles`.
    """

    store: PlateStore
    claims: Claims
    bar: tqdm[Any]
    check: bool = False
    elsewhere: list[BlockPart] = field(default_factory=list)
    drawn: int = 0
    found: int = 0
    damaged: int = 0
    _open: dict[int, OpenBlock] = field(default_factory=dict)

    def taken(self, parts: Iterable[BlockPart]) -> Iterator[Aperture]:
        """Claim the blocks that nobody else is drawing, and yield their hogels that are not finished."""
        for part in parts:
            if not self.store.state(part, check=self.check).missing:
                self._count_found(part, 0)
                continue
            if not self.claims.take(part.block.number):
                self.elsewhere.append(part)
                continue
            # Another process that claimed it before may have finished it since.
            state = self.store.state(part, check=self.check)
            self.damaged += len(state.damaged)
            self._count_found(part, len(state.missing))
            if not state.missing:
                self.claims.release(part.block.number)
                continue
            self._open[part.block.number] = OpenBlock(block=part.block, missing=set(state.missing))
            yield from state.missing

    def keep(self, aperture: Aperture, encoded: Encoded) -> OpenBlock | None:
        """Keep a hogel, and return its block if it was the last one that was missing."""
        being_drawn = self._open[self.store.layout.block_of(aperture)]
        being_drawn.encoded[aperture] = encoded
        being_drawn.missing.remove(aperture)
        self.bar.update()
        return None if being_drawn.missing else being_drawn

    def finished(self, full: OpenBlock) -> None:
        """Count the hogels of a block that has been written."""
        self.claims.release(full.block.number)
        del self._open[full.block.number]
        self.drawn += len(full.encoded)

    def files(self) -> PlateFiles:
        """Return what became of the hogels."""
        return PlateFiles(
            out=self.store.out,
            drawn=self.drawn,
            found=self.found,
            damaged=self.damaged,
            notes=tuple(notes_of(self.store, self.damaged)),
            table=self.store.out.with_suffix(".parquet") if self.store.layout.measures else None,
        )

    def _count_found(self, part: BlockPart, missing: int) -> None:
        self.found += len(part.apertures) - missing
        self.bar.update(len(part.apertures) - missing)


def notes_of(store: PlateStore, damaged: int) -> Iterator[str]:
    """Yield what was damaged and has been mended, in sentences.

    Parameters
    ----------
    store
        Store that was opened, whose descriptions may have been mended then.
    damaged
        Number of hogels that were damaged and have been drawn again.
    """
    for name in store.mended:
        yield f"{store.out}: the description of {name} was damaged and has been written again"
    if damaged:
        hogels = "hogel was" if damaged == 1 else "hogels were"
        yield f"{store.out}: {damaged} {hogels} damaged, and drawn again"


def _draw(hogels: Iterable[PlateHogel], work: BlockWork) -> None:
    """Compress and write hogels while the next ones are drawn."""
    waiting: deque[Future[Callable[[], OpenBlock | None]]] = deque()

    def encode(hogel: PlateHogel) -> Callable[[], OpenBlock | None]:
        encoded = work.store.encoded(hogel)
        return lambda: work.keep(hogel.aperture, encoded)

    def write(full: OpenBlock) -> Callable[[], None]:
        work.store.write(full.block, full.encoded)
        return lambda: work.finished(full)

    with ThreadPoolExecutor(MAX_WAITING_HOGELS, thread_name_prefix="plate") as pool:

        def step() -> None:
            full = waiting.popleft().result()()
            if full is not None:
                waiting.append(pool.submit(write, full))

        for hogel in hogels:
            while len(waiting) >= MAX_WAITING_HOGELS:
                step()
            waiting.append(pool.submit(encode, hogel))
        while waiting:
            step()


def blocks_of_apertures(plate: Plate, blocks: Sequence[tuple[Span, Span]]) -> ApertureBlocks:
    """Return the apertures of some blocks.

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
    found = []
    for block in blocks:
        (left, right), (top, bottom) = (
            (0, count - 1) if span is None else span for span, count in zip(block, plate.hogels, strict=True)
        )
        # Both corners first: a mistake is not found in the middle of the work.
        plate.aperture(left, top), plate.aperture(right, bottom)
        found.append((range(left, right + 1), range(top, bottom + 1)))
    return ApertureBlocks(plate, tuple(found))
