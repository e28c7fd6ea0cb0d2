"""`verify --baseline`: differences between a verification and the accepted verification.

    DIR/accepted/KEY.json    verification.json of the accepted run, with its origin

Each scene, renderer, device and way of judging has its own file; approval replaces it.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
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
    machine,
    refused,
    write_output,
)
from xfrustum.reports.verification.verdict import Verification
from xfrustum.reports.verification.words import text
from xfrustum.scenes import InputError
from xfrustum.scenes.disk import read_input
from xfrustum.scenes.representation import counted

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
"""Measures of a hogel, most important first; smaller is better."""

ROUNDING_PX = 1e-6
"""Largest rounding error of displacements, px: some hundred operations on doubles up to 1e3 px."""

# Largest number of listed changes of a kind; time limit of git, seconds.
MAX_LISTED, GIT_SECONDS = 8, 20.0

HARMLESS = [
    word
    for setting in ("core.fsmonitor=false", "core.hooksPath=/dev/null", "protocol.allow=never")
    for word in ("-c", setting)
]
"""Options that prevent git from running programs that a repository names."""

#: column and row of a hogel
Place = tuple[int, int]
Measures = dict[str, float | None]


class Change(StrEnum):
    """Change of a measure or of a whole run; `NEW` without an accepted value."""

    WORSE = "worse"
    BETTER = "better"
    SAME = "same"
    NEW = "new"


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Tolerances of the user: a share of the accepted value, and amounts by measure."""

    share: float | None = None
    amounts: Mapping[str, float]

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Read `5%`, or amounts such as `wrong_surfaces=3,displacement_p99_px=0.01`, or both."""
        share, amounts, names = None, {}, ", ".join(MEASURES)
        for part in map(str.strip, text.split(",")):
            name, equals, number = part.rpartition("=")
            # Accept the spelling of options and of JSON: wrong-surfaces and wrong_surfaces.
            name = name.strip().replace("-", "_")
            if equals and name not in MEASURES:
                raise InputError(f"baseline tolerance: {name!r} is not one of {names}")
            try:
                value = float(number if equals else number.removesuffix("%"))
            except ValueError:
                value = math.nan
            if not 0 <= value < math.inf or not (equals or part.endswith("%")):
                raise InputError(
                    f"baseline tolerance {part!r}: write a share such as 5%, or NAME=AMOUNT such "
                    f"as wrong_surfaces=3, not negative; names are {names}"
                )
            if equals:
                amounts[name] = value
            else:
                share = value / 100
        return cls(share=share, amounts=amounts)

    def amount(self, name: str, mean: float) -> float:
        """Return the tolerance of a measure; an amount overrides the share."""
        return self.amounts.get(name, (self.share or 0.0) * mean)


@dataclass(frozen=True, kw_only=True)
class MeasureChange:
    """A measure of a hogel, its accepted value, and its change."""

    measure: str
    aperture: Place
    accepted: float | None
    #: largest value that is not worse; None without an accepted value
    limit: float | None
    #: present value; None if it can no longer be measured
    now: float | None
    change: Change

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key: the most important measure first, then the largest change."""
        # A measure that became unmeasurable ranks before every number.
        change = math.inf if self.now is None else abs(self.now - (self.accepted or 0.0))
        return list(MEASURES).index(self.measure), -change


@dataclass(frozen=True, kw_only=True)
class Run:
    """A verification with its origin; runs with equal `key` are comparable."""

    time: str
    scene_hash: str
    renderer: str
    device: str
    judged: str
    commit: str | None
    xfrustum: str
    #: content of verification.json
    verification: dict[str, Any]

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Properties that are equal in comparable runs."""
        return self.scene_hash, self.renderer, self.device, self.judged

    @property
    def origin(self) -> str:
        """Renderer, device and way of judging."""
        return f"{self.renderer} on {self.device} ({self.judged})"

    @property
    def hogels(self) -> dict[Place, Mapping[str, Any]]:
        """Hogels of verification.json by column and row."""
        return {tuple(hogel["aperture"]): hogel for hogel in self.verification["hogels"]}


_RUN = TypeAdapter(Run)


@dataclass(frozen=True, kw_only=True)
class BaselineOptions:
    """Options of the comparison with the accepted run."""

    #: name of the renderer; None selects the source
    renderer: str | None = None
    #: name of the renderer's device; None selects this machine's processor
    device: str | None = None
    #: `near`, `accept` and `encoding` of `verify`: measures depend on them
    near: float | None = None
    accept: Sequence[str] = ()
    encoding: str | None = None
    #: tolerances; None compares measures exactly
    tolerance: Stated | None = None
    approve: bool = False
    #: folder whose commit is noted; None selects the current folder
    repository: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """Result of `xfrustum verify --baseline`: all measures of all hogels, and their changes."""

    run: Run
    approved: bool
    changes: tuple[MeasureChange, ...]
    #: origin of the limits
    tolerance: str
    new_hogels: int
    #: number of hogels that were not accepted before and exceed the limits
    new_beyond_limits: int
    not_judged_hogels: int
    #: other accepted runs of this scene, if no accepted run has the present key
    others: tuple[str, ...] = ()

    @property
    def change(self) -> Change:
        """The worst of all changes."""
        there = {measured.change for measured in self.changes}
        # A single worse measure makes the run worse, however many measures are better.
        order = (Change.WORSE, Change.BETTER, Change.SAME)
        return next((change for change in order if change in there), Change.NEW)

    @property
    def compared(self) -> bool:
        """True if there are accepted measures."""
        return self.change is not Change.NEW

    @property
    def passed(self) -> bool:
        """True if no measure is worse and new hogels keep to the limits, or if approved."""
        return self.approved or (self.change is not Change.WORSE and not self.new_beyond_limits)

    def of_kind(self, change: Change) -> list[MeasureChange]:
        """Return the changes of one kind by measure, the largest first."""
        some = (measured for measured in self.changes if measured.change is change)
        return sorted(some, key=lambda measured: measured.rank)

    def summary(self) -> dict[str, Any]:
        """Return the JSON object; `changes` lists worse measures, then better ones."""
        changes = self.of_kind(Change.WORSE) + self.of_kind(Change.BETTER)
        counts = ("approved", "tolerance", "new_hogels", "new_beyond_limits", "not_judged_hogels")
        origin = ("commit", "renderer", "device", "judged")
        return {
            "change": str(self.change),
            **{name: getattr(self, name) for name in counts},
            **{name: getattr(self.run, name) for name in origin},
            "changes": list(map(json_object, changes)),
        }


def baseline(
    verification: Verification, folder: Path | str, options: BaselineOptions | None = None
) -> Baseline:
    """Compare a verification with the accepted run in a folder; store it there if approved.

    Raises InputError if the folder cannot be written, or contains a file that is not an accepted
    run; in that case the run is not approved.
    """
    options, folder = options or BaselineOptions(), Path(folder)
    check_folder(folder)
    # Read all runs: a damaged file must not count as a missing baseline.
    run = _present(verification, options)
    everything = accepted_runs(folder)
    accepted = everything.get(run.key)
    others = [] if accepted is not None else everything.values()
    # Without an accepted run of this key every hogel is new, and limits decide.
    before = {} if accepted is None else accepted.hogels
    new = [hogel for hogel in verification.hogels if hogel.aperture.index not in before]
    held = Baseline(
        run=run,
        approved=options.approve,
        changes=tuple(_changes(run.hogels, before, options.tolerance or Stated(amounts={}))),
        tolerance="compared exactly" if options.tolerance is None else "tolerance as stated",
        new_hogels=len(new),
        new_beyond_limits=sum(not hogel.passed for hogel in new),
        not_judged_hogels=len(before.keys() - run.hogels.keys()),
        others=tuple(other.origin for other in others if other.scene_hash == run.scene_hash),
    )
    if options.approve:
        # Hogels that this run does not judge remain accepted.
        hogels = [*run.hogels.values(), *(before[place] for place in before.keys() - run.hogels)]
        kept = asdict(run) | {"verification": run.verification | {"hogels": hogels}}
        # No part of the key contains NUL: different keys give different strings.
        name = hashlib.sha256("\0".join(run.key).encode()).hexdigest()[:16]
        content = json.dumps(kept, allow_nan=False, indent=1) + "\n"
        with refused(f"{OPTION} {folder}: cannot be made", "choose another place"):
            (folder / ACCEPTED).mkdir(parents=True, exist_ok=True)
        write_output(folder / ACCEPTED / f"{name}.json", content.encode(), OPTION)
    return held


def check_folder(folder: Path) -> None:
    """Raise InputError if accepted runs cannot be stored in a folder; leave nothing behind."""
    try:
        check_writable_folder(folder)
        # Test both levels: the folder may be writable and its subfolder read-only.
        check_writable_folder(folder / ACCEPTED)
    except InputError as error:
        raise InputError(str(error).replace("--out", OPTION, 1)) from error


def accepted_runs(folder: Path) -> dict[tuple[str, str, str, str], Run]:
    """Return the accepted runs of a folder by their keys."""
    runs = {}
    # Hidden names are files that other processes are writing.
    for path in sorted((folder / ACCEPTED).glob("[!.]*")):
        try:
            run = _RUN.validate_json(read_input(path, "accepted run"))
            for hogel in run.hogels.values():
                # Evaluate every measure, so that a damaged file fails here and not in a later
                # comparison.
                measures(hogel)
        except (InputError, ValidationError, LookupError, TypeError, AttributeError) as error:
            raise InputError(
                f"{OPTION} {path}: is no accepted run of this version; remove it, and approve anew"
            ) from error
        runs[run.key] = run
    return runs


def measures(hogel: Mapping[str, Any]) -> Measures:
    """Return the measures of a hogel in verification.json; a missing hogel has only `missing`."""
    numbers, corrected = hogel["as_found"], hogel["corrected"]
    values: Measures = {**dict.fromkeys(MEASURES), "missing": float(numbers is None)}
    if numbers is None:
        return values
    # An image that shows nothing has no displacement; its check has the value 0.
    still = any(
        check["figure"] == DISPLACEMENT and check["value"] == 0 for check in hogel["checks"]
    )
    moved = numbers["displacement_px"] or dict.fromkeys(
        ("rms", "p99", "max"), 0.0 if still else None
    )
    return values | {
        "wrong_surfaces": (numbers["surface"] or {}).get("wrong"),
        "wrong_pixels": numbers["wrong"],
        "wrong_colors": (numbers["radiance"] or {}).get("wrong"),
        "invalid": numbers["invalid"],
        "unexplained": (corrected["causes"] or {}).get("unexplained"),
        **{f"displacement_{name}_px": moved[name] for name in ("rms", "p99", "max")},
    }


def _present(verification: Verification, options: BaselineOptions) -> Run:
    """Return the present run."""
    judging = verification.limits.judging
    judged = [f"compare {judging.compared}", f"max-color {judging.color_tolerance:.6g}"]
    judged += [f"near {options.near:.9g}"] if options.near else []
    judged += [f"encoding {options.encoding}"] if options.encoding else []
    judged += [f"accept {','.join(sorted(options.accept))}"] if options.accept else []
    return Run(
        time=datetime.now(UTC).isoformat(timespec="seconds"),
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
    accepted: Mapping[Place, Mapping[str, Any]],
    stated: Stated,
) -> Iterator[MeasureChange]:
    """Yield the changes of all measures of hogels."""
    for place, hogel in hogels.items():
        there, present = accepted.get(place), measures(hogel)
        before = {} if there is None else measures(there)
        kinds = {(of or {}).get("by") for of in (hogel["as_found"], (there or {}).get("as_found"))}
        if len(kinds - {None}) > 1:
            # Numbers of wrong pixels of different kinds are not comparable.
            before["wrong_pixels"] = None
        for name, now in present.items():
            was = before.get(name)
            # A missing hogel counts once, not again for every other measure.
            if now is None and (was is None or present["missing"]):
                continue
            limit, change = None, Change.NEW
            if was is not None:
                limit, change = was + stated.amount(name, was), Change.SAME
                rounding = ROUNDING_PX if name.endswith("_px") else 0.0
                if now is None or now > limit + rounding:
                    change = Change.WORSE
                elif now < 2 * was - limit - rounding:
                    change = Change.BETTER
            yield MeasureChange(
                measure=name, aperture=place, accepted=was, limit=limit, now=now, change=change
            )


def commit_of(folder: Path) -> str | None:
    """Return the checked-out commit of a folder; None outside a repository of this user.

    The folder may be untrusted. `git rev-parse` reads a reference and no file of the work tree, so
    that no filter runs; `HARMLESS` disables programs that the repository configures.
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
    return text("baseline_sentence", held=held, changed=held.of_kind(held.change), names=MEASURES)


def lines(held: Baseline) -> str:
    """Return the changes as lines for the terminal and for GitHub."""
    listed = [sentence(held)]
    for change in (Change.WORSE, Change.BETTER):
        changed = [
            f"  {change}: {text('change_words', changed=entry, name=MEASURES[entry.measure])}"
            for entry in held.of_kind(change)
        ]
        more = len(changed) - MAX_LISTED
        listed += changed[:MAX_LISTED] + ([f"  {change}: {more} more"] if more > 0 else [])
    if held.compared and held.new_hogels:
        beyond = f"{held.new_beyond_limits:,} of them beyond the limits"
        listed.append(f"  note: {counted(held.new_hogels, 'hogel')} not accepted before, {beyond}")
    if held.not_judged_hogels:
        listed.append(f"  note: {counted(held.not_judged_hogels, 'accepted hogel')} not judged now")
    if held.others:
        known = "; ".join(sorted(held.others))
        listed.append(
            f"  note: of this scene, accepted is {known}; judged now is {held.run.origin}"
        )
    return "\n".join(listed)


def append_step_summary(held: Baseline) -> str | None:
    """Append the changes to GitHub's step summary, if there is one; return an error or None."""
    name, run = os.environ.get("GITHUB_STEP_SUMMARY"), held.run
    if not name:
        return None
    commit = f"commit {run.commit[:7]}" if run.commit else "no commit"
    scene = run.verification["scene"]
    origin = f"{scene}: {run.renderer} on {run.device}, {commit}, xfrustum {run.xfrustum}"
    # A code block shows every text literally: names cannot become markup.
    block = f"{origin}\n{lines(held)}".replace("```", "")
    try:
        with Path(name).open("a", encoding="utf-8") as file:
            file.write(f"### xfrustum verify\n\n```\n{block}\n```\n")
    except OSError as error:
        return f"the summary for GitHub was not written: {name}: {error.strerror}"
    return None
