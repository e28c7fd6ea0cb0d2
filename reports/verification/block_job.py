"""Blocks of hogels of a foreign renderer, judged by any process as `verify` does."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from xfrustum.compare.diagnosis.diagnosis import Diagnosis
from xfrustum.compare.judging.judged import Figures, HogelNumbers
from xfrustum.reference import Reference
from xfrustum.reports.cluster.job import Session
from xfrustum.reports.cluster.rows_job import RowsJob
from xfrustum.reports.common.json_ready import json_object
from xfrustum.reports.common.records import table_of
from xfrustum.reports.verification.commands import Command
from xfrustum.reports.verification.file_state import (
    require_same_command,
    require_same_images,
    state_of_command,
    state_of_images,
)
from xfrustum.reports.verification.sources import Source, absolute_pattern
from xfrustum.reports.verification.stored_question import (
    QUESTION,
    StoredQuestion,
    agreed_question,
    plain_json,
    stored_question,
)
from xfrustum.reports.verification.verdict import Check, Hogel, Limits
from xfrustum.reports.verification.verification import (
    Question,
    Run,
    asked_apertures,
    nominal_model,
    opened_source,
    sampled,
)
from xfrustum.reports.verification.worst_hogels import Pictured, WorstHogels
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

Index = tuple[int, int]
"""Column and row of a hogel."""


@dataclass(frozen=True, kw_only=True)
class ForeignRenderer:
    """Where the images of a renderer come from, and what is known of it; see `verify`.

    Attributes
    ----------
    source, command
        Pattern of files with {i} and {j}; or a command, which is run by the process that judges.
    encoding, near, accept, timeout_s
        As for `verify`.
    folder
        Folder in which a command runs; None for that of the process.
    named_from
        Folder from which the user named the files, for what is written of them, where `source` is absolute
        and the name that was given is not; else None.
    """

    source: str | None = None
    command: str | None = None
    encoding: Encoding | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()
    timeout_s: float = 60.0
    folder: Path | None = None
    named_from: Path | None = None

    @property
    def images(self) -> dict[str, Any]:
        """The images and what is known of them, as the folder of a verification describes them.

        They are the same wherever the files were named from, and whatever command draws them.
        """
        named = replace(self, source=self.source and absolute_pattern(self.source), command=None, folder=None)
        return {name: value for name, value in json_object(named).items() if name != "named_from"}

    def state(self, apertures: Sequence[Aperture]) -> str:
        """Return a digest of the files that its images depend on."""
        if self.command is not None:
            return state_of_command(self.command, self.folder or Path.cwd())
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
    worst_as_found, worst_corrected
        How bad it is, by which the worst are chosen; None where it is missing.
    question
        Digest of the question that it was judged by.
    """

    column: int
    row: int
    verdict: str
    found: str
    worst_as_found: float | None
    worst_corrected: float | None
    question: str


@dataclass(frozen=True, kw_only=True)
class _Found:
    """The fields of a `Hogel` beside its aperture."""

    problem: str | None
    as_found: HogelNumbers | None
    corrected: HogelNumbers | None
    checks: tuple[Check, ...]


_FOUND = TypeAdapter(_Found)


def hogel_of(aperture: Aperture, found: str) -> Hogel:
    """Return a hogel from the JSON object of its row."""
    return Hogel(aperture=aperture, **vars(_FOUND.validate_python(json.loads(found))))


@dataclass(frozen=True, kw_only=True)
class VerifyJob(RowsJob):
    """A verification, as it travels to workers.

    Attributes
    ----------
    renderer
        ForeignRenderer whose images are judged.
    state
        Digest of the image files, or of the program and the files that a command names; every process
        compares it.
    limits
        Limits that every hogel is held to.
    indices
        Column and row of each hogel that is judged; none for the whole plate.
    """

    renderer: ForeignRenderer
    state: str
    limits: Limits
    indices: tuple[Index, ...]
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
            The scene, the images or the program are others than those of the command.
        """
        here, renderer = self.scene_here(scene), self.renderer
        asked = asked_apertures(here, self.indices)
        if renderer.source is not None:
            require_same_images(renderer.source, renderer.state(asked), self.state)
        else:
            assert renderer.command is not None, "there is either a source or a command"
            if renderer.folder is not None and not renderer.folder.is_dir():
                raise InputError(
                    f"--command {renderer.command!r}: there is no folder {renderer.folder}, in which it is "
                    "to run; start it from one that the command and all workers share"
                )
            require_same_command(renderer.command, renderer.state(asked), self.state)
        reference = Reference(here)
        with source_of(reference, renderer) as source:
            yield VerifySession(
                self, Run(reference=reference, source=source, asked=asked, limits=self.limits)
            )

    def stored_question(self) -> StoredQuestion | None:
        """Return the question in its folder; None where nobody has diagnosed the renderer yet."""
        return stored_question(self.parts)

    def begin_anew(self) -> None:
        """Remove all blocks, and what they were judged by."""
        for number in self.blocks.numbers(0):
            self.parts.remove(number)
        self.parts.remove_beside(QUESTION)


@contextmanager
def source_of(reference: Reference, renderer: ForeignRenderer) -> Iterator[Source]:
    """Open where images come from."""
    with opened_source(
        reference, renderer.source, renderer.command, renderer.encoding, renderer.timeout_s, None
    ) as source:
        if isinstance(source, Command):
            source.working = renderer.folder
        yield source


class VerifySession(Session):
    """A judge of one renderer's hogels, for the blocks of one verification."""

    def __init__(self, job: VerifyJob, run: Run) -> None:
        self._job, self._run = job, run
        self._known: tuple[StoredQuestion, Question] | None = None

    @property
    def diagnosis(self) -> Diagnosis:
        """What was found wrong with the renderer."""
        return self._agreed()[1].found.diagnosis

    def _agreed(self) -> tuple[StoredQuestion, Question]:
        """Return what all processes judge by; a session may outlive a verification that began anew."""
        stored = self._job.stored_question()
        if self._known is None or stored is None or stored.digest != self._known[0].digest:
            self._run.kept.clear()
            self._known = agreed_question(self._job.parts, self._diagnosed)
        return self._known

    def _diagnosed(self) -> tuple[Question, tuple[Index, ...]]:
        """Diagnose the renderer; return what its hogels are judged by, and those that could not be had."""
        run, renderer = self._run, self._job.renderer
        scene = run.reference.scene
        nominal = nominal_model(scene, renderer.near, renderer.accept)
        question = run.question(sampled(run.asked, scene), nominal, renderer.accept)
        had = run.kept.items()
        return question, tuple(one.index for one, image in had if not isinstance(image, HogelImage))

    def make(self, number: int) -> None:
        """Judge the hogels of a block, and write their rows."""
        stored, question = self._agreed()
        bad = _Badness()
        apertures = self._job.blocks.apertures(number)
        rows = []
        for hogel in self._run.hogels(question, apertures, bad):
            badness = bad.taken(hogel.aperture)
            rows.append(
                VerifiedRow(
                    column=hogel.aperture.column,
                    row=hogel.aperture.row,
                    verdict=hogel.verdict,
                    found=_written(hogel.told_from(self._job.renderer.named_from)),
                    worst_as_found=badness[0],
                    worst_corrected=badness[1],
                    question=stored.digest,
                )
            )
        self._job.parts.write(number, table_of(VerifiedRow, rows))

    def pictured(self, index: Index, *, channels: bool) -> Pictured | None:
        """Return a hogel in pictures, with all its channels or without; None where it is missing."""
        scene = self._run.reference.scene
        aperture = scene.plate.aperture(*index)
        worst = WorstHogels(scene=scene if channels else None)
        figures = self._run.judged(self._agreed()[1], aperture)[1]
        if figures is not None:
            worst.add(aperture, *figures)
        return worst.kept[0] if worst.kept else None

    def can_be_had(self, indices: Sequence[Index]) -> bool:
        """Return whether there is an image of any of some hogels."""
        plate = self._run.reference.scene.plate
        return any(self._run.had(plate.aperture(*index)) for index in indices)


class _Badness:
    """How bad hogels are, in place of their pictures, while a block passes by."""

    def __init__(self) -> None:
        self._known: dict[Aperture, tuple[float, float]] = {}

    def add(self, aperture: Aperture, as_found: Figures, corrected: Figures) -> None:
        """Keep how bad a hogel is."""
        self._known[aperture] = (as_found.judged_fraction, corrected.judged_fraction)

    def taken(self, aperture: Aperture) -> tuple[float, float] | tuple[None, None]:
        """Return how bad a hogel is, and forget it; two times None where it is missing."""
        return self._known.pop(aperture, (None, None))


def diagnosis_of(session: VerifySession) -> Diagnosis:
    """Return what was diagnosed; a question that a team of workers is asked."""
    return session.diagnosis


def pictured_of(session: VerifySession, index: Index, channels: bool) -> Pictured | None:
    """Return a hogel in pictures; a question that a team of workers is asked."""
    return session.pictured(index, channels=channels)


def can_be_had_of(session: VerifySession, indices: Sequence[Index]) -> bool:
    """Return whether any of some hogels can be had; a question that a team of workers is asked."""
    return session.can_be_had(indices)


def _written(hogel: Hogel) -> str:
    """Return the fields of a hogel but its aperture as JSON; numbers keep all digits."""
    return plain_json({name: value for name, value in asdict(hogel).items() if name != "aperture"})
