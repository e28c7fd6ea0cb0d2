"""Verifications on the engine of `reports.cluster`: blocks of hogels judged by any process, as `verify` does.

A block becomes a Parquet part with one row for each hogel, and the pictures of its worst ones. When all parts
are there, the verification is put together from them, and is the one that one process makes alone. Every
process diagnoses the renderer for itself, with the same outcome, for a diagnosis holds images and truths.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.extent import require_seen
from xfrustum.compare.judging.judged import HogelNumbers
from xfrustum.reference import Reference
from xfrustum.reports.cluster.blocks import Blocks, ListedBlocks, Tiles, hogels_per_block
from xfrustum.reports.cluster.job import Session
from xfrustum.reports.cluster.parts import Parts
from xfrustum.reports.cluster.rows_job import RowsJob
from xfrustum.reports.cluster.run import Engine, open_team, run_blocks
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.records import table_of
from xfrustum.reports.inspection.foreign import inspected_figures
from xfrustum.reports.inspection.hogels import InspectedHogel
from xfrustum.reports.verification.file_state import (
    require_same_images,
    state_of_command,
    state_of_images,
)
from xfrustum.reports.verification.laid_out import LaidOut
from xfrustum.reports.verification.sources import Source
from xfrustum.reports.verification.verdict import Check, Hogel, Limits, Verification
from xfrustum.reports.verification.verification import (
    Question,
    Run,
    asked_apertures,
    nominal_model,
    opened_source,
    sampled,
)
from xfrustum.reports.verification.worst_hogels import Pictured, WorstHogels
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.plate import Aperture

PARTS = "verification.parquet"
"""Folder of the parts, in the folder of the verification."""


@dataclass(frozen=True, kw_only=True)
class ForeignRenderer:
    """Where the images of a renderer come from, and what is known of it; see `verify`.

    Attributes
    ----------
    source, command
        Pattern of files with {i} and {j}; or a command, which is run by the process that judges.
    encoding, near, accept, timeout_s
        As for `verify`.
    """

    source: str | None = None
    command: str | None = None
    encoding: Encoding | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()
    timeout_s: float = 60.0

    def state(self, apertures: Sequence[Aperture]) -> str:
        """Return a digest of the files that its images depend on."""
        if self.command is not None:
            return state_of_command(self.command)
        assert self.source is not None
        return state_of_images(self.source, apertures)


@dataclass(frozen=True, kw_only=True)
class VerifiedRow:
    """One hogel as it is kept.

    Attributes
    ----------
    column, row
        Place of the hogel on the plate.
    verdict
        The verdict in a word.
    found
        JSON object of its problem, checks and figures.
    pictured
        JSON object of its pictures with how bad it is; None unless it is one of the worst of its block.
    """

    column: int
    row: int
    verdict: str
    found: str
    pictured: str | None


@dataclass(frozen=True, kw_only=True)
class _Found:
    """The fields of a `Hogel` beside its aperture."""

    problem: str | None
    as_found: HogelNumbers | None
    corrected: HogelNumbers | None
    checks: tuple[Check, ...]


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """The fields of a `Pictured` beside its aperture."""

    words: str
    badness: tuple[float, float]
    fraction: float
    corrected_fraction: float
    pictures: dict[str, str]


_FOUND, _SHOWN = TypeAdapter(_Found), TypeAdapter(_Shown)


@dataclass(frozen=True, kw_only=True)
class VerifyJob(RowsJob):
    """A verification, as it travels to workers.

    Attributes
    ----------
    renderer
        ForeignRenderer whose images are judged.
    state
        Digest of the image files, which every process compares; of a command it is the caller's alone.
    limits
        Limits that every hogel is held to.
    indices
        Column and row of each hogel that is judged; none for the whole plate.
    """

    renderer: ForeignRenderer
    state: str
    limits: Limits
    indices: tuple[tuple[int, int], ...]
    draws = False

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "verify"

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[VerifySession]:
        """Open the scene and the source of images.

        Raises
        ------
        InputError
            The scene or the images are others than those of the command.
        """
        here, renderer = self.scene_here(scene), self.renderer
        asked = asked_apertures(here, self.indices)
        if renderer.source is not None:
            require_same_images(renderer.source, renderer.state(asked), self.state)
        reference = Reference(here)
        with _source(reference, renderer) as source:
            yield VerifySession(
                self, Run(reference=reference, source=source, asked=asked, limits=self.limits)
            )


@contextmanager
def _source(reference: Reference, renderer: ForeignRenderer) -> Iterator[Source]:
    """Open where images come from."""
    with opened_source(
        reference, renderer.source, renderer.command, renderer.encoding, renderer.timeout_s, None
    ) as source:
        yield source


class VerifySession(Session):
    """A judge of one renderer's hogels, for the blocks of one verification."""

    def __init__(self, job: VerifyJob, run: Run) -> None:
        self._job, self._run = job, run
        scene, renderer = run.reference.scene, job.renderer
        nominal = nominal_model(scene, renderer.near, renderer.accept)
        self._question: Question = run.question(sampled(run.asked, scene), nominal, renderer.accept)

    @property
    def diagnosis(self) -> Diagnosis:
        """What was found wrong with the renderer."""
        return self._question.found.diagnosis

    def make(self, number: int) -> None:
        """Judge the hogels of a block, and write their rows."""
        worst = WorstHogels()
        hogels = list(self._run.hogels(self._question, self._job.blocks.apertures(number), worst))
        pictured = {one.aperture: one for one in worst.kept}
        rows = [
            VerifiedRow(
                column=hogel.aperture.column,
                row=hogel.aperture.row,
                verdict=hogel.verdict,
                found=_written(hogel),
                pictured=_written(pictured[hogel.aperture]) if hogel.aperture in pictured else None,
            )
            for hogel in hogels
        ]
        self._job.parts.write(number, table_of(VerifiedRow, rows))

    def inspected(self, column: int, row: int) -> InspectedHogel | None:
        """Return all channels of a hogel; None where it is missing."""
        scene = self._run.reference.scene
        aperture = scene.plate.aperture(column, row)
        figures = self._run.judged(self._question, aperture)[1]
        return None if figures is None else inspected_figures(scene, aperture, *figures)


def diagnosis_of(session: VerifySession) -> Diagnosis:
    """Return what a process has diagnosed; the question that a team of workers is asked."""
    return session.diagnosis


def inspected_of(session: VerifySession, column: int, row: int) -> InspectedHogel | None:
    """Return all channels of a hogel; a question that a team of workers is asked."""
    return session.inspected(column, row)


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

    Stopped at any moment and called again with the same folder it goes on where it was.

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
    if engine.scheduler is not None and renderer.source is not None:
        # Workers elsewhere have another working folder.
        renderer = replace(renderer, source=str(Path(renderer.source).absolute()))
    asked = asked_apertures(scene, apertures)
    name = _checked(scene, renderer, asked)
    with _folder(out) as folder:
        job = _job(scene, renderer, limits, asked, folder)
        answer = _answer(engine, job, scene, told, channels=out is not None, progress=progress)
    if answer is None:
        return None
    return Verification(
        scene=scene,
        source=name,
        limits=limits,
        diagnosis=answer.diagnosis,
        hogels=answer.hogels,
        worst=answer.worst,
    )


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
    numbers = engine.part.of(job.blocks.numbers(0))
    finished = sum(map(job.finished, numbers))
    if finished:
        told(f"{finished} of {len(numbers)} blocks were judged before, and are in {job.parts.folder}")
    with open_team(engine, len(numbers), scene, told, draws=False) as team:
        hogels = job.blocks.hogels(0) // engine.part.count
        run_blocks(job, numbers, team, hogels, "verify", progress=progress)
        if not all(map(job.finished, job.blocks.numbers(0))):
            return None
        judged, worst = _read(job, asked_apertures(scene, job.indices))
        if channels:
            worst.kept = [
                replace(one, inspected=team.ask(job, inspected_of, *one.aperture.index)) for one in worst.kept
            ]
        return _Answer(diagnosis=team.ask(job, diagnosis_of), hogels=judged, worst=worst)


def _checked(scene: Scene, renderer: ForeignRenderer, asked: Sequence[Aperture]) -> str:
    """Return the name of a renderer whose images can be judged in blocks.

    Raises
    ------
    InputError
        They cannot, or none of the apertures sees any object.
    """
    nominal_model(scene, renderer.near, renderer.accept)
    require_seen(scene, asked)
    with _source(Reference(scene), renderer) as source:
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
    named = renderer.source and str(Path(renderer.source).absolute())
    parts.open(
        json_ready(
            {
                "scene": ticket.description,
                "images": replace(renderer, source=named, command=None),
                "command": renderer.command,
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


def _read(job: VerifyJob, asked: Sequence[Aperture]) -> tuple[tuple[Hogel, ...], WorstHogels]:
    """Return all hogels in the order in which they were asked for, and the worst of them."""
    rows = {
        (row["column"], row["row"]): row
        for number in job.blocks.numbers(0)
        for row in job.parts.read(number).to_pylist()
    }
    hogels, worst = [], WorstHogels()
    for aperture in asked:
        row = rows[aperture.index]
        found = _FOUND.validate_python(json.loads(row["found"]))
        hogels.append(Hogel(aperture=aperture, **vars(found)))
        if row["pictured"] is not None:
            shown = _SHOWN.validate_python(json.loads(row["pictured"]))
            worst.keep(Pictured(aperture=aperture, **vars(shown)))
    return tuple(hogels), worst


def _written(one: Hogel | Pictured) -> str:
    """Return the fields of a hogel or of its pictures, but the aperture, as JSON; numbers keep all digits."""
    fields = {name: value for name, value in asdict(one).items() if name != "aperture"}
    return json.dumps(fields, default=_plain)


def _plain(value: Any) -> object:
    """Return a number of numpy as Python's own."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be written")
