"""Commands that examine: where an error comes from, whether the truth is true, and what it costs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

LIMIT_EXCEEDED = 1


@click.command()
@options.scene_argument
@options.aperture_option
@options.double_frustum_options
@cli_light.light_options("supersample", "multisample", "aperture", "shadows", "interreflection", "samples")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder for a page, and pictures of causes and links."
)
@options.quiet_option
@options.json_option
def budget(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    settings: DoubleFrustum,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart."""
    from xfrustum.reports.commands import budgeting, radiance_budgeting
    from xfrustum.reports.commands.budget_page import FILES, write_budget
    from xfrustum.reports.common.outputs import check_writable_folder

    opened = light.applied(options.open_scene(scene))
    if out is not None:
        check_writable_folder(out, FILES)
    chosen = options.chosen_aperture(opened, aperture)
    options.look_at(opened, [chosen])
    charged = budgeting.budget(opened, settings, chosen, progress=not quiet)
    if out is not None:
        write_budget(charged, out)
    if as_json:
        options.print_json(charged.summary())
    else:
        click.echo(f"{budgeting.table(charged.geometry)}\n{radiance_budgeting.table(charged.radiance)}")


@click.command()
@click.argument("scenes", metavar="[SCENE]...", nargs=-1)
@click.option("--quick", is_flag=True, help="A part of it, in less than a minute.")
@options.quiet_option
@options.json_option
def selfcheck(scenes: tuple[str, ...], quick: bool, quiet: bool, as_json: bool) -> int:
    """Compare the truth with integer brute force; exit status 1 if anything disagrees.

    Without SCENE: all built-in scenes, all hard cases but the giants, a sphere through all its vertices
    and edges, and the scene files in the folder of test data beside the checkout.
    """
    from xfrustum.compare.selfcheck.selfcheck import selfcheck as compare_with_integers
    from xfrustum.compare.selfcheck.selfcheck import table

    check = compare_with_integers(scenes, quick=quick, progress=not quiet)
    if as_json:
        options.print_json(check.summary())
    else:
        click.echo(table(check))
    return 0 if check.agrees else LIMIT_EXCEEDED


@click.group(no_args_is_help=False)
def bench() -> None:
    """Measure speed, here and now."""


@bench.command("truth")
@click.argument("scene", default="car")
@click.option("--resolution", type=options.Sizes(), help="W = H of each race.  [default: 512,1024,2048]")
@click.option(
    "--repeat", type=click.IntRange(1), default=9, show_default=True, help="Timed, after a warm-up."
)
@options.quiet_option
@options.json_option
def bench_truth(
    *, scene: str, resolution: tuple[int, ...] | None, repeat: int, quiet: bool, as_json: bool
) -> None:
    """Race the certified truth against bare tracers, in million pixels per second."""
    from xfrustum.reports.benchmarks import truth as benchmarks

    sizes = resolution or benchmarks.RESOLUTIONS
    measured = benchmarks.benchmark_truth(options.open_scene(scene), sizes, repeat, progress=not quiet)
    if as_json:
        options.print_json(measured.summary())
    else:
        click.echo(benchmarks.table(measured))


@bench.command("plate")
@click.argument("scene", default="car")
@click.option("--resolution", type=click.IntRange(1), default=128, show_default=True, help="W = H.")
@click.option(
    "--repeat", type=click.IntRange(1), default=5, show_default=True, help="Timed, after a warm-up."
)
@options.quiet_option
@options.json_option
def bench_plate(*, scene: str, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Race one row of a plate, drawn many hogels at once, against plain loops."""
    from xfrustum.reports.benchmarks import plate as benchmarks

    measured = benchmarks.benchmark_plate(options.open_scene(scene), resolution, repeat, progress=not quiet)
    if as_json:
        options.print_json(measured.summary())
    else:
        click.echo(benchmarks.table(measured))


@bench.command("table1")
@click.option("--resolution", type=click.IntRange(1), default=512, show_default=True, help="W = H.")
@click.option(
    "--repeat", type=click.IntRange(1), default=5, show_default=True, help="Timed, after a warm-up."
)
@options.quiet_option
@options.json_option
def bench_table1(*, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure table 1 of the paper on the project's own car."""
    from xfrustum.reports.benchmarks import table1 as benchmarks

    measured = benchmarks.benchmark_table1(resolution, repeat, progress=not quiet)
    if as_json:
        options.print_json(measured.summary())
    else:
        click.echo(benchmarks.table(measured))


@bench.command("scaling")
@click.option("--quick", is_flag=True, help="Small sizes once, to see that everything runs.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for a page of curves.")
@options.quiet_option
@options.json_option
def bench_scaling(*, quick: bool, out: Path | None, quiet: bool, as_json: bool) -> None:
    """Measure how time and memory grow with triangles, pixels and hogels, and where tracing overtakes."""
    from xfrustum.reports.benchmarks.scaling import page as scaling_page
    from xfrustum.reports.benchmarks.scaling import scaling as benchmarks
    from xfrustum.reports.benchmarks.scaling import table as scaling_table
    from xfrustum.reports.benchmarks.scaling.extent import FULL, QUICK

    with scaling_page.staged(out) as write:
        measured = benchmarks.benchmark_scaling(QUICK if quick else FULL, progress=not quiet)
        write(measured)
    if as_json:
        options.print_json(measured.summary())
    else:
        click.echo(scaling_table.table(measured))
