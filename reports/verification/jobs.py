"""Verification by several processes: hogels are judged in blocks, each a Parquet part.

With `--workers`, `--scheduler` and `--part` any process judges any block. When all parts are there,
the verification is put together from them, and equals the verification of one process; the worst
hogels are
judged once more for their pictures. The first process that judges diagnoses the renderer, and
leaves the question beside the parts: a renderer with noise answers otherwise each time. Files are
the same as long as their sizes and times are. Dependencies of a command are unknown: one that was
interrupted goes on, but for hogels without an image; one that was finished is begun anew.
"""

from __future__ import annotations

import hashlib
import heapq
import json
import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
from pydantic import TypeAdapter

from xfrustum.compare.judging.verdict import Hogel, Limits, Outcome
from xfrustum.compare.sampling import PathApertures, PlateSample, SampleExtent
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Engine, Job, Session, Workers, open_workers
from xfrustum.reports.common.outputs import json_ready
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.verification import sources
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.verification import (
    Question,
    Run,
    VerifyOptions,
    with_tested_diagnosis,
)
from xfrustum.reports.verification.worst import MAX_SHOWN_HOGELS, Pictured, WorstHogels
from xfrustum.scenes import InputError, Scene
from xfrustum.scenes.disk.durable import TempPath, scratch_folder
from xfrustum.scenes.disk.input_files import damage_refused
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks

PARTS, QUESTION = "verification.parquet", "_question.json"
"""Folder of the parts, and file of the question; readers of Parquet skip names with `_`."""

MAX_BLOCK_PIXELS, MIN_BLOCKS = 1 << 22, 16
"""Largest number of pixels in a block, some seconds of work; smallest number of blocks."""


_HOGEL, _QUESTION = TypeAdapter(Hogel), TypeAdapter(Question)


def _json(record: Hogel | Question) -> str:
    """Return a record as JSON; numbers of NumPy have the same digits as Python's own."""
    return json.dumps(asdict(record), default=lambda number: number.item())


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifyJob(Job):
    """A verification as sent to workers; `state` is the digest of the image files."""

    scene: Scene
    renderer: sources.ForeignRenderer
    limits: Limits
    state: str
    #: hogels of all looks of a sample, in their order
    judged: Sequence[Aperture]
    #: number of hogels after each look
    ends: tuple[int, ...]
    hogels_per_block: int
    parts: ParquetParts
    name = "verify"
    draws = False

    @cached_property
    def begins(self) -> list[int]:
        """First hogel of each block; no block has hogels of two looks."""
        # Blocks end at looks: the decision after a look needs exactly its own hogels.
        looks = pairwise((0, *self.ends))
        return [begin for look in looks for begin in range(*look, self.hogels_per_block)]

    def blocks(self, look: int) -> list[int]:
        """Return the numbers of the blocks of a look."""
        first, last = (bisect_left(self.begins, end) for end in (0, *self.ends)[look : look + 2])
        return list(range(first, last))

    def apertures(self, block: int) -> Sequence[Aperture]:
        """Return the apertures of a block."""
        return self.judged[self.begins[block] : [*self.begins, len(self.judged)][block + 1]]

    def finished(self, block: int) -> bool:
        """Return whether the part of a block is there."""
        return self.parts.finished(block)

    def size(self, block: int) -> int:
        """Return the number of hogels of a block."""
        return len(self.apertures(block))

    def words(self, block: int) -> str:
        """Return a block in words."""
        i, j = self.judged[self.begins[block]].index
        return f"the hogels from {i},{j}"

    @contextmanager
    def open(self) -> Iterator[VerifySession]:
        """Open the source of images; InputError where it has others than the command's."""
        # Image files may change while a long verification runs, or differ between machines.
        self.renderer.require_state(self.judged, self.state)
        reference = Reference(self.scene)
        with self.renderer.opened(reference) as source:
            run = Run(
                renderer=self.renderer,
                reference=reference,
                source=source,
                apertures=self.judged[: self.ends[0]],
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
        """Question of all processes, and its digest; the first call diagnoses the renderer."""
        parts = self.job.parts
        # The diagnosis is written once: all processes must judge by the same one.
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
        """Judge the hogels of a block, and write their rows, with the badness of each hogel."""
        digest, question = self.known
        rows = []
        for hogel, figures in self.run.hogels(question, self.job.apertures(block)):
            bad = (
                [None, None]
                if figures is None
                else [figure.numbers.judged_fraction for figure in figures]
            )
            row = {
                "column": hogel.aperture.column,
                "row": hogel.aperture.row,
                "verdict": hogel.verdict,
                "found": _json(sources.named_as_given(hogel, self.job.renderer.named_from)),
                "worst_as_found": bad[0],
                "worst_corrected": bad[1],
                "question": digest,
            }
            rows.append(row)
        self.job.parts.write(block, pa.Table.from_pylist(rows))

    def pictured(self, index: tuple[int, int], channels: bool) -> Pictured | None:
        """Return a hogel in pictures, perhaps with all channels; None where it is missing."""
        return self.run.pictured(
            self.known[1], self.job.scene.plate.aperture(*index), channels=channels
        )


def verify_on(
    engine: Engine,
    scene: Scene,
    source: str | None,
    options: VerifyOptions,
    out: Path | None = None,
    note: Callable[[str], object] = lambda line: None,
) -> Verification | None:
    """Judge the hogel images of a renderer by several processes, with `verify`'s result.

    Stopped at any moment and called again with the same folder it goes on where it was. A command
    whose hogels are all judged in this folder is judged anew, and so are blocks with hogels that
    are missing. Parts are kept in `out`, None for a folder of this machine's that is gone
    afterwards; `told` is called with notes in words. Returns None where other parts of a job array
    are not finished yet.

    InputError as from `verify`, and where there is no folder that others see, or it holds something
    else.
    """
    if out is None and (engine.scheduler is not None or not engine.part.everything):
        raise InputError("--scheduler and --part keep what is judged in a folder: give --out too")
    renderer, limits = options.renderer(source), options.limits
    # InputError of settings, before any process starts.
    renderer.nominal(scene)
    sample = options.plate_sample(scene)
    judged, ends = _looks(scene, options, sample, engine)
    with renderer.opened(Reference(scene)) as images:
        if isinstance(images, sources.LaidOut):
            raise InputError(
                "--workers, --scheduler and --part judge files that a pattern names, or a "
                "--command: name "
                "the files with {i} and {j}, or leave these options out"
            )
        images.check(judged)
        name = images.name
    most = MAX_BLOCK_PIXELS // math.prod(scene.frustum.resolution)
    # Workers run in other folders: paths become absolute.
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
            state=renderer.state(judged),
            judged=judged,
            ends=ends,
            hogels_per_block=max(1, min(most, math.ceil(ends[0] / MIN_BLOCKS))),
            parts=ParquetParts(out=folder, name=PARTS),
        )
        described = {
            "scene": scene.content_hash,
            "renderer": renderer.description,
            "state of the images": job.state,
            "limits": limits,
            "hogels": {
                # The sequence of a whole plate or a sample follows from scene and seed; a list of
                # millions of indices would bloat the record.
                "hogels": ()
                if isinstance(judged, ApertureBlocks | PathApertures)
                else tuple(entry.index for entry in judged),
                "size": job.hogels_per_block,
            },
            "sample": None if sample is None else sample.description,
        }
        job.parts.open(json_ready(described))
        blocks = list(engine.part.of(job.blocks(0)))
        if renderer.command is not None:
            # Files have a digest of their state; the answers of a program have none.
            _forget_answers(job, blocks, sample, note)
        job.parts.tell_damaged(blocks, note)
        done = sum(map(job.finished, blocks))
        if done:
            note(
                f"{done} of {len(blocks)} blocks were judged before, and are in {job.parts.folder}"
            )
        with open_workers(engine, len(blocks), draws=False) as workers:
            if done < len(blocks):
                # One process diagnoses before all others judge.
                workers.ask(job, VerifySession.question)
            for look in range(len(ends)):
                own = blocks if look == 0 else job.blocks(look)
                workers.run(job, own, sum(map(job.size, own)), progress=options.progress)
                judged_look = _judged_look(job, sample, look)
                if judged_look is None:
                    # Another part of the job array finishes last, and assembles the verification.
                    return None
                extent, decided = judged_look
                if decided:
                    break
            every = list(range(job.blocks(look)[-1] + 1))
            verification = _put_together(job, workers, every, note, channels=out is not None)
            verification = replace(verification, source=name, extent=extent)
    return with_tested_diagnosis(verification)


def _looks(
    scene: Scene, options: VerifyOptions, sample: PlateSample | None, engine: Engine
) -> tuple[Sequence[Aperture], tuple[int, ...]]:
    """Return the hogels of all looks of a sample, and their number after each look."""
    first = options.judged(scene)
    if sample is None or sample.looks == 1:
        return first, (len(first),)
    if not engine.part.everything:
        raise InputError("--part needs the number of hogels beforehand: use --sample, not --until")
    places = [np.asarray(sample.new_places(look)) for look in range(sample.looks)]
    ends = tuple(np.cumsum([len(look) for look in places]).tolist())
    return PathApertures(scene.plate, np.concatenate(places).tolist()), ends


def _judged_look(
    job: VerifyJob, sample: PlateSample | None, look: int
) -> tuple[SampleExtent | None, bool] | None:
    """Return the extent after a look, and whether it ends judging; None for missing blocks."""
    every = range(job.blocks(look)[-1] + 1)
    if not all(map(job.finished, every)):
        return None
    if sample is None:
        return None, True
    parts = (job.parts.read(block, ["verdict"])["verdict"].to_pylist() for block in every)
    verdicts = [verdict for part in parts for verdict in part]
    extent = sample.extent(len(verdicts), look)
    return extent, extent.decides(sum(verdict != Outcome.PASS for verdict in verdicts))


def _forget_answers(
    job: VerifyJob,
    blocks: Sequence[int],
    sample: PlateSample | None,
    note: Callable[[str], object],
) -> None:
    """Remove the answers of a command that is judged anew: it may answer otherwise by now."""
    looks = (_judged_look(job, sample, look) for look in range(len(job.ends)))
    if blocks and any(judged is not None and judged[1] for judged in looks):
        note(f"what is in {job.parts.folder} was finished; the command is judged anew")
        for block in range(len(job.begins)):
            job.parts.remove(block)
        job.parts.remove(QUESTION)
    # Parts of a job array have a single look.
    later = range(job.blocks(0)[-1] + 1, len(job.begins))
    for block in filter(job.finished, (*blocks, *later)):
        if Outcome.MISSING in job.parts.read(block, ["verdict"])["verdict"].to_pylist():
            job.parts.remove(block)


def _put_together(
    job: VerifyJob,
    workers: Workers,
    blocks: Sequence[int],
    note: Callable[[str], object],
    *,
    channels: bool,
) -> Verification:
    """Assemble finished blocks; judge the worst hogels once more for their pictures."""
    digest, question = workers.ask(job, VerifySession.question)
    hogels: list[Hogel] = []
    badness: list[tuple[tuple[float, float], Aperture]] = []
    # One part after the other: a plate of millions has more text than hogels have numbers.
    for block in blocks:
        for row in job.parts.read(block).to_pylist():
            # Two parts that started at the same time may have diagnosed separately.
            if row["question"] != digest:
                raise InputError(
                    f"{job.parts.path(block)}: was judged by another diagnosis than the rest; "
                    "delete "
                    f"{job.parts.folder} and repeat the command"
                )
            hogels.append(_HOGEL.validate_json(row["found"]))
            if row["worst_as_found"] is not None:
                badness.append(
                    ((row["worst_as_found"], row["worst_corrected"]), hogels[-1].aperture)
                )
    kept = []
    # As in `WorstHogels.add`, of equals those that come first.
    for _, aperture in heapq.nlargest(MAX_SHOWN_HOGELS, badness, key=lambda entry: entry[0]):
        pictured = workers.ask(job, VerifySession.pictured, aperture.index, channels)
        if pictured is None:
            i, j = aperture.index
            note(f"hogel {i},{j} is missing now, and has no pictures")
        else:
            kept.append(pictured)
    return Verification(
        scene=job.scene,
        source="",
        limits=job.limits,
        diagnosis=question.findings.diagnosis,
        hogels=tuple(hogels),
        worst=WorstHogels(kept=kept),
    )
