"""What changed in words: for the terminal, for JSON, and as Markdown."""

from __future__ import annotations

import os
import re
from pathlib import Path

from xfrustum.reports.baselines.baseline import Baseline
from xfrustum.reports.baselines.changes import Change, MeasureChange, in_units, is_shown
from xfrustum.reports.baselines.measures import WORDS
from xfrustum.reports.baselines.tolerance import MIN_FREEDOM
from xfrustum.reports.verification.files import sentence as verdict_sentence
from xfrustum.reports.verification.verdict import Verification

MAX_TOLD = 8
"""Largest number of changes that the terminal names one by one."""

MAX_ROWS = 20
"""Largest number of hogels' changes in the Markdown table: GitHub drops summaries of over a mebibyte."""

SUMMARY_VARIABLE = "GITHUB_STEP_SUMMARY"
"""Name of the environment variable by which GitHub names the file for a step's summary."""


def sentence(held: Baseline) -> str:
    """Return in one sentence how the measures are beside those that were accepted before."""
    accepted = ", and accepted now" if held.run.approved else ""
    if held.run.change is Change.NEW:
        if held.run.approved:
            return "Baseline: these measures are the first that are accepted."
        return "Baseline: nothing is accepted yet that could be compared; --approve accepts what is here now."
    if held.run.change is Change.SAME:
        return f"Baseline: as accepted ({held.tolerance_words}){accepted}."
    changed = held.changes.of_kind(held.run.change)
    more = f"; and {len(changed) - 1} more" if len(changed) > 1 else ""
    before = " before, and accepted now" if held.run.approved else ""
    first = f"Baseline: {held.run.change} than accepted{before}: {changed[0].words}"
    return f"{first}{more} ({held.tolerance_words})."


def lines(held: Baseline) -> str:
    """Return what changed as lines for the terminal."""
    found = [sentence(held)]
    for change in (Change.WORSE, Change.BETTER):
        changed = held.changes.of_kind(change)
        found += [f"  {change}: {one.words}" for one in changed[:MAX_TOLD]]
        if len(changed) > MAX_TOLD:
            found.append(f"  {change}: {len(changed) - MAX_TOLD} more")
    found += [f"  note: {note}" for note in notes(held)]
    return "\n".join([*found, f"history: {held.page}"])


def notes(held: Baseline) -> list[str]:
    """Return what may be misunderstood otherwise."""
    told = [held.run.hogels_sentence] if held.run.hogels_words else []
    if held.beside:
        runs = ", ".join(f"{one.run} ({one.commit[:7]})" if one.commit else one.run for one in held.beside)
        told.append(
            f"besides the state that counts, another was accepted, in another branch or at once: {runs}; "
            "--approve settles it"
        )
    if held.changes.uncertain:
        told.append(
            f"too few runs: the limits of {held.changes.uncertain} measures are learnt with fewer than "
            f"{MIN_FREEDOM} degrees of freedom; approve more runs, with --repeated"
        )
    if held.run.change in (Change.WORSE, Change.BETTER) and held.repeats_commit:
        told.append(
            "a run of this very commit is accepted: if the renderer has noise, give --approve --repeated"
        )
    for other in held.others:
        differ = [
            f"{name} {getattr(other, name)!r}, not {getattr(held.run.key, name)!r}"
            for name in ("renderer", "device", "judged")
            if getattr(other, name) != getattr(held.run.key, name)
        ]
        told.append(f"of this scene, measures are accepted for {'; '.join(differ)}")
    if held.run.change is Change.WORSE and set(held.judges) - {held.run.xfrustum}:
        told.append(f"accepted by xfrustum {', '.join(held.judges)}, judged now by {held.run.xfrustum}")
    return told


def markdown(held: Baseline, found: Verification) -> str:
    """Return a sentence and a table of measures as Markdown."""
    plate = [
        one
        for one in held.changes.plate
        if is_shown(one.measure, one.now) or is_shown(one.measure, one.accepted)
    ]
    changed = [
        one
        for change in (Change.WORSE, Change.BETTER)
        for one in held.changes.of_kind(change)
        if one.aperture is not None
    ]
    rows = [_row(one) for one in (*plate, *changed[:MAX_ROWS])]
    text = [f"### xfrustum verify: {_plain(held.run.scene)}", "", _plain(sentence(held)), ""]
    text += [_plain(verdict_sentence(found)), ""]
    if held.run.hogels_words:
        text += [_plain(held.run.hogels_sentence), ""]
    text += [
        "| measure | where | accepted | limit | now | change |",
        "| --- | --- | ---: | ---: | ---: | --- |",
    ]
    text += rows or [f"| all measures | plate | | | 0 | {held.run.change} |"]
    if len(changed) > MAX_ROWS:
        text += ["", f"{len(changed) - MAX_ROWS} more changes of hogels are in the history."]
    commit = "no commit" if held.run.commit is None else f"commit {held.run.commit[:7]}"
    made = f"{commit}, {held.run.key.renderer} on {held.run.key.device}, xfrustum {held.run.xfrustum}"
    return "\n".join([*text, "", _plain(made), ""])


def append_step_summary(held: Baseline, found: Verification) -> str | None:
    """Append the Markdown to the file that GitHub names; return what went wrong, None if nothing did."""
    name = os.environ.get(SUMMARY_VARIABLE)
    if not name:
        return None
    try:
        with Path(name).open("a", encoding="utf-8") as file:
            file.write(markdown(held, found) + "\n")
    except OSError as error:
        return f"the summary for GitHub was not written: {name}: {error.strerror}"
    return None


def _row(one: MeasureChange) -> str:
    words = (
        WORDS[one.measure],
        one.place_words,
        "-" if one.accepted is None else in_units(one.measure, one.accepted),
        "-" if one.limit is None else in_units(one.measure, one.limit),
        in_units(one.measure, one.now),
        f"**{one.change}**" if one.change is Change.WORSE else str(one.change),
    )
    return f"| {' | '.join(words)} |"


_MARKUP = re.compile(r"([\\`*_{}\[\]<>&#|~])")


def _plain(text: str) -> str:
    """Return text that Markdown shows as it is, on one line."""
    return _MARKUP.sub(r"\\\1", " ".join(text.split()))
