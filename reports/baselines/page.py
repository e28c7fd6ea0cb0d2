"""The history page: every measure over all runs, as one file that works offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from xfrustum.reports.baselines.changes import Change, MeasureChange
from xfrustum.reports.baselines.editions import lineage
from xfrustum.reports.baselines.figures import curve, measured_names
from xfrustum.reports.baselines.measures import NAMES, WORDS
from xfrustum.reports.baselines.records import Key, Run, ToldRun
from xfrustum.reports.baselines.store import OPTION, Store
from xfrustum.reports.common.outputs import write_output
from xfrustum.reports.common.templates_environment import html_page

MAX_TRIES = 10
"""Largest number of times that one process makes the page because others keep runs meanwhile."""


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One run as a line of the table: what it was of, what changed, and which hogels were not compared."""

    run: Run
    changes: tuple[MeasureChange, ...]
    more: int
    hogels: str


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
    """

    key: Key
    scene: str
    sentence: str
    accepted: str
    last: Run
    curves: tuple[str, ...]
    silent: str
    table: tuple[TableRow, ...]


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
        page = render_page(store.history(), store.accepted(), store.older())
        write_output(store.page, page.encode(), OPTION)
        if store.names() == names:
            return


def render_page(history: Sequence[ToldRun], accepted: Sequence[Run], older: int = 0) -> str:
    """Return one HTML document that needs nothing else; of the same runs, always the same.

    Parameters
    ----------
    history, accepted
        Runs that are shown, and those that are accepted, the oldest first.
    older
        Number of older runs that are not shown.
    """
    by_key: dict[Key, list[ToldRun]] = {}
    for one in history:
        by_key.setdefault(one.run.key, []).append(one)
    # The renderer that was verified last comes first.
    newest = sorted(by_key.values(), key=lambda runs: runs[-1].run.run, reverse=True)
    stories, figures = [], {}
    for number, runs in enumerate(newest):
        places = {f"curve-{number}-{name}": curve(name, runs) for name in measured_names(runs)}
        figures.update(places)
        of_key = [run for run in accepted if run.key == runs[-1].run.key]
        stories.append(_story(runs, of_key, tuple(places)))
    values = {"stories": stories, "figures": figures, "runs": len(history) + older, "older": older}
    return html_page("history.html.j2", {}, values)


def _story(shown: Sequence[ToldRun], accepted: Sequence[Run], curves: tuple[str, ...]) -> Story:
    last = shown[-1]
    measured = measured_names(shown)
    return Story(
        key=last.run.key,
        scene=last.run.scene,
        sentence=" ".join(filter(None, (_sentence(last, shown), last.run.hogels_sentence))),
        accepted=_accepted(accepted),
        last=last.run,
        curves=curves,
        silent=", ".join(WORDS[name] for name in NAMES if name not in measured),
        table=tuple(_table_row(one) for one in reversed(shown)),
    )


def _table_row(one: ToldRun) -> TableRow:
    return TableRow(
        run=one.run,
        changes=one.changes,
        more=one.changed - len(one.changes),
        hogels=one.run.hogels_words,
    )


def _accepted(runs: Sequence[Run]) -> str:
    """Return which runs of a renderer are accepted now."""
    editions = lineage(runs)
    current = [run for run in runs if editions.of_run[run.run] == editions.newest[0]]
    if not current:
        return "Nothing is accepted."
    first, count = current[0], len(current)
    commit = "" if first.commit is None else f"commit {first.commit[:7]}, "
    return f"Accepted: {commit}{first.time[:10]}, {count} {'run' if count == 1 else 'runs'}."


def _sentence(last: ToldRun, shown: Sequence[ToldRun]) -> str:
    """Return what became of the last run, and since when."""
    run, changes = last.run, last.changes
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
