"""`verify --workers`, `--scheduler` and `--part`: blocks of hogels that any process judges as `verify` does.

A block becomes a Parquet part with one row for each hogel. When all parts are there, the verification is put
together from them, and is the one that one process makes alone; the worst hogels are judged once more for
their pictures. The first process that judges diagnoses the renderer, and leaves the question beside the
parts: a renderer with noise answers otherwise each time.

Files are the same as long as their sizes and times are. Nobody knows what a command depends on: one that was
interrupted goes on, but for hogels that could not be had; one that was finished is begun anew.
"""

from __future__ import annotations

import hashlib
import heapq
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from xfrustum.compare.extent import require_seen
from xfrustum.compare.judging.judged import HogelNumbers
from xfrustum.reference import Reference
from xfrustum.reports.blocks import Engine, Job, Session, Workers, open_workers
from xfrustum.reports.common.json_ready import json_object, json_ready
from xfrustum.reports.common.records import table_of
from xfrustum.reports.parts import Parts
from xfrustum.reports.verification.laid_out import LaidOut, is_place
from xfrustum.reports.verification.sources import (
    Command,
    Source,
    absolute_pattern,
    folder_named_from,
    require_same_command,
    require_same_images,
    state_of_command,
    state_of_files,
    state_of_images,
)
from xfrustum.reports.verification.verdict import (
    Check,
    Hogel,
    Limits,
    Verification,
    with_correction_tested,
)
from xfrustum.reports.verification.verification import (
    Question,
    Run,
    asked_apertures,
    nominal_model,
    opened_source,
    sampled,
)
from xfrustum.reports.verification.worst_hogels import MAX_SHOWN_HOGELS, Pictured, WorstHogels
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.files.foreign_images import Encoding
from xfrustum.scenes.files.plate_files import PARAMETERS_FILE, pictures_at
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture, ApertureBlocks

Index = tuple[int, int]
"""Column and row of a hogel."""

PARTS, QUESTION = "verification.parquet", "_question.json"
"""Folder of the parts in that of the verification; and the file beside the parts that says what all hogels
are judged by. Readers of Parquet leave out names that begin like this."""

MAX_BLOCK_PIXELS, MIN_BLOCKS = 1 << 22, 16
"""Largest number of pixels in a block, some seconds of work; and number of blocks that even a small plate is
cut into, so that there is something for several processes to do."""


@dataclass(frozen=True, kw_only=True)
class ForeignRenderer:
    """Where the images of a renderer come from, and what is known of it; see `verify`.

    A command runs in `folder`, or in that of the process. Where `source` is absolute and the name that was
    given is not, the user named the files from `named_from`. Folders and pictures may state a `layout`.
    """

    source: str | None = None
    command: str | None = None
    encoding: Encoding | None = None
    near: float | None = None
    accept: tuple[str, ...] = ()
    timeout_s: float = 60.0
    folder: Path | None = None
    named_from: Path | None = None
    layout: str | None = None

    def placed(self, scene: Scene, told: Callable[[str], object]) -> ForeignRenderer:
        """Return the renderer with absolute names of its files, and the layout in which they are read.

        Where none is stated, `told` is called with the layout that a folder or picture looks like.

        Raises
        ------
        InputError
            There is no file of any hogel, or the files do not fit the layout.
        """
        assert self.source is not None
        named = self.layout is not None or is_place(self.source, scene.plate)
        place = str(Path(self.source).absolute()) if named else absolute_pattern(self.source)
        found = replace(self, source=place, named_from=folder_named_from(self.source))
        with found.opened(Reference(scene)) as source:
            source.check(scene.plate.apertures())
            if not isinstance(source, LaidOut):
                return found
            if self.layout is None:
                told(f"{self.source} looks like {source.files.words}")
            return replace(found, layout=source.files.layout.name)

    def for_workers(self, *, elsewhere: bool) -> ForeignRenderer:
        """Return the renderer as workers find it, who may have another working folder than the command."""
        if self.command is not None and self.folder is None:
            return replace(self, folder=Path.cwd())
        if self.source is not None and elsewhere:
            named_from = folder_named_from(self.source)
            return replace(self, source=absolute_pattern(self.source), named_from=named_from)
        return self

    @property
    def description(self) -> dict[str, Any]:
        """What is written of it: the same wherever its files were named from."""
        source = self.source and absolute_pattern(self.source)
        fields = json_object(replace(self, source=source))
        return {name: value for name, value in fields.items() if name != "named_from"}

    def state(self, apertures: Sequence[Aperture]) -> str:
        """Return a digest of the files that its images depend on."""
        if self.command is not None:
            return state_of_command(self.command, self.folder or Path.cwd())
        assert self.source is not None
        if self.layout is None:
            return state_of_images(self.source, apertures)
        place = Path(self.source)
        beside = (place if place.is_dir() else place.parent) / PARAMETERS_FILE
        return state_of_files(map(str, (*pictures_at(place), beside)))

    def require_state(self, apertures: Sequence[Aperture], state: str) -> None:
        """Raise InputError where this process finds other files than the command did."""
        if self.source is not None:
            require_same_images(self.source, self.state(apertures), state)
            return
        assert self.command is not None, "there is either a source or a command"
        if self.folder is not None and not self.folder.is_dir():
            raise InputError(
                f"--command {self.command!r}: there is no folder {self.folder}, in which it is to run; start "
                "it from one that the command and all workers share"
            )
        require_same_command(self.command, self.state(apertures), state)

    @contextmanager
    def opened(self, reference: Reference) -> Iterator[Source]:
        """Open where its images come from."""
        with opened_source(
            reference, self.source, self.command, self.encoding, self.timeout_s, self.layout
        ) as source:
            if isinstance(source, Command):
                source.working = self.folder
            yield source


@dataclass(frozen=True, kw_only=True)
class VerifiedRow:
    """One hogel as it is kept: its place and verdict, and the JSON object of problem, checks and figures.

    The worst are chosen by how bad they are; None where a hogel is missing. `question` is the digest of what
    it was judged by.
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


_FOUND, _QUESTION = TypeAdapter(_Found), TypeAdapter(Question)


def _plain(value: Any) -> object:
    """Return a number of NumPy as Python's own, which has the same digits in JSON."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be written")


@dataclass(frozen=True, kw_only=True)
class VerifyJob(Job):
    """A verification, as it travels to workers.

    `state` is the digest of the image files, or of the program and the files that a command names; `indices`
    are those of the hogels that are judged, none for the whole plate.
    """

    scene: Scene
    renderer: ForeignRenderer
    limits: Limits
    state: str
    indices: tuple[Index, ...]
    hogels_per_block: int
    parts: Parts
    draws: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """Word for the work."""
        return "verify"

    @cached_property
    def asked(self) -> Sequence[Aperture]:
        """Apertures of all hogels."""
        return asked_apertures(self.scene, self.indices)

    @property
    def blocks(self) -> range:
        """Numbers of all blocks."""
        return range(math.ceil(len(self.asked) / self.hogels_per_block))

    def apertures(self, block: int) -> Sequence[Aperture]:
        """Return the apertures of a block."""
        return self.asked[block * self.hogels_per_block :][: self.hogels_per_block]

    def finished(self, block: int) -> bool:
        """Return whether the part of a block is there."""
        return self.parts.finished(block)

    def size(self, block: int) -> int:
        """Return the number of hogels of a block."""
        return min(self.hogels_per_block, len(self.asked) - block * self.hogels_per_block)

    def words(self, block: int) -> str:
        """Return a block in words."""
        i, j = self.asked[block * self.hogels_per_block].index
        return f"the hogels from {i},{j}"

    @contextmanager
    def open(self) -> Iterator[VerifySession]:
        """Open the source of images.

        Raises
        ------
        InputError
            The images or the program are others than those of the command.
        """
        self.renderer.require_state(self.asked, self.state)
        reference = Reference(self.scene)
        with self.renderer.opened(reference) as source:
            run = Run(reference=reference, source=source, asked=self.asked, limits=self.limits)
            yield VerifySession(self, run)


class VerifySession(Session):
    """A judge of one renderer's hogels."""

    def __init__(self, job: VerifyJob, run: Run) -> None:
        self._job, self._run = job, run
        self._known: tuple[str, Question] | None = None

    def question(self) -> tuple[str, Question]:
        """Return what all processes judge by, and its digest; who asks first diagnoses the renderer."""
        if self._known is None:
            parts, renderer, scene = self._job.parts, self._job.renderer, self._job.scene
            if parts.read_beside(QUESTION) is None:
                nominal = nominal_model(scene, renderer.near, renderer.accept)
                found = self._run.question(sampled(self._job.asked, scene), nominal, renderer.accept)
                parts.write_beside(QUESTION, json.dumps(asdict(found), default=_plain).encode())
            content = parts.read_beside(QUESTION)
            assert content is not None
            self._known = hashlib.sha256(content).hexdigest(), _QUESTION.validate_json(content)
        return self._known

    def make(self, block: int) -> None:
        """Judge the hogels of a block, and write their rows."""
        digest, question = self.question()
        rows = []
        for hogel, figures in self._run.hogels(question, self._job.apertures(block)):
            told = hogel.told_from(self._job.renderer.named_from)
            fields = {name: value for name, value in asdict(told).items() if name != "aperture"}
            as_found, corrected = figures or (None, None)
            rows.append(
                VerifiedRow(
                    column=hogel.aperture.column,
                    row=hogel.aperture.row,
                    verdict=hogel.verdict,
                    found=json.dumps(fields, default=_plain),
                    worst_as_found=None if as_found is None else as_found.judged_fraction,
                    worst_corrected=None if corrected is None else corrected.judged_fraction,
                    question=digest,
                )
            )
        self._job.parts.write(block, table_of(VerifiedRow, rows))

    def pictured(self, index: Index, channels: bool) -> Pictured | None:
        """Return a hogel in pictures, with all its channels or without; None where it is missing."""
        aperture = self._job.scene.plate.aperture(*index)
        return self._run.pictured(self.question()[1], aperture, channels=channels)


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
    scene, renderer, limits, apertures, progress
        As for `verify`.
    out
        Folder in which the parts are kept; None for a folder of this machine's that is gone afterwards.
    told
        Called with notes in words.

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
    renderer = renderer.for_workers(elsewhere=engine.scheduler is not None)
    with _folder(out) as folder:
        job = _job(scene, renderer, limits, asked, folder)
        blocks = list(engine.part.of(job.blocks))
        if renderer.command is not None:
            _forget(job, blocks, told)
        job.parts.tell_damaged(blocks, told)
        done = sum(map(job.finished, blocks))
        if done:
            told(f"{done} of {len(blocks)} blocks were judged before, and are in {job.parts.folder}")
        with open_workers(engine, len(blocks), draws=False) as workers:
            if done < len(blocks):
                # One process diagnoses before all others judge.
                workers.ask(job, VerifySession.question)
            workers.run(job, blocks, sum(map(job.size, blocks)), progress=progress)
            if not all(map(job.finished, job.blocks)):
                return None
            found = _put_together(job, workers, name, told, channels=out is not None)
    return found if renderer.accept else with_correction_tested(found)


def _forget(job: VerifyJob, blocks: Sequence[int], told: Callable[[str], object]) -> None:
    """Remove what a command may answer otherwise by now: what is finished, and what was missing."""
    if blocks and all(map(job.finished, job.blocks)):
        told(f"what is in {job.parts.folder} was finished; the command is judged anew")
        for block in job.blocks:
            job.parts.remove(block)
        job.parts.remove_beside(QUESTION)
    for block in filter(job.finished, blocks):
        if "missing" in job.parts.read(block, ["verdict"])["verdict"].to_pylist():
            job.parts.remove(block)


def _checked(scene: Scene, renderer: ForeignRenderer, asked: Sequence[Aperture]) -> str:
    """Return the name of a renderer whose images can be judged in blocks.

    Raises
    ------
    InputError
        They cannot, or none of the apertures sees any object.
    """
    nominal_model(scene, renderer.near, renderer.accept)
    require_seen(scene, asked)
    with renderer.opened(Reference(scene)) as source:
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
    whole = isinstance(asked, ApertureBlocks)
    indices = () if whole else tuple(one.index for one in asked)
    most = MAX_BLOCK_PIXELS // math.prod(scene.frustum.resolution)
    size = max(1, min(most, math.ceil(len(asked) / MIN_BLOCKS)))
    state, parts = renderer.state(asked), Parts(out=folder, name=PARTS)
    parts.open(
        json_ready(
            {
                "scene": scene.content_hash,
                "renderer": renderer.description,
                "state of the images": state,
                "limits": limits,
                "hogels": {"hogels": indices, "size": size},
            }
        )
    )
    return VerifyJob(
        scene=scene,
        renderer=renderer,
        limits=limits,
        state=state,
        indices=indices,
        hogels_per_block=size,
        parts=parts,
    )


def _put_together(
    job: VerifyJob, workers: Workers, name: str, told: Callable[[str], object], *, channels: bool
) -> Verification:
    """Return the verification of finished blocks; the worst hogels are judged once more for pictures.

    Raises
    ------
    InputError
        The hogels were not all judged by the same question.
    """
    digest, question = workers.ask(job, VerifySession.question)
    hogels: list[Hogel] = []
    badness: list[tuple[Index, tuple[float, float]]] = []
    # One part after the other: a plate of millions has more text than hogels have numbers.
    for block in job.blocks:
        for aperture, row in zip(job.apertures(block), job.parts.read(block).to_pylist(), strict=True):
            if row["question"] != digest:
                raise InputError(
                    f"{job.parts.path(block)}: was judged by another diagnosis than the rest; delete "
                    f"{job.parts.folder} and repeat the command"
                )
            hogels.append(Hogel(aperture=aperture, **vars(_FOUND.validate_json(row["found"]))))
            if row["worst_as_found"] is not None:
                badness.append((aperture.index, (row["worst_as_found"], row["worst_corrected"])))
    # As in `WorstHogels.keep`, of equals those that come first.
    kept = []
    for index, _ in heapq.nlargest(MAX_SHOWN_HOGELS, badness, key=itemgetter(1)):
        one = workers.ask(job, VerifySession.pictured, index, channels)
        if one is None:
            told(f"hogel {index[0]},{index[1]} could not be had once more, and has no pictures")
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
