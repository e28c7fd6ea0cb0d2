"""The command `explain`: the effects that a scene calls for, said before anything is simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import Camera


@click.command()
@options.scene_argument
@options.aperture_option
@click.option("--slabs", type=options.Numbers(), help="Heights |z| at which both frusta are cut.")
@click.option("--camera", type=options.Name("Camera"), help="Which cameras draw.  [default: both]")
@options.tracer_option
@cli_light.light_options("supersample", "multisample", "aperture", "shadows", "interreflection", "samples")
@click.option(
    "--repeat",
    type=click.IntRange(0),
    default=6,
    show_default=True,
    help="Measured pairs of images; 0 measures no cost.",
)
@options.quiet_option
@options.json_option
def explain(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    slabs: tuple[float, ...] | None,
    camera: Camera | None,
    tracer: str,
    light: Light,
    repeat: int,
    quiet: bool,
    as_json: bool,
) -> None:
    """Say what a scene calls for: each effect, the fact that decides it, and what it costs.

    Effects that are left out do not change the picture. Antialiasing, band limiting and light
    transport do: they are used if the scene, or an option here, asks for them.
    """
    from xfrustum.reports.effects import plan as effects_plan
    from xfrustum.reports.effects import table as effects_table
    from xfrustum.scenes import Camera, DoubleFrustum

    opened = light.applied(options.open_scene(scene))
    settings = DoubleFrustum(
        near=effects_plan.DEFAULT_NEAR_PER_REACH * opened.frustum.longest_reach,
        slabs=slabs or (),
        camera=camera or Camera.BOTH,
    )
    chosen = options.chosen_aperture(opened, aperture)
    options.look_at(opened, [chosen])
    plan = effects_plan.explain(
        opened,
        chosen,
        settings,
        tracer=tracer,
        repeat=repeat,
        progress=not quiet,
    )
    options.tell(as_json, lambda: effects_table.summary(plan), lambda: effects_table.table(plan))
