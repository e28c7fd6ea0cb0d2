"""Editions: accepted states of a renderer, which follow one another also where branches are merged.

An edition is named after its first run, and says which editions it followed when it was begun. Two branches
of a repository, or two processes, may each begin one beside the other: after a merge both are newest, the one
that was begun later counts, and their difference is no noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from xfrustum.reports.baselines.changes import Accepted, Edition
from xfrustum.reports.baselines.measures import HogelMeasures, Place
from xfrustum.reports.baselines.records import AcceptedRun, Run


@dataclass(frozen=True, kw_only=True)
class Lineage:
    """Editions of the accepted runs of one key.

    Attributes
    ----------
    of_run
        Name of the edition of each run.
    order
        Names of all editions, the newest first; no edition comes before one that follows it.
    newest
        Names of the editions that none follows, the one that was begun last first. One, where no branches
        were merged.
    number
        Largest number of an edition; 0 where there is none.
    """

    of_run: Mapping[str, str]
    order: tuple[str, ...]
    newest: tuple[str, ...]
    number: int


def lineage(runs: Sequence[Run]) -> Lineage:
    """Return the editions of accepted runs, the oldest of which comes first."""
    of_run, followed = _named(runs)
    names = set(of_run.values())
    successors = Counter(one for before in followed.values() for one in before)
    newest = sorted((name for name in names if not successors[name]), reverse=True)
    order: list[str] = []
    while names:
        # Repeated runs that were approved in two branches may each follow the other edition: names decide.
        chosen = max([name for name in names if not successors[name]] or names)
        order.append(chosen)
        names.remove(chosen)
        successors.subtract(followed[chosen])
    return Lineage(
        of_run=of_run,
        order=tuple(order),
        newest=tuple(newest or order[:1]),
        number=max((run.edition or 0 for run in runs), default=0),
    )


def _named(runs: Sequence[Run]) -> tuple[dict[str, str], dict[str, set[str]]]:
    """Return the edition of each run, and the editions that each edition follows."""
    of_run: dict[str, str] = {}
    numbered: dict[int, str] = {}
    followed: dict[str, set[str]] = {}
    for run in runs:
        # Runs of earlier versions have a number only.
        edition = run.began or numbered.setdefault(run.edition or 0, run.run)
        of_run[run.run] = edition
        followed.setdefault(edition, set()).update(run.follows)
    for number, edition in numbered.items():
        followed[edition].update(name for other, name in numbered.items() if other < number)
    known = set(of_run.values())
    return of_run, {edition: (before & known) - {edition} for edition, before in followed.items()}


def accepted_hogels(runs: Iterable[AcceptedRun], editions: Lineage) -> Accepted:
    """Return the accepted runs of each hogel by edition, the newest first."""
    rank = {name: number for number, name in enumerate(editions.order)}
    of_place: dict[Place, dict[int, list[tuple[AcceptedRun, int]]]] = {}
    for one in runs:
        number = rank[editions.of_run[one.run.run]]
        for row, place in enumerate(one.places):
            of_place.setdefault(place, {}).setdefault(number, []).append((one, row))
    return {
        place: [
            Edition(runs=tuple(one.run.run for one, _ in rows), kept=_Kept(rows=rows))
            for _, rows in sorted(numbered.items())
        ]
        for place, numbered in of_place.items()
    }


@dataclass(frozen=True, kw_only=True)
class _Kept(Sequence[HogelMeasures]):
    """Measures of one hogel in several runs, made from the columns of these when they are asked for."""

    rows: Sequence[tuple[AcceptedRun, int]]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> HogelMeasures:  # type: ignore[override]  # no slices are asked for
        run, row = self.rows[index]
        return run.hogel(row)


def beside(runs: Iterable[AcceptedRun], editions: Lineage, places: Collection[Place]) -> tuple[str, ...]:
    """Return the newest editions beside the one that counts, if they accept hogels that it accepts too."""
    held: dict[str, set[Place]] = {name: set() for name in editions.newest}
    for one in runs:
        name = editions.of_run[one.run.run]
        if name in held:
            held[name].update(place for place in one.places if place in places)
    first, *others = editions.newest or ("",)
    return tuple(name for name in others if held[name] & held[first])
