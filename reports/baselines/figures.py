"""Curves of the history page."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from xfrustum.reports.baselines.changes import in_units, is_shown
from xfrustum.reports.baselines.measures import NAMES, WORDS, is_count
from xfrustum.reports.baselines.records import ToldRun
from xfrustum.reports.common.figure_style import style

MEASURED, LIMIT, WORSE, ACCEPTED = "#0072B2", "#8C8C8C", "#D55E00", "#009E73"
"""Colors of the measured values, of the limit, of what got worse, and of accepted runs (Okabe and Ito)."""

MAX_TICKS = 12
"""Largest number of commits that are written below a curve; all others show theirs under the cursor."""

MAX_SUBJECT = 60
"""Characters of a commit's message that are shown under the cursor."""

CURVE_PX = 250
"""Height of a curve, pixels."""


def measured_names(runs: Sequence[ToldRun]) -> tuple[str, ...]:
    """Return the measures that are not zero, or unknown, in all runs."""
    return tuple(name for name in NAMES if any(is_shown(name, one.plate.now.value(name)) for one in runs))


def curve(name: str, runs: Sequence[ToldRun]) -> go.Figure:
    """Draw one measure of the plate over all runs, with its limit, what got worse, and what was accepted."""
    places = list(range(len(runs)))
    values = [one.plate.now.value(name) for one in runs]
    texts = [_hover(name, one) for one in runs]
    figure = go.Figure()
    figure.add_scatter(
        x=places,
        y=[one.plate.limit.value(name) for one in runs],
        mode="lines+markers",
        line={"color": LIMIT, "dash": "dot", "shape": "hvh"},
        marker={"size": 1},
        hoverinfo="skip",
    )
    figure.add_scatter(
        x=places,
        y=values,
        mode="lines+markers",
        line={"color": MEASURED},
        marker={"size": 6},
        text=texts,
        hovertemplate="%{text}<extra></extra>",
    )
    worse = [place for place in places if name in runs[place].worse or name in runs[place].plate.worse]
    approved = [place for place in places if runs[place].run.approved]
    _mark(figure, values, approved, {"symbol": "circle-open", "size": 14, "color": ACCEPTED})
    _mark(figure, values, worse, {"symbol": "x-thin", "size": 10, "color": WORSE})
    style(figure)
    words = WORDS[name] if is_count(name) else f"{WORDS[name]}, px"
    largest = max((value for value in values if value is not None), default=0.0)
    figure.update_layout(
        title={"text": words, "x": 0, "xref": "paper", "font": {"size": 15}},
        height=CURVE_PX,
        showlegend=False,
        margin={"l": 48, "r": 14, "t": 40, "b": 40},
    )
    ticks = _thinned(places)
    figure.update_xaxes(
        tickvals=ticks,
        ticktext=[_short(runs[place]) for place in ticks],
        range=[-0.5, len(runs) - 0.5],
        showgrid=False,
    )
    figure.update_yaxes(range=[0, 1.15 * largest or 1], nticks=5)
    return figure


def _mark(
    figure: go.Figure,
    values: Sequence[float | None],
    places: Sequence[int],
    marker: dict[str, str | int],
) -> None:
    """Mark runs of a curve."""
    color = marker["color"]
    figure.add_scatter(
        x=list(places),
        y=[values[place] for place in places],
        mode="markers",
        marker={**marker, "line": {"width": 3, "color": color}},
        hoverinfo="skip",
        cliponaxis=False,
    )


def _thinned(places: Sequence[int]) -> list[int]:
    """Return the runs whose commits are written; the last one is among them."""
    step = -(-len(places) // MAX_TICKS)
    return [place for place in places if (len(places) - 1 - place) % step == 0]


def _short(one: ToldRun) -> str:
    """Return the commit of a run as it is written below a curve; its date where there is none."""
    return one.run.time[5:10] if one.run.commit is None else one.run.commit[:7]


def _hover(name: str, one: ToldRun) -> str:
    """Return what is shown under the cursor."""
    run, plate = one.run, one.plate
    subject = (run.subject or "").replace("<", "&lt;")
    cut = subject if len(subject) <= MAX_SUBJECT else f"{subject[:MAX_SUBJECT]}.."
    lines = [f"<b>{in_units(name, plate.now.value(name))}</b>"]
    if plate.accepted.value(name) is not None:
        accepted, limit = plate.accepted.value(name), plate.limit.value(name)
        lines.append(f"accepted {in_units(name, accepted)}, limit {in_units(name, limit)}")
    worse = one.worse.get(name, 0)
    if worse:
        lines.append(f"worse in {worse} {'hogel' if worse == 1 else 'hogels'}")
    lines.append(" ".join(part for part in (_short(one), cut) if part))
    lines.append(run.time[:16].replace("T", " ") + " UTC" + (", accepted" if run.approved else ""))
    return "<br>".join(lines)
