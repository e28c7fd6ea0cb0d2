"""Commands that examine causes of errors (`budget`), the truth (`selfcheck`) and speed (`bench`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.options import Command

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

LIMIT_EXCEEDED = 1
"""Exit status of a command that was done and whose result is no: a limit exceeded, a pixel that differs."""


def _timed_option(repeat: int) -> Callable[[Command], Command]:
    """Return the option for the number of timed repetitions."""
    return click.option(
        "--repeat", type=click.IntRange(1), default=repeat, show_default=True, help="Timed, after a warm-up."
    )


def _side_option(pixels: int) -> Callable[[Command], Command]:
    """Return the option for the side of a square image."""
    return click.option(
        "--resolution", type=click.IntRange(1), default=pixels, show_default=True, help="W = H."
    )


@click.command()
@options.scene_argument
@options.aperture_option
@options.auto_option
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
    auto: str | None,
    settings: DoubleFrustum,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Charge every wrong pixel of one image to its cause, and take its radiance error apart.

    With --apertures auto, of one image for each of several apertures.
    """
    opened = light.applied(options.open_scene(scene))
    settings.check_against(opened.frustum)
    from xfrustum.compare.scouting.automatic import AutoApertures
    from xfrustum.reports.commands import budgeting
    from xfrustum.reports.commands.budget_page import FILES, folder_of, write_budget
    from xfrustum.reports.common.outputs import check_writable_folder

    if out is not None:
        check_writable_folder(out, () if auto else FILES)
    chosen = options.one_or_auto(opened, aperture, auto, quiet=quiet)
    charged: budgeting.BudgetReport | budgeting.AutoBudget
    if isinstance(chosen, AutoApertures):
        if out is not None:
            for one in chosen.apertures:
                check_writable_folder(out / folder_of(one), FILES)
        charged = budgeting.auto_budget(opened, settings, chosen, progress=not quiet)
    else:
        charged = budgeting.budget(opened, settings, chosen, progress=not quiet)
    if out is not None:
        write_budget(charged, out)
    options.tell(as_json, charged.summary, charged.table)


@click.command()
@click.argument("scenes", metavar="[SCENE]...", nargs=-1)
@click.option("--quick", is_flag=True, help="Fewer scenes and pixels, in less than a minute.")
@options.quiet_option
@options.json_option
def selfcheck(scenes: tuple[str, ...], quick: bool, quiet: bool, as_json: bool) -> int:
    """Compare the truth with integer brute force; exit status 1 if anything disagrees.

    Without SCENE: all built-in scenes, all hard cases but the giants, a sphere through all its vertices
    and edges, and the scene files in the folder of test data beside the checkout.
    """
    from xfrustum.scenes.opening.catalogue import check_scene

    for name in scenes:
        check_scene(name)
    from xfrustum.compare.selfcheck.selfcheck import selfcheck as compare_with_integers
    from xfrustum.compare.selfcheck.selfcheck import table

    check = compare_with_integers(scenes, quick=quick, progress=not quiet)
    options.tell(as_json, check.summary, lambda: table(check))
    return 0 if check.agrees else LIMIT_EXCEEDED


def _tell_measured(as_json: bool, measured: dict[str, Any], table: Callable[[dict[str, Any]], str]) -> None:
    """Print the record of a benchmark as JSON or as a table."""
    from xfrustum.reports.common.json_ready import json_ready

    options.tell(as_json, lambda: json_ready(measured), lambda: table(measured))


@click.group(no_args_is_help=False)
def bench() -> None:
    """Measure speed on this machine."""


@bench.command("truth")
@click.argument("scene", default="car")
@click.option("--resolution", type=options.Sizes(), help="W = H of each race.  [default: 512,1024,2048]")
@_timed_option(9)
@options.quiet_option
@options.json_option
def bench_truth(
    *, scene: str, resolution: tuple[int, ...] | None, repeat: int, quiet: bool, as_json: bool
) -> None:
    """Measure the certified truth beside bare tracers, in million pixels per second."""
    opened = options.open_scene(scene)
    from xfrustum.reports.benchmarks import truth as benchmarks

    sizes = resolution or benchmarks.RESOLUTIONS
    measured = benchmarks.benchmark_truth(opened, sizes, repeat, progress=not quiet)
    _tell_measured(as_json, measured, benchmarks.table)


@bench.command("judge")
@click.argument("scenes", metavar="[SCENE]...", nargs=-1)
@click.option("--resolution", type=options.Sizes(), help="W = H of each race.  [default: 128,256,512,1024]")
@click.option("--triangles", type=click.IntRange(1), help="Also globes of so many triangles.")
@click.option("--hogels", type=click.IntRange(1), default=6, show_default=True, help="Judged in each run.")
@_timed_option(5)
@options.quiet_option
@options.json_option
def bench_judge(
    *,
    scenes: tuple[str, ...],
    resolution: tuple[int, ...] | None,
    triangles: int | None,
    hogels: int,
    repeat: int,
    quiet: bool,
    as_json: bool,
) -> None:
    """Measure how fast hogels are judged, beside loops and bare renderers, and CPU seconds by stage.

    Without SCENE: the built-in car, ../shared/scenes/beetle.toml where it is beside the checkout, and globes
    of a million triangles.
    """
    opened = [options.open_scene(name) for name in scenes]
    from xfrustum.reports.benchmarks import judge as benchmarks

    count = triangles or (None if scenes else 1_000_000)
    opened = opened or [options.open_scene(name) for name in benchmarks.default_scenes()]
    opened += [] if count is None else [benchmarks.globes_through_a_plate(count)]
    sizes = resolution or benchmarks.RESOLUTIONS
    measured = benchmarks.benchmark_judge(opened, sizes, hogels, repeat, progress=not quiet)
    _tell_measured(as_json, measured, benchmarks.table)


@bench.command("plate")
@click.argument("scene", default="car")
@_side_option(128)
@_timed_option(5)
@options.quiet_option
@options.json_option
def bench_plate(*, scene: str, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure one row of a plate, drawn many hogels at once, beside plain loops."""
    opened = options.open_scene(scene)
    from xfrustum.reports.benchmarks import plate as benchmarks

    measured = benchmarks.benchmark_plate(opened, resolution, repeat, progress=not quiet)
    _tell_measured(as_json, measured, benchmarks.table)


@bench.command("table1")
@_side_option(512)
@_timed_option(5)
@options.quiet_option
@options.json_option
def bench_table1(*, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure table 1 of the paper on the project's own car."""
    from xfrustum.reports.benchmarks import table1 as benchmarks

    measured = benchmarks.benchmark_table1(resolution, repeat, progress=not quiet)
    _tell_measured(as_json, measured, benchmarks.table)
