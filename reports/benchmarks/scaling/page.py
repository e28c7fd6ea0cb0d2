"""`xfrustum bench scaling` as a page: the curves of every axis, logarithmic both ways, and their reasons."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import plotly.graph_objects as go

from xfrustum.reports.benchmarks.scaling.contestants import CONTESTANTS
from xfrustum.reports.benchmarks.scaling.expected import MEMORY, SECONDS
from xfrustum.reports.benchmarks.scaling.scaling import AxisScaling, ScalingBenchmark
from xfrustum.reports.benchmarks.scaling.table import (
    TOO_SMALL,
    growth_sentence,
    memory_sentence,
    runs_sentence,
    size_name,
)
from xfrustum.reports.common.figure_style import error_bars, log_axis, look, style
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.templates_environment import html_page


@contextmanager
def staged(out: Path | None) -> Iterator[Callable[[ScalingBenchmark], None]]:
    """Prove that a folder can be written, and give what writes index.html and scaling.json to it.

    Parameters
    ----------
    out
        None where nothing is to be written.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    if out is None:
        yield lambda _: None
        return
    with Staging(out, ["index.html", "scaling.json"]) as staging:

        def write(measured: ScalingBenchmark) -> None:
            text = json.dumps(measured.summary(), allow_nan=False, indent=1)
            (staging.folder / "scaling.json").write_text(text + "\n", encoding="utf-8")
            (staging.folder / "index.html").write_text(_page(measured), encoding="utf-8")
            staging.commit()

        yield write


def scaling_figure(one: AxisScaling, quantity: str) -> go.Figure:
    """Draw seconds of a run, or peak MiB, of every contestant along an axis."""
    figure = go.Figure()
    for place, name in enumerate(CONTESTANTS):
        if name not in one.measured:
            continue
        points = one.measured[name]
        if quantity == SECONDS:
            values = [point.seconds.median for point in points]
            spread = error_bars([point.seconds for point in points])
        else:
            values, spread = [point.peak_mib for point in points], None
        color, symbol = look(place)
        figure.add_scatter(
            x=one.axis.counts,
            y=values,
            error_y=spread,
            name=name,
            mode="lines+markers",
            line={"color": color},
            marker={"symbol": symbol, "size": 8, "color": color},
            hovertemplate="%{x:,}: %{y:.3g}<extra>" + name + "</extra>",
        )
    style(figure)
    figure.update_layout(height=420)
    figure.update_xaxes(
        title_text=one.axis.unit,
        type="log",
        # Few powers of ten lie between the sizes, and none of the squares is one.
        tickvals=one.axis.counts,
        ticktext=[size_name(one, size) for size in one.axis.sizes],
    )
    shown = [value for trace in figure.data for value in trace.y]
    figure.update_yaxes(
        title_text="seconds a run" if quantity == SECONDS else "peak memory of the process, MiB",
        **log_axis(shown),
    )
    return figure


def _page(measured: ScalingBenchmark) -> str:
    figures = {
        f"{one.axis.unit}-{quantity}": scaling_figure(one, quantity).to_plotly_json()
        for one in measured.axes
        for quantity in (SECONDS, MEMORY)
    }
    sentences = {
        one.axis.unit: {
            quantity: [growth_sentence(name, found) for name, found in one.findings(quantity).items()]
            for quantity in (SECONDS, MEMORY)
        }
        for one in measured.axes
        if measured.extent.asymptotic
    }
    values = {
        "scaling": measured,
        "sentences": sentences,
        "runs": runs_sentence(measured.extent),
        "too_small": None if measured.extent.asymptotic else TOO_SMALL,
        "memory": memory_sentence(measured),
        "meanings": {name: one.meaning for name, one in CONTESTANTS.items()},
        "figures": figures,
    }
    return html_page("scaling.html.j2", {}, values)
