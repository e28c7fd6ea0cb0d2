"""`trace`, `raster`: one aperture, traced or drawn with the two cameras."""

from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.light import RASTER, REFERENCE, light_options
from xfrustum.cli.options import FOLDER, option


def check_no_other_tracer(tracer: str | None, decided_by: str) -> None:
    """Refuse a tracer for second opinions if an uncertified tracer decides."""
    if decided_by != "certified" and tracer not in (None, decided_by):
        raise click.UsageError(
            f"--tracer {tracer} gives a second opinion, and --decided-by {decided_by} uses none"
        )


class _Trace(options.Measured):
    scene = options.scene_argument
    aperture = options.aperture_option
    tracer = option(
        options.one_of(options.TRACERS), "Ray tracer.  [default: embree; for light paths mitsuba]"
    )
    decided_by = options.decided_by_option
    light = light_options(*REFERENCE)
    out = option(FOLDER, "EXR file, NAME.exr.", required=True)


@options.command("xfrustum trace car --out truth.exr")
def trace(request: _Trace) -> None:
    """Trace the truth of one aperture and write it as EXR.

    With --json, count the pixels that Embree alone and Mitsuba alone would get wrong.

    With interreflection, the color of a pixel is the mean of light paths traced by Mitsuba; the
    channels variance.R, variance.G and variance.B have its variance. Shadows without
    interreflection are exact.
    """
    opened = request.light.applied(options.open_scene(request.scene))
    chosen = options.chosen_aperture(opened, request.aperture)
    from xfrustum.reference import Reference
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.reports.image_files import forecast, trace_alone, trace_to_file, trace_transported

    check_writable_image(request.out)
    options.look_at(opened, [chosen], black_is_right=True)
    effects = request.light.chosen(opened, (chosen,))
    record: Any
    if request.decided_by != "certified":
        check_no_other_tracer(request.tracer, request.decided_by)
        reference = Reference(opened, tracer=request.decided_by, effects=effects)
        record = trace_alone(reference, chosen, request.out)
    else:
        who, transported = request.light.tracer(opened, request.tracer)
        # Light paths may take hours: estimate the duration before they start.
        ahead = None if request.quiet else forecast(opened, transported=transported)
        if ahead is not None:
            options.note(ahead)
        reference = Reference(opened, tracer=who, effects=effects)
        if transported:
            if request.as_json:
                words = "--json counts pixels of the certified truth: leave out light transport"
                raise click.UsageError(words)
            trace_transported(reference, chosen, request.out, progress=request.progress)
            return
        record = trace_to_file(
            reference, chosen, request.out, compared=request.as_json, progress=request.progress
        )
    if request.as_json:
        request.tell(lambda: record, str)


class _Raster(options.Asked):
    scene = options.scene_argument
    aperture = options.aperture_option
    settings = options.settings_options(required=True)
    light = light_options(*RASTER)
    out = option(FOLDER, "EXR file, NAME.exr.", required=True)


@options.command("xfrustum raster car --near 0.1 --out raster.exr")
def raster(request: _Raster) -> None:
    """Draw one aperture with the two cameras and write it as EXR."""
    settings = request.settings
    opened = request.light.applied(options.open_scene(request.scene))
    chosen = options.chosen_aperture(opened, request.aperture)
    # Refuse impossible options before OpenGL is loaded.
    settings.check_against(opened.frustum)
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.scenes.files.exr import write_image

    check_writable_image(request.out)
    options.look_at(opened, [chosen], black_is_right=True)
    options.warn_of_culling(opened, settings.cull)
    with Rasterizer(
        opened, effects=request.light.chosen(opened, (chosen,), settings)
    ) as rasterizer:
        write_image(request.out, rasterizer.render(chosen, settings, normals=True, color=True))
