"""`bench`: speed on this machine."""

from __future__ import annotations

from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import Measured, option


@click.group(
    no_args_is_help=False, epilog="\b\nExample:\n  xfrustum bench plate asymmetric --resolution 64 --repeat 1"
)
def bench() -> None:
    """Measure speed on this machine."""


def _repeat(count: int) -> Any:
    return option(click.IntRange(1), "Timed, after a warm-up.", default=count)


def _sizes(default: str) -> Any:
    return option(options.SIZES, f"W = H of each race.  [default: {default}]")


def _measured(asked: Measured, name: str, *what: Any, **given: Any) -> None:
    """Run a benchmark with the options that are given, and print what it found."""
    from xfrustum.reports import benchmarks

    known = {key: value for key, value in given.items() if value is not None}
    found = getattr(benchmarks, f"benchmark_{name}")(*what, **known, progress=asked.progress)
    asked.tell(lambda: found, lambda: getattr(benchmarks, f"{name}_table")(found))


class _Truth(Measured):
    scene = options.argument(default="car")
    resolution = _sizes("512,1024,2048")
    repeat = _repeat(9)


@options.command("xfrustum bench truth asymmetric --resolution 128 --repeat 1", bench)
def truth(asked: _Truth) -> None:
    """Measure the certified truth beside bare tracers, in million pixels per second."""
    scene = options.open_scene(asked.scene)
    _measured(asked, "truth", scene, resolutions=asked.resolution, repeat=asked.repeat)


class _Judge(Measured):
    scenes = options.argument(metavar="[SCENE]...", nargs=-1)
    resolution = _sizes("128,256,512,1024")
    triangles = option(click.IntRange(1), "Also globes of so many triangles.")
    hogels = option(click.IntRange(1), "Judged in each run.", default=6)
    repeat = _repeat(5)


@options.command("xfrustum bench judge asymmetric --resolution 64 --hogels 2 --repeat 1", bench)
def judge(asked: _Judge) -> None:
    """Measure how fast hogels are judged, beside loops and bare renderers, and CPU seconds by stage.

    Without SCENE: the built-in car, ../shared/scenes/beetle.toml where it is beside the checkout, and globes
    of a million triangles.
    """
    opened = [options.open_scene(name) for name in asked.scenes]
    from xfrustum.reports import benchmarks

    count = asked.triangles or (None if opened else 1_000_000)
    opened = opened or [options.open_scene(name) for name in benchmarks.default_scenes()]
    opened += [] if count is None else [benchmarks.globes_through_a_plate(count)]
    _measured(asked, "judge", opened, resolutions=asked.resolution, hogels=asked.hogels, repeat=asked.repeat)


class _Plate(Measured):
    scene = options.argument(default="car")
    resolution = option(click.IntRange(1), "W = H.", default=128)
    repeat = _repeat(5)


@options.command("xfrustum bench plate asymmetric --resolution 64 --repeat 1", bench)
def plate(asked: _Plate) -> None:
    """Measure one row of a plate, drawn many hogels at once, beside plain loops."""
    _measured(asked, "plate", options.open_scene(asked.scene), asked.resolution, asked.repeat)


class _Table1(Measured):
    resolution = option(click.IntRange(1), "W = H.", default=512)
    repeat = _repeat(5)


@options.command("xfrustum bench table1 --resolution 128 --repeat 1", bench)
def table1(asked: _Table1) -> None:
    """Measure table 1 of the paper on the project's own car."""
    _measured(asked, "table1", asked.resolution, asked.repeat)
