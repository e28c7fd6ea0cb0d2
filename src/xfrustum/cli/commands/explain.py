"""`explain`: the effects that a scene calls for, said before anything is simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.light import REFERENCE, light_options
from xfrustum.cli.options import option
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum

if TYPE_CHECKING:
    from xfrustum.cli.light import Light


@options.command("xfrustum explain car --viewer 600 --near 0.1")
@options.scene_argument
@options.aperture_option
@option("--slabs", options.NUMBERS, "Heights |z| at which both frusta are cut.", default=())
@option("--camera", options.member(Camera), "Which cameras draw.", default=Camera.BOTH)
@options.tracer_option
@light_options(*REFERENCE[1:], "multisample")
@option("--near", options.POSITIVE, "Near offset of the table of depths.  [default: reach/1000]")
@option("--viewer", options.LENGTH, "Distance of an eye, such as 600mm: what does it notice there?")
@click.option("--measure", is_flag=True, help="Measure what each effect costs on this machine.")
@option("--repeat", click.IntRange(0), "Measured pairs of images; implies --measure.  [default: 6]")
@options.quiet_and_json
def explain(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    slabs: tuple[float, ...],
    camera: Camera,
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
    from xfrustum.reports import explain as explaining

    near = near or explaining.DEFAULT_NEAR_PER_REACH * opened.frustum.longest_reach
    settings = DoubleFrustum(near=near, slabs=slabs, camera=camera)
    chosen = options.chosen_aperture(opened, aperture)
    options.look_at(opened, [chosen])
    plan = explaining.explain(
        opened,
        chosen,
        settings,
        tracer=tracer,
        repeat=(explaining.REPEAT if measure else 0) if repeat is None else repeat,
        progress=not quiet,
    )
    summary, text = explaining.summary(plan), explaining.table(plan)
    if viewer is not None:
        from xfrustum.compare.eye.noticeable import scene_length

        record = explaining.viewer_record(plan.scene, scene_length(viewer, plan.scene), plan.settings)
        summary, text = (
            {**summary, "viewer": record},
            f"{text}\n\n{explaining.viewer_table(record, opened.units)}",
        )
    options.tell(as_json, lambda: summary, lambda: text)
