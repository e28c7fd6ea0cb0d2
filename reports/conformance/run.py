"""A renderer taken through the conformance suite: handed each case, judged, and its mistakes named.

Each case is a block of work whose result is a Parquet part: a run that was stopped goes on where it
was, and any process may judge any case. Verdicts rest on the frozen truth and the bounds of
rounding alone; a case that fails is verified once more, to name the cause.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
from PIL import Image
from pydantic import TypeAdapter

from xfrustum.compare.judging.conformance import Pixels, judged
from xfrustum.compare.judging.judged import ANY_DEVICE
from xfrustum.reference import Reference
from xfrustum.reports.blocks import HERE, Engine, Job, Session, open_workers
from xfrustum.reports.common.outputs import json_ready
from xfrustum.reports.conformance.cases import Truths, traced, write_case
from xfrustum.reports.parts import ParquetParts
from xfrustum.reports.verification.sources import ForeignRenderer, Problem, fields_of, run_program
from xfrustum.scenes import NOTHING, HogelImage, InputError, Scene
from xfrustum.scenes.arguments import check_program, real
from xfrustum.scenes.conformance.suite import SUITE, Case, suite_digest
from xfrustum.scenes.disk.durable import TempPath, scratch_folder
from xfrustum.scenes.disk.input_files import read_small
from xfrustum.scenes.files.exr import write_planes
from xfrustum.scenes.files.foreign_images import Encoding, bytes_of, read_foreign
from xfrustum.scenes.model.device_model import DeviceModel

PARTS = "conformance.parquet"
"""Folder of the parts in that of the statement."""

UNSUPPORTED = "unsupported"
"""File that a renderer writes in place of images, with the reason, for a case that it does not claim."""

LARGEST_REASON = 1 << 16  # bytes of the largest such file

SUFFIXES = (".png", ".exr")

Drawing = Callable[[Path, dict[str, Any], tuple[int, int]], Any]
"""A renderer in Python: it takes the folder of a case, its case.json and a hogel, and returns numbers plus
one, 0 for nothing, (H, W), or linear radiance (H, W, 3); NotImplementedError where it claims nothing."""


class UnsupportedError(Exception):
    """A case that a renderer does not claim, with its reason."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What was found of one case."""

    name: str
    level: str
    verdict: str  #: `pass`, `fail` or `unsupported`
    cause: str | None = (
        None  #: names of faults, or what else is wrong; of what is unsupported, the reason
    )
    words: tuple[str, ...] = ()  #: what is wrong, in sentences
    #: By fault, others that show the same images of this case: its level decides (`agreed`)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    hogels: int = 0
    pixels: Pixels = field(default_factory=Pixels)
    pictures: dict[str, str] = field(
        default_factory=dict
    )  #: truth, image and error of the worst hogel

    @property
    def told(self) -> str:
        """What is wrong, in words, or in numbers."""
        return "; ".join(self.words) or self.pixels.words

    @property
    def faults(self) -> tuple[str, ...]:
        """The faults that are named as the cause of a failure."""
        unnamed = self.verdict != "fail" or self.cause in (None, "missing", "unexplained")
        return () if unnamed else tuple(str(self.cause).split(", "))


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """A renderer that is taken through the suite: exactly one of command, images and python."""

    command: str | None = (
        None  #: run once for each case: {case} its folder, {out} the folder to be written
    )
    images: str | None = None  #: folder with a folder of images for each case
    python: str | None = None  #: module:function, a `Drawing`
    timeout_s: float = 60.0  #: of one case
    working: Path = field(default_factory=Path.cwd)  #: folder in which command and module are found

    def __post_init__(self) -> None:
        given = [one for one in (self.command, self.images, self.python) if one is not None]
        if len(given) != 1:
            raise InputError("give one of --command, --images and --python")
        if self.command is not None:
            named = fields_of(self.command, ("case", "out"), "--command")
            if "out" not in named:
                raise InputError(
                    f"--command {self.command!r} has no {{out}}: the folder to be written"
                )
            check_program(self.command, self.working)
        if self.images is not None and not (self.working / self.images).is_dir():
            raise InputError(
                f"--images {self.images}: is not a folder; give that of the folders of cases"
            )
        if self.python is not None and not all(self.python.partition(":")):
            raise InputError(f"--python {self.python!r}: give module:function")
        if not real(self.timeout_s) > 0:
            raise InputError(f"timeout must be positive, not {self.timeout_s}")

    @property
    def name(self) -> str:
        """How the renderer was given."""
        return str(self.command or self.images or self.python)

    @property
    def state(self) -> str:
        """Digest of names, sizes and times of the files that its images depend on, where they are known."""
        command = self.command
        if self.python is not None:
            module = sys.modules[self.function().__module__]
            command = shlex.quote(str(getattr(module, "__file__", None)))
        if command is not None:
            return ForeignRenderer(command=command, folder=self.working).state(())
        place = self.working / str(self.images)
        files = (file for file in place.rglob("*") if file.is_file())
        known = [
            (str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in sorted(files)
        ]
        return hashlib.sha256(repr(known).encode()).hexdigest()

    def function(self) -> Drawing:
        """Return the function of a renderer in Python; InputError where there is none."""
        module, _, name = str(self.python).partition(":")
        if str(self.working) not in sys.path:
            sys.path.insert(0, str(self.working))
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            raise InputError(f"--python {self.python}: {error}") from error
        if not callable(found):
            raise InputError(f"--python {self.python}: is no function")
        return cast(Drawing, found)

    def draw(self, case: Case, scene: Scene, aside: Path) -> Path:
        """Let it draw a case, and return the folder of its images; Problem or UnsupportedError where not."""
        out = aside / "out" if self.images is None else self.working / self.images / case.name
        if self.images is None:
            out.mkdir()
            write_case(case, scene, aside / "case")
        if self.command is not None:
            folders = {"case": aside / "case", "out": out}
            arguments = [one.format(**folders) for one in shlex.split(self.command)]
            run_program(arguments, aside, self.timeout_s, self.working)
        elif self.python is not None:
            self._call(case, aside / "case", out)
        reasons = sorted(out.glob(f"{UNSUPPORTED}*"))
        for path in (out, *reasons, *out.glob("hogel_*")):
            _check_within(path, out if self.images is None else self.working / self.images)
        if reasons:
            raise UnsupportedError(_reason(reasons[0]) or "not claimed")
        return out

    def _call(self, case: Case, folder: Path, out: Path) -> None:
        function, asked = (
            self.function(),
            json.loads((folder / "case.json").read_text(encoding="utf-8")),
        )
        for index in case.hogels:
            try:
                drawn = np.asarray(function(folder, asked, index))
            except NotImplementedError as error:
                raise UnsupportedError(str(error) or "not claimed") from error
            except Exception as error:
                # Whatever a stranger's code raises is a finding about the case.
                raise Problem(f"{self.python} raised {type(error).__name__}: {error}") from error
            width, height = asked["resolution"]
            wanted = (height, width, 3) if case.colored else (height, width)
            if drawn.shape != wanted:
                raise Problem(
                    f"{self.python} returned an array of shape {drawn.shape}, not {wanted}"
                )
            # Three bytes of a picture hold no fraction, no NaN, and no number beyond: none is to be
            # wrapped.
            if not case.colored and not (
                drawn.dtype.kind in "iu" and 0 <= drawn.min() <= drawn.max() < 1 << 24
            ):
                raise Problem(
                    f"{self.python} returned {drawn.dtype}; give integers from 0 to {(1 << 24) - 1:,}"
                )
            write_hogel(case, out, index, drawn)


def _check_within(path: Path, folder: Path) -> None:
    """Raise Problem at a link out of a folder: a stranger's link would bring any file into the statement."""
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        raise Problem(f"{path}: is a link out of {folder}; put the file itself there")


def _reason(path: Path) -> str:
    """Return the reason that a renderer's file states, which may be empty; Problem where it is no file."""
    try:
        empty = path.is_file() and path.stat().st_size == 0
        content = b"" if empty else read_small(path, "file with a reason", LARGEST_REASON)
    except InputError as error:
        raise Problem(str(error)) from error
    return content.decode(errors="replace").strip()


def write_hogel(case: Case, out: Path, index: tuple[int, int], drawn: Any) -> None:
    """Write the image of a hogel from numbers plus one, linear radiance, or bytes of a picture."""
    path = out / f"hogel_{index[0]}x{index[1]}"
    if case.colored and drawn.dtype == np.uint8:
        Image.fromarray(drawn).save(path.with_suffix(".png"))
        return
    if case.colored:
        planes = {name: drawn[..., place].astype(np.float32) for place, name in enumerate("RGB")}
        write_planes(path.with_suffix(".exr"), planes)
        return
    Image.fromarray(bytes_of(drawn)).save(path.with_suffix(".png"))


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One renderer's way through a case: how it draws, and what it is judged by."""

    contestant: Contestant
    truths: Truths = traced
    device: DeviceModel = ANY_DEVICE  #: by whose roundings wrong pixels are explained
    pictures: bool = True  #: whether to keep the pictures of what fails

    def verdict(self, case: Case) -> Verdict:
        """Let the renderer draw a case, judge it, and name the cause where it fails."""
        scene = case.open()
        found: dict[str, Any] = {"name": case.name, "level": case.level}
        with TempPath(scratch_folder(), folder=True) as aside:
            try:
                out = self.contestant.draw(case, scene, aside.path)
                images = {index: self._image(case, scene, out, index) for index in case.hogels}
            except UnsupportedError as told:
                return Verdict(**found, verdict="unsupported", cause=str(told))
            except Problem as problem:
                words = str(problem).replace(f"{aside.path}/", "")
                return Verdict(**found, verdict="fail", cause="missing", words=(words,))
            pixels, unexplained = Pixels(), dict[tuple[int, int], int]()
            for truth in self.truths(case, scene):
                index = truth.camera.aperture.index
                one, left = judged(case, scene, truth, images[index], self.device)
                pixels, unexplained[index] = pixels + one, int(left.sum())
            found |= {"hogels": len(images), "pixels": pixels}
            if pixels.within(case):
                return Verdict(**found, verdict="pass")
            if not any(map(_shows, images.values())):
                nothing = "nothing is shown, in any hogel"
                return Verdict(**found, verdict="fail", cause="nothing-shown", words=(nothing,))
            return Verdict(**found, verdict="fail", **self._named(case, scene, out))

    def _image(self, case: Case, scene: Scene, out: Path, index: tuple[int, int]) -> HogelImage:
        paths = [out / f"hogel_{index[0]}x{index[1]}{suffix}" for suffix in SUFFIXES]
        path = next(filter(Path.exists, paths), None)
        if path is None:
            raise Problem(f"no {paths[0].name} and no {paths[1].name} was written")
        camera = Reference(scene).camera(scene.plate.aperture(*index))
        try:
            return read_foreign(path, camera, Encoding(case.asked))
        except InputError as error:
            raise Problem(str(error)) from error

    def _named(self, case: Case, scene: Scene, out: Path) -> dict[str, Any]:
        """Return the cause of what is wrong by `verify`, and pictures of the worst hogel."""
        from xfrustum.reports.verification.verification import verify  # noqa: PLC0415 - takes long to load

        i, j = case.hogels[0]
        suffix = next(one for one in SUFFIXES if (out / f"hogel_{i}x{j}{one}").exists())
        folder = str(out).replace("{", "{{").replace("}", "}}")
        said = verify(
            scene,
            f"{folder}/hogel_{{i}}x{{j}}{suffix}",
            encoding=case.asked,
            apertures=case.hogels,
            near=case.near,
        )
        faults = said.diagnosis.faults
        guesses = tuple(f"perhaps {guess['words']}" for guess in said.best_guesses())
        worst = said.worst.kept[0].pictures if said.worst.kept and self.pictures else {}
        return {
            "cause": ", ".join(dict.fromkeys(fault.fault for fault in faults)) or "unexplained",
            "words": tuple(defect["words"] for defect in said.defects()) or guesses,
            "alternatives": {
                fault.fault: fault.alternatives for fault in faults if fault.alternatives
            },
            "pictures": {
                name: worst[name] for name in ("truth", "image", "error") if name in worst
            },
        }


def _shows(image: HogelImage) -> bool:
    """Return whether an image shows anything."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or (image.color is not None and (image.color > 0).any()))


_VERDICT = TypeAdapter(Verdict)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConformanceJob(Job):
    """The suite for one renderer, as it travels to workers; a block is the number of a case."""

    cases: Sequence[Case]
    trial: Trial
    parts: ParquetParts
    name = "conformance"
    draws = False
    unit = "case"

    def finished(self, block: int) -> bool:
        """Return whether the part of a case is there."""
        return self.parts.finished(block)

    def size(self, block: int) -> int:
        """Return 1: a block is a case."""
        return 1

    def words(self, block: int) -> str:
        """Return the name of a case."""
        return f"case {self.cases[block].name}"

    def verdict(self, block: int) -> Verdict:
        """Return the verdict of a finished case."""
        return _VERDICT.validate_json(self.parts.read(block)["verdict"][0].as_py())

    @contextmanager
    def open(self) -> Iterator[ConformanceSession]:
        """Open what judges cases."""
        yield ConformanceSession(job=self)


@dataclass
class ConformanceSession(Session):
    """A process that takes the renderer through cases."""

    job: ConformanceJob

    def make(self, block: int) -> None:
        """Judge a case, and write its verdict."""
        verdict = self.job.trial.verdict(self.job.cases[block])
        told = json.dumps(asdict(verdict), default=lambda number: number.item())
        self.job.parts.write(block, pa.Table.from_pylist([{"case": verdict.name, "verdict": told}]))


def run(
    cases: Sequence[Case],
    trial: Trial,
    out: Path | None = None,
    engine: Engine = HERE,
    *,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> tuple[Verdict, ...] | None:
    """Take a renderer through cases, and return the verdicts in their order.

    Stopped and called again with the same folder it goes on where it was; a run that was finished
    is made anew. None where other parts of a job array are not finished yet.
    """
    if out is None and (engine.scheduler is not None or not engine.part.everything):
        raise InputError("--scheduler and --part keep what is judged in a folder: give --out too")
    contestant = trial.contestant
    if contestant.python is not None:
        contestant.function()
    with ExitStack() as stack:
        folder = (
            out.absolute()
            if out
            else stack.enter_context(TempPath(scratch_folder(), folder=True)).path
        )
        job = ConformanceJob(
            cases=cases,
            trial=replace(trial, pictures=out is not None),
            parts=ParquetParts(out=folder, name=PARTS),
        )
        described = {
            "suite": f"{SUITE} {suite_digest()}",
            "cases": [case.name for case in cases],
            "renderer": json_ready(contestant),
            "state of the renderer": contestant.state,
            "device": trial.device.as_json(),
        }
        job.parts.open(json_ready(described))
        every = range(len(cases))
        blocks = list(engine.part.of(every))
        if all(map(job.finished, every)):
            told(f"what is in {job.parts.folder} was finished; the renderer is judged anew")
            for block in every:
                job.parts.remove(block)
        job.parts.tell_damaged(blocks, told)
        if done := sum(map(job.finished, blocks)):
            told(f"{done} of {len(blocks)} cases were judged before, and are in {job.parts.folder}")
        with open_workers(engine, len(blocks), draws=False) as workers:
            workers.run(job, blocks, len(blocks), progress=progress)
        if not all(map(job.finished, every)):
            return None
        return agreed(list(map(job.verdict, every)))


MIN_AGREEING = 0.5
"""Smallest share of the failed cases of a level with a named cause that must name a fault, for it to stand:
a case with few surfaces may be explained by a fault that the others do not have."""


def agreed(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """Return verdicts whose causes are those that the cases of a level agree on; others become guesses.

    A case that cannot tell faults apart counts for each, and is given the one that most cases
    admit.
    """
    found = []
    for one in verdicts:
        known = [
            {*other.faults}.union(*other.alternatives.values())
            for other in verdicts
            if other.level == one.level and other.faults
        ]

        def admitting(name: str, known: Sequence[set[str]] = known) -> int:
            return sum(name in some for some in known)

        told = [max((name, *one.alternatives.get(name, ())), key=admitting) for name in one.faults]
        stands = [
            name for name in dict.fromkeys(told) if admitting(name) >= MIN_AGREEING * len(known)
        ]
        if one.faults and not stands:
            words = tuple(f"perhaps {told}" for told in one.words)
            found.append(replace(one, cause="unexplained", words=words))
        else:
            found.append(replace(one, cause=", ".join(stands)) if stands else one)
    return tuple(found)


def encoded_truth(case: Case, truth: HogelImage) -> Any:
    """Return what a right renderer would write: numbers plus one (H, W), or linear radiance (H, W, 3)."""
    if case.colored:
        return truth.color
    return (truth.triangle if case.asked == "triangle-id" else truth.object) + 1
