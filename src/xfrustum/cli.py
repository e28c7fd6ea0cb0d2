"""The command line: arguments in, exit status out, and nothing else.

Exit status: 0 done, 1 a stated limit was exceeded, 2 bad input (one line on standard error).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum import cli_checks, cli_cost, cli_explain, cli_light, cli_plan, cli_plate, cli_study, cli_verify
from xfrustum import cli_options as options
from xfrustum.cli_termination import Terminated, terminated_like_interrupted

if TYPE_CHECKING:
    from xfrustum.cli_light import Light
    from xfrustum.scenes.double_frustum import DepthFormat, DepthMapping, DoubleFrustum

BAD_INPUT = 2
INTERRUPTED = 130
"""128 + SIGINT, what shells expect of a program that was stopped by Ctrl-C."""

TERMINATED = 143
"""128 + SIGTERM, likewise."""


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, invoke_without_command=True)
@click.version_option(package_name="xfrustum", message="%(version)s")
@click.pass_context
def cli(context: click.Context) -> None:
    """Measure how far renderers of full-parallax spatial displays are from the truth.

    SCENE is the path of a scene file (TOML) or the name of a built-in scene.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


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
    type=options.Indices(),
    help="Column,row of each.  [default: the middle, recentered also two corners]",
)
@click.option("--depth", "depths", type=options.Depths(), help="Such as d24,d32f:reversed.  [default: five]")
@options.tracer_option
@cli_light.light_options(*cli_light.ALL)
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: report/NAME]")
@options.quiet_option
@options.json_option
def report(
    *,
    scene: str,
    nears: tuple[float, ...] | None,
    apertures: tuple[tuple[int, int], ...] | None,
    depths: tuple[tuple[DepthFormat, DepthMapping], ...] | None,
    tracer: str,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Sweep near planes and depth formats; write index.html, report.json, measurements.parquet.

    A recentered frustum is measured at two corners of the plate too.
    """
    from xfrustum.reports.report import make_report

    opened = light.applied(options.open_scene(scene))
    files = make_report(
        opened,
        out,
        nears=nears,
        apertures=None if apertures is None else [opened.plate.aperture(*index) for index in apertures],
        depths=depths,
        tracer=tracer,
        effects=light.effects,
        progress=not quiet,
    )
    if as_json:
        options.print_json(
            {"files": {"html": files.html, "json": files.json, "parquet": files.parquet}, **files.content}
        )
    else:
        click.echo("\n".join((files.sentence, *files.notes, files.cost, str(files.html))))


@cli.command()
@options.scene_argument
@options.aperture_option
@options.free_tracer_option
@cli_light.light_options(*cli_light.REFERENCE)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="EXR file, NAME.exr.")
@options.quiet_option
def trace(
    *, scene: str, aperture: tuple[int, int] | None, tracer: str | None, light: Light, out: Path, quiet: bool
) -> None:
    """Trace the truth of one aperture and write it as EXR.

    With shadows or interreflection, Mitsuba traces, and its color is the mean of light paths, with
    their variance in the channels variance.R, variance.G and variance.B.
    """
    from xfrustum.reference import Reference
    from xfrustum.reports.outputs import check_writable_image
    from xfrustum.reports.tracing import forecast, trace_to_file
    from xfrustum.reports.transported import trace_transported

    opened = light.applied(options.open_scene(scene))
    chosen = options.chosen_aperture(opened, aperture)
    check_writable_image(out)
    effects = light.chosen(opened)
    who, transported = light.tracer(opened, tracer)
    ahead = None if quiet else forecast(opened, transported=transported)
    if ahead is not None:
        click.echo(f"xfrustum: note: {ahead}", err=True)
    reference = Reference(opened, tracer=who, effects=effects)
    if not transported:
        trace_to_file(reference, chosen, out, progress=not quiet)
    else:
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
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.outputs import check_writable_image
    from xfrustum.scenes.exr import write_image

    opened = light.applied(options.open_scene(scene))
    chosen = options.chosen_aperture(opened, aperture)
    settings.check_against(opened.frustum)
    check_writable_image(out)
    with Rasterizer(opened, effects=light.chosen(opened, settings.camera)) as rasterizer:
        write_image(out, rasterizer.render(chosen, settings, normals=True, color=True))


@cli.command()
@click.argument("truth", type=click.Path(path_type=Path))
@click.argument("raster", type=click.Path(path_type=Path))
@options.json_option
@click.option("--out", type=click.Path(path_type=Path), help="Folder for error pictures.")
def compare(truth: Path, raster: Path, as_json: bool, out: Path | None) -> None:
    """Compare a raster image with the truth, both EXR."""
    from xfrustum.reports.comparison import FILES, compare_files, table, write_comparison
    from xfrustum.reports.outputs import check_writable_folder

    if out is not None:
        check_writable_folder(out, FILES)
    compared = compare_files(truth, raster)
    if compared.note:
        click.echo(f"xfrustum: note: {compared.note}", err=True)
    if out is not None:
        write_comparison(compared, out)
    if as_json:
        options.print_json(compared.comparison.summary())
    else:
        click.echo(table(compared.comparison))


@cli.command()
@click.option("--hard", is_flag=True, help="The hard cases instead.")
@options.json_option
def scenes(hard: bool, as_json: bool) -> None:
    """List the built-in scenes, each with what it is for."""
    from xfrustum.scenes import builtin, hard_cases

    listing = hard_cases.listing() if hard else builtin.listing()
    if as_json:
        entries = [{"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in listing]
        options.print_json({"scenes": entries})
        return
    width = max(len(entry.name) for entry in listing)
    for entry in listing:
        click.echo(f"{entry.name:<{width}}  {entry.triangles:>7,} triangles  {entry.purpose}")


for _command in (
    cli_checks.budget,
    cli_checks.selfcheck,
    cli_checks.bench,
    cli_cost.cost,
    cli_explain.explain,
    cli_light.figure7,
    cli_plan.plan,
    cli_plate.plate,
    cli_study.study,
    cli_verify.verify,
):
    cli.add_command(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments
        Without the program's name; those of the process where None.
    """
    # Importing the scenes for their one exception would cost `--help` a second.
    try:
        with terminated_like_interrupted():
            status = cli.main(args=arguments, prog_name="xfrustum", standalone_mode=False)
    except click.ClickException as error:
        return _refuse(error.format_message())
    except click.Abort as error:
        terminated = isinstance(error.__cause__, Terminated)
        click.echo(f"xfrustum: {'terminated' if terminated else 'interrupted'}", err=True)
        return TERMINATED if terminated else INTERRUPTED
    except Exception as error:
        from xfrustum.scenes.errors import InputError

        if not isinstance(error, InputError):
            raise
        return _refuse(str(error))
    return status if isinstance(status, int) else 0


def _refuse(message: str) -> int:
    click.echo("xfrustum: error: " + " ".join(message.split()), err=True)
    return BAD_INPUT
