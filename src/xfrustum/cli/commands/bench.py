"""`bench`: speed on this machine."""

from __future__ import annotations

import click

from xfrustum.cli import options
from xfrustum.cli.options import option


def _repeat_option(repeat: int) -> options.Decorator:
    """Return the option for the number of timed repetitions."""
    return option("--repeat", click.IntRange(1), "Timed, after a warm-up.", default=repeat)


def _side_option(pixels: int) -> options.Decorator:
    """Return the option for the side of a square image."""
    return option("--resolution", click.IntRange(1), "W = H.", default=pixels)


def _sides_option(default: str) -> options.Decorator:
    """Return the option for the sides of several square images."""
    return option("--resolution", options.SIZES, f"W = H of each race.  [default: {default}]")


@click.group(
    no_args_is_help=False, epilog="\b\nExample:\n  xfrustum bench plate asymmetric --resolution 64 --repeat 1"
)
def bench() -> None:
    """Measure speed on this machine."""


@bench.command(epilog="\b\nExample:\n  xfrustum bench truth asymmetric --resolution 128 --repeat 1")
@click.argument("scene", default="car")
@_sides_option("512,1024,2048")
@_repeat_option(9)
@options.quiet_and_json
def truth(*, scene: str, resolution: tuple[int, ...] | None, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure the certified truth beside bare tracers, in million pixels per second."""
    opened = options.open_scene(scene)
    from xfrustum.reports.benchmarks import truth as benchmarks

    sizes = resolution or benchmarks.RESOLUTIONS
    measured = benchmarks.benchmark_truth(opened, sizes, repeat, progress=not quiet)
    options.tell(as_json, lambda: measured, lambda: benchmarks.table(measured))


@bench.command(epilog="\b\nExample:\n  xfrustum bench judge asymmetric --resolution 64 --hogels 2 --repeat 1")
@click.argument("scenes", metavar="[SCENE]...", nargs=-1)
@_sides_option("128,256,512,1024")
@option("--triangles", click.IntRange(1), "Also globes of so many triangles.")
@option("--hogels", click.IntRange(1), "Judged in each run.", default=6)
@_repeat_option(5)
@options.quiet_and_json
def judge(
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
    options.tell(as_json, lambda: measured, lambda: benchmarks.table(measured))


@bench.command(epilog="\b\nExample:\n  xfrustum bench plate asymmetric --resolution 64 --repeat 1")
@click.argument("scene", default="car")
@_side_option(128)
@_repeat_option(5)
@options.quiet_and_json
def plate(*, scene: str, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure one row of a plate, drawn many hogels at once, beside plain loops."""
    opened = options.open_scene(scene)
    from xfrustum.reports.benchmarks import plate as benchmarks

    measured = benchmarks.benchmark_plate(opened, resolution, repeat, progress=not quiet)
    options.tell(as_json, lambda: measured, lambda: benchmarks.table(measured))


@bench.command(epilog="\b\nExample:\n  xfrustum bench table1 --resolution 128 --repeat 1")
@_side_option(512)
@_repeat_option(5)
@options.quiet_and_json
def table1(*, resolution: int, repeat: int, quiet: bool, as_json: bool) -> None:
    """Measure table 1 of the paper on the project's own car."""
    from xfrustum.reports.benchmarks import table1 as benchmarks

    measured = benchmarks.benchmark_table1(resolution, repeat, progress=not quiet)
    options.tell(as_json, lambda: measured, lambda: benchmarks.table(measured))
