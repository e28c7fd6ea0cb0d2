"""`xfrustum budget` in radiance: the table, and a picture of what each link changes."""

from __future__ import annotations

from collections.abc import Iterator

from xfrustum.compare.attribution.radiance_budget import (
    RadianceBudget,
    RadianceLink,
    make_radiance_budget,
    steps,
)
from xfrustum.compare.prediction.chain import Chain
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.error_report import images
from xfrustum.scenes.model.scene import Scene


def radiance_budget_of(scene: Scene, chain: Chain, *, progress: bool = False) -> RadianceBudget:
    """Take the radiance error of a chain's last image apart, with a progress bar if it takes its time."""
    total = steps(scene)
    with progress_bar(total, "radiance", "image", shown=progress and total > 0) as bar:
        return make_radiance_budget(scene, chain, bar.update)


def table(budget: RadianceBudget) -> str:
    """Return the radiance error link by link as aligned lines."""
    numbers = budget.numbers
    rows = [*numbers.links, RadianceLink(name="in all", **vars(numbers.total), standard_error=None)]
    width = max(len(row.name) for row in rows)
    heads = ("mean", "rms", "max", "rms, same tri.", "max, same tri.")
    lines = [f"{'radiance changes by':<{width + 2}}" + "".join(f"{head:>16}" for head in heads)]
    for row in rows:
        values = (row.mean, row.rms, row.max, row.rms_same_triangle, row.max_same_triangle)
        cells = "".join(f"{_number(value):>16}" for value in values)
        noise = row.standard_error
        lines.append(f"{row.name:<{width + 2}}{cells}" + (f"  +- {noise:.2g} rms" if noise else ""))
    return "\n".join(lines)


def pictures(budget: RadianceBudget) -> Iterator[tuple[str, bytes]]:
    """Yield name and PNG of what each link changes, and of the total; see `images.radiance_map`."""
    changes = (*budget.change.steps, budget.change.total)
    for name, change in zip((*budget.links, "total"), changes, strict=True):
        yield f"radiance-{name.replace(' ', '-')}.png", images.radiance_map(change)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
