"""`verify --baseline`: one verification held to the accepted measures, and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from xfrustum.reports.baselines.changes import Accepted, Change, Changes, MeasureChange, changes_of
from xfrustum.reports.baselines.editions import Lineage, accepted_hogels, beside, lineage
from xfrustum.reports.baselines.measures import HogelMeasures, measures_of
from xfrustum.reports.baselines.page import write_page
from xfrustum.reports.baselines.records import Key, Run, stored_run
from xfrustum.reports.baselines.repository import Commit, commit_of
from xfrustum.reports.baselines.store import Store, name_of_run
from xfrustum.reports.baselines.tolerance import Stated
from xfrustum.reports.common.provenance import machine
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.verification.verdict import Verification


@dataclass(frozen=True, kw_only=True)
class BaselineOptions:
    """How a verification is held to accepted measures.

    Attributes
    ----------
    renderer, device
        Names under which measures are kept; the source of the images, and this machine's processor, where
        None.
    near, accept, encoding
        As given to `verify`: images judged by other options are not comparable.
    tolerance
        Tolerances that go before those learnt from repeated runs.
    approve
        Whether to accept the present measures.
    repeated
        Whether the renderer is known to be unchanged since the accepted runs, so that differences are noise.
    repository
        Folder whose commit is noted; the current one where None.
    """

    renderer: str | None = None
    device: str | None = None
    near: float | None = None
    accept: Sequence[str] = ()
    encoding: str | None = None
    tolerance: Stated | None = None
    approve: bool = False
    repeated: bool = False
    repository: Path | None = None


@dataclass(frozen=True, kw_only=True)
class BaselineRecord:
    """JSON object of a `Baseline`."""

    change: Change
    approved: bool
    edition: int | None
    accepted_runs: int
    new_hogels: int
    new_beyond_limits: int
    not_judged_hogels: int
    tolerance: str
    run: str
    commit: str | None
    renderer: str
    device: str
    judged: str
    page: Path
    changes: tuple[MeasureChange, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline(Summarized[BaselineRecord]):
    """The answer to `xfrustum verify --baseline`.

    Attributes
    ----------
    run, changes
        The present run, and how its measures are beside the accepted ones.
    stated
        Whether the user stated a tolerance.
    others
        Keys under which measures of the same scene are accepted; empty where these can be compared.
    judges
        Versions of xfrustum that judged the accepted runs.
    beside
        First runs of accepted states that are as new as the one that counts, which was accepted last.
    repeats_commit
        Whether the run is of the very commit of an accepted run, neither with modifications, and not said to
        be a repetition.
    page
        Path of the history page.
    """

    run: Run
    changes: Changes
    stated: bool
    others: tuple[Key, ...]
    judges: tuple[str, ...]
    beside: tuple[Run, ...]
    repeats_commit: bool
    page: Path

    @property
    def passed(self) -> bool:
        """Whether nothing got worse and new hogels keep to the limits, or all was approved."""
        good = self.run.change is not Change.WORSE and not self.run.new_beyond_limits
        return self.run.approved or good

    @property
    def compared(self) -> bool:
        """Whether anything was accepted that the present measures could be compared with."""
        return self.run.change is not Change.NEW

    @property
    def tolerance_words(self) -> str:
        """Where the tolerance is from, in words."""
        runs = self.changes.runs
        if self.stated:
            return "tolerance as stated"
        if not self.changes.noisy:
            return "compared exactly, with " + (
                "one accepted run" if runs == 1 else f"{runs} accepted runs that are all alike"
            )
        return "tolerance learnt from " + ("earlier" if runs == 1 else str(runs)) + " accepted runs"

    @property
    def record(self) -> BaselineRecord:
        """The answer, as it is written; `changes` has what got worse, then what got better."""
        return BaselineRecord(
            change=self.run.change,
            approved=self.run.approved,
            edition=self.run.edition,
            accepted_runs=self.changes.runs,
            new_hogels=self.run.new_hogels or 0,
            new_beyond_limits=self.run.new_beyond_limits or 0,
            not_judged_hogels=self.run.not_judged_hogels or 0,
            tolerance=self.tolerance_words,
            run=self.run.run,
            commit=self.run.commit,
            renderer=self.run.key.renderer,
            device=self.run.key.device,
            judged=self.run.key.judged,
            page=self.page,
            changes=self.changes.of_kind(Change.WORSE) + self.changes.of_kind(Change.BETTER),
        )


def baseline(found: Verification, folder: Path | str, options: BaselineOptions | None = None) -> Baseline:
    """Hold a verification to the measures accepted in a folder, keep it there, and draw the history page.

    Parameters
    ----------
    found
        The verification.
    folder
        Folder of the baseline; it is made where there is none.
    options
        How they are compared, and whether the present measures are accepted.

    Raises
    ------
    InputError
        The folder cannot be written, or holds what is no run.
    """
    options = options or BaselineOptions()
    store = Store(folder=Path(folder))
    store.check()
    key = key_of(found, options)
    everything = store.accepted()
    runs = [run for run in everything if run.key == key]
    editions = lineage(runs)
    measured = store.measures(runs)
    hogels = tuple(measures_of(hogel) for hogel in found.hogels)
    present = frozenset(one.place for one in hogels)
    there = {place for one in measured for place in one.places}
    measured = tuple(one.of_places(present) for one in measured)
    accepted = accepted_hogels(measured, editions)
    changes = changes_of(hogels, accepted, options.tolerance)
    commit = commit_of(options.repository or Path())
    run = _run(found, key, options, changes, commit)
    run = _counted(run, found, accepted, len(there - present))
    run = _in_edition(run, editions, repeated=options.repeated)
    store.keep(stored_run(run, hogels, changes))
    write_page(store)
    others = {one.key for one in everything if one.key.scene_hash == key.scene_hash}
    as_new = beside(measured, editions, present)
    return Baseline(
        run=run,
        changes=changes,
        stated=options.tolerance is not None,
        others=() if runs else tuple(sorted(others, key=str)),
        judges=_judges(runs, hogels, accepted),
        beside=tuple(one for one in runs if one.run in as_new),
        repeats_commit=not options.repeated and _repeats(commit, runs),
        page=store.page,
    )


def key_of(found: Verification, options: BaselineOptions) -> Key:
    """Return what the measures of a verification are comparable with."""
    judging = found.limits.judging
    judged = [f"compare {judging.compared}", f"max-color {judging.color_tolerance:.6g}"]
    if options.near:
        judged.append(f"near {options.near:.9g}")
    if options.encoding:
        judged.append(f"encoding {options.encoding}")
    if options.accept:
        judged.append(f"accept {','.join(sorted(options.accept))}")
    return Key(
        scene_hash=found.scene.content_hash,
        renderer=options.renderer or found.source,
        device=options.device or machine()["processor"],
        judged=", ".join(judged),
    )


def _run(
    found: Verification, key: Key, options: BaselineOptions, changes: Changes, commit: Commit | None
) -> Run:
    """Return the present run, which belongs to no edition yet."""
    now = datetime.now(UTC)
    return Run(
        run=name_of_run(now),
        time=now.isoformat(timespec="seconds"),
        scene=found.scene.name,
        key=key,
        commit=None if commit is None else commit.hash,
        subject=None if commit is None else commit.subject,
        modified=None if commit is None else commit.modified,
        xfrustum=metadata.version("xfrustum"),
        verdict="pass" if found.passed else "fail",
        change=changes.change,
        approved=options.approve,
        edition=None,
        began=None,
        follows=(),
        new_hogels=None,
        new_beyond_limits=None,
        not_judged_hogels=None,
        faults=tuple(fault.words for fault in found.diagnosis.faults),
    )


def _counted(run: Run, found: Verification, accepted: Accepted, not_judged: int) -> Run:
    """Return the run with the numbers of hogels that were not compared."""
    new = [hogel for hogel in found.hogels if hogel.aperture.index not in accepted]
    return replace(
        run,
        new_hogels=len(new),
        new_beyond_limits=sum(not hogel.passed for hogel in new),
        not_judged_hogels=not_judged,
    )


def _in_edition(run: Run, editions: Lineage, *, repeated: bool) -> Run:
    """Return the run with the edition that it begins or repeats, where it was approved."""
    if not run.approved:
        return run
    # Only the user knows that a difference is noise: at the same commit, a compiler may have got worse.
    if editions.order and (run.change is Change.SAME or repeated):
        began, *follows = editions.newest
        return replace(run, edition=editions.number, began=began, follows=tuple(follows))
    return replace(run, edition=editions.number + 1, began=run.run, follows=editions.newest)


def _repeats(commit: Commit | None, accepted: Sequence[Run]) -> bool:
    """Return whether an accepted run is of the very same commit, neither with modifications."""
    return (
        commit is not None
        and not commit.modified
        and any(run.commit == commit.hash and not run.modified for run in accepted)
    )


def _judges(runs: Sequence[Run], hogels: Sequence[HogelMeasures], accepted: Accepted) -> tuple[str, ...]:
    """Return the versions that judged the runs with which hogels are compared."""
    names = {run for one in hogels if one.place in accepted for run in accepted[one.place][0].runs}
    return tuple(sorted({one.xfrustum for one in runs if one.run in names}))
