"""`cost`: error against time of many settings."""

from __future__ import annotations

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, option


class _Asked(options.OneOrAuto):
    tolerance_px = options.tolerance_option
    repeat = option(click.IntRange(1), "Timed pictures of each, after a warm-up.", default=5)
    out = option(FOLDER, "Folder for the page and cost.json.")


@options.command("xfrustum cost asymmetric --repeat 1 --out cost")
def cost(asked: _Asked) -> None:
    """Measure error against time of every configuration; name the cheapest within a tolerance.

    The answer is given for the tolerance and for a fifth of it. With --apertures auto, pictures are judged at
    several apertures, the worst of which counts.
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.reports.cost import page
    from xfrustum.reports.cost.cost import measure_cost

    options.check_out(asked.out, page.FILES)
    chosen = asked.chosen(opened)
    measured = measure_cost(opened, chosen, asked.tolerance_px, repeat=asked.repeat, progress=asked.progress)
    if asked.out is not None:
        page.write_cost(measured, asked.out)
    asked.tell(measured.summary, lambda: page.table(measured))
