"""Run of a renderer on the cases of the conformance suite, and the files with its verdicts.

Verdicts depend only on the frozen truth and the rounding bounds; `verify` names the cause of a
failed case. The files are a statement to cite, a page, JUnit, and a badge.
"""

from __future__ import annotations

import importlib
import json
import os
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any, cast

import numpy as np
from PIL import Image

from xfrustum.compare.judging.conformance import Pixels, judged
from xfrustum.compare.judging.judged import ANY_DEVICE
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import json_object, progress_bar, write_files
from xfrustum.reports.common.templates_environment import JUnitCase, html_page, junit
from xfrustum.reports.conformance_cases import Truths, traced, write_case
from xfrustum.reports.verification.sources import Problem, fields_of, run_program
from xfrustum.scenes import NOTHING, HogelImage, InputError, Scene
from xfrustum.scenes.arguments import check_program, real
from xfrustum.scenes.conformance_suite import LEVELS, SUITE, Case, chosen, suite_digest
from xfrustum.scenes.disk import TempPath, read_small, scratch_folder
from xfrustum.scenes.files.exr import write_planes
from xfrustum.scenes.files.pictures import Encoding, bytes_of, read_foreign
from xfrustum.scenes.model.device_model import DeviceModel

#: file with the reason that a renderer writes in place of images
UNSUPPORTED_FILE = "unsupported"
#: largest size of this file, bytes
MAX_REASON_BYTES = 1 << 16
SUFFIXES = (".png", ".exr")

Drawing = Callable[[Path, dict[str, Any], tuple[int, int]], Any]
"""Renderer in Python: a function of the folder of a case, its case.json, and a hogel.

The function returns triangle or object numbers plus one (H, W), 0 for background, or linear
radiance (H, W, 3). It raises NotImplementedError for an unsupported case.
"""


class UnsupportedError(Exception):
    """Case that a renderer does not support, with the reason."""


class CaseOutcome(StrEnum):
    """Outcome of a case."""

    PASS = "pass"
    FAIL = "fail"
    UNSUPPORTED = "unsupported"


class Failure(StrEnum):
    """Cause of a failed case for which `verify` names no defect."""

    # An image is absent, or cannot be read.
    MISSING = "missing"
    NOTHING_SHOWN = "nothing-shown"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Verdict of a case."""

    name: str
    level: str
    verdict: CaseOutcome
    #: names of defects, or a `Failure`; for unsupported cases, the reason
    cause: str | None = None
    #: sentences about the failure
    words: tuple[str, ...] = ()
    #: equivalent defects, by named defect; `agreed` chooses the level's most frequent defect
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    #: judged hogels, >= 0
    hogels: int = 0
    pixels: Pixels = field(default_factory=Pixels)
    #: pictures of the worst hogel, data URLs by name
    pictures: dict[str, str] = field(default_factory=dict)

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the defects that explain the failure."""
        unnamed = self.verdict is not CaseOutcome.FAIL or self.cause in (
            None,
            Failure.MISSING,
            Failure.UNEXPLAINED,
        )
        return () if unnamed else tuple(str(self.cause).split(", "))


@dataclass(frozen=True, kw_only=True)
class CaseRenderer:
    """A renderer: exactly one of command, images and python."""

    #: program that runs once per case, with the folders {case} and {out}
    command: str | None = None
    #: folder with a folder of images per case
    images: str | None = None
    #: module:function, a `Drawing`
    python: str | None = None
    #: time limit of a command per case, seconds, > 0
    timeout_s: float = 60.0

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.command, self.images, self.python)) != 1:
            raise InputError("give one of --command, --images and --python")
        if self.command is not None:
            if "out" not in fields_of(self.command, ("case", "out"), "--command"):
                raise InputError(
                    f"--command {self.command!r} has no {{out}}: the folder to be written"
                )
            check_program(self.command)
        if self.images is not None and not Path(self.images).is_dir():
            raise InputError(
                f"--images {self.images}: is not a folder; give the folder of the cases' folders"
            )
        if self.python is not None:
            self.function()
        if not real(self.timeout_s) > 0:
            raise InputError(f"timeout must be positive, not {self.timeout_s}")

    @property
    def name(self) -> str:
        """Command, folder or function, as given."""
        return str(self.command or self.images or self.python)

    def function(self) -> Drawing:
        """Return the function of a renderer in Python; InputError if there is none."""
        module, _, name = str(self.python).partition(":")
        if not module or not name:
            raise InputError(f"--python {self.python!r}: give module:function")
        # The program `xfrustum`, unlike `python -m`, does not search the working folder.
        if str(Path.cwd()) not in sys.path:
            sys.path.insert(0, str(Path.cwd()))
        try:
            function = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError) as error:
            raise InputError(f"--python {self.python}: {error}") from error
        if not callable(function):
            raise InputError(f"--python {self.python}: is no function")
        return cast(Drawing, function)

    def draw(self, case: Case, scene: Scene, scratch: Path) -> Path:
        """Draw a case in a scratch folder, and return the folder of its images.

        Raises Problem if drawing fails, UnsupportedError if the renderer does not support the case.
        """
        if self.images is not None:
            allowed, out = Path(self.images), Path(self.images, case.name)
        else:
            allowed = out = scratch / "out"
            out.mkdir()
            write_case(case, scene, scratch / "case")
        if self.command is not None:
            folders = {"case": scratch / "case", "out": out}
            arguments = [word.format(**folders) for word in shlex.split(self.command)]
            run_program(arguments, scratch, self.timeout_s, Path.cwd())
        elif self.python is not None:
            self._call(case, scratch / "case", out)
        reasons = sorted(out.glob(f"{UNSUPPORTED_FILE}*"))
        for path in (out, *reasons, *out.glob("hogel_*")):
            # A symbolic link could copy the content of any file into the statement.
            if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(allowed)):
                raise Problem(f"{path}: is a link out of {allowed}; put the file itself there")
        if reasons:
            raise UnsupportedError(_reason(reasons[0]) or "not claimed")
        return out

    def _call(self, case: Case, folder: Path, out: Path) -> None:
        """Draw the hogels of a case with the function of a renderer in Python."""
        question = json.loads((folder / "case.json").read_text(encoding="utf-8"))
        width, height = question["resolution"]
        shape = (height, width, 3) if case.colored else (height, width)
        for index in case.hogels:
            try:
                drawn = np.asarray(self.function()(folder, question, index))
            except NotImplementedError as error:
                raise UnsupportedError(str(error) or "not claimed") from error
            # any exception of the renderer's code is a result of the case
            except Exception as error:
                raise Problem(f"{self.python} raised {type(error).__name__}: {error}") from error
            if drawn.shape != shape:
                raise Problem(
                    f"{self.python} returned an array of shape {drawn.shape}, not {shape}"
                )
            # Three bytes cannot store fractions, NaN, or numbers from 2^24 on: refuse them instead
            # of wrapping.
            if not case.colored and not (
                drawn.dtype.kind in "iu" and 0 <= drawn.min() <= drawn.max() < 1 << 24
            ):
                raise Problem(
                    f"{self.python} returned {drawn.dtype}; give integers from 0 to "
                    f"{(1 << 24) - 1:,}"
                )
            write_hogel(case, out, index, drawn)


def _reason(path: Path) -> str:
    """Return the text of a file with a reason, "" for an empty file; Problem if unreadable."""
    try:
        empty = path.is_file() and path.stat().st_size == 0
        content = b"" if empty else read_small(path, "file with a reason", MAX_REASON_BYTES)
    except InputError as error:
        raise Problem(str(error)) from error
    return content.decode(errors="replace").strip()


def write_hogel(case: Case, out: Path, index: tuple[int, int], drawn: Any) -> None:
    """Write the image of a hogel: identities plus one, linear radiance, or 8-bit colors."""
    path = out / f"hogel_{index[0]}x{index[1]}"
    if case.colored and drawn.dtype != np.uint8:
        planes = {name: drawn[..., place].astype(np.float32) for place, name in enumerate("RGB")}
        write_planes(path.with_suffix(".exr"), planes)
    else:
        Image.fromarray(drawn if case.colored else bytes_of(drawn)).save(path.with_suffix(".png"))


def encoded_truth(case: Case, truth: HogelImage) -> Any:
    """Return a correct renderer's image: identities plus one (H, W), or radiance (H, W, 3)."""
    if case.colored:
        return truth.color
    return (truth.triangle if case.encoding == "triangle-id" else truth.object) + 1


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Settings by which the images of a renderer are judged."""

    truths: Truths = traced
    #: device model that explains wrong pixels by rounding
    device: DeviceModel = ANY_DEVICE
    #: whether to keep pictures of failed cases
    pictures: bool = True


def run(
    cases: Sequence[Case],
    renderer: CaseRenderer,
    options: RunOptions | None = None,
    *,
    progress: bool = False,
) -> tuple[Verdict, ...]:
    """Run a renderer on cases, and return the verdicts in the order of cases."""
    options, verdicts = options or RunOptions(), []
    with progress_bar(len(cases), "conformance", "case", shown=progress) as bar:
        for case in cases:
            verdicts.append(judge_case(case, renderer, options))
            bar.update()
    return agreed(verdicts)


def judge_case(case: Case, renderer: CaseRenderer, options: RunOptions) -> Verdict:
    """Draw a case, judge its images, and name the cause of a failure."""
    scene, verdict = (
        case.open(),
        Verdict(name=case.name, level=case.level, verdict=CaseOutcome.FAIL),
    )
    with TempPath(scratch_folder(), folder=True) as scratch:
        try:
            out = renderer.draw(case, scene, scratch.path)
            files = {index: _file(out, index) for index in case.hogels}
            images = {index: _image(case, scene, index, path) for index, path in files.items()}
        except UnsupportedError as reason:
            return replace(verdict, verdict=CaseOutcome.UNSUPPORTED, cause=str(reason))
        except Problem as problem:
            # Remove the name of the scratch folder, so that statements of equal runs are equal.
            text = str(problem).replace(f"{scratch.path}/", "")
            return replace(verdict, cause=Failure.MISSING, words=(text,))
        pixels = Pixels()
        for truth in options.truths(case, scene):
            image = images[truth.camera.aperture.index]
            pixels += judged(case, scene, truth, image, options.device)
        verdict = replace(verdict, hogels=len(images), pixels=pixels)
        if pixels.within(case):
            return replace(verdict, verdict=CaseOutcome.PASS)
        # For empty pictures `verify` would name culling or a wrong scale.
        if not any(map(_shows, images.values())):
            text = "nothing is shown, in any hogel"
            return replace(verdict, cause=Failure.NOTHING_SHOWN, words=(text,))
        suffix = files[case.hogels[0]].suffix
        return _diagnosed(verdict, case, scene, out, suffix, pictures=options.pictures)


def _file(out: Path, index: tuple[int, int]) -> Path:
    """Return the file of a hogel; a Problem if it is missing."""
    paths = [out / f"hogel_{index[0]}x{index[1]}{suffix}" for suffix in SUFFIXES]
    path = next(filter(Path.exists, paths), None)
    if path is None:
        raise Problem(f"no {paths[0].name} and no {paths[1].name} was written")
    return path


def _image(case: Case, scene: Scene, index: tuple[int, int], path: Path) -> HogelImage:
    """Read the image of a hogel; raise Problem if the image cannot be read."""
    camera = Reference(scene).camera(scene.plate.aperture(*index))
    try:
        return read_foreign(path, camera, Encoding(case.encoding))
    except InputError as error:
        raise Problem(str(error)) from error


def _shows(image: HogelImage) -> bool:
    """Return whether an image shows anything."""
    named = (image.triangle != NOTHING).any() or (image.object != NOTHING).any()
    return bool(named or (image.color is not None and (image.color > 0).any()))


def _diagnosed(
    verdict: Verdict, case: Case, scene: Scene, out: Path, suffix: str, *, pictures: bool
) -> Verdict:
    """Return the verdict of a failed case with the defects named by `verify`, and pictures."""
    from xfrustum.reports.verification.verification import verify  # noqa: PLC0415 - loads long

    # Escape braces in the folder's name, because the pattern of files has fields in braces.
    folder = str(out).replace("{", "{{").replace("}", "}}")
    result = verify(
        scene,
        f"{folder}/hogel_{{i}}x{{j}}{suffix}",
        encoding=case.encoding,
        apertures=case.hogels,
        near=case.near,
    )
    faults = result.diagnosis.faults
    guesses = tuple(f"perhaps {guess['words']}" for guess in result.guesses(printed=True))
    worst = result.worst[0].pictures if result.worst and pictures else {}
    return replace(
        verdict,
        cause=", ".join(dict.fromkeys(fault.fault for fault in faults)) or Failure.UNEXPLAINED,
        words=tuple(defect["words"] for defect in result.defects()) or guesses,
        alternatives={fault.fault: fault.alternatives for fault in faults if fault.alternatives},
        pictures={name: worst[name] for name in ("truth", "image", "error") if name in worst},
    )


MIN_AGREEING = 0.5
"""Share of a level's failed cases with named causes that a defect must explain to be named: a
defect can explain a single case of few surfaces by chance."""


def agreed(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """Return verdicts whose causes agree within each level; other causes are marked as guesses.

    A case with several possible defects counts for each, and gets the most frequent defect.
    """
    admitted = [
        (verdict.level, {*verdict.faults}.union(*verdict.alternatives.values()))
        for verdict in verdicts
        if verdict.faults
    ]
    return tuple(_agreed(verdict, admitted) for verdict in verdicts)


def _agreed(verdict: Verdict, admitted: Sequence[tuple[str, set[str]]]) -> Verdict:
    """Return a verdict consistent with `admitted`: levels and possible defects of failed cases."""
    if not verdict.faults:
        return verdict
    level = [names for level, names in admitted if level == verdict.level]

    def count(name: str) -> int:
        return sum(name in names for names in level)

    likely = [
        max((name, *verdict.alternatives.get(name, ())), key=count) for name in verdict.faults
    ]
    standing = [name for name in dict.fromkeys(likely) if count(name) >= MIN_AGREEING * len(level)]
    if standing:
        return replace(verdict, cause=", ".join(standing))
    words = tuple(f"perhaps {sentence}" for sentence in verdict.words)
    return replace(verdict, cause=Failure.UNEXPLAINED, words=words)


FILES = PAGE, JUNIT, STATEMENT, BADGE = "index.html", "junit.xml", "statement.json", "badge.json"
#: largest number of failed cases in the terminal
MAX_LISTED = 20
NOT_RUN = "not run"


@dataclass(kw_only=True, eq=False)
class Statement:
    """Verdicts of a renderer, with its name and device."""

    renderer: str
    device: str
    #: name of the device model that explains rounding
    device_model: str
    verdicts: tuple[Verdict, ...]

    @cached_property
    def counts(self) -> dict[str, Counter[str]]:
        """Numbers of cases by judged level and outcome, including cases that were not run."""
        counts = dict[str, Counter[str]]()
        for case in sorted(self.verdicts, key=lambda case: list(LEVELS).index(case.level)):
            counts.setdefault(case.level, Counter())[str(case.verdict)] += 1
        for level, run in counts.items():
            # A partial run must not look like a complete pass.
            run[NOT_RUN] = len(chosen((level,))) - run.total()
        return counts

    @property
    def levels(self) -> dict[str, CaseOutcome]:
        """Outcome of each judged level: pass if no case fails and at least one passes."""
        # One failed case fails the level; a level with unsupported cases may pass in part.
        order = (CaseOutcome.FAIL, CaseOutcome.PASS, CaseOutcome.UNSUPPORTED)
        return {
            level: next(outcome for outcome in order if counts[outcome])
            for level, counts in self.counts.items()
        }

    def of_outcome(self, outcome: CaseOutcome) -> list[str]:
        """Return the judged levels with an outcome."""
        return [level for level, result in self.levels.items() if result is outcome]

    @property
    def passed(self) -> bool:
        """True if no case fails; unsupported cases do not count as failed."""
        return CaseOutcome.FAIL not in self.levels.values()

    @property
    def partly(self) -> set[str]:
        """Passed levels with cases that are unsupported or were not run."""
        return {level for level, n in self.counts.items() if 0 < n[CaseOutcome.PASS] < n.total()}

    @property
    def sentence(self) -> str:
        """Verdict, one sentence."""
        failed, passed = self.of_outcome(CaseOutcome.FAIL), []
        for level in self.of_outcome(CaseOutcome.PASS):
            counts = self.counts[level]
            share = f" ({counts[CaseOutcome.PASS]} of {counts.total()} cases)"
            passed.append(level + (share if level in self.partly else ""))
        parts = [f"passes {', '.join(passed)}"] if passed else []
        parts += [f"fails {', '.join(failed)}"] if failed else []
        claims = " and ".join(parts) or "claims none of these cases"
        return f"{self.renderer} {claims} of suite {SUITE}."

    def summary(self) -> dict[str, Any]:
        """Return statement.json."""
        cases = [json_object(verdict) for verdict in self.verdicts]
        return {
            "suite": SUITE,
            "suite_digest": suite_digest(),
            "xfrustum": metadata.version("xfrustum"),
            "renderer": self.renderer,
            "device": self.device,
            "device_model": self.device_model,
            "levels": self.levels,
            "counts": self.counts,
            # Only the page has the pictures, which are megabytes of base64.
            "cases": [{k: v for k, v in case.items() if k != "pictures"} for case in cases],
        }

    def badge(self) -> dict[str, Any]:
        """Return badge.json, in the form that badge services read."""
        levels = self.of_outcome(CaseOutcome.PASS)
        message = " ".join(level + ("*" if level in self.partly else "") for level in levels)
        # Yellow: some levels pass and some fail.
        color = "brightgreen" if self.passed else "yellow"
        if not message:
            nothing = ("nothing claimed", "lightgrey") if self.passed else ("no level", "red")
            message, color = nothing
        return {
            "schemaVersion": 1,
            "label": f"hogel conformance {SUITE}",
            "message": message,
            "color": color,
        }

    def table(self) -> str:
        """Return lines for the verdict, each level, and each failed case."""
        lines = [self.sentence]
        for level, outcome in self.levels.items():
            counts = ", ".join(f"{n} {name}" for name, n in sorted(self.counts[level].items()) if n)
            lines.append(f"{level}  {outcome:<11}  {counts:<32}  {LEVELS[level]}")
        failed = [case for case in self.verdicts if case.verdict is CaseOutcome.FAIL]
        lines += [f"  {case.name}: {case.cause}: {failure(case)}" for case in failed[:MAX_LISTED]]
        if more := len(failed[MAX_LISTED:]):
            lines.append(f"  and {more} more; --out has them all")
        return "\n".join(lines)


def counted_pixels(pixels: Pixels) -> str:
    """Return counts of pixels in words."""
    counts = asdict(pixels)
    shown, wrong = counts.pop("shown"), counts.pop("wrong")
    causes = ", ".join(f"{count:,} {name}" for name, count in counts.items() if count)
    return f"{wrong:,} of {shown:,} pixels wrong" + (f" ({causes})" if causes else "")


def failure(verdict: Verdict) -> str:
    """Return the sentences about a failed case, or its counts of wrong pixels."""
    return "; ".join(verdict.words) or counted_pixels(verdict.pixels)


def junit_case(verdict: Verdict) -> JUnitCase:
    """Return the test case of JUnit for a case."""
    cause, outcome = verdict.cause or "not claimed", verdict.verdict
    failed = f"{cause}: {failure(verdict)}" if outcome is CaseOutcome.FAIL else None
    return JUnitCase(
        classname=verdict.level,
        name=verdict.name,
        failure=failed,
        text=counted_pixels(verdict.pixels),
        # Continuous integration shows skipped tests without failing the build.
        skipped=cause if outcome is CaseOutcome.UNSUPPORTED else None,
    )


def write_statement(statement: Statement, out: Path) -> tuple[Path, ...]:
    """Write statement, page, JUnit and badge, all or nothing."""
    values = {"statement": statement, "suite": SUITE, "levels": LEVELS, "badge": statement.badge()}
    cases = list(map(junit_case, statement.verdicts))
    files: dict[str, object] = {
        STATEMENT: statement.summary(),
        BADGE: statement.badge(),
        JUNIT: junit(f"xfrustum conformance {SUITE}", cases, statement.table()),
        PAGE: html_page("conformance.html.j2", values, {"pixels": counted_pixels}),
    }
    return write_files(out, files)
