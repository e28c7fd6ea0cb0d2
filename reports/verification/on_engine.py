"""Verifications on the engine of `reports.cluster`: blocks of hogels judged by any process, as `verify` does.

A block becomes a Parquet part with one row for each hogel. When all parts are there, the verification is put
together from them, and is the one that one process makes alone; the worst hogels are judged once more for
their pictures. The first process that judges diagnoses the renderer for all of them.

Files are the same as long as their sizes and times are. Nobody knows what a command depends on: one that was
interrupted goes on, but for hogels that could not be had; one that was finished is begun anew.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path

from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.extent import require_seen
from xfrustum.reference import Reference
from xfrustum.reports.cluster.blocks import Blocks, ListedBlocks, Tiles, hogels_per_block
from xfrustum.reports.cluster.run import Engine, Team, open_team, run_blocks
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.parts import Parts
from xfrustum.reports.verification.block_job import (
    ForeignRenderer,
    Index,
    VerifyJob,
    can_be_had_of,
    diagnosis_of,
    hogel_of,
    pictured_of,
    source_of,
)
from xfrustum.reports.verification.laid_out import LaidOut
from xfrustum.reports.verification.sources import absolute_pattern, folder_named_from
from xfrustum.reports.verification.stored_question import POLL_S, QUESTION_CLAIM
from xfrustum.reports.verification.verdict import Hogel, Limits, Verification, with_correction_tested
from xfrustum.reports.verification.verification import asked_apertures, nominal_model
from xfrustum.reports.verification.worst_hogels import MAX_SHOWN_HOGELS, WorstHogels
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.plate import Aperture

__all__ = ["PARTS", "ForeignRenderer", "verify_on"]

PARTS = "verification.parquet"
"""Folder of the parts, in the folder of the verification."""

WHOLE_CLAIM = QUESTION_CLAIM + 1
"""Claim of whoever begins all blocks anew, or puts them together."""


def verify_on(  # noqa: PLR0913 - one keyword for each thing that `verify` is told
    engine: Engine,
    scene: Scene,
    renderer: ForeignRenderer,
    limits: Limits,
    *,
    apertures: Sequence[tuple[int, int]] | None = None,
    out: Path | None = None,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> Verification | None:
    """Judge the hogel images of a renderer by several processes; the verification is that of `verify`.

    Stopped at any moment and called again with the same folder it goes on where it was. A command whose
    hogels are all judged in this folder is judged anew, and so are blocks with hogels that could not be had.

    Parameters
    ----------
    engine
        Where hogels are judged, and commands run.
    scene, apertures, progress
        As for `verify`.
    renderer
        ForeignRenderer whose images are judged.
    limits
        Limits that every hogel is held to.
    out
        Folder in which the parts are kept; None for a folder of this machine's that is gone afterwards.
    told
        Called with notes in words, such as the address of the dashboard.

    Returns
    -------
    None where other parts of a job array are not finished yet.

    Raises
    ------
    InputError
        As from `verify`; or there is no folder that others see, or the folder holds something else.
    """
    if out is None and (engine.scheduler is not None or not engine.part.everything):
        raise InputError("--scheduler and --part keep what is judged in a folder: give --out too")
    asked = asked_apertures(scene, apertures)
    name = _checked(scene, renderer, asked)
    renderer = for_workers(renderer, elsewhere=engine.scheduler is not None)
    with _folder(out) as folder:
        job = _job(scene, renderer, limits, asked, folder)
        answer = _answer(engine, job, scene, told, channels=out is not None, progress=progress)
    if answer is None:
        return None
    found = Verification(
        scene=scene,
        source=name,
        limits=limits,
        diagnosis=answer.diagnosis,
        hogels=answer.hogels,
        worst=answer.worst,
    )
    return found if renderer.accept else with_correction_tested(found)


def for_workers(renderer: ForeignRenderer, *, elsewhere: bool) -> ForeignRenderer:
    """Return a renderer as workers find it, who may have another working folder than the command."""
    if renderer.command is not None and renderer.folder is None:
        return replace(renderer, folder=Path.cwd())
    if renderer.source is not None and elsewhere:
        named_from = folder_named_from(renderer.source)
        return replace(renderer, source=absolute_pattern(renderer.source), named_from=named_from)
    return renderer


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """What processes have found out together."""

    diagnosis: Diagnosis
    hogels: tuple[Hogel, ...]
    worst: WorstHogels


def _answer(
    engine: Engine,
    job: VerifyJob,
    scene: Scene,
    told: Callable[[str], object],
    *,
    channels: bool,
    progress: bool,
) -> _Answer | None:
    """Have all hogels judged, and return what was found; None where others are at work."""
    numbers = list(engine.part.of(job.blocks.numbers(0)))
    with open_team(engine, len(numbers), scene, told, draws=False) as team:
        if job.renderer.command is not None:
            outdated = _outdated(job, team)
            with _all_of(job):
                _forget(job, numbers, outdated, told)
        finished = sum(map(job.finished, numbers))
        if finished:
            told(f"{finished} of {len(numbers)} blocks were judged before, and are in {job.parts.folder}")
        hogels = job.blocks.hogels(0) // engine.part.count
        run_blocks(job, numbers, team, hogels, "verify", progress=progress)
        with _all_of(job):
            if not all(map(job.finished, job.blocks.numbers(0))):
                return None
            judged, indices = _read(job, asked_apertures(scene, job.indices))
            pictured = [(index, team.ask(job, pictured_of, index, channels)) for index in indices]
            for index, one in pictured:
                if one is None:
                    told(f"hogel {index[0]},{index[1]} could not be had once more, and has no pictures")
            worst = WorstHogels(kept=[one for _, one in pictured if one is not None])
            return _Answer(diagnosis=team.ask(job, diagnosis_of), hogels=judged, worst=worst)


@contextmanager
def _all_of(job: VerifyJob) -> Iterator[None]:
    """Keep others from beginning all blocks anew or putting them together, until a `with` block ends."""
    with job.claims() as claims:
        while not claims.take(WHOLE_CLAIM):
            time.sleep(POLL_S)
        yield


def _outdated(job: VerifyJob, team: Team) -> str | None:
    """Return the digest of the stored question if it lacks hogels of which any can be had by now."""
    stored = job.stored_question()
    if stored is None or not stored.missing or not team.ask(job, can_be_had_of, stored.missing):
        return None
    return stored.digest


def _forget(
    job: VerifyJob, numbers: Sequence[int], outdated: str | None, told: Callable[[str], object]
) -> None:
    """Remove what a command may answer otherwise by now.

    That is everything if nothing is left to do, or if the question is outdated; else those of some blocks
    that have hogels which could not be had, or that were judged by another question. A part of the work that
    has no blocks removes nothing.
    """
    stored = job.stored_question()
    digest = None if stored is None else stored.digest
    if numbers and all(map(job.finished, job.blocks.numbers(0))):
        told(f"what is in {job.parts.folder} was finished; the command is judged anew")
        job.begin_anew()
    elif digest is not None and digest == outdated:
        told(f"hogels can be had that were missing; what is in {job.parts.folder} is judged anew")
        job.begin_anew()
    else:
        for number in filter(job.finished, numbers):
            rows = job.parts.read(number, ["verdict", "question"]).to_pydict()
            if "missing" in rows["verdict"] or any(one != digest for one in rows["question"]):
                job.parts.remove(number)


def _checked(scene: Scene, renderer: ForeignRenderer, asked: Sequence[Aperture]) -> str:
    """Return the name of a renderer whose images can be judged in blocks.

    Raises
    ------
    InputError
        They cannot, or none of the apertures sees any object.
    """
    nominal_model(scene, renderer.near, renderer.accept)
    require_seen(scene, asked)
    with source_of(Reference(scene), renderer) as source:
        if isinstance(source, LaidOut):
            raise InputError(
                "--workers, --scheduler and --part judge files that a pattern names, or a --command: name "
                "the files with {i} and {j}, or leave these options out"
            )
        source.check(asked)
        return source.name


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    """Provide the folder of the parts."""
    if out is not None:
        yield out.absolute()
        return
    with Aside(scratch_folder(), folder=True) as aside:
        yield aside.path


def _job(
    scene: Scene, renderer: ForeignRenderer, limits: Limits, asked: Sequence[Aperture], folder: Path
) -> VerifyJob:
    """Return the work, described in its folder."""
    size = hogels_per_block(len(asked), scene.frustum, 1)
    whole = isinstance(asked, ApertureBlocks)
    indices = () if whole else tuple(one.index for one in asked)
    blocks: Blocks = (
        Tiles.of(scene.plate, size) if whole else ListedBlocks(plate=scene.plate, indices=indices, size=size)
    )
    ticket, state = SceneTicket.of(scene), renderer.state(asked)
    parts = Parts(out=folder, name=PARTS)
    parts.open(
        json_ready(
            {
                "scene": ticket.description,
                "images": renderer.images,
                "command": renderer.command,
                "working folder": renderer.folder and str(renderer.folder),
                "state of the images": state,
                "limits": limits,
                "hogels": blocks.description,
            }
        )
    )
    return VerifyJob(
        ticket=ticket,
        blocks=blocks,
        parts=parts,
        renderer=renderer,
        state=state,
        limits=limits,
        indices=indices,
    )


def _read(job: VerifyJob, asked: Sequence[Aperture]) -> tuple[tuple[Hogel, ...], list[Index]]:
    """Return all hogels in the order in which they were asked for, and the indices of the worst of them.

    Raises
    ------
    InputError
        They were not all judged by the same question.
    """
    stored = job.stored_question()
    hogels: dict[Index, Hogel] = {}
    badness: dict[Index, tuple[float, float]] = {}
    # One part after the other: a plate of millions has more text than hogels have numbers.
    for number in job.blocks.numbers(0):
        for aperture, row in zip(
            job.blocks.apertures(number), job.parts.read(number).to_pylist(), strict=True
        ):
            if stored is None or row["question"] != stored.digest:
                raise InputError(
                    f"{job.parts.path(number)}: was judged by another diagnosis than the rest; delete "
                    f"{job.parts.folder} and repeat the command"
                )
            index = aperture.index
            hogels[index] = hogel_of(aperture, row["found"])
            if row["worst_as_found"] is not None:
                badness[index] = (row["worst_as_found"], row["worst_corrected"])
    judged = ((one.index, badness[one.index]) for one in asked if one.index in badness)
    # As in `WorstHogels.keep`, of equals those that come first.
    worst = heapq.nlargest(MAX_SHOWN_HOGELS, judged, key=itemgetter(1))
    return tuple(hogels[one.index] for one in asked), [index for index, _ in worst]
