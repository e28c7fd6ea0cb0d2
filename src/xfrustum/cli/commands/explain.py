"""`explain`: the effects that a scene calls for, said before anything is simulated."""

from __future__ import annotations

import click

from xfrustum.cli import options
from xfrustum.cli.light import BUDGET, light_options
from xfrustum.cli.options import LENGTH, NUMBERS, POSITIVE, flag, option
from xfrustum.scenes.plate.double_frustum import Camera, DoubleFrustum


class _Asked(options.Measured):
    scene = options.scene_argument
    aperture = options.aperture_option
    slabs = option(NUMBERS, "Heights |z| at which both frusta are cut.", default=())
    camera = option(options.member(Camera), "Which cameras draw.", default=Camera.BOTH)
    tracer = options.tracer_option
    light = light_options(*BUDGET)
    near = option(POSITIVE, "Near offset of the table of depths.  [default: reach/1000]")
    viewer = option(LENGTH, "Distance of an eye, such as 600mm: what does it notice there?")
    measure = flag("Measure what each effect costs on this machine.")
    repeat = option(click.IntRange(0), "Measured pairs of images; implies --measure.  [default: 6]")


@options.command("xfrustum explain car --viewer 600 --near 0.1")
def explain(asked: _Asked) -> None:
    """Say what a scene calls for: each effect, and the fact that decides it.

    The answer comes from the scene alone, with closed forms of what near offset, depth buffer, shear and band
    limiting do at each depth; --measure adds what each effect costs. Effects that are left out do not
    change the picture. Antialiasing, band limiting and light transport do: they are used if the scene,
    or an option here, asks for them.
    """
    opened = asked.light.applied(options.open_scene(asked.scene))
    from xfrustum.reports import explain as explaining

    near = asked.near or explaining.DEFAULT_NEAR_PER_REACH * opened.frustum.longest_reach
    settings = DoubleFrustum(near=near, slabs=asked.slabs, camera=asked.camera)
    chosen = options.chosen_aperture(opened, asked.aperture)
    options.look_at(opened, [chosen])
    repeat = asked.repeat if asked.repeat is not None else explaining.REPEAT if asked.measure else 0
    plan = explaining.explain(
        opened, chosen, settings, tracer=asked.tracer, repeat=repeat, progress=asked.progress
    )
    summary, text = explaining.summary(plan), explaining.table(plan)
    if asked.viewer is not None:
        from xfrustum.compare.eye.noticeable import scene_length

        record = explaining.viewer_record(plan.scene, scene_length(asked.viewer, plan.scene), plan.settings)
        summary = {**summary, "viewer": record}
        text = f"{text}\n\n{explaining.viewer_table(record, opened.units)}"
    asked.tell(lambda: summary, lambda: text)
