"""The command `explain`: the effects that a scene calls for, said before anything is simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.numbers import Length, Positive

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.effects.plan import EffectsPlan
    from xfrustum.scenes.plate.double_frustum import Camera


@click.command()
@options.scene_argument
@options.aperture_option
@click.option("--slabs", type=options.Numbers(), help="Heights |z| at which both frusta are cut.")
@click.option("--camera", type=options.Name("Camera"), help="Which cameras draw.  [default: both]")
@options.tracer_option
@cli_light.light_options("supersample", "multisample", "aperture", "shadows", "interreflection", "samples")
@click.option("--near", type=Positive(), help="Near offset of the table of depths.  [default: reach/1000]")
@click.option(
    "--viewer",
    type=Length(),
    help="Distance of an eye, such as 600mm: what a display shows there, and whether near is noticed.",
)
@click.option("--measure", is_flag=True, help="Measure what each effect costs on this machine.")
@click.option(
    "--repeat",
    type=click.IntRange(0),
    help="Measured pairs of images, which implies --measure; 0 measures nothing.  [default: 6]",
)
@options.quiet_option
@options.json_option
def explain(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    slabs: tuple[float, ...] | None,
    camera: Camera | None,
    near: float | None,
    viewer: tuple[float, str | None] | None,
    measure: bool,
    tracer: str,
    light: Light,
    repeat: int | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Say what a scene calls for: each effect, and the fact that decides it.

    The answer comes from the scene alone, with closed forms of what near offset, depth buffer, shear and band
    limiting do at each depth; --measure adds what each effect costs. Effects that are left out do not
    change the picture. Antialiasing, band limiting and light transport do: they are used if the scene,
    or an option here, asks for them.
    """
    opened = light.applied(options.open_scene(scene))
    from xfrustum.reports.effects import plan as effects_plan
    from xfrustum.reports.effects import table as effects_table
    from xfrustum.scenes import Camera, DoubleFrustum

    settings = DoubleFrustum(
        near=near or effects_plan.DEFAULT_NEAR_PER_REACH * opened.frustum.longest_reach,
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
        repeat=(effects_plan.REPEAT if measure else 0) if repeat is None else repeat,
        progress=not quiet,
    )
    summary, table = effects_table.summary, effects_table.table
    if viewer is None:
        options.tell(as_json, lambda: summary(plan), lambda: table(plan))
        return
    _tell_with_viewer(plan, viewer, as_json=as_json)


def _tell_with_viewer(plan: EffectsPlan, viewer: tuple[float, str | None], *, as_json: bool) -> None:
    from xfrustum.compare.eye.limits import scene_length
    from xfrustum.reports.common.json_ready import json_object
    from xfrustum.reports.effects import table as effects_table
    from xfrustum.reports.effects.viewer import viewer_record, viewer_table

    record = viewer_record(plan.scene, scene_length(viewer, plan.scene), plan.settings)
    options.tell(
        as_json,
        lambda: {**effects_table.summary(plan), "viewer": json_object(record)},
        lambda: f"{effects_table.table(plan)}\n\n{viewer_table(record, plan.scene.units)}",
    )
