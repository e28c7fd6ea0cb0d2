"""`survey`: hogels judged all over a plate."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.checks import LIMIT_EXCEEDED
from xfrustum.cli.commands.convert import layout_option
from xfrustum.cli.commands.verify import Conventions, Share
from xfrustum.cli.options import Command
from xfrustum.cli.tev import check_tev, send_to_tev, tev_option
from xfrustum.cli.where import Where, engine_options
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.reports.survey.foreign import ForeignPlate
    from xfrustum.reports.survey.survey import Chosen
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


class Resolution(click.ParamType[tuple[int, int]]):
    """Width and height separated by a comma."""

    name = "W,H"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return both."""
        sizes = options.Sizes().convert(value, param, ctx)
        if len(sizes) != 2:
            self.fail(f"{value!r} is not a width and a height such as 128,128", param, ctx)
        return sizes[0], sizes[1]


def several_double_frusta_options(command: Command) -> Command:
    """Add the options of the double frustum, with one near or several, or none.

    The command receives them as one tuple `settings`, which is empty where no near is given.
    """

    def with_one(*, nears: tuple[float, ...] | None, settings: DoubleFrustum | None, **rest: Any) -> Any:
        if settings is None:
            return command(settings=(), **rest)
        return command(
            settings=tuple(replace(settings, near=near) for near in nears or (settings.near,)), **rest
        )

    with_near = options.optional_double_frustum_options(with_one)

    @functools.wraps(command)
    def with_several(**given: Any) -> Any:
        nears = given["nears"]
        if nears is not None and given["near"] is not None:
            raise click.UsageError("--near is one setting and --nears are several: give one of them")
        return with_near(**(given if nears is None else {**given, "near": nears[0]}))

    with_several.__click_params__ = [  # type: ignore[attr-defined]  # where click keeps options
        *getattr(command, "__click_params__", ()),
        *getattr(with_near, "__click_params__", ()),
    ]
    several = click.option(
        "--nears", type=options.Numbers(), help="Several offsets, each of which is a setting."
    )
    return several(with_several)  # type: ignore[return-value]  # wraps() keeps the name, not the type


@click.command()
@options.scene_argument
@several_double_frusta_options
@click.option("--all", "everything", is_flag=True, help="Judge every hogel: facts, not bounds.")
@click.option("--sample", type=click.IntRange(1), help="Hogels drawn at random.  [default: 300]")
@click.option(
    "--until",
    type=Share(),
    help="Go on until at most this share, such as 1%, is beyond (95 %), or cannot be.",
)
@options.tolerance_option
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Start of the random numbers."
)
@options.tracer_option
@click.option("--resolution", type=Resolution(), help="Pixels of each hogel.  [default: the scene's]")
@click.option("--images", help="Judge another renderer's files instead, as verify does: 'DIR/{i}x{j}.png'.")
@click.option(
    "--encoding",
    type=click.Choice(["rgb", "srgb", "triangle-id", "object-id"]),
    help="What pixels of --images hold; not for OpenEXR.  [default: rgb]",
)
@layout_option("--layout", "Layout of --images, a folder or a picture.  [default: what it looks like]")
@click.option("--accept", type=Conventions(), help="Conventions of --images that are no faults; see verify.")
@engine_options()
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder.")
@tev_option
@options.quiet_option
@options.json_option
def survey(
    *,
    scene: str,
    settings: tuple[DoubleFrustum, ...],
    everything: bool,
    sample: int | None,
    until: float | None,
    tolerance_px: float,
    seed: int,
    tracer: str,
    resolution: tuple[int, int] | None,
    images: str | None,
    encoding: str | None,
    layout: str | None,
    accept: tuple[str, ...] | None,
    where: Where,
    out: Path,
    tev: str | None,
    quiet: bool,
    as_json: bool,
) -> int:
    """Judge hogels all over a plate: which share is beyond a tolerance, where, and why.

    Writes survey.parquet, one row for each hogel and setting, survey.json, index.html, and inspect.html.
    Stopped at any moment and called again with the same --out, it goes on where it was; any number of
    processes may do one survey at once. Exit status 1 if the share is above --until; without it, if
    --tolerance-px was given, or --images, and any judged hogel is beyond.
    """
    opened = options.open_scene(scene)

    from xfrustum.reports.survey.page import INSPECTION, PAGE
    from xfrustum.reports.survey.survey import survey as surveyed

    check_tev(tev)

    if resolution is not None:
        opened = replace(opened, frustum=replace(opened.frustum, resolution=resolution))
    asked = _asked(settings, images, encoding, layout, accept)
    found = surveyed(
        opened,
        asked,
        out,
        _chosen(everything, sample, until, seed),
        tolerance_px=tolerance_px,
        tracer=tracer,
        engine=where.engine(),
        told=lambda line: say(f"note: {line}"),
        progress=not quiet,
    )
    options.warn_of(opened)
    # A part of a job array leaves no page.
    place = out / PAGE if found.extent.complete else out
    options.tell(as_json, found.summary, lambda: f"{found.table()}\n{place}")
    if found.extent.complete:
        send_to_tev(tev, out / INSPECTION, opened.name)
    limited = until is not None or images is not None or options.is_given("tolerance_px")
    return LIMIT_EXCEEDED if limited and found.extent.complete and found.exceeded else 0


def _asked(
    settings: tuple[DoubleFrustum, ...],
    images: str | None,
    encoding: str | None,
    layout: str | None,
    accept: tuple[str, ...] | None,
) -> tuple[DoubleFrustum, ...] | ForeignPlate:
    """Return what is judged: settings of our own rasterizer, or another renderer's plate."""
    from xfrustum.reports.survey.foreign import ForeignPlate
    from xfrustum.scenes.files.foreign_images import Encoding

    if images is None:
        if any(one is not None for one in (encoding, layout, accept)):
            raise click.UsageError(
                "--encoding, --layout and --accept say how --images are read: give --images too"
            )
        if not settings:
            raise click.UsageError("give --near or --nears, or the --images of another renderer")
        return settings
    if len(settings) > 1:
        raise click.UsageError("--images were drawn with one near offset: give --near, or none")
    return ForeignPlate(
        pattern=images,
        encoding=None if encoding is None else Encoding(encoding),
        near=settings[0].near if settings else None,
        accept=accept or (),
        layout=layout,
    )


def _chosen(everything: bool, sample: int | None, until: float | None, seed: int) -> Chosen:
    """Return which hogels are judged."""
    from xfrustum.reports.survey.survey import DEFAULT_SAMPLE, Chosen

    if sum((everything, sample is not None, until is not None)) > 1:
        raise click.UsageError("--all, --sample and --until exclude each other: give one of them")
    return Chosen(sample=None if everything else sample or DEFAULT_SAMPLE, until=until, seed=seed)
