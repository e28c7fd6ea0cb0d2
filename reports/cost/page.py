"""What `xfrustum cost` shows: the answers first, then the front, then everything."""

from __future__ import annotations

from pathlib import Path

from xfrustum.reports.common.json_ready import write_json
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.common.templates_environment import html_page
from xfrustum.reports.common.timing import CONFIDENCE
from xfrustum.reports.cost.cost import CostReport
from xfrustum.reports.cost.figure import trade_off_figure
from xfrustum.reports.cost.trade_off import pareto
from xfrustum.reports.error_report import best
from xfrustum.scenes.notebook import digits, percent

FILES = PAGE, DATA = "index.html", "cost.json"


def table(measured: CostReport) -> str:
    """Return the answers, then every option on the front as aligned lines."""
    front = [one for one, best_of in zip(measured.options, pareto(measured.options), strict=True) if best_of]
    front.sort(key=lambda one: one.time_s.median)
    lines = [f"{'ms':>8}  {'from':>7}  {'to':>7}  {'99 %, px':>9}  {'wrong':>9}  on the Pareto front"]
    lines += [
        f"{1e3 * one.time_s.median:8.2f}  {1e3 * low:7.2f}  {1e3 * high:7.2f}  "
        f"{one.displacement_p99_px:9.3g}  {one.surface_fraction:9.3g}  {one.label}"
        for one in front
        for low, high in (one.time_s.interval,)
    ]
    return "\n".join([*(answer.sentence for answer in measured.answers), "", *lines])


def write_cost(measured: CostReport, out: Path) -> tuple[Path, ...]:
    """Write index.html and cost.json to a folder, all or nothing.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with Staging(out, FILES) as staging:
        write_json(staging.folder / DATA, measured.summary())
        (staging.folder / PAGE).write_text(_page(measured), encoding="utf-8")
        return staging.commit()


def _page(measured: CostReport) -> str:
    figure = trade_off_figure(measured.options, measured.tolerance_px)
    rows = sorted(
        zip(measured.options, pareto(measured.options), strict=True), key=lambda row: row[0].time_s.median
    )
    filters = {"digits": digits, "percent": percent, "pixels": best.pixels}
    values = {
        "cost": measured,
        "confidence": CONFIDENCE,
        "rows": rows,
        "figure": figure,
    }
    return html_page("cost.html.j2", filters, values)
