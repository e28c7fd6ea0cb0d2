"""`cost`: error against time of many settings."""

from __future__ import annotations

from pathlib import Path

import click

from xfrustum.cli import options
from xfrustum.cli.options import option


@options.command("xfrustum cost asymmetric --repeat 1 --out cost")
@options.scene_argument
@options.aperture_option
@options.auto_option
@options.tolerance_option
@option("--repeat", click.IntRange(1), "Timed pictures of each, after a warm-up.", default=5)
@options.out_option("Folder for the page and cost.json.")
@options.quiet_and_json
def cost(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    auto: str | None,
    tolerance_px: float,
    repeat: int,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Measure error against time of every configuration; name the cheapest within a tolerance.

    The answer is given for the tolerance and for a fifth of it. With --apertures auto, pictures are judged at
    several apertures, the worst of which counts.
    """
    opened = options.open_scene(scene)
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.cost.cost import measure_cost
    from xfrustum.reports.cost.page import FILES, table, write_cost

    if out is not None:
        check_writable_folder(out, FILES)
    chosen = options.one_or_auto(opened, aperture, auto, quiet=quiet)
    measured = measure_cost(opened, chosen, tolerance_px, repeat=repeat, progress=not quiet)
    if out is not None:
        write_cost(measured, out)
    options.tell(as_json, measured.summary, lambda: table(measured))
