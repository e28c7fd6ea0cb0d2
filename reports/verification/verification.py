"""`xfrustum verify`: is a renderer that nobody here wrote right, and if not, what is wrong with it?

With `--workers`, `--scheduler` and `--part` hogels are judged in blocks by any process; each block
becomes a Parquet part. When all parts are there, the verification is put together from them, and is
the one that one process makes alone; the worst hogels are judged once more for their pictures. The
first process that judges diagnoses the renderer, and leaves the question beside the parts: a
renderer with noise answers otherwise each time. Files are the same as long as their sizes and times
are. Nobody knows what a command depends on: one that was interrupted goes on, but for hogels that
could not be had; one that was finished is begun anew.
"""

from __future__ import annotations

import hashlib
import heapq
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from pydantic import TypeAdapter

from xfrustum.compare.diagnosis.diagnosis import Findings, TestSet, declared, diagnose
from xfrustum.compare.diagnosis.faults import Defect
from xfrustum.compare.extent import require_seen
from xfrustum.compare.judging.judged import Compared, Figures, Judging, judge
from xfrustum.compare.renderer_model.changed_scene import changed
from xfrustum.compare.renderer_model.conventions import ENCODING
from xfrustum.compare.renderer_model.drawn_model import RendererModel
from xfrustum.compare.renderer_model.pictures import shown_points
from xfrustum.compare.run import images_under_way, in_order
from xfrustum.reference import Reference
from xfrustum.reference.llvm import worker_count
from xfrustum.reports.blocks import Engine, Job, Session, Workers, open_workers
from xfrustum.reports.common.outputs import json_ready, progress_bar
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.verification import sources
from xfrustum.reports.verification.verdict import (
    Hogel,
    Limits,
    Verification,
    with_correction_tested,
    wrong_in,
)
from xfrustum.reports.verification.where import places_of
from xfrustum.reports.verification.worst import MAX_SHOWN_HOGELS, Pictured, WorstHogels
from xfrustum.scenes import HogelImage, InputError, Scene, open_scene
from xfrustum.scenes.arguments import choice, real, wholes
from xfrustum.scenes.disk.durable import TempPath, scratch_folder
from xfrustum.scenes.disk.input_files import damage_refused
from xfrustum.scenes.files import layouts
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.files.plate_files import FileSet, find_files
from xfrustum.scenes.model.device_model import DeviceModel
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

Item = TypeVar("Item")

SAMPLE_SIDE = 5
"""Columns and rows of hogels that are diagnosed: 25 tell apart all orders of apertures, many times over."""

MAX_SAMPLE_PIXELS, MIN_SAMPLE_HOGELS = 1 << 22, 4
"""Pixels of all diagnosed hogels together, which bounds the memory; and number of hogels that are diagnosed
whatever their size."""


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """What is judged of a renderer, and by what: the options of `xfrustum verify`."""

    command: str | None = None
    """In place of files: a program that is run for each aperture, with {x}, {y}, {i}, {j} and {out}."""
    timeout_s: float = 60.0  #: of one run
    encoding: Encoding | str | None = None  #: what pictures mean, `rgb` where nobody says
    layout: str | None = None  #: of a folder or picture (docs/layouts.md)
    apertures: Sequence[tuple[int, int]] | None = (
        None  #: column and row of each; None for the whole plate
    )
    near: float | None = (
        None  #: offset that the renderer's author states; it is then part of the question
    )
    accept: Sequence[str] = ()
    """Conventions out of `ACCEPTABLE`, of which images are judged by what was found."""
    max_wrong: float = (
        MAX_WRONG  #: share of wrong surfaces of each hogel; of pictures, of colors or outlines
    )
    max_displacement_px: float | None = TOLERANCE_PX
    """Limits how far 99 of 100 surface points or outlines are off; unknown is too far. None: no limit."""
    max_color: float | None = (
        None  #: difference of linear radiance that is wrong; None: `COLOR_TOLERANCE`
    )
    compare: Compared | str = Compared.COLOR
    """What plain pictures are judged by: `color`, or `geometry`: where they show something, and outlines."""
    device: DeviceModel | None = None  #: model of the machine that drew; None: any
    channels: bool = False  #: whether to keep all channels of the worst hogels
    progress: bool = False  #: whether to draw a bar on standard error

    @property
    def limits(self) -> Limits:
        """The limits, and how images are judged."""
        judging = Judging(compared=choice(Compared, self.compare, "compare"))
        if self.max_color is not None:
            judging = replace(judging, color_tolerance=real(self.max_color))
        if self.device is not None:
            judging = replace(judging, device=self.device)
        return Limits(
            wrong=self.max_wrong, displacement_px=self.max_displacement_px, judging=judging
        )

    def renderer(self, source: str | sources.Renderer | None) -> sources.ForeignRenderer:
        """Return where images come from: files of a pattern or place, or a function; else the command."""
        names = ("command", "encoding", "layout", "near", "timeout_s")
        stated: dict[str, Any] = {name: getattr(self, name) for name in names}
        accept = (self.accept,) if isinstance(self.accept, str) else tuple(self.accept)
        return sources.ForeignRenderer(source=source, accept=accept, **stated)

    def asked(self, scene: Scene) -> Sequence[Aperture]:
        """Return the apertures that are judged, each once; InputError where none sees any object."""
        asked: Sequence[Aperture] = scene.plate.apertures()
        if self.apertures:
            pairs = [wholes(index, 2) for index in self.apertures]
            if short := [
                given for given, pair in zip(self.apertures, pairs, strict=True) if len(pair) < 2
            ]:
                raise InputError(
                    f"apertures are pairs of a column and a row, such as (2, 1), not {short[0]!r:.100}"
                )
            asked = [scene.plate.aperture(*pair) for pair in dict.fromkeys(pairs)]
        require_seen(scene, asked)
        return asked


def verify(
    scene: Scene | str,
    source: str | sources.Renderer | None = None,
    options: VerifyOptions | None = None,
    **fields: Any,
) -> Verification:
    """Judge the hogel images of any renderer, and say what is wrong with it.

    `source` is files named by {i} and {j}, a place of files, or a function of scene and aperture;
    single fields of `VerifyOptions` may be given by name.

    InputError where the scene, the source or an option is not usable, or no aperture sees any
    object.
    """
    opened = open_scene(scene) if isinstance(scene, str) else scene
    asked = replace(options or VerifyOptions(), **fields)
    renderer, limits = asked.renderer(source), asked.limits
    renderer.nominal(opened)
    apertures, reference = asked.asked(opened), Reference(opened)
    with renderer.opened(reference) as images:
        images.check(apertures)

        def verified(one: sources.Source) -> Verification:
            run = Run(
                renderer=renderer, reference=reference, source=one, asked=apertures, limits=limits
            )
            return run.verified(channels=asked.channels, progress=asked.progress)

        found = with_layout_named(verified(images), images, verified)
    return with_correction_tested(found)


FiguresPair = tuple[Figures, Figures]  #: figures of a hogel as found, and as corrected


@dataclass(frozen=True, kw_only=True)
class Question:
    """What hogels are judged by: how the renderer is supposed to draw, and how it draws and stores."""

    asked: RendererModel
    found: Findings
    read_as_found: bool  #: whether another reading of the pixels is accepted


@dataclass(kw_only=True, eq=False)
class Run:
    """One verification under way; images of the sample are kept until they are judged."""

    renderer: sources.ForeignRenderer
    reference: Reference
    source: sources.Source
    asked: Sequence[Aperture]
    limits: Limits
    kept: dict[Aperture, HogelImage | sources.Problem] = field(default_factory=dict)

    def verified(self, *, channels: bool, progress: bool) -> Verification:
        """Diagnose a sample, judge every hogel, and return the verification."""
        scene = self.reference.scene
        total = len(self.asked) + len(sampled(self.asked, scene))
        worst, hogels = WorstHogels(scene=scene if channels else None), []
        with progress_bar(total, "verify", "hogel", shown=progress) as bar:
            question = self.question(bar.update)
            for hogel, figures in self.hogels(question, self.asked):
                if figures is not None:
                    worst.add(hogel.aperture, *figures)
                hogels.append(hogel)
                bar.update()
        return Verification(
            scene=scene,
            source=self.source.name,
            limits=self.limits,
            diagnosis=question.found.diagnosis,
            hogels=tuple(hogels),
            worst=worst,
        )

    def question(self, done: Callable[[], object] = lambda: None) -> Question:
        """Diagnose a sample of hogels, and return what all are judged by; `done` is called after each."""
        scene, accept = self.reference.scene, self.renderer.accept
        nominal = self.renderer.nominal(scene)
        for aperture in sampled(self.asked, scene):
            self.kept[aperture] = self._had(aperture)
            done()
        images = [image for image in self.kept.values() if isinstance(image, HogelImage)]
        of_views = (
            isinstance(self.source, sources.LaidOut) and not self.source.files.layout.in_hogels
        )
        evidence = TestSet(
            reference=self.reference, images=images, nominal=nominal, judging=self.limits.judging
        )
        found = diagnose(evidence, of_views=of_views)
        conventions = [name for name in accept if name != ENCODING]
        return Question(
            asked=declared(nominal, found.diagnosis.model, conventions),
            found=found,
            read_as_found=ENCODING in accept and found.encoding.reading is not None,
        )

    def hogels(
        self, question: Question, apertures: Iterable[Aperture]
    ) -> Iterator[tuple[Hogel, FiguresPair | None]]:
        """Judge some hogels; yield them in their order, each with its figures where it has an image.

        The renderer is asked in the caller's thread.
        """
        most = images_under_way(math.prod(self.reference.scene.frustum.resolution))
        with ThreadPoolExecutor(worker_count(), thread_name_prefix="judging") as pool:
            images = (
                (one, self.kept.pop(one) if one in self.kept else self._had(one))
                for one in apertures
            )
            yield from in_order((pool.submit(self._judged, question, *one) for one in images), most)

    def pictured(
        self, question: Question, aperture: Aperture, *, channels: bool
    ) -> Pictured | None:
        """Return one hogel in pictures, with all its channels if asked; None where it is missing."""
        worst = WorstHogels(scene=self.reference.scene if channels else None)
        figures = self._judged(question, aperture, self._had(aperture))[1]
        if figures is not None:
            worst.add(aperture, *figures)
        return worst.kept[0] if worst.kept else None

    def _had(self, aperture: Aperture) -> HogelImage | sources.Problem:
        try:
            return self.source.image(aperture)
        except sources.Problem as problem:
            return problem

    def _judged(
        self, question: Question, aperture: Aperture, image: HogelImage | sources.Problem
    ) -> tuple[Hogel, FiguresPair | None]:
        """Judge one hogel; return it with its figures as found and as corrected, where it has an image."""
        if isinstance(image, sources.Problem):
            return Hogel(aperture=aperture, problem=str(image)), None
        encoding, model = question.found.encoding, question.found.diagnosis.model
        given = encoding.plainly(image) if question.read_as_found else image
        read = encoding.read(self.reference, image)
        # Correction may read nothing in another way than the verdict does, and draw nothing
        # otherwise.
        same = question.asked == model and encoding.restoring is None
        same = same and (question.read_as_found or encoding.reading is None)

        def figures(
            asked: RendererModel, of: HogelImage, judging: Judging, *, explained: bool
        ) -> Figures:
            points = shown_points(changed(self.reference, model.changes).scene, model, of)
            return judge(self.reference, asked, of, points, judging, explained=explained)

        as_found = figures(question.asked, given, self.limits.judging, explained=same)
        corrected = (
            as_found if same else figures(model, read, question.found.judging, explained=True)
        )
        judged = Hogel(
            aperture=aperture,
            checks=self.limits.checks(as_found),
            as_found=as_found.numbers,
            corrected=corrected.numbers,
            places=places_of(as_found),
            left=wrong_in(corrected.numbers) - corrected.rounded,
            mended=self.limits.mends(as_found, corrected, model),
            storage=image.storage,
        )
        return judged, (as_found, corrected)


def sampled(apertures: Sequence[Aperture], scene: Scene) -> list[Aperture]:
    """Return the apertures to be diagnosed: spread over the plate, few enough for the memory."""

    def spread(items: Sequence[Item], most: int) -> list[Item]:
        return [
            items[index] for index in np.unique(np.linspace(0, len(items) - 1, most).astype(int))
        ]

    pixels = math.prod(scene.frustum.resolution)
    count = int(np.clip(MAX_SAMPLE_PIXELS // pixels, MIN_SAMPLE_HOGELS, SAMPLE_SIDE**2))
    side = max(2, int(np.sqrt(count)))
    if isinstance(apertures, ApertureBlocks):
        columns, rows = (spread(range(hogels), side) for hogels in scene.plate.hogels)
        return [scene.plate.aperture(column, row) for row in rows for column in columns]
    columns = spread(sorted({aperture.column for aperture in apertures}), side)
    rows = spread(sorted({aperture.row for aperture in apertures}), side)
    chosen = [a for a in apertures if a.column in columns and a.row in rows]
    return spread(list(apertures), count) if len(chosen) < min(side, len(apertures)) else chosen


# Other layouts in which the files of a plate may be meant, where they are wrong in the stated one

CONVENTIONAL_FAULTS = {"orientation", "aperture-order", "shift-x", "shift-y", "view-shear"}
"""Faults that files in the right layout have too: where these alone explain the images, it is not doubted."""

MAX_TRIED_HOGELS = 9  #: largest number of hogels by which another reading is tried

MAX_WRONG_IN_RIGHT_READING = 0.1
"""Largest share of wrong pixels under which another reading counts as right: a tenth, as for all that must
explain what is wrong (`compare.diagnosis.diagnosis`)."""


def with_layout_named(
    found: Verification, source: sources.Source, verified: Callable[[sources.Source], Verification]
) -> Verification:
    """Return a verification that names the layout of the files if it is another than the stated one.

    The layout is then a fault, and the corrected figures are those of the other reading.
    """
    named = {fault.fault for fault in found.diagnosis.faults}
    if (
        not isinstance(source, sources.LaidOut)
        or found.passed
        or (named and named <= CONVENTIONAL_FAULTS)
    ):
        return found
    readings = other_readings(source.files, sources.shape_of(found.scene))
    others = (replace(source, files=files) for files in readings)
    right = next((one for one in others if _is_right(one, found)), None)
    if right is None:
        return found
    other = verified(right)
    before = sum(hogel.as_found.wrong for hogel in found.hogels if hogel.as_found is not None)
    after = sum(hogel.corrected.wrong for hogel in other.hogels if hogel.corrected is not None)
    fault = Defect(
        fault="layout",
        value=right.files.layout.name,
        words=f"files were read as {source.files.layout.meaning}, and hold {right.files.layout.meaning}",
        explains=max(0.0, 1.0 - after / before) if before else None,
    )
    corrected = {hogel.aperture: hogel for hogel in other.hogels}

    def mended(hogel: Hogel) -> Hogel:
        its = corrected[hogel.aperture]
        return replace(hogel, corrected=its.corrected, left=its.left, mended=its.mended)

    return replace(
        found,
        diagnosis=replace(
            other.diagnosis, faults=(fault, *other.diagnosis.faults), does_not_explain=()
        ),
        hogels=tuple(map(mended, found.hogels)),
    )


def other_readings(stated: FileSet, told: layouts.PlateShape) -> Iterator[FileSet]:
    """Yield other layouts in which the same files form the plate that is told."""
    for layout in (
        *layouts.LAYOUTS,
        *(other for each in layouts.LAYOUTS for other in mistaken(each)),
    ):
        with suppress(InputError):
            found = find_files(stated.place, told, (layout,)) if layout != stated.layout else stated
            if found is not stated and found.shape == told and not found.missing:
                yield found


def mistaken(layout: layouts.Layout) -> tuple[layouts.Layout, ...]:
    """Return what others take for a layout: numbers in the other order, and views from the other side."""

    def other_side(one: layouts.Layout) -> layouts.Layout:
        def view(pixels: layouts.Pixels, _: layouts.Index, tiles: layouts.Index) -> layouts.Pixels:
            return layouts.tiled_views(pixels, tiles, downward=True)

        return replace(one, view=view, meaning=one.meaning.replace("bottom left", "top left"))

    numbers = layout.stated if layout.name == "quilt" else tuple(layout.numbers)
    exchanged: tuple[layouts.Layout, ...] = ()
    if len(numbers) == 2:
        first, second = numbers
        pattern = layout.pattern.replace(f"<{first}>", "<swapped>").replace(
            f"<{second}>", f"<{first}>"
        )
        meaning = layout.meaning.replace("columns x rows", "rows x columns")
        if meaning == layout.meaning:
            meaning = f"{meaning}, with the two numbers of its names exchanged"
        exchanged = (
            replace(layout, pattern=pattern.replace("<swapped>", f"<{second}>"), meaning=meaning),
        )
    if layout.name == "quilt":
        return (*exchanged, *(other_side(one) for one in (layout, *exchanged)))
    return exchanged


def _is_right(source: sources.LaidOut, found: Verification) -> bool:
    """Return whether nearly all claims of a few hogels in another reading hold, whatever the other faults."""
    reference, nominal, wrong, shown = source.reference, RendererModel(), 0, 0
    for hogel in found.hogels[:: max(1, len(found.hogels) // MAX_TRIED_HOGELS)][:MAX_TRIED_HOGELS]:
        try:
            image = source.image(hogel.aperture)
        except sources.Problem:
            return False
        points = shown_points(reference.scene, nominal, image)
        figures = judge(reference, nominal, image, points, found.limits.judging, explained=False)
        wrong, shown = wrong + figures.numbers.limited, shown + figures.numbers.shown
    return wrong <= MAX_WRONG_IN_RIGHT_READING * shown


PARTS, QUESTION = "verification.parquet", "_question.json"
"""Folder of the parts in that of the verification; and the file beside the parts that says what all hogels
are judged by. Readers of Parquet leave out names that begin like this."""

MAX_BLOCK_PIXELS, MIN_BLOCKS = 1 << 22, 16
"""Largest number of pixels in a block, some seconds of work; and number of blocks that even a small plate is
cut into, so that there is something for several processes to do."""


_HOGEL, _QUESTION = TypeAdapter(Hogel), TypeAdapter(Question)


def _json(record: Hogel | Question) -> str:
    """Return a record as JSON; numbers of NumPy have the same digits as Python's own."""
    return json.dumps(asdict(record), default=lambda number: number.item())


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifyJob(Job):
    """A verification, as it travels to workers; `state` is the digest of the files that images depend on."""

    scene: Scene
    renderer: sources.ForeignRenderer
    limits: Limits
    state: str
    asked: Sequence[Aperture]
    hogels_per_block: int
    parts: ParquetParts
    name = "verify"
    draws = False

    @property
    def blocks(self) -> range:
        """Numbers of all blocks."""
        return range(math.ceil(len(self.asked) / self.hogels_per_block))

    def apertures(self, block: int) -> Sequence[Aperture]:
        """Return the apertures of a block."""
        begin = block * self.hogels_per_block
        return self.asked[begin : begin + self.hogels_per_block]

    def finished(self, block: int) -> bool:
        """Return whether the part of a block is there."""
        return self.parts.finished(block)

    def size(self, block: int) -> int:
        """Return the number of hogels of a block."""
        return len(self.apertures(block))

    def words(self, block: int) -> str:
        """Return a block in words."""
        i, j = self.asked[block * self.hogels_per_block].index
        return f"the hogels from {i},{j}"

    @contextmanager
    def open(self) -> Iterator[VerifySession]:
        """Open the source of images; InputError where it has others than that of the command."""
        self.renderer.require_state(self.asked, self.state)
        reference = Reference(self.scene)
        with self.renderer.opened(reference) as source:
            run = Run(
                renderer=self.renderer,
                reference=reference,
                source=source,
                asked=self.asked,
                limits=self.limits,
            )
            yield VerifySession(job=self, run=run)


@dataclass
class VerifySession(Session):
    """A judge of one renderer's hogels."""

    job: VerifyJob
    run: Run

    @cached_property
    def known(self) -> tuple[str, Question]:
        """What all processes judge by, and its digest; who asks first diagnoses the renderer."""
        parts = self.job.parts
        if parts.read_beside(QUESTION) is None:
            parts.write_beside(QUESTION, _json(self.run.question()).encode())
        content = parts.read_beside(QUESTION)
        assert content is not None
        with damage_refused(
            parts.folder / QUESTION, "question of a verification", "delete its folder"
        ):
            return hashlib.sha256(content).hexdigest(), _QUESTION.validate_json(content)

    def question(self) -> tuple[str, Question]:
        """Return `known`; a question to the workers."""
        return self.known

    def make(self, block: int) -> None:
        """Judge the hogels of a block, and write their rows, with what the worst are chosen by."""
        digest, question = self.known
        rows = []
        for hogel, figures in self.run.hogels(question, self.job.apertures(block)):
            bad = (
                [None, None]
                if figures is None
                else [one.numbers.judged_fraction for one in figures]
            )
            row = {
                "column": hogel.aperture.column,
                "row": hogel.aperture.row,
                "verdict": hogel.verdict,
                "found": _json(hogel.told_from(self.job.renderer.named_from)),
                "worst_as_found": bad[0],
                "worst_corrected": bad[1],
                "question": digest,
            }
            rows.append(row)
        self.job.parts.write(block, pa.Table.from_pylist(rows))

    def pictured(self, index: tuple[int, int], channels: bool) -> Pictured | None:
        """Return a hogel in pictures, with all its channels or without; None where it is missing."""
        return self.run.pictured(
            self.known[1], self.job.scene.plate.aperture(*index), channels=channels
        )


def verify_on(
    engine: Engine,
    scene: Scene,
    source: str | None,
    options: VerifyOptions,
    out: Path | None = None,
    told: Callable[[str], object] = lambda line: None,
) -> Verification | None:
    """Judge the hogel images of a renderer by several processes; the verification is that of `verify`.

    Stopped at any moment and called again with the same folder it goes on where it was. A command
    whose hogels are all judged in this folder is judged anew, and so are blocks with hogels that
    could not be had. Parts are kept in `out`, None for a folder of this machine's that is gone
    afterwards; `told` is called with notes in words. Returns None where other parts of a job array
    are not finished yet.

    InputError as from `verify`, and where there is no folder that others see, or it holds something
    else.
    """
    if out is None and (engine.scheduler is not None or not engine.part.everything):
        raise InputError("--scheduler and --part keep what is judged in a folder: give --out too")
    renderer, limits = options.renderer(source), options.limits
    renderer.nominal(scene)
    asked = options.asked(scene)
    with renderer.opened(Reference(scene)) as images:
        if isinstance(images, sources.LaidOut):
            raise InputError(
                "--workers, --scheduler and --part judge files that a pattern names, or a --command: name "
                "the files with {i} and {j}, or leave these options out"
            )
        images.check(asked)
        name = images.name
    most = MAX_BLOCK_PIXELS // math.prod(scene.frustum.resolution)
    renderer = renderer.placed(scene)
    with ExitStack() as stack:
        folder = (
            out.absolute()
            if out
            else stack.enter_context(TempPath(scratch_folder(), folder=True)).path
        )
        job = VerifyJob(
            scene=scene,
            renderer=renderer,
            limits=limits,
            state=renderer.state(asked),
            asked=asked,
            hogels_per_block=max(1, min(most, math.ceil(len(asked) / MIN_BLOCKS))),
            parts=ParquetParts(out=folder, name=PARTS),
        )
        described = {
            "scene": scene.content_hash,
            "renderer": renderer.description,
            "state of the images": job.state,
            "limits": limits,
            "hogels": {
                "hogels": ()
                if isinstance(asked, ApertureBlocks)
                else tuple(one.index for one in asked),
                "size": job.hogels_per_block,
            },
        }
        job.parts.open(json_ready(described))
        blocks = list(engine.part.of(job.blocks))
        if renderer.command is not None:
            # It may answer otherwise by now.
            if blocks and all(map(job.finished, job.blocks)):
                told(f"what is in {job.parts.folder} was finished; the command is judged anew")
                for block in job.blocks:
                    job.parts.remove(block)
                job.parts.remove(QUESTION)
            for block in filter(job.finished, blocks):
                if "missing" in job.parts.read(block, ["verdict"])["verdict"].to_pylist():
                    job.parts.remove(block)
        job.parts.tell_damaged(blocks, told)
        done = sum(map(job.finished, blocks))
        if done:
            told(
                f"{done} of {len(blocks)} blocks were judged before, and are in {job.parts.folder}"
            )
        with open_workers(engine, len(blocks), draws=False) as workers:
            if done < len(blocks):
                # One process diagnoses before all others judge.
                workers.ask(job, VerifySession.question)
            workers.run(job, blocks, sum(map(job.size, blocks)), progress=options.progress)
            if not all(map(job.finished, job.blocks)):
                return None
            found = _put_together(job, workers, name, told, channels=out is not None)
    return with_correction_tested(found)


def _put_together(
    job: VerifyJob, workers: Workers, name: str, told: Callable[[str], object], *, channels: bool
) -> Verification:
    """Return the verification of finished blocks; the worst hogels are judged once more for pictures."""
    digest, question = workers.ask(job, VerifySession.question)
    hogels: list[Hogel] = []
    badness: list[tuple[tuple[float, float], Aperture]] = []
    # One part after the other: a plate of millions has more text than hogels have numbers.
    for block in job.blocks:
        for row in job.parts.read(block).to_pylist():
            if row["question"] != digest:
                raise InputError(
                    f"{job.parts.path(block)}: was judged by another diagnosis than the rest; delete "
                    f"{job.parts.folder} and repeat the command"
                )
            hogels.append(_HOGEL.validate_json(row["found"]))
            if row["worst_as_found"] is not None:
                badness.append(
                    ((row["worst_as_found"], row["worst_corrected"]), hogels[-1].aperture)
                )
    kept = []
    # As in `WorstHogels.add`, of equals those that come first.
    for _, aperture in heapq.nlargest(MAX_SHOWN_HOGELS, badness, key=lambda one: one[0]):
        one = workers.ask(job, VerifySession.pictured, aperture.index, channels)
        if one is None:
            i, j = aperture.index
            told(f"hogel {i},{j} could not be had once more, and has no pictures")
        else:
            kept.append(one)
    return Verification(
        scene=job.scene,
        source=name,
        limits=job.limits,
        diagnosis=question.found.diagnosis,
        hogels=tuple(hogels),
        worst=WorstHogels(kept=kept),
    )
