"""`verify --baseline`: one verification held to the accepted measures, and kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from xfrustum.reports.baselines.changes import Change, Changes, MeasureChange, changes_of
from xfrustum.reports.baselines.measures import HogelMeasures, measures_of
from xfrustum.reports.baselines.page import write_page
from xfrustum.reports.baselines.records import Key, Run, StoredRun, stored_run
from xfrustum.reports.baselines.repository import Commit, commit_of
from xfrustum.reports.baselines.store import Store, accepted_hogels, edition_of, name_of_run, with_key
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
    near, accept
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
    page
        Path of the history page.
    """

    run: Run
    changes: Changes
    stated: bool
    others: tuple[Key, ...]
    judges: tuple[str, ...]
    page: Path

    @property
    def passed(self) -> bool:
        """Whether nothing got worse beyond the tolerance, or what did was approved."""
        return self.run.approved or self.run.change is not Change.WORSE

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
    accepted = with_key(everything, key)
    hogels = tuple(measures_of(hogel) for hogel in found.hogels)
    changes = changes_of(hogels, accepted_hogels(accepted), options.tolerance)
    run = _run(found, key, options, changes, accepted)
    store.keep(stored_run(run, hogels, changes))
    write_page(store)
    others = {one.run.key for one in everything if one.run.key.scene_hash == key.scene_hash}
    return Baseline(
        run=run,
        changes=changes,
        stated=options.tolerance is not None,
        others=() if accepted else tuple(sorted(others, key=str)),
        judges=_judges(accepted, hogels),
        page=store.page,
    )


def key_of(found: Verification, options: BaselineOptions) -> Key:
    """Return what the measures of a verification are comparable with."""
    judging = found.limits.judging
    judged = [f"compare {judging.compared}", f"max-color {judging.color_tolerance:.6g}"]
    if options.near:
        judged.append(f"near {options.near:.9g}")
    if options.accept:
        judged.append(f"accept {','.join(sorted(options.accept))}")
    return Key(
        scene_hash=found.scene.content_hash,
        renderer=options.renderer or found.source,
        device=options.device or machine()["processor"],
        judged=", ".join(judged),
    )


def _run(
    found: Verification,
    key: Key,
    options: BaselineOptions,
    changes: Changes,
    accepted: Sequence[StoredRun],
) -> Run:
    now = datetime.now(UTC)
    commit = commit_of(options.repository or Path())
    edition = None
    if options.approve:
        edition = max((edition_of(one.run) for one in accepted), default=0)
        differs = changes.change in (Change.WORSE, Change.BETTER, Change.NEW)
        repeats = options.repeated or _repeats(commit, [one.run for one in accepted])
        if not edition or (differs and not repeats):
            edition += 1
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
        edition=edition,
        faults=tuple(fault.words for fault in found.diagnosis.faults),
    )


def _repeats(commit: Commit | None, accepted: Sequence[Run]) -> bool:
    """Return whether a run of the newest edition is of the very same commit, neither with modifications."""
    newest = max((edition_of(run) for run in accepted), default=0)
    return (
        commit is not None
        and not commit.modified
        and any(
            edition_of(run) == newest and run.commit == commit.hash and not run.modified for run in accepted
        )
    )


def _judges(accepted: Sequence[StoredRun], hogels: Sequence[HogelMeasures]) -> tuple[str, ...]:
    """Return the versions that judged the runs with which hogels are compared."""
    compared = accepted_hogels(accepted)
    names = {run for one in hogels if one.place in compared for run in compared[one.place][0].runs}
    return tuple(sorted({one.run.xfrustum for one in accepted if one.run.run in names}))
