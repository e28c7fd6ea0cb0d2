"""The command that plans the settings that keep what is required."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.numbers import Positive
from xfrustum.tolerances import MAX_DEPTH_WRONG, SAMPLED_HOGELS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from xfrustum.scenes.plate.double_frustum import DepthFormat, DepthMapping
    from xfrustum.scenes.plate.plate import Aperture


@click.command()
@options.scene_argument
@click.option(
    "--aperture",
    type=options.Index(),
    help="Column,row on the plate: plan for this aperture alone.  [default: the whole plate]",
)
@click.option(
    "--apertures",
    type=options.CountOrAuto(),
    help="Instead of the plate: the middle, the corners, then between; auto: the middle and the worst.",
)
@click.option(
    "--sample",
    type=click.IntRange(1),
    default=SAMPLED_HOGELS,
    show_default=True,
    help="Hogels drawn at random to measure the plan at, for the whole plate.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Start of the random numbers."
)
@options.tolerance_option
@click.option(
    "--separation",
    type=Positive(),
    help="Distance of two sheets that must be ordered.  [default: reach/1000]",
)
@click.option(
    "--max-wrong",
    type=Positive(below=1),
    default=MAX_DEPTH_WRONG,
    show_default=True,
    help="Largest share of pixels that are wrong by depth.",
)
@click.option("--depth", type=options.Name("DepthFormat"), help="Depth buffer format.  [default: any]")
@click.option("--mapping", type=options.Name("DepthMapping"), help="Depth mapping.  [default: any]")
@options.quiet_option
@options.json_option
def plan(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    apertures: int | str | None,
    sample: int,
    seed: int,
    tolerance_px: float,
    separation: float | None,
    max_wrong: float,
    depth: DepthFormat | None,
    mapping: DepthMapping | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Find the fewest slabs and the most robust near that keep what is required, all over the plate.

    The plan is made from the worst apertures of the plate, and measured at these and at a random sample.
    With --aperture or --apertures it is made for these alone.
    """
    if aperture is not None and apertures is not None:
        raise click.UsageError(
            "--aperture names one aperture and --apertures asks for many: give one of them"
        )
    opened = options.open_scene(scene)
    from xfrustum.compare.planning.plan import depth_buffers
    from xfrustum.compare.planning.views import Requirement
    from xfrustum.compare.scouting.automatic import AutoApertures
    from xfrustum.compare.scouting.sample import RandomSample
    from xfrustum.raster import require_room
    from xfrustum.reports.commands.planning import make_plan, spread_apertures, table

    requirement = Requirement(tolerance_px=tolerance_px, separation=separation, max_wrong=max_wrong)
    # The plan is measured by drawing it, but only after a search that traces and predicts for long.
    require_room(opened)
    chosen: Sequence[Aperture] | AutoApertures | None = None
    if isinstance(apertures, str):
        chosen = options.auto_apertures(opened, quiet=quiet)
    elif aperture is not None or apertures is not None:
        asked = options.chosen_aperture(opened, aperture)
        chosen = [asked] if apertures is None else spread_apertures(opened.plate, apertures)
        options.look_at(opened, chosen)
    made = make_plan(
        opened,
        chosen,
        requirement,
        depth_buffers(depth, mapping),
        sample=RandomSample(hogels=sample, seed=seed),
        progress=not quiet,
    )
    if chosen is None:
        # The middle may see nothing of what other hogels do. The plan's scout refuses what no hogel sees.
        options.warn_of(opened)
    drawn = chosen.apertures if isinstance(chosen, AutoApertures) else (chosen or [opened.plate.middle])
    options.tell(as_json, made.summary, lambda: table(made, opened, drawn, requirement))
