"""`verify --baseline`: the difference of a verification from accepted ones.

    DIR/accepted/RUN.json    the verification of one accepted run; never rewritten

A run that is approved begins a new accepted state; approved as repeated, it joins the newest one,
and the spread of the runs of one state is the renderer's noise. Branches that accept different runs
merge without conflict: the state that was begun last counts.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError

from xfrustum.compare.judging.verdict import DISPLACEMENT
from xfrustum.reports.common.outputs import (
    check_writable_folder,
    json_object,
    json_ready,
    refused,
    write_output,
)
from xfrustum.reports.common.provenance import machine
from xfrustum.reports.verification.verdict import Verification
from xfrustum.scenes import InputError
from xfrustum.scenes.disk.input_files import read_input
from xfrustum.scenes.representation import counted, digits

ACCEPTED, OPTION = "accepted", "--baseline"

MEASURES = {
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
"""Measures of a hogel, the most important first; all are the better the smaller they are."""

ROUNDING_PX = 1e-6
"""Largest rounding of displacements, px: some hundred operations on doubles up to 1e3 px."""

MAX_LISTED, GIT_SECONDS = 8, 20.0  # changes of a kind that are listed; longest time of git

HARMLESS = [
    word
    for setting in ("core.fsmonitor=false", "core.hooksPath=/dev/null", "protocol.allow=never")
    for word in ("-c", setting)
]
"""Options with which git starts no program that a repository names."""

Place = tuple[int, int]  #: column and row of a hogel
Measures = dict[str, float | None]


class Change(StrEnum):
    """Change of a measure, or of a whole run; `NEW` where nothing is accepted."""

    WORSE = "worse"
    BETTER = "better"
    SAME = "same"
    NEW = "new"


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Tolerances that the user states: a share of the accepted value, and amounts by measure."""

    share: float | None = None
    amounts: Mapping[str, float]

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Read `5%`, or amounts such as `wrong_surfaces=3,displacement_p99_px=0.01`, or both."""
        share, amounts, names = None, {}, ", ".join(MEASURES)
        for part in (part.strip() for part in text.split(",")):
            name, equals, number = part.rpartition("=")
            name = name.strip().replace("-", "_")
            if equals and name not in MEASURES:
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
                    f"baseline tolerance {part!r}: write a share such as 5%, or NAME=AMOUNT such "
                    "as "
                    f"wrong_surfaces=3; names are {names}"
                ) from error
        if not all(
            math.isfinite(entry) and entry >= 0 for entry in (*amounts.values(), share or 0.0)
        ):
            raise InputError("baseline tolerance: tolerances are numbers that are not negative")
        return cls(share=share, amounts=amounts)

    def amount(self, name: str, mean: float) -> float | None:
        """Return the tolerance of a measure; None where none is stated."""
        return self.amounts.get(name, None if self.share is None else self.share * mean)


@dataclass(frozen=True, kw_only=True)
class MeasureChange:
    """One measure of a hogel beside the mean of the accepted runs."""

    measure: str
    aperture: Place
    accepted: float | None
    limit: float | None  #: largest value that is not worse; None where nothing is accepted
    now: float | None  #: None where it cannot be measured any more
    change: Change

    @property
    def words(self) -> str:
        """The measure, its place and size."""

        def sized(value: float | None) -> str:
            if value is None:
                return "unknown"
            if self.measure.endswith("_px"):
                return f"{digits(value)} px" if abs(value) > 10 * ROUNDING_PX else "0 px"
            return f"{value:,.0f}" if value == round(value) else f"{value:,.1f}"

        column, row = self.aperture
        before, now = sized(self.accepted), sized(self.now)
        return f"{MEASURES[self.measure]} of hogel {column},{row}: {before} accepted, {now} now"


@dataclass(frozen=True, kw_only=True)
class Run:
    """An accepted run; runs of one scene, renderer, device and judging are comparable."""

    run: str
    began: str  #: name of the accepted state, which is the name of its first run
    time: str
    scene_hash: str
    renderer: str
    device: str
    judged: str
    commit: str | None
    xfrustum: str
    verification: dict[str, Any]  #: content of verification.json

    def like(self, runs: Iterable[Self]) -> list[Self]:
        """Return the runs that this one can be compared with."""
        shared = ("scene_hash", "renderer", "device", "judged")
        return [
            run for run in runs if all(getattr(run, name) == getattr(self, name) for name in shared)
        ]

    @property
    def hogels(self) -> dict[Place, Mapping[str, Any]]:
        """The hogels of verification.json by place."""
        return {tuple(hogel["aperture"]): hogel for hogel in self.verification["hogels"]}


_RUN = TypeAdapter(Run)


@dataclass(frozen=True, kw_only=True)
class BaselineOptions:
    """Options of the comparison with accepted runs."""

    renderer: str | None = None  #: name of the renderer; None: the source
    device: str | None = None  #: name of its device; None: this machine's processor
    near: float | None = None  #: as of `verify`, like the next two: other options, other measures
    accept: Sequence[str] = ()
    encoding: str | None = None
    tolerance: Stated | None = None  #: in place of the spread of repeated runs
    approve: bool = False
    repeated: bool = False  #: the present measures differ from the accepted ones by noise alone
    repository: Path | None = None  #: folder whose commit is noted; None: the current one


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """The answer to `xfrustum verify --baseline`: every measure of each hogel, and its change."""

    run: Run
    approved: bool
    changes: tuple[MeasureChange, ...]
    accepted_runs: int  #: largest number of runs that a hogel is compared with
    tolerance: str  #: origin of the limits
    new_hogels: int
    new_beyond_limits: int  #: hogels that were not accepted before and exceed the limits
    not_judged_hogels: int
    notes: tuple[str, ...]  #: facts without which the comparison may be misunderstood

    @property
    def change(self) -> Change:
        """The worst of all changes."""
        there = {change.change for change in self.changes}
        order = (Change.WORSE, Change.BETTER, Change.SAME)
        return next((entry for entry in order if entry in there), Change.NEW)

    @property
    def compared(self) -> bool:
        """True if there are accepted measures to compare with."""
        return self.change is not Change.NEW

    @property
    def passed(self) -> bool:
        """True if nothing got worse and new hogels keep to the limits, or all was approved."""
        return self.approved or (self.change is not Change.WORSE and not self.new_beyond_limits)

    def of_kind(self, change: Change) -> tuple[MeasureChange, ...]:
        """Return the changes of one kind by measure, the largest first."""

        def rank(entry: MeasureChange) -> tuple[int, float]:
            increase = math.inf if entry.now is None else abs(entry.now - (entry.accepted or 0.0))
            return list(MEASURES).index(entry.measure), -increase

        return tuple(sorted((entry for entry in self.changes if entry.change is change), key=rank))

    def summary(self) -> dict[str, Any]:
        """Return the JSON object; `changes` lists worse measures, then better ones."""
        origin = ("run", "commit", "renderer", "device", "judged")
        kinds = (Change.WORSE, Change.BETTER)
        changes = [json_object(change) for kind in kinds for change in self.of_kind(kind)]
        left_out = ("run", "changes", "notes")
        rest = {name: value for name, value in vars(self).items() if name not in left_out}
        named = {name: getattr(self.run, name) for name in origin}
        return {"change": str(self.change), **rest, **named, "changes": changes}


def baseline(
    verification: Verification, folder: Path | str, options: BaselineOptions | None = None
) -> Baseline:
    """Compare a verification with the accepted runs of a folder; keep it if approved.

    InputError where the folder cannot be written, or holds a file that is no accepted run; then
    nothing is approved.
    """
    options, folder = options or BaselineOptions(), Path(folder)
    check_folder(folder)
    everything, run = accepted_runs(folder), _present(verification, options)
    alike = run.like(everything)
    # The runs of the newest state of each hogel that is accepted, whether it is judged now or not.
    newest = {place: candidate.began for candidate in alike for place in candidate.hogels}
    accepted: dict[Place, list[Mapping[str, Any]]] = {}
    for run_of_state in alike:
        for place, hogel in run_of_state.hogels.items():
            if newest[place] == run_of_state.began:
                accepted.setdefault(place, []).append(hogel)
    runs = max((len(accepted[place]) for place in run.hogels.keys() & accepted.keys()), default=0)
    tolerance = f"beyond the spread of {runs} accepted runs"
    if runs == 1:
        tolerance = "compared exactly, with one accepted run"
    new = [hogel for hogel in verification.hogels if hogel.aperture.index not in accepted]
    if options.approve and options.repeated and alike:
        # Only the user can state that a difference is noise: at the same commit, a compiler may
        # have
        # got worse.
        run = replace(run, began=alike[-1].began)
    held = Baseline(
        run=run,
        approved=options.approve,
        changes=tuple(_changes(run.hogels, accepted, options.tolerance)),
        accepted_runs=runs,
        tolerance=tolerance if options.tolerance is None else "tolerance as stated",
        new_hogels=len(new),
        new_beyond_limits=sum(not entry.passed for entry in new),
        not_judged_hogels=len(accepted.keys() - run.hogels.keys()),
        notes=(),
    )
    held = replace(held, notes=tuple(_notes(held, everything, options)))
    if options.approve:
        content = json.dumps(asdict(run), allow_nan=False, indent=1) + "\n"
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
    """Return all accepted runs of a folder, by the time at which their state, then they, began."""
    runs = []
    # Hidden names are files that other processes are writing.
    for path in sorted((folder / ACCEPTED).glob("[!.]*")):
        try:
            run = _RUN.validate_json(read_input(path, "accepted run"))
            for hogel in run.hogels.values():
                measures(hogel)
        except (InputError, ValidationError, LookupError, TypeError, AttributeError) as error:
            raise InputError(
                f"{OPTION} {path}: is no accepted run of this version; remove it, and approve anew"
            ) from error
        runs.append(run)
    return sorted(runs, key=lambda run: (run.began, run.run))


def measures(hogel: Mapping[str, Any]) -> Measures:
    """Return the measures of a hogel of verification.json; a missing one has no other measure."""
    verification, corrected = hogel["as_found"], hogel["corrected"]
    values: Measures = {**dict.fromkeys(MEASURES), "missing": float(verification is None)}
    if verification is None:
        return values
    # An image that shows nothing displaces nothing: its check has a displacement of 0.
    still = any(
        entry["figure"] == DISPLACEMENT and entry["value"] == 0 for entry in hogel["checks"]
    )
    moved = verification["displacement_px"] or (
        dict.fromkeys(("rms", "p99", "max"), 0.0) if still else {}
    )
    counts = {
        "wrong_surfaces": (verification["surface"] or {}).get("wrong"),
        "wrong_pixels": verification["wrong"],
        "wrong_colors": (verification["radiance"] or {}).get("wrong"),
        "invalid": verification["invalid"],
        "unexplained": (corrected["causes"] or {}).get("unexplained"),
        **{f"displacement_{name}_px": moved.get(name) for name in ("rms", "p99", "max")},
    }
    return values | {
        name: None if count is None else float(count) for name, count in counts.items()
    }


def _present(verification: Verification, options: BaselineOptions) -> Run:
    """Return the present run, which begins a state of its own."""
    judging, now = verification.limits.judging, datetime.now(UTC)
    judged = [f"compare {judging.compared}", f"max-color {judging.color_tolerance:.6g}"]
    judged += [f"near {options.near:.9g}"] if options.near else []
    judged += [f"encoding {options.encoding}"] if options.encoding else []
    judged += [f"accept {','.join(sorted(options.accept))}"] if options.accept else []
    name = f"{now:%Y%m%dT%H%M%S.%fZ}-{secrets.token_hex(4)}"  # names sort by time
    return Run(
        run=name,
        began=name,
        time=now.isoformat(timespec="seconds"),
        scene_hash=verification.scene.content_hash,
        renderer=options.renderer or verification.source,
        device=options.device or machine()["processor"],
        judged=", ".join(judged),
        commit=commit_of(options.repository or Path()),
        xfrustum=metadata.version("xfrustum"),
        verification=json_ready(verification.summary()),
    )


def _changes(
    hogels: Mapping[Place, Mapping[str, Any]],
    accepted: Mapping[Place, Sequence[Mapping[str, Any]]],
    stated: Stated | None,
) -> Iterator[MeasureChange]:
    """Compare hogels with their accepted runs: worse exceeds all by more than their spread."""
    values: dict[tuple[str, Place], tuple[list[float], float | None]] = {}
    for place, hogel in hogels.items():
        runs, present = accepted.get(place, ()), measures(hogel)
        before_of = [measures(run) for run in runs]
        # Counts of another kind of wrong pixels are another measure.
        kinds = {(run["as_found"] or {}).get("by") for run in (hogel, *runs)} - {None}
        for name, now in present.items():
            before = [value for run in before_of if (value := run[name]) is not None]
            before = before if len(kinds) <= 1 or name != "wrong_pixels" else []
            # A missing hogel counts once, and not once more for each of its other measures.
            if now is not None or (before and not present["missing"]):
                values[name, place] = before, now
    # The spread of few runs is uncertain: it is no less than the root mean square over all hogels.
    spreads = {key: max(before) - min(before) for key, (before, _) in values.items() if before}
    floors = {}
    for name in {name for name, _ in spreads}:
        squares = [size * size for (other, _), size in spreads.items() if other == name]
        floors[name] = math.sqrt(math.fsum(squares) / len(squares))
    for (name, place), (before, now) in values.items():
        mean, high, change = None, None, Change.NEW
        if before:
            mean, spread = math.fsum(before) / len(before), max(spreads[name, place], floors[name])
            low, high = min(before) - spread, max(before) + spread
            if stated is not None and (amount := stated.amount(name, mean)) is not None:
                low, high = mean - amount, mean + amount
            slack = ROUNDING_PX if name.endswith("_px") else 0.0
            change = Change.WORSE if now is None or now > high + slack else Change.SAME
            change = Change.BETTER if now is not None and now < low - slack else change
        yield MeasureChange(
            measure=name, aperture=place, accepted=mean, limit=high, now=now, change=change
        )


def _notes(held: Baseline, everything: Sequence[Run], options: BaselineOptions) -> Iterator[str]:
    """Yield the notes of a comparison."""
    run, parts = held.run, []
    if held.new_hogels and (held.compared or held.not_judged_hogels):
        beyond = f", {held.new_beyond_limits:,} of them beyond the limits"
        beyond = beyond if held.new_beyond_limits else ""
        parts.append(f"{counted(held.new_hogels, 'hogel')} not accepted before{beyond}")
    if held.not_judged_hogels:
        parts.append(f"{counted(held.not_judged_hogels, 'hogel')} accepted, and not judged now")
    if parts:
        yield f"Not compared: {'; '.join(parts)}."
    alike = run.like(everything)
    same = any(candidate.commit == run.commit for candidate in alike) and run.commit
    if held.change in (Change.WORSE, Change.BETTER) and same and not options.repeated:
        yield (
            "a run of this commit is accepted: if no file differs, give --approve --repeated for "
            "the noise"
        )
    others = [entry for entry in everything if entry.scene_hash == run.scene_hash]
    if others and not alike:
        kept = sorted({f"{other.renderer} on {other.device} ({other.judged})" for other in others})
        yield f"of this scene, measures are accepted for {'; '.join(kept)}"
        yield f"what is judged now is {run.renderer} on {run.device} ({run.judged})"


def commit_of(folder: Path) -> str | None:
    """Return the commit at which a folder is checked out; None without a repository of this user.

    The folder may be a stranger's. `git rev-parse` reads a reference and no file of the work tree,
    so that no filter runs; programs that the repository's settings name are switched off.
    """
    line, null = ["git", *HARMLESS, "-C", str(folder), "rev-parse", "HEAD"], subprocess.DEVNULL
    try:
        return subprocess.check_output(
            line, stdin=null, stderr=null, text=True, timeout=GIT_SECONDS
        ).strip()
    except (OSError, subprocess.SubprocessError):
        return None


def sentence(held: Baseline) -> str:
    """Return the change of the measures in one sentence."""
    if held.change is Change.NEW:
        if held.approved:
            return "Baseline: these measures are the first that are accepted."
        return (
            "Baseline: nothing is accepted yet that could be compared; --approve accepts what is "
            "here now."
        )
    if held.change is Change.SAME:
        also = ", and accepted now" if held.approved else ""
        return f"Baseline: as accepted ({held.tolerance}){also}."
    first, *more = held.of_kind(held.change)
    others = f"; and {len(more)} more" if more else ""
    before = " before, and accepted now" if held.approved else ""
    return (
        f"Baseline: {held.change} than accepted{before}: {first.words}{others} ({held.tolerance})."
    )


def lines(held: Baseline) -> str:
    """Return the changes as lines for the terminal and for GitHub."""
    text = [sentence(held)]
    for change in (Change.WORSE, Change.BETTER):
        changed = held.of_kind(change)
        text += [f"  {change}: {entry.words}" for entry in changed[:MAX_LISTED]]
        more = len(changed) - MAX_LISTED
        text += [f"  {change}: {more} more"] if more > 0 else []
    return "\n".join([*text, *(f"  note: {note}" for note in held.notes)])


def append_step_summary(held: Baseline) -> str | None:
    """Append the changes to GitHub's step summary, if there is one; return an error or None."""
    name, run = os.environ.get("GITHUB_STEP_SUMMARY"), held.run
    if not name:
        return None
    commit = f"commit {run.commit[:7]}" if run.commit else "no commit"
    scene = run.verification["scene"]
    origin = f"{scene}: {run.renderer} on {run.device}, {commit}, xfrustum {run.xfrustum}"
    # A block of code shows every text literally: no name becomes markup.
    block = f"{origin}\n{lines(held)}".replace("```", "")
    try:
        with Path(name).open("a", encoding="utf-8") as file:
            file.write(f"### xfrustum verify\n\n```\n{block}\n```\n")
    except OSError as error:
        return f"the summary for GitHub was not written: {name}: {error.strerror}"
    return None
