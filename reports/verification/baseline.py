"""`verify --baseline`: a verification is held to the measures that were accepted before.

    DIR/accepted/RUN.json    a file for each accepted run; nobody writes it again

A run that is approved begins a new accepted state; approved as repeated, it joins the newest one,
and the spread of the runs of one state is the renderer's noise. Branches that accept different runs
merge without conflict: the state that was begun last counts.
"""

import json
import math
import os
import secrets
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError

from xfrustum.compare.judging.verdict import DISPLACEMENT, Hogel
from xfrustum.reports.common.outputs import (
    check_writable_folder,
    json_object,
    refused,
    write_output,
)
from xfrustum.reports.common.provenance import machine
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import InputError
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.representation import counted, digits

ACCEPTED, OPTION = "accepted", "--baseline"

WORDS = {
    "missing": "missing hogels",
    "wrong_surfaces": "wrong surfaces",
    "wrong_pixels": "wrong pixels",
    "wrong_colors": "wrong colors",
    "invalid": "claims of what does not exist",
    "unexplained": "unexplained pixels after correction",
    "displacement_rms_px": "displacement (rms)",
    "displacement_p99_px": "displacement (p99)",
    "displacement_max_px": "displacement (max)",
}
"""Measures of a hogel in words, what matters most first; all are the better the smaller they are."""

ROUNDING_PX = 1e-6
"""Largest difference between two displacements that is rounding, px: they are found from doubles of
coordinates up to 1e3 px, with some hundred operations."""

MAX_TOLD, GIT_SECONDS = 8, 20.0
"""Largest number of changes of a kind that are named one by one; longest time that git may take."""

HARMLESS = [
    word
    for setting in ("core.fsmonitor=false", "core.hooksPath=/dev/null", "protocol.allow=never")
    for word in ("-c", setting)
]
"""Options with which git starts no program that a repository names."""

Place = tuple[int, int]  #: column and row of a hogel


class Change(StrEnum):
    """How a measure, or a whole run, is beside what was accepted; `NEW` where nothing is."""

    WORSE = "worse"
    BETTER = "better"
    SAME = "same"
    NEW = "new"


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Tolerances that the user states: a share of the accepted value, and amounts by name of measure."""

    share: float | None = None
    amounts: Mapping[str, float]

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Read `5%`, or amounts such as `wrong_surfaces=3,displacement_p99_px=0.01`, or both with a comma."""
        share, amounts, names = None, {}, ", ".join(WORDS)
        for part in (part.strip() for part in text.split(",")):
            name, equals, number = part.rpartition("=")
            name = name.strip().replace("-", "_")
            if equals and name not in WORDS:
                raise InputError(f"baseline tolerance: {name!r} is not one of {names}")
            try:
                if equals:
                    amounts[name] = float(number)
                elif part.endswith("%"):
                    share = float(part[:-1]) / 100
                else:
                    raise ValueError
            except ValueError as error:
                raise InputError(
                    f"baseline tolerance {part!r}: write a share such as 5%, or NAME=AMOUNT such as "
                    f"wrong_surfaces=3; names are {names}"
                ) from error
        if not all(math.isfinite(one) and one >= 0 for one in (*amounts.values(), share or 0.0)):
            raise InputError("baseline tolerance: tolerances are numbers that are not negative")
        return cls(share=share, amounts=amounts)


@dataclass(frozen=True, kw_only=True)
class MeasureChange:
    """One measure of a hogel beside the mean of what was accepted."""

    measure: str
    aperture: Place
    accepted: float | None
    limit: float | None  #: largest value that is not worse; None where nothing is accepted
    now: float | None  #: None where it cannot be known any more
    change: Change

    @property
    def words(self) -> str:
        """Which measure, where, and how much."""

        def told(value: float | None) -> str:
            if value is None:
                return "unknown"
            if self.measure.endswith("_px"):
                return f"{digits(value)} px" if abs(value) > 10 * ROUNDING_PX else "0 px"
            return f"{value:,.0f}" if value == round(value) else f"{value:,.1f}"

        column, row = self.aperture
        was, now = told(self.accepted), told(self.now)
        return f"{WORDS[self.measure]} of hogel {column},{row}: {was} accepted, {now} now"


@dataclass(frozen=True, kw_only=True)
class KeptHogel:
    """One hogel of an accepted run; `by` says which kind of wrong pixels is counted."""

    aperture: Place
    by: str | None
    measures: dict[str, float | None]

    @classmethod
    def from_hogel(cls, hogel: Hogel) -> Self:
        """Return the measures of a hogel, as it was delivered; a missing one has no other measure."""
        found, corrected = hogel.as_found, hogel.corrected
        measures: dict[str, float | None] = {
            **dict.fromkeys(WORDS),
            "missing": float(found is None),
        }
        if found is None or corrected is None:
            return cls(aperture=hogel.aperture.index, by=None, measures=measures)
        measures |= {
            "wrong_surfaces": None if found.surface is None else float(found.surface.wrong),
            "wrong_pixels": float(found.wrong),
            "wrong_colors": None if found.radiance is None else float(found.radiance.wrong),
            "invalid": float(found.invalid),
            "unexplained": None
            if corrected.causes is None
            else float(corrected.causes["unexplained"]),
        }
        # An image that shows nothing displaces nothing; `Limits.checks` knows which image that is.
        still = any(check.figure == DISPLACEMENT and check.value == 0 for check in hogel.checks)
        for name in ("rms", "p99", "max"):
            measures[f"displacement_{name}_px"] = getattr(
                found.displacement_px, name, 0.0 if still else None
            )
        return cls(aperture=hogel.aperture.index, by=found.by, measures=measures)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A verification as its file keeps it; runs of one scene, renderer, device and judging are comparable."""

    run: str
    began: str  #: name of the accepted state, which is the name of its first run
    time: str
    scene: str
    scene_hash: str
    renderer: str
    device: str
    judged: str
    commit: str | None
    xfrustum: str
    hogels: tuple[KeptHogel, ...]

    def like(self, runs: Iterable[Self]) -> list[Self]:
        """Return the runs that this one can be compared with."""
        shared = ("scene_hash", "renderer", "device", "judged")
        return [
            one for one in runs if all(getattr(one, name) == getattr(self, name) for name in shared)
        ]


_RUN = TypeAdapter(Run)


@dataclass(frozen=True, kw_only=True)
class BaselineOptions:
    """How a verification is held to accepted measures."""

    renderer: str | None = (
        None  #: name under which measures are kept; that of the source where None
    )
    device: str | None = None  #: likewise; this machine's processor where None
    near: float | None = (
        None  #: as given to `verify`, like the next two: other options, other measures
    )
    accept: Sequence[str] = ()
    encoding: str | None = None
    tolerance: Stated | None = None  #: goes before the spread of repeated runs
    approve: bool = False
    repeated: bool = False  #: the present measures differ from those accepted by noise alone
    repository: Path | None = None  #: folder whose commit is noted; the current one where None


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """The answer to `xfrustum verify --baseline`: every measure of each hogel beside what was accepted."""

    run: Run
    approved: bool
    changes: tuple[MeasureChange, ...]
    accepted_runs: int  #: largest number of runs that a hogel is compared with
    tolerance: str  #: where the limits are from
    new_hogels: int
    new_beyond_limits: int  #: hogels that were not accepted before and exceed the limits
    not_judged_hogels: int
    notes: tuple[str, ...]  #: what may be misunderstood otherwise

    @property
    def change(self) -> Change:
        """The worst of all changes."""
        there = {one.change for one in self.changes}
        return next(
            (one for one in (Change.WORSE, Change.BETTER, Change.SAME) if one in there), Change.NEW
        )

    @property
    def compared(self) -> bool:
        """Whether anything was accepted that the present measures could be compared with."""
        return self.change is not Change.NEW

    @property
    def passed(self) -> bool:
        """Whether nothing got worse and new hogels keep to the limits, or all was approved."""
        return self.approved or (self.change is not Change.WORSE and not self.new_beyond_limits)

    def of_kind(self, change: Change) -> tuple[MeasureChange, ...]:
        """Return the changes of one kind by measure, the largest first."""

        def rank(one: MeasureChange) -> tuple[int, float]:
            increase = math.inf if one.now is None else abs(one.now - (one.accepted or 0.0))
            return list(WORDS).index(one.measure), -increase

        return tuple(sorted((one for one in self.changes if one.change is change), key=rank))

    def summary(self) -> dict[str, Any]:
        """Return the JSON object; `changes` has what got worse, then what got better."""
        told = {
            name: getattr(self.run, name)
            for name in ("run", "commit", "renderer", "device", "judged")
        }
        changes = [
            json_object(one) for kind in (Change.WORSE, Change.BETTER) for one in self.of_kind(kind)
        ]
        rest = {
            name: value
            for name, value in vars(self).items()
            if name not in ("run", "changes", "notes")
        }
        return {"change": str(self.change), **rest, **told, "changes": changes}


def baseline(
    found: Verification, folder: Path | str, options: BaselineOptions | None = None
) -> Baseline:
    """Hold a verification to the measures accepted in a folder; keep it there where it is approved.

    InputError where the folder cannot be written, or holds what is no accepted run; then nothing is
    approved.
    """
    options, folder = options or BaselineOptions(), Path(folder)
    check_folder(folder)
    everything = accepted_runs(folder)
    run = _present(found, options)
    alike = run.like(everything)
    # The runs of the newest state of each hogel that is accepted, whether it is judged now or not.
    accepted: dict[Place, list[KeptHogel]] = {}
    newest = {hogel.aperture: one.began for one in alike for hogel in one.hogels}
    for one in alike:
        for hogel in one.hogels:
            if newest[hogel.aperture] == one.began:
                accepted.setdefault(hogel.aperture, []).append(hogel)
    judged = {one.aperture for one in run.hogels}
    runs = max((len(accepted[place]) for place in judged & accepted.keys()), default=0)
    tolerance = f"beyond the spread of {runs} accepted runs"
    if options.tolerance is not None or runs == 1:
        alone = "compared exactly, with one accepted run"
        tolerance = alone if options.tolerance is None else "tolerance as stated"
    new = [one for one in found.hogels if one.aperture.index not in accepted]
    if options.approve and options.repeated and alike:
        # Only the user knows that a difference is noise: at the same commit, a compiler may have
        # got worse.
        run = replace(run, began=alike[-1].began)
    held = Baseline(
        run=run,
        approved=options.approve,
        changes=tuple(_changes(run.hogels, accepted, options.tolerance)),
        accepted_runs=runs,
        tolerance=tolerance,
        new_hogels=len(new),
        new_beyond_limits=sum(not one.passed for one in new),
        not_judged_hogels=len(accepted.keys() - judged),
        notes=(),
    )
    held = replace(held, notes=tuple(_notes(held, everything, options)))
    if options.approve:
        content = json.dumps(json_object(run), allow_nan=False, indent=1) + "\n"
        with refused(f"{OPTION} {folder}: cannot be made", "choose another place"):
            (folder / ACCEPTED).mkdir(parents=True, exist_ok=True)
        write_output(folder / ACCEPTED / f"{run.run}.json", content.encode(), OPTION)
    return held


def check_folder(folder: Path) -> None:
    """Raise InputError where accepted runs cannot be kept in a folder; leaves nothing behind."""
    try:
        check_writable_folder(folder)
        check_writable_folder(folder / ACCEPTED)
    except InputError as error:
        raise InputError(str(error).replace("--out", OPTION, 1)) from error


def accepted_runs(folder: Path) -> list[Run]:
    """Return all accepted runs of a folder; what was begun last comes last, and of that the last run."""
    found = []
    # Hidden names are those of files that other processes are about to put there.
    for path in sorted((folder / ACCEPTED).glob("[!.]*")):
        try:
            found.append(_RUN.validate_json(read_input(path, "accepted run")))
        except (InputError, ValidationError) as error:
            raise InputError(
                f"{OPTION} {path}: is no accepted run of this version; remove it, and approve anew"
            ) from error
    return sorted(found, key=lambda run: (run.began, run.run))


def _present(found: Verification, options: BaselineOptions) -> Run:
    """Return the present run, which begins a state of its own."""
    judging, now = found.limits.judging, datetime.now(UTC)
    judged = [f"compare {judging.compared}", f"max-color {judging.color_tolerance:.6g}"]
    judged += [f"near {options.near:.9g}"] if options.near else []
    judged += [f"encoding {options.encoding}"] if options.encoding else []
    judged += [f"accept {','.join(sorted(options.accept))}"] if options.accept else []
    name = f"{now:%Y%m%dT%H%M%S.%fZ}-{secrets.token_hex(4)}"  # names sort by time
    return Run(
        run=name,
        began=name,
        time=now.isoformat(timespec="seconds"),
        scene=found.scene.name,
        scene_hash=found.scene.content_hash,
        renderer=options.renderer or found.source,
        device=options.device or machine()["processor"],
        judged=", ".join(judged),
        commit=commit_of(options.repository or Path()),
        xfrustum=metadata.version("xfrustum"),
        hogels=tuple(map(KeptHogel.from_hogel, found.hogels)),
    )


def _changes(
    hogels: Sequence[KeptHogel],
    accepted: Mapping[Place, Sequence[KeptHogel]],
    stated: Stated | None,
) -> Iterator[MeasureChange]:
    """Compare hogels with their accepted runs: worse is what exceeds all by more than their spread."""
    values: dict[tuple[str, Place], tuple[list[float], float | None]] = {}
    for hogel in hogels:
        runs = accepted.get(hogel.aperture, ())
        # What counts another kind of wrong pixels is another measure.
        alike = len({one.by for one in (hogel, *runs)} - {None}) <= 1
        for name, now in hogel.measures.items():
            before = [value for one in runs if (value := one.measures.get(name)) is not None]
            before = before if alike or name != "wrong_pixels" else []
            # A missing hogel is counted as such, and not once more for each of its other measures.
            if now is not None or (before and not hogel.measures["missing"]):
                values[name, hogel.aperture] = before, now
    # The spread of few runs is uncertain: it is no less than the root mean square over all hogels.
    ranges = {key: max(before) - min(before) for key, (before, _) in values.items() if before}
    floors = {}
    for name in {name for name, _ in ranges}:
        squares = [size * size for (one, _), size in ranges.items() if one == name]
        floors[name] = math.sqrt(math.fsum(squares) / len(squares))
    for (name, place), (before, now) in values.items():
        mean, high, change = None, None, Change.NEW
        if before:
            mean, spread = math.fsum(before) / len(before), max(ranges[name, place], floors[name])
            low, high = min(before) - spread, max(before) + spread
            if stated is not None:
                share = None if stated.share is None else stated.share * mean
                amount = stated.amounts.get(name, share)
                low, high = (low, high) if amount is None else (mean - amount, mean + amount)
            slack = ROUNDING_PX if name.endswith("_px") else 0.0
            change = Change.WORSE if now is None or now > high + slack else Change.SAME
            change = Change.BETTER if now is not None and now < low - slack else change
        yield MeasureChange(
            measure=name, aperture=place, accepted=mean, limit=high, now=now, change=change
        )


def _notes(held: Baseline, everything: Sequence[Run], options: BaselineOptions) -> Iterator[str]:
    """Yield what may be misunderstood otherwise."""
    run, told = held.run, []
    if held.new_hogels and (held.compared or held.not_judged_hogels):
        beyond = (
            f", {held.new_beyond_limits:,} of them beyond the limits"
            if held.new_beyond_limits
            else ""
        )
        told.append(f"{counted(held.new_hogels, 'hogel')} not accepted before{beyond}")
    if held.not_judged_hogels:
        told.append(f"{counted(held.not_judged_hogels, 'hogel')} accepted, and not judged now")
    if told:
        yield f"Not compared: {'; '.join(told)}."
    alike = run.like(everything)
    same = any(one.commit == run.commit for one in alike)
    if (
        held.change in (Change.WORSE, Change.BETTER)
        and not options.repeated
        and run.commit
        and same
    ):
        yield "a run of this commit is accepted: if no file differs, give --approve --repeated for the noise"
    others = [one for one in everything if one.scene_hash == run.scene_hash]
    if others and not alike:
        kept = sorted({f"{one.renderer} on {one.device} ({one.judged})" for one in others})
        yield f"of this scene, measures are accepted for {'; '.join(kept)}"
        yield f"what is judged now is {run.renderer} on {run.device} ({run.judged})"


def commit_of(folder: Path) -> str | None:
    """Return the commit at which a folder is checked out; None without a repository of this user.

    The folder may be a stranger's. `git rev-parse` reads a reference and no file of the work tree,
    so that no filter runs; programs that the repository's settings name are switched off.
    """
    line = ["git", *HARMLESS, "-C", str(folder), "rev-parse", "HEAD"]
    null = subprocess.DEVNULL
    try:
        return subprocess.check_output(
            line, stdin=null, stderr=null, text=True, timeout=GIT_SECONDS
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return None


def sentence(held: Baseline) -> str:
    """Return in one sentence how the measures are beside those that were accepted before."""
    if held.change is Change.NEW:
        if held.approved:
            return "Baseline: these measures are the first that are accepted."
        return "Baseline: nothing is accepted yet that could be compared; --approve accepts what is here now."
    if held.change is Change.SAME:
        return f"Baseline: as accepted ({held.tolerance}){', and accepted now' if held.approved else ''}."
    first, *more = held.of_kind(held.change)
    others = f"; and {len(more)} more" if more else ""
    before = " before, and accepted now" if held.approved else ""
    return (
        f"Baseline: {held.change} than accepted{before}: {first.words}{others} ({held.tolerance})."
    )


def lines(held: Baseline) -> str:
    """Return what changed as lines for the terminal and for GitHub."""
    found = [sentence(held)]
    for change in (Change.WORSE, Change.BETTER):
        changed = held.of_kind(change)
        found += [f"  {change}: {one.words}" for one in changed[:MAX_TOLD]]
        found += [f"  {change}: {len(changed) - MAX_TOLD} more"] if len(changed) > MAX_TOLD else []
    return "\n".join([*found, *(f"  note: {note}" for note in held.notes)])


def append_step_summary(held: Baseline) -> str | None:
    """Append what changed to the summary that GitHub shows, if it asks for one; return what went wrong."""
    name, run = os.environ.get("GITHUB_STEP_SUMMARY"), held.run
    if not name:
        return None
    commit = f"commit {run.commit[:7]}" if run.commit else "no commit"
    made = f"{run.scene}: {run.renderer} on {run.device}, {commit}, xfrustum {run.xfrustum}"
    # A block of code shows every text as it is: no name becomes markup.
    block = f"{made}\n{lines(held)}".replace("```", "")
    try:
        with Path(name).open("a", encoding="utf-8") as file:
            file.write(f"### xfrustum verify\n\n```\n{block}\n```\n")
    except OSError as error:
        return f"the summary for GitHub was not written: {name}: {error.strerror}"
    return None
