"""Verification by several processes: hogels are judged in blocks, each a Parquet part.

With `--workers`, `--scheduler` and `--part` any process may judge any block. The finished parts are
merged into the verification that a single process would return; the worst hogels are judged once
more for their pictures. The first process diagnoses the renderer and stores the diagnosis beside
the parts: a renderer with noise draws other images each time, and all processes must judge by one
diagnosis. Image files count as unchanged if their sizes and times are equal. Dependencies of a
command are unknown: an interrupted verification of a command continues, except for hogels without
an image, and a finished one starts again.
"""

from __future__ import annotations

import hashlib
import heapq
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa
from pydantic import TypeAdapter

from xfrustum.compare.judging.verdict import Hogel, Outcome
from xfrustum.compare.sampling import SampleExtent
from xfrustum.reference import Reference
from xfrustum.reference.truth import TruthBy
from xfrustum.reports.blocks import (
    Engine,
    HogelBlock,
    HogelJob,
    Session,
    blocks_of,
    open_workers,
)
from xfrustum.reports.common.outputs import json_ready
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.verification.request import Request, VerifyOptions
from xfrustum.reports.verification.sources import (
    LaidOut,
    StoredPlate,
    opened,
    require_state,
    state_of,
)
from xfrustum.reports.verification.verdict import MAX_SHOWN_HOGELS, Pictured, Verification, badness
from xfrustum.reports.verification.verification import Question, Run, with_tested_diagnosis
from xfrustum.scenes import InputError, Scene
from xfrustum.scenes.disk import TempPath, damage_refused, scratch_folder

PARTS, QUESTION = "verification.parquet", "_question.json"
"""Folder of the parts, and file of the question; Parquet readers skip names with `_`."""

MAX_BLOCK_PIXELS, MIN_BLOCKS = 1 << 22, 16
"""Largest number of pixels in a block (seconds of work); smallest number of blocks."""

_HOGEL, _QUESTION = TypeAdapter(Hogel), TypeAdapter(Question)


def _json(record: Hogel | Question) -> str:
    """Return a record as JSON; NumPy numbers are written like Python numbers."""
    return json.dumps(asdict(record), default=lambda number: number.item())


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifyJob(HogelJob):
    """Job of a verification for workers; `state` is the digest of the image files."""

    request: Request
    state: str
    name = "verify"
    draws = False

    @contextmanager
    def open(self) -> Iterator[VerifySession]:
        """Open the source of images; InputError if its files differ from the command's."""
        # Image files may change while a long verification runs, or differ between machines.
        require_state(self.request, self.state)
        reference = Reference(self.request.scene)
        with opened(self.request, reference) as source:
            run = Run(request=self.request, reference=reference, source=source)
            yield VerifySession(job=self, run=run)


@dataclass
class VerifySession(Session):
    """Session of a worker that judges hogels."""

    job: VerifyJob
    run: Run

    @cached_property
    def known(self) -> tuple[str, Question]:
        """Digest and question, shared by all processes; the first call diagnoses the renderer."""
        parts = self.job.parts
        # Write the diagnosis once, because all processes must judge by the same diagnosis.
        if parts.read_beside(QUESTION) is None:
            parts.write_beside(QUESTION, _json(self.run.question()).encode())
        content = parts.read_beside(QUESTION)
        assert content is not None
        file = parts.folder / QUESTION
        with damage_refused(file, "question of a verification", "delete its folder"):
            return hashlib.sha256(content).hexdigest(), _QUESTION.validate_json(content)

    def question(self) -> tuple[str, Question]:
        """Return `known`; the command calls it in a worker."""
        return self.known

    def make(self, block: HogelBlock) -> None:
        """Judge the hogels of a block, and write their rows, with the badness of each hogel."""
        (digest, question), rows = self.known, []
        for hogel, figures in self.run.hogels(question, block.apertures):
            bad = (None, None) if figures is None else badness(*figures)
            rows.append(
                {
                    "column": hogel.aperture.column,
                    "row": hogel.aperture.row,
                    "verdict": hogel.verdict,
                    "found": _json(hogel),
                    "worst_as_found": bad[0],
                    "worst_corrected": bad[1],
                    "question": digest,
                }
            )
        self.job.parts.write(block.number, pa.Table.from_pylist(rows))

    def pictured(self, index: tuple[int, int], channels: bool) -> Pictured | None:
        """Return the pictures of a hogel, with `channels` all channels; None without an image."""
        scene = self.job.request.scene
        aperture = scene.plate.aperture(*index)
        figures = self.run.figures(self.known[1], aperture)
        return figures and Pictured.from_figures(scene if channels else None, aperture, *figures)


def verify_on(
    engine: Engine,
    scene: Scene,
    source: str | None,
    options: VerifyOptions,
    out: Path | None = None,
    note: Callable[[str], object] = lambda line: None,
) -> Verification | None:
    """Judge the hogel images of a renderer in several processes, with the result of `verify`.

    A stopped run continues when it is repeated with the same folder. Parts are kept in `out` (None:
    a temporary folder of this machine); `note` receives sentences. Returns None while other parts
    of a job array are not finished.

    Raises InputError as `verify` does, and if a shared folder is needed and missing, or contains
    something else.
    """
    if out is None and (engine.scheduler is not None or not engine.part.everything):
        raise InputError("--scheduler and --part keep what is judged in a folder: give --out too")
    # Truths by directions need tiles of whole rows; blocks are not tiles.
    request = Request.from_options(scene, source, replace(options, truth_by=TruthBy.HOGELS))
    if request.looks > 1 and not engine.part.everything:
        raise InputError("--part needs the number of hogels beforehand: use --sample, not --until")
    with opened(request, Reference(scene)) as images:
        if isinstance(images, LaidOut | StoredPlate):
            raise InputError(
                "--workers, --scheduler and --part judge files that a pattern names, or a "
                "--command: name the files with {i} and {j}, or leave these options out"
            )
        images.check(request.apertures)
        name = images.name
    # Make paths absolute, because workers run in other folders.
    request = replace(request, folder=Path.cwd())
    channels = out is not None
    with ExitStack() as stack:
        if out is None:
            out = stack.enter_context(TempPath(scratch_folder(), folder=True)).path
        parts = ParquetParts(out=out.absolute(), name=PARTS)
        job = VerifyJob(request=request, state=state_of(request), parts=parts)
        most = MAX_BLOCK_PIXELS // math.prod(scene.frustum.resolution)
        size = max(1, min(most, math.ceil(len(request.apertures) / MIN_BLOCKS)))
        parts.open(json_ready(_description(job, size)))
        looks = _blocks(request, size)
        if options.command is not None and _rows(job, looks) is not None:
            # A digest proves that files are unchanged; the output of a program has no digest.
            note(f"what is in {parts.folder} was finished; the command is judged anew")
            parts.remove(QUESTION)
            for block in chain.from_iterable(looks):
                parts.remove(block.number)
        with open_workers(engine, len(looks[0]), draws=False) as workers:
            # One process diagnoses before all others judge.
            digest, question = workers.ask(job, VerifySession.question)
            for blocks in looks:
                own = list(engine.part.of(blocks))
                _prepare(job, own, note)
                workers.run(job, own, sum(map(job.size, own)), progress=options.progress)
                if (judged := _rows(job, looks)) is not None:
                    break
            else:
                # The part of the job array that finishes last assembles the verification.
                return None
            rows, extent = judged
            # Two parts that started at the same time may both have diagnosed the renderer.
            if any(row["question"] != digest for row in rows):
                raise InputError(
                    f"{parts.folder}: was judged by another diagnosis than the rest; delete it and "
                    "repeat the command"
                )
            worst = []
            for row in _worst(rows):
                index = row["column"], row["row"]
                pictured = workers.ask(job, VerifySession.pictured, index, channels)
                if pictured is None:
                    note("hogel {},{} is missing now, and has no pictures".format(*index))
                worst += [] if pictured is None else [pictured]
    verification = Verification(
        scene=scene,
        source=name,
        limits=request.limits,
        diagnosis=question.findings.diagnosis,
        hogels=tuple(row["found"] for row in rows),
        worst=tuple(worst),
        extent=extent,
    )
    return with_tested_diagnosis(verification)


def _blocks(request: Request, size: int) -> list[list[HogelBlock]]:
    """Return the blocks of each look; its result also depends on all earlier blocks."""
    looks, begun = list[list[HogelBlock]](), 0
    for look in range(request.looks):
        looks.append(blocks_of(list(request.apertures_of(look)), size, begun))
        begun += len(looks[-1])
    return looks


def _description(job: VerifyJob, size: int) -> dict[str, object]:
    """Return all inputs that determine the rows of a verification."""
    request, options = job.request, job.request.options
    renderer: dict[str, object] = {"near": options.near, "accept": request.accept}
    renderer |= {name: getattr(options, name) for name in ("command", "encoding", "timeout_s")}
    # Absolute file names make the record independent of the current folder.
    renderer["place"] = str(Path(request.folder or "", str(request.source or "")))
    # List only chosen hogels: scene and seed determine the millions of hogels of a plate or sample.
    chosen = request.apertures if isinstance(request.apertures, list) else ()
    return {
        "scene": request.scene.content_hash,
        "renderer": renderer,
        "state of the images": job.state,
        "limits": request.limits,
        "hogels": {"hogels": [aperture.index for aperture in chosen], "size": size},
        "sample": None if request.sample is None else request.sample.description,
    }


def _prepare(job: VerifyJob, blocks: Sequence[HogelBlock], note: Callable[[str], object]) -> None:
    """Remove a command's blocks that lack hogels, and note damaged and finished blocks."""
    finished = list(filter(job.finished, blocks))
    if job.request.options.command is not None:
        for block in finished:
            if Outcome.MISSING in job.parts.read(block.number)["verdict"].to_pylist():
                job.parts.remove(block.number)
    job.parts.tell_damaged((block.number for block in blocks), note)
    if done := sum(map(job.finished, finished)):
        note(f"{done} of {len(blocks)} blocks were judged before, and are in {job.parts.folder}")


def _rows(
    job: VerifyJob, looks: Sequence[Sequence[HogelBlock]]
) -> tuple[list[dict[str, Any]], SampleExtent | None] | None:
    """Return all rows with hogels, and the counts of a sample; None while blocks are missing."""
    rows, sample = list[dict[str, Any]](), job.request.sample
    for look, blocks in enumerate(looks):
        if not all(map(job.finished, blocks)):
            return None
        # Parse each block before reading the next: the text of millions of hogels is large.
        rows += [
            row | {"found": _HOGEL.validate_json(row["found"])}
            for block in blocks
            for row in job.parts.read(block.number).to_pylist()
        ]
        extent = None if sample is None else sample.extent(len(rows), look)
        failed = sum(row["verdict"] != Outcome.PASS for row in rows)
        if extent is None or extent.decides(failed):
            return rows, extent
    return None


def _worst(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the worst hogels, in the order of `WorstHogels`."""
    there = [row for row in rows if row["worst_as_found"] is not None]
    key = itemgetter("worst_as_found", "worst_corrected")
    return heapq.nlargest(MAX_SHOWN_HOGELS, there, key=key)
