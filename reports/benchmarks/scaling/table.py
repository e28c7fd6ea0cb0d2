"""`xfrustum bench scaling` as text: tables of every axis, exponents with their reasons, crossovers."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from xfrustum.reports.benchmarks.scaling.contestants import CONTESTANTS, PIXELS
from xfrustum.reports.benchmarks.scaling.expected import MEMORY, SECONDS, Finding
from xfrustum.reports.benchmarks.scaling.extent import Extent
from xfrustum.reports.benchmarks.scaling.process import ENOUGH_S, FEWEST, Measured
from xfrustum.reports.benchmarks.scaling.scaling import LIMIT_MIB, AxisScaling, ScalingBenchmark

Cell = Callable[[Measured], str]

TOO_SMALL = "these sizes are too small for exponents to mean anything: this shows that it runs, and no more"
"""Sentence that the text has where the extent is not asymptotic."""


def table(measured: ScalingBenchmark) -> str:
    """Return everything measured and found as text."""
    machine = measured.machine
    names = {name for one in measured.axes for name in one.measured}
    parts = [
        f"{machine['cores']} cores of {machine['processor']}; each point is a process of its own",
        runs_sentence(measured.extent),
        *([] if measured.extent.asymptotic else [TOO_SMALL]),
        *(line for one in measured.axes for line in _axis(one, exponents=measured.extent.asymptotic)),
        "",
        memory_sentence(measured),
        "",
        *(f"{name}: {one.meaning}" for name, one in CONTESTANTS.items() if name in names),
        *(f"{name}: not here, {reason}" for name, reason in measured.unavailable.items()),
    ]
    return "\n".join(parts)


def runs_sentence(extent: Extent) -> str:
    """Say how many runs each time is the median of."""
    if extent.repeat == 1:
        return "times are of one run, after a first one that counts as set-up"
    text = (
        f"times are medians (lowest to highest) of {extent.repeat} runs, after a first one that counts as "
        "set-up"
    )
    if extent.repeat <= FEWEST:
        return text
    return f"{text}; of fewer, but at least {FEWEST}, where these take {ENOUGH_S:g} s"


def memory_sentence(measured: ScalingBenchmark) -> str:
    """Say whether everybody stays within `LIMIT_MIB` with the most triangles, or who does not."""
    points = measured.most_triangles
    triangles = next(iter(points.values())).triangles
    most = max(points, key=lambda name: points[name].peak_mib)
    beyond = [name for name, point in points.items() if point.peak_mib >= LIMIT_MIB]
    fits = f"{', '.join(beyond)} need more than" if beyond else "every contestant fits in"
    return (
        f"{triangles:,} triangles: {fits} {LIMIT_MIB / 1024:g} GiB; "
        f"the most takes {most}, {points[most].peak_mib:,.0f} MiB"
    )


def growth_sentence(name: str, found: Finding) -> str:
    """Return a contestant's exponents, what was expected, and why."""
    exponents, (low, high) = found.exponents, found.expected
    verdict = "NOT AS EXPECTED, although " if found.as_expected is False else ""
    return (
        f"{name}: {_exponent(exponents.overall)}, at the large end {_exponent(exponents.large_end)} "
        f"(expected {low:g} to {high:g}): {verdict}{found.sentence}"
    )


def _exponent(value: float | None) -> str:
    return "unknown, as a cost is zero" if value is None else f"{value:.2f}"


def size_name(one: AxisScaling, size: int) -> str:
    """Return a size as people say it."""
    return f"{size} x {size}" if one.axis.unit == PIXELS else f"{size:,}"


def _axis(one: AxisScaling, *, exponents: bool) -> list[str]:
    floors = [f"{point.imported_mib:,.0f}" for points in one.measured.values() for point in points[:1]]
    return [
        "",
        f"{one.axis.unit}: {one.axis.fixed}",
        "",
        *_rows(one, "ms a run", _milliseconds),
        "",
        *_rows(one, "set-up, s", lambda point: f"{point.set_up_s:.2f}"),
        "",
        *_rows(one, "peak, MiB", lambda point: f"{point.peak_mib:,.0f}", ("imported alone", *floors)),
        "",
        *(_exponents(one) if exponents else []),
        "tracing against rasterizing",
        *(f"  {name}: {race.sentence(one.axis.unit)}" for name, race in one.overtakings.items()),
    ]


def _exponents(one: AxisScaling) -> list[str]:
    findings = {quantity: one.findings(quantity) for quantity in (SECONDS, MEMORY)}
    return [
        f"exponents of time in {one.axis.unit}",
        *(f"  {growth_sentence(name, found)}" for name, found in findings[SECONDS].items()),
        f"exponents of memory beyond what is imported in {one.axis.unit}",
        *(f"  {growth_sentence(name, found)}" for name, found in findings[MEMORY].items()),
    ]


def _rows(one: AxisScaling, head: str, cell: Cell, *first: Sequence[str]) -> list[str]:
    lines: list[Sequence[str]] = [(head, *one.measured), *first]
    for place, size in enumerate(one.axis.sizes):
        cells = (cell(points[place]) for points in one.measured.values())
        lines.append((size_name(one, size), *cells))
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return [
        "  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]


def _milliseconds(point: Measured) -> str:
    low, middle, high = (
        f"{1e3 * value:,.4g}" if value < 1 else f"{1e3 * value:,.0f}"
        for value in (point.seconds.lowest, point.seconds.median, point.seconds.highest)
    )
    return middle if point.seconds.repetitions == 1 else f"{middle} ({low} to {high})"
