"""The history page: every measure over all runs, as one file that works offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from xfrustum.reports.baselines.changes import Change, MeasureChange, ranked
from xfrustum.reports.baselines.figures import curve, measured_names
from xfrustum.reports.baselines.measures import NAMES, WORDS
from xfrustum.reports.baselines.records import Key, Run, StoredRun
from xfrustum.reports.baselines.store import OPTION, Store, edition_of
from xfrustum.reports.common.outputs import write_output
from xfrustum.reports.common.templates_environment import html_page

MAX_RUNS = 400
"""Largest number of runs of one renderer that the page shows: the newest; the files have all."""

MAX_CHANGES = 4
"""Largest number of changes of one run that the page names."""

MAX_TRIES = 10
"""Largest number of times that one process makes the page because others keep runs meanwhile."""


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One run as a line of the table: what it was of, and what changed."""

    run: Run
    changes: tuple[MeasureChange, ...]
    more: int


@dataclass(frozen=True, kw_only=True)
class Story:
    """All runs of one scene, renderer and device.

    Attributes
    ----------
    key, scene
        What the runs have in common.
    sentence, accepted
        What became of the last one, and which runs it is compared with next.
    curves
        Names of the elements that hold the curves.
    silent
        Measures that were zero, or unknown, throughout, in words.
    table
        The runs, the newest first.
    left_out
        Number of older runs that are not shown.
    """

    key: Key
    scene: str
    sentence: str
    accepted: str
    last: Run
    curves: tuple[str, ...]
    silent: str
    table: tuple[TableRow, ...]
    left_out: int


def write_page(store: Store) -> None:
    """Write the history page of a baseline.

    Where another process keeps a run meanwhile, the page is made once more, so that the last one to write it
    has seen all runs.

    Raises
    ------
    InputError
        The page cannot be written.
    """
    for _ in range(MAX_TRIES):
        names = store.names()
        write_output(store.page, render_page(store.history()).encode(), OPTION)
        if store.names() == names:
            return


def render_page(history: Sequence[StoredRun]) -> str:
    """Return one HTML document that needs nothing else; of the same runs, always the same."""
    by_key: dict[Key, list[StoredRun]] = {}
    for one in history:
        by_key.setdefault(one.run.key, []).append(one)
    # The renderer that was verified last comes first.
    newest = sorted(by_key.values(), key=lambda runs: runs[-1].run.run, reverse=True)
    stories, figures = [], {}
    for number, runs in enumerate(newest):
        shown = runs[-MAX_RUNS:]
        places = {f"curve-{number}-{name}": curve(name, shown) for name in measured_names(shown)}
        figures.update(places)
        stories.append(_story(runs, shown, tuple(places)))
    values = {"stories": stories, "figures": figures, "runs": len(history)}
    return html_page("history.html.j2", {}, values)


def _story(runs: Sequence[StoredRun], shown: Sequence[StoredRun], curves: tuple[str, ...]) -> Story:
    last = shown[-1]
    measured = measured_names(shown)
    return Story(
        key=last.run.key,
        scene=last.run.scene,
        sentence=_sentence(last, shown),
        accepted=_accepted([one.run for one in runs]),
        last=last.run,
        curves=curves,
        silent=", ".join(WORDS[name] for name in NAMES if name not in measured),
        table=tuple(_table_row(one) for one in reversed(shown)),
        left_out=len(runs) - len(shown),
    )


def _table_row(one: StoredRun) -> TableRow:
    changes = changes_of_run(one)
    return TableRow(run=one.run, changes=changes[:MAX_CHANGES], more=max(0, len(changes) - MAX_CHANGES))


def changes_of_run(one: StoredRun) -> tuple[MeasureChange, ...]:
    """Return what got worse in a run, or, where nothing did, what got better; see `ranked`."""
    found = chain.from_iterable(row.changes for row in one.rows)
    return ranked(change for change in found if change.change is one.run.change)


def _accepted(runs: Sequence[Run]) -> str:
    """Return which runs are accepted now, as far as the history knows."""
    newest = max((edition_of(run) for run in runs), default=0)
    current = [run for run in runs if newest and edition_of(run) == newest]
    if not current:
        return "Nothing is accepted."
    first, count = current[0], len(current)
    commit = "" if first.commit is None else f"commit {first.commit[:7]}, "
    return f"Accepted: {commit}{first.time[:10]}, {count} {'run' if count == 1 else 'runs'}."


def _sentence(last: StoredRun, shown: Sequence[StoredRun]) -> str:
    """Return what became of the last run, and since when."""
    run, changes = last.run, changes_of_run(last)
    accepted = " and was accepted" if run.approved else ""
    if run.change is Change.NEW:
        return f"Nothing had been accepted before the last run{', which' + accepted[4:] if accepted else ''}."
    if run.change is Change.SAME:
        return f"The last run is as accepted{accepted}."
    told = changes[0].words if changes else ""
    text = f"The last run is {run.change} than accepted{accepted}: {told}."
    streak = 0
    for one in reversed(shown):
        if one.run.change is not Change.WORSE or one.run.approved:
            break
        streak += 1
    if streak > 1:
        first = shown[-streak].run
        since = first.time[:10] if first.commit is None else f"commit {first.commit[:7]}"
        text += f" So were all {streak} runs since {since}."
    return text
