"""The group of all commands, and those of one image."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import completion as cli_completion
from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.commands import camera as cli_camera
from xfrustum.cli.commands import checks as cli_checks
from xfrustum.cli.commands import convert as cli_convert
from xfrustum.cli.commands import cost as cli_cost
from xfrustum.cli.commands import explain as cli_explain
from xfrustum.cli.commands import figure7 as cli_figure7
from xfrustum.cli.commands import plan as cli_plan
from xfrustum.cli.commands import plate as cli_plate
from xfrustum.cli.commands import scene as cli_scene
from xfrustum.cli.commands import study as cli_study
from xfrustum.cli.commands import survey as cli_survey
from xfrustum.cli.commands import verify as cli_verify
from xfrustum.cli.commands import view as cli_view
from xfrustum.cli.files import check_encoding
from xfrustum.cli.help import CommandsByUse
from xfrustum.cli.numbers import Size
from xfrustum.cli.tev import check_tev, send_to_tev, tev_option
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import (
        Cull,
        DepthFormat,
        DepthMapping,
        DoubleFrustum,
        Fit,
        Offset,
        Pivot,
    )


@click.group(
    cls=CommandsByUse,
    context_settings={"help_option_names": ["-h", "--help"]},
    invoke_without_command=True,
    epilog="`xfrustum COMMAND --help` lists the options of a command and ends with an example.",
)
@click.version_option(package_name="xfrustum", message="%(version)s")
@click.option(
    "--max-input-memory",
    type=Size(),
    help="Memory that reading one file may take, such as 4G.  [default: 1G, or 64 times the file's size]",
)
@click.option(
    "--max-hogels",
    type=click.IntRange(min=1),
    help="Largest number of hogels of a scene file's plate.  [default: 20000000]",
)
@click.option(
    "--traceback",
    is_flag=True,
    help="Show the traceback of an unexpected error, and what libraries print; stands before COMMAND.",
)
@click.pass_context
def cli(
    context: click.Context, *, max_input_memory: int | None, max_hogels: int | None, traceback: bool
) -> None:
    """Measure how far renderers of full-parallax spatial displays are from the truth.

    SCENE is the path of a scene file (TOML) or the name of a built-in scene.
    """
    del traceback  # `main` reads this option before anything else can fail
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
    elif max_input_memory is not None or max_hogels is not None:
        from xfrustum.scenes.disk import input_files

        if max_input_memory is not None:
            context.with_resource(input_files.input_memory(max_input_memory))
        if max_hogels is not None:
            context.with_resource(input_files.largest_plate(max_hogels))


_decided_by_option = click.option(
    "--decided-by",
    type=click.Choice(["certified", "embree", "mitsuba"]),
    default="certified",
    show_default=True,
    help="Certified truth, or a tracer's own picture, of which nothing is examined.",
)


@cli.command()
@options.scene_argument
@click.option(
    "--near",
    "nears",
    type=options.Numbers(),
    help="Offsets in scene units.  [default: 25 values from 1e-1 to 1e-8 of the reach]",
)
@click.option(
    "--apertures",
    type=options.IndicesOrAuto(),
    help="Column,row of each, or auto.  [default: the middle; if recentered, also two corners]",
)
@click.option(
    "--depth",
    "depths",
    type=options.Depths(),
    help="Depth buffers, such as d24,d32f:reversed.  [default: five]",
)
@click.option(
    "--pivot",
    "pivots",
    type=options.NameList("Pivot"),
    help="Centers of the shear.  [default: aperture; if recentered, both]",
)
@click.option(
    "--fit",
    "fits",
    type=options.FitHeights(),
    help="Heights |z| drawn exactly, such as angle,screen,15.  [default: the first cut, or angle]",
)
@click.option(
    "--offset",
    "offsets",
    type=options.NameList("Offset"),
    help="Whether cameras step back; none leaves a gap of near at the plate.  [default: plate]",
)
@click.option(
    "--slabs",
    type=options.CutLists(),
    help="Heights |z| at which both frusta are cut, such as '15,40;20;none'.  [default: none]",
)
@click.option("--cull", type=options.Name("Cull"), default="none", help="Faces left out.  [default: none]")
@options.tracer_option
@_decided_by_option
@cli_light.light_options(*cli_light.ALL)
@click.option(
    "--causes/--no-causes",
    default=True,
    help="Whether wrong pixels are charged to causes, and errors predicted.  [default: causes]",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: report/NAME]")
@tev_option
@options.quiet_option
@options.json_option
def report(
    *,
    scene: str,
    nears: tuple[float, ...] | None,
    apertures: tuple[tuple[int, int], ...] | str | None,
    depths: tuple[tuple[DepthFormat, DepthMapping], ...] | None,
    pivots: tuple[Pivot, ...] | None,
    fits: tuple[Fit | float, ...] | None,
    offsets: tuple[Offset, ...] | None,
    slabs: tuple[tuple[float, ...], ...] | None,
    cull: Cull,
    tracer: str,
    decided_by: str,
    light: Light,
    causes: bool,
    out: Path | None,
    tev: str | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Sweep near planes and depth formats; write index.html, inspect.html, report.json, measurements.parquet.

    Every combination of near, depth buffer, pivot, fit, offset and cuts is measured. A recentered frustum is
    measured at two corners of the plate too. With --apertures auto, a look through hundreds of apertures
    chooses the worst ones, and the page has a map of the plate. Without causes it takes a third of the time:
    wrong pixels are counted and shown, and not explained.
    """
    _check_no_other_tracer(tracer if options.is_given("tracer") else None, decided_by)
    opened = light.applied(options.open_scene(scene))
    from xfrustum.reports.error_report.report import make_report

    check_tev(tev)
    chosen = options.several_or_auto(opened, apertures, quiet=quiet)
    files = make_report(
        opened,
        out,
        nears=nears,
        apertures=chosen,
        depths=depths,
        pivots=pivots,
        fits=fits,
        offsets=offsets,
        slabs=slabs,
        tracer=tracer,
        effects=light.effects,
        cull=cull,
        decided_by=decided_by,
        causes=causes,
        progress=not quiet,
    )
    options.tell(
        as_json,
        lambda: {"files": files.places, **files.content},
        lambda: "\n".join((files.sentence, files.command, *files.notes, files.cost, str(files.html))),
    )
    send_to_tev(tev, files.inspection, opened.name)


def _check_no_other_tracer(tracer: str | None, decided_by: str) -> None:
    """Refuse a tracer for second opinions where another one decides alone."""
    if decided_by != "certified" and tracer not in (None, decided_by):
        raise click.UsageError(
            f"--tracer {tracer} gives a second opinion, and --decided-by {decided_by} asks for none"
        )


@cli.command()
@options.scene_argument
@options.aperture_option
@options.free_tracer_option
@_decided_by_option
@cli_light.light_options(*cli_light.REFERENCE)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="EXR file, NAME.exr.")
@options.quiet_option
@options.json_option
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
    from xfrustum.reports.commands.tracing import forecast, trace_alone, trace_to_file
    from xfrustum.reports.commands.transported import trace_transported
    from xfrustum.reports.common.json_ready import json_object
    from xfrustum.reports.common.outputs import check_writable_image

    check_writable_image(out)
    options.look_at(opened, [chosen], black_is_right=True)
    effects = light.chosen(opened, (chosen,))
    if decided_by != "certified":
        _check_no_other_tracer(tracer, decided_by)
        record = trace_alone(Reference(opened, tracer=decided_by, effects=effects), chosen, out)
        if as_json:
            options.print_json(json_object(record))
        return
    who, transported = light.tracer(opened, tracer)
    ahead = None if quiet else forecast(opened, transported=transported)
    if ahead is not None:
        say(f"note: {ahead}")
    reference = Reference(opened, tracer=who, effects=effects)
    if not transported:
        record = trace_to_file(reference, chosen, out, compared=as_json, progress=not quiet)
        if as_json:
            options.print_json(json_object(record))
    else:
        if as_json:
            raise click.UsageError("--json counts pixels of the certified truth: leave out light transport")
        trace_transported(reference, chosen, out, progress=not quiet)


@cli.command()
@options.scene_argument
@options.aperture_option
@options.double_frustum_options
@cli_light.light_options(*cli_light.RASTER)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="EXR file, NAME.exr.")
def raster(
    *, scene: str, aperture: tuple[int, int] | None, settings: DoubleFrustum, light: Light, out: Path
) -> None:
    """Draw one aperture with the two cameras and write it as EXR."""
    opened = light.applied(options.open_scene(scene))
    chosen = options.chosen_aperture(opened, aperture)
    settings.check_against(opened.frustum)
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.scenes.files.openexr.images import write_image

    check_writable_image(out)
    options.look_at(opened, [chosen], black_is_right=True)
    with Rasterizer(opened, effects=light.chosen(opened, (chosen,), settings)) as rasterizer:
        write_image(out, rasterizer.render(chosen, settings, normals=True, color=True))


@cli.command()
@click.argument("truth", type=click.Path(path_type=Path))
@click.argument("raster", type=click.Path(path_type=Path))
@options.json_option
@click.option("--out", type=click.Path(path_type=Path), help="Folder for error pictures.")
def compare(truth: Path, raster: Path, as_json: bool, out: Path | None) -> None:
    """Compare a raster image with the truth, both EXR."""
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.scenes.disk.input_files import check_image_file

    if out is not None:
        check_writable_folder(out, ())
    for image in (truth, raster):
        check_image_file(image)
    from xfrustum.reports.commands.comparison import FILES, compare_files, table, write_comparison

    if out is not None:
        check_writable_folder(out, FILES)
    compared = compare_files(truth, raster)
    for note in filter(None, (compared.note, compared.unexamined)):
        say(f"note: {note}")
    if out is not None:
        write_comparison(compared, out)
    options.tell(as_json, compared.comparison.summary, lambda: table(compared.comparison))


@cli.command()
@click.option("--hard", is_flag=True, help="List the hard cases instead.")
@options.json_option
def scenes(hard: bool, as_json: bool) -> None:
    """List the built-in scenes, each with what it is for."""
    if hard:
        from xfrustum.scenes.library.hard.cases import listing as listed
    else:
        from xfrustum.scenes.library.builtin import listing as listed

    listing = listed()
    if as_json:
        entries = [{"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in listing]
        options.print_json({"scenes": entries})
        return
    width = max(len(entry.name) for entry in listing)
    lines = (f"{one.name:<{width}}  {one.triangles:>7,} triangles  {one.purpose}" for one in listing)
    options.echo("\n".join(lines))


for _command in (
    cli_camera.camera,
    cli_checks.budget,
    cli_checks.selfcheck,
    cli_checks.bench,
    cli_convert.convert,
    cli_cost.cost,
    cli_explain.explain,
    cli_figure7.figure7,
    cli_plan.plan,
    cli_plate.plate,
    cli_scene.check,
    cli_scene.new,
    cli_study.study,
    cli_survey.survey,
    cli_verify.verify,
    cli_view.view,
):
    cli.add_command(_command)


def invoke(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status; unlike click's own `main`, let all exceptions through."""
    check_encoding(arguments)
    asked = cli_completion.instruction()
    if asked is not None:
        return cli_completion.answer(cli, asked)
    try:
        with cli.make_context("xfrustum", list(arguments)) as context:
            status = cli.invoke(context)
    except click.exceptions.Exit as ended:
        status = ended.exit_code
    if sys.stdout is not None:
        sys.stdout.flush()
    return status if isinstance(status, int) else 0
