"""Plates drawn block by block into a store, by this process or by others, and never twice.

Hogels come from a source: drawn, drawn and judged, or traced; it says what decides their pixels.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.radiance import transported
from xfrustum.compare.run import Evaluator, FrameRequest, JudgedFrame
from xfrustum.raster.plate.one_by_one import OneByOne, plate_hogel
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.raster.rasterizer import normals_of
from xfrustum.reference import Reference
from xfrustum.reports.blocks import HERE, Engine, Job, open_workers
from xfrustum.reports.common.outputs import json_ready, progress_bar
from xfrustum.reports.common.records import columns_of
from xfrustum.reports.plate.store import (
    PLACES,
    SOURCE,
    Block,
    JudgedPlateHogel,
    Layout,
    MeasuredHogel,
    PlateStore,
    default_side,
    open_store,
)
from xfrustum.scenes import Certainty, DoubleFrustum, HogelImage, InputError
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, needed
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene, is_shaded, look_hash
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks, Plate


def measures_of(scene: Scene) -> dict[str, str]:
    """Return the unit of each measure of a scene's hogels; colors are measured where it has an appearance."""
    nothing = dict.fromkeys(("surface", "triangle", "displacement_px", "height", "radiance"))
    counts = dict.fromkeys(("pixels", "judged", "covered", "at_plate"), 0)
    certainty = {kind.name.lower(): 0 for kind in Certainty}
    empty = ComparisonNumbers(**counts, **nothing, certainty=certainty)  # type: ignore[arg-type]
    found = {}
    for column in columns_of(
        MeasuredHogel, [MeasuredHogel(column=0, row=0, x=0.0, y=0.0, comparison=empty)]
    ):
        name, numeric = (
            column.name,
            pa.types.is_integer(column.type) or pa.types.is_floating(column.type),
        )
        if name not in PLACES and numeric and (is_shaded(scene) or not name.startswith("radiance")):
            length = scene.units if name.startswith("height") else "1"
            found[name] = "px" if name.startswith("displacement_px") else length
    return found


@dataclass(frozen=True, kw_only=True)
class HogelSource:
    """What makes the hogels of a scene, in the order of their apertures."""

    hogels: Callable[[Iterable[Aperture]], Iterator[PlateHogel]]
    description: dict[str, Any]


@contextmanager
def source_of(
    scene: Scene, settings: DoubleFrustum | None, content: PlateContent, *, judge: bool = False
) -> Iterator[HogelSource]:
    """Open what makes the hogels of a scene: with settings they are drawn, without they are traced."""
    if settings is None:
        if judge:
            raise InputError(
                "--judge compares what is drawn with the truth: leave out --truth, or --judge"
            )
        yield _traced(scene, content)
        return
    if Channel.CERTAINTY in content.channels:
        raise InputError(
            "certainty is the truth's alone: leave it out of the channels, or add --truth"
        )
    # More effects than the scene calls for change no pixel.
    visible = needed(scene, question=Question(camera=settings.camera, settings=(settings,)))
    if not judge:
        fine = scene.sampling != Sampling(aperture=scene.sampling.aperture)
        with (OneByOne if fine else PlateRenderer)(scene, settings, content) as drawing:
            device = str(drawing.device["renderer"])
            described = described_as(scene, content, device, drawing.effects & visible, settings)
            yield HogelSource(hogels=drawing.hogels, description=described)
        return
    settings.check_against(scene.frustum)
    with Evaluator(scene, effects=content.effects) as judging:
        judging.rasterizer.check_sampling(scene.sampling)
        effects = judging.rasterizer.effects_for(settings) & visible
        described = described_as(scene, content, judging.device["renderer"], effects, settings)
        described["content"]["judged"] = True
        hogels = partial(_judged, judging, content, settings)
        yield HogelSource(hogels=hogels, description=described)


def _traced(scene: Scene, content: PlateContent) -> HogelSource:
    """Return truths, certified; their colors are means of light paths where the scene has any."""
    by_paths = scene.transport.simulated
    reference = Reference(
        scene, tracer="mitsuba" if by_paths else "embree", effects=content.effects
    )

    def colored(aperture: Aperture) -> HogelImage:
        image = reference.trace(aperture, Sampling())
        mean = transported(scene, aperture, scene.transport).mean
        return replace(image, color=mean.astype(np.float32))

    def hogels(apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        images = map(colored, apertures) if by_paths else reference.stream(apertures)
        return (plate_hogel(image, content) for image in images)

    simulated = frozenset(reference.rendering().effects) & needed(scene)
    renderer = f"reference, {'colored by Mitsuba' if by_paths else 'certified'}"
    return HogelSource(
        hogels=hogels,
        description=described_as(
            scene, content, renderer, ALL_EFFECTS if by_paths else simulated, None
        ),
    )


def _judged(
    judge: Evaluator, content: PlateContent, settings: DoubleFrustum, apertures: Iterable[Aperture]
) -> Iterator[PlateHogel]:
    """Draw and judge hogels; the images are those of a plate that is drawn alone, bit for bit."""
    colors = is_shaded(judge.scene)
    # Pixels are stored with color; whether it is compared is another question.
    wanted = FrameRequest(color=True, colored_truths=colors, radiance=colors)

    def stored(frame: JudgedFrame) -> JudgedPlateHogel:
        here, image = frame.aperture, frame.image
        if Channel.NORMAL in content.channels:
            image = replace(image, normal=normals_of(judge.scene, image.triangle))
        measured = MeasuredHogel(
            column=here.column,
            row=here.row,
            x=here.x,
            y=here.y,
            comparison=frame.comparison.numbers,
        )
        return JudgedPlateHogel(**{**vars(plate_hogel(image, content)), "measured": measured})

    with closing(judge.frames(apertures, [settings], wanted)) as frames:
        yield from map(stored, frames)


def described_as(
    scene: Scene,
    content: PlateContent,
    renderer: str,
    simulated: frozenset[Effect],
    settings: DoubleFrustum | None,
) -> dict[str, Any]:
    """Return everything that decides the pixels of hogels, as JSON; it must agree to go on with a store.

    What is None is left out: plates of truths have no `settings`, those with one sample a pixel
    through the middle of its aperture no `sampling`, and those without light paths no `transport`.
    """
    usual = PlateContent(color=content.color, ids=content.ids).channels == content.channels
    sampling, transport = scene.sampling, scene.transport
    finer = {"supersample": sampling.supersample, "multisample": sampling.multisample}
    sampled = sampling.aperture > 1 or max(finer.values()) > 1
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
        "content": {"color": content.color, "ids": content.ids}
        | ({} if usual else {"channels": content.channels}),
        "renderer": {"device": renderer, "xfrustum": metadata.version("xfrustum")},
        "sampling": {"aperture": sampling.aperture, **{k: n for k, n in finer.items() if n > 1}}
        if sampled
        else None,
        "transport": {
            name: getattr(transport, name) for name in ("shadows", "interreflection", "samples")
        }
        if settings is None and transport.simulated
        else None,
    }
    return {key: value for key, value in json_ready(described).items() if value is not None}


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


_opened = lru_cache(1)(
    PlateStore
)  # store of the last job, which this process asks about many blocks


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

    def draw(
        self, blocks: Iterable[Block], done: Callable[[int], object] = lambda hogels: None
    ) -> None:
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
    begun: Callable[[], object] = lambda: None,
) -> PlateFiles:
    """Draw apertures of a plate that have not been drawn yet, block by block, each into a shard of its own.

    Without settings the plate is one of truths; without apertures, the whole one. Blocks are drawn
    in the order in which their apertures are named, by `engine`. Killed at any moment it loses no
    finished block; called again it goes on with the others and ends with the arrays of a run that
    was not disturbed.

    A `block` is the columns and rows of hogels that are stored together, 1 x 1 for chunks without
    shards; None for those of a store that exists, and for a new one as many as `BLOCK_BYTES` hold.
    `judge` says whether every hogel is traced too, and its measures are stored beside its pixels;
    `check`, whether every hogel that is there is read in full, and drawn again where it is damaged.
    `begun` is called once the store is open, before the first hogel is drawn.

    InputError: see `source_of` and `open_store`; or the block is none, no scheduler answers, or a
    worker has another device than the one that began the plate.
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
        begun()

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
        raise InputError(
            f"a block must have at least one column and one row, not {block[0]} x {block[1]}"
        )
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
        (left, right), (top, bottom) = (
            (0, count - 1) if span is None else span for span, count in spans
        )
        # Both corners first: a mistake is not found in the middle of the work.
        plate.aperture(left, top), plate.aperture(right, bottom)
        found.append((range(left, right + 1), range(top, bottom + 1)))
    return ApertureBlocks(plate, tuple(found))
