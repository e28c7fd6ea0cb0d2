"""`trace`: the truth of one aperture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.light import REFERENCE, light_options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.cli.light import Light


def check_no_other_tracer(tracer: str | None, decided_by: str) -> None:
    """Refuse a tracer for second opinions where another one decides alone."""
    if decided_by != "certified" and tracer not in (None, decided_by):
        raise click.UsageError(
            f"--tracer {tracer} gives a second opinion, and --decided-by {decided_by} asks for none"
        )


@options.command("xfrustum trace car --out truth.exr")
@options.scene_argument
@options.aperture_option
@option(
    "--tracer", options.one_of(options.TRACERS), "Ray tracer.  [default: embree; for light paths mitsuba]"
)
@options.decided_by_option
@light_options(*REFERENCE)
@options.out_option("EXR file, NAME.exr.", required=True)
@options.quiet_and_json
def trace(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    tracer: str | None,
    decided_by: str,
    light: Light,
    out: Path,
    quiet: bool,
    as_json: bool,
) -> None:
    """Trace the truth of one aperture and write it as EXR.

    With --json, it is counted how many pixels Embree alone and Mitsuba alone would have got wrong.

    With shadows or interreflection, Mitsuba traces, and its color is the mean of light paths, with
    their variance in the channels variance.R, variance.G and variance.B.
    """
    opened = light.applied(options.open_scene(scene))
    chosen = options.chosen_aperture(opened, aperture)
    from xfrustum.reference import Reference
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.reports.trace import forecast, trace_alone, trace_to_file, trace_transported

    check_writable_image(out)
    options.look_at(opened, [chosen], black_is_right=True)
    effects = light.chosen(opened, (chosen,))
    record: Any
    if decided_by != "certified":
        check_no_other_tracer(tracer, decided_by)
        record = trace_alone(Reference(opened, tracer=decided_by, effects=effects), chosen, out)
    else:
        who, transported = light.tracer(opened, tracer)
        ahead = None if quiet else forecast(opened, transported=transported)
        if ahead is not None:
            options.note(ahead)
        reference = Reference(opened, tracer=who, effects=effects)
        if transported:
            if as_json:
                raise click.UsageError(
                    "--json counts pixels of the certified truth: leave out light transport"
                )
            trace_transported(reference, chosen, out, progress=not quiet)
            return
        record = trace_to_file(reference, chosen, out, compared=as_json, progress=not quiet)
    if as_json:
        options.tell(True, lambda: record, str)
