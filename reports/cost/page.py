"""What `xfrustum cost` shows: the answers first, then the front, then everything."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from xfrustum.reports.common.figure_style import INK, Figure, look, styled
from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.common.timing import CONFIDENCE
from xfrustum.reports.cost.cost import CostReport
from xfrustum.reports.cost.trade_off import STRICTER_FRACTION, Option, pareto
from xfrustum.reports.error_report.best import pixels
from xfrustum.scenes.notebook import aligned, digits, percent
from xfrustum.tolerances import MAX_WRONG

FILES = PAGE, DATA = "index.html", "cost.json"

SMALLEST_DRAWN_PX = 1e-4
"""Displacement at which all smaller ones are drawn: 32-bit positions cannot tell them apart, and a
logarithmic axis has no zero."""


def _ascending(options: Sequence[Option]) -> list[tuple[Option, bool]]:
    """Return options by time, and whether they are on the front."""
    pairs = zip(options, pareto(options), strict=True)
    return sorted(pairs, key=lambda pair: pair[0].time_s.median)


def table(measured: CostReport) -> str:
    """Return the answers, then every option on the front as aligned lines."""
    rows: list[tuple[str, ...]] = [("on the Pareto front", "ms", "from", "to", "99 %, px", "wrong")]
    for one, best in _ascending(measured.options):
        if best:
            times = (f"{1e3 * value:.2f}" for value in (one.time_s.median, *one.time_s.interval))
            rows.append((one.label, *times, f"{one.displacement_p99_px:.3g}", f"{one.surface_fraction:.3g}"))
    return "\n".join([*(answer.sentence for answer in measured.answers), "", aligned(rows)])


def write_cost(measured: CostReport, out: Path) -> tuple[Path, ...]:
    """Write index.html and cost.json to a folder, all or nothing; InputError where that cannot be."""
    values = {
        "cost": measured,
        "confidence": CONFIDENCE,
        "rows": _ascending(measured.options),
        "figure": trade_off_figure(measured.options, measured.tolerance_px),
    }
    filters = {"digits": digits, "percent": percent, "pixels": pixels}
    with Staging(out, FILES) as staging:
        write_json(staging.folder / DATA, measured.summary())
        page = html_page("cost.html.j2", filters, values)
        (staging.folder / PAGE).write_text(page, encoding="utf-8")
        return staging.commit()


def trade_off_figure(options: Sequence[Option], tolerance_px: float) -> Figure:
    """Draw the displacement of every option against its time; options on the front are filled.

    More options are on the front of displacement, time and wrong surfaces than the line goes through: a
    picture with many wrong surfaces may be fast and displaced little.
    """
    drawn = [
        replace(one, displacement_p99_px=max(one.displacement_p99_px, SMALLEST_DRAWN_PX)) for one in options
    ]
    front, data = pareto(options), list[Figure]()
    for place, family in enumerate(dict.fromkeys(option.family for option in options)):
        mine = [(one, best) for one, best in zip(drawn, front, strict=True) if one.family == family]
        color, symbol = look(place)
        times = [one.time_s for one, _ in mine]
        # Bars from the lowest to the highest repetition.
        bars = {
            "array": [1000 * (one.highest - one.median) for one in times],
            "arrayminus": [1000 * (one.median - one.lowest) for one in times],
        }
        symbols = [symbol + ("" if best else "-open") for _, best in mine]
        data.append(
            {
                "x": [1000 * one.median for one in times],
                "y": [one.displacement_p99_px for one, _ in mine],
                "error_x": {"type": "data", "symmetric": False, **bars, "thickness": 0.8, "width": 0},
                "name": family,
                "mode": "markers",
                "marker": {
                    "symbol": symbols,
                    "size": [12 if best else 8 for _, best in mine],
                    "color": color,
                },
                "text": [f"{one.label}<br>wrong surface {one.surface_fraction:.3g}" for one, _ in mine],
                "hovertemplate": "%{text}<br>%{x:.3g} ms, %{y:.3g} px<extra></extra>",
            }
        )
    # The options with few wrong surfaces that none beats in time and displacement, the fastest first.
    # Displacements that are drawn at one height are equal.
    planar = [replace(one, surface_fraction=0.0) for one in drawn if one.surface_fraction <= MAX_WRONG]
    line = [one for one, best in _ascending(planar) if best]
    data.append(
        {
            "x": [1000 * one.time_s.median for one in line],
            "y": [one.displacement_p99_px for one in line],
            "name": f"front, at most {percent(MAX_WRONG)} wrong surfaces",
            "mode": "lines",
            "line": {"color": INK, "width": 1.5, "shape": "hv"},
            "hoverinfo": "skip",
        }
    )
    # The two lines are less than a decade apart: one label stands above its line, one below.
    limits = {"bottom": tolerance_px, "top": STRICTER_FRACTION * tolerance_px}
    across = {
        "type": "line",
        "xref": "x domain",
        "x0": 0,
        "x1": 1,
        "line": {"color": INK, "dash": "dot", "width": 1},
    }
    at_end = {"x": 1, "xref": "x domain", "xanchor": "right", "showarrow": False}
    # A range of less than a decade has no power of ten in it, and digits alone are read as numbers.
    ticks = [digit * 10.0**power for power in range(-2, 6) for digit in (1, 2, 3, 5, 7)]
    labels = {"tickvals": ticks, "ticktext": [f"{value:g}" for value in ticks]}
    decades = {"type": "log", "exponentformat": "power", "dtick": 1}
    layout = {
        "height": 520,
        "xaxis": {"title": "time of a picture with read-back, ms", "type": "log", **labels},
        "yaxis": {"title": "99th percentile of displacement, px", **decades},
        # Shapes on a logarithmic axis take values, annotations their logarithms.
        "shapes": [{**across, "y0": limit, "y1": limit} for limit in limits.values()],
        "annotations": [
            {"text": f"{limit:g} px", "y": math.log10(limit), "yanchor": anchor, **at_end}
            for anchor, limit in limits.items()
        ],
    }
    return styled(data, layout)
