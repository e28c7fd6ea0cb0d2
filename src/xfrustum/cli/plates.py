"""`plate`, `survey`: draw whole plates into a store, and judge hogels all over a plate."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property, partial
from operator import truediv
from typing import TYPE_CHECKING, Any

import click

from xfrustum import process
from xfrustum.cli import options
from xfrustum.cli.light import ALL, light_options
from xfrustum.cli.options import choice, flag, group, option
from xfrustum.cli.verifying import tell_losses

CHANNELS = ("color", "height", "triangle", "normal", "certainty")


class _Plate(options.Measured):
    scene = options.scene_argument
    blocks = option(
        options.BLOCKS,
        "Hogels to draw: columns,rows, such as 0-80,30;*,0-5.  [default: all]",
        "--apertures",
    )
    by = choice(
        "auto directions hogels",
        "Draw one pixel of all hogels at once, without near, or one hogel at a time.",
        default="auto",
    )
    memory = option(
        options.MEMORY, "Memory for tiles of hogels by directions, per process.", default="1G"
    )
    named = options.group(options.present, **options.settings_members())
    light = light_options(*ALL)
    color = choice("uint8 float16 float32", "Number type of the linear RGB.", default="float16")
    ids = flag("Store triangle numbers too: the channel triangle.")
    channels = option(
        options.list_of(options.one_of(CHANNELS), name="NAME,NAME,.."),
        "Channels to store; certainty only with --truth.  [default: color]",
        default=(),
    )
    block = option(
        options.TILES,
        "Hogels in one shard file.  [default: at most 16x16 and 64 MiB; by directions 512x64]",
    )
    truth = flag("Trace and store certified truths; excludes --near.")
    judge = flag("Trace every hogel too, and store the measures of `compare`.")
    check = flag("Read all finished hogels in full, and draw damaged ones again.")
    layout = option(
        options.LAYOUT,
        "Also write pictures in this layout to NAME-LAYOUT; alone if --out is not NAME.zarr.",
    )
    ignore_disk_space = flag("Start even if the disk may be too small; hogels are compressed.")
    engine = options.engine_options("this process")
    out = option(options.FOLDER, "Folder of the Zarr group.", required=True)

    @cached_property
    def settings(self) -> DoubleFrustum | None:
        """Settings of the two cameras; None for truths and plates by directions."""
        # Plates by directions have a depth buffer, but no other setting of the cameras.
        directions = self.by != "hogels" and not self.truth
        others = [name for name in self.named if name != "depth" or not directions]
        if self.by == "directions" and others:
            lacking = (
                "a rasterizer, and --truth" if self.truth else "two cameras, and --by directions"
            )
            raise click.UsageError(
                f"--{others[0]} is a setting of {lacking} has none: leave it out"
            )
        return options.settings_of(**self.named) if others else None

    def refuse_contradictions(self) -> None:
        """Refuse a plate with no or two renderers, and light effects that a rasterizer lacks."""
        problem, light = "", self.light
        if self.truth and self.settings is not None:
            problem = "--truth is traced with the true frustum: leave out --near and its options"
        elif not self.truth and self.settings is None and self.needs_near:
            problem = "Missing option '--near'; give it, or --truth for a plate of truths"
        # Without an error, the stored plate would look complete, but lack this light.
        elif not self.truth and (light.shadows or light.interreflection or light.samples):
            problem = "a rasterizer has no shadows and no interreflection: add --truth"
        elif self.layout and (self.blocks or (self.engine and not self.engine.part.everything)):
            problem = "--layout writes whole plates: leave out --apertures and --part"
        # Workers write at the same time, and a check needs a consistent store.
        elif self.check and self.engine is not None:
            problem = "--check reads a plate in this process: leave out --workers and the like"
        if problem:
            raise click.UsageError(problem)

    @property
    def needs_near(self) -> bool:
        """True if options require drawing hogel by hogel."""
        return self.by == "hogels" or (self.by == "auto" and bool(self.blocks or self.judge))


def _begun(words: str) -> None:
    """Print the size of a plate once drawing starts, after all refusals."""
    process.advice = process.CONTINUES
    options.note(words)


@options.command("xfrustum plate hard/only-behind --near 0.1 --out plate.zarr")
def plate(request: _Plate) -> None:
    """Draw all or some hogels of a plate into a Zarr group, hogel by hogel or by directions.

    By directions, each image has one pixel of all hogels: a parallel view without near, faster for
    many hogels of few pixels. A stopped run continues when the command is repeated. Several
    processes may draw one plate at once; --workers, --scheduler or --part divide it. Any Zarr
    reader opens the group; xarray shows names and units. With --aperture-samples each hogel is the
    mean over points of its area (band limiting).
    """
    started = time.monotonic()
    request.refuse_contradictions()
    light = request.light
    opened = light.applied(options.open_scene(request.scene))
    # If --effects excludes light paths, switch off the light transport of the scene.
    if request.truth and opened.transport.simulated and not light.tracer(opened, None)[1]:
        opened = replace(
            opened, transport=replace(opened.transport, shadows=False, interreflection=False)
        )
    from xfrustum.reports.blocks import HERE
    from xfrustum.reports.exchange.convert import LaidOutPlate
    from xfrustum.reports.plate.directions import DEPTH, By, Request, choose, write_directions
    from xfrustum.reports.plate.plate import (
        PlateOptions,
        arrays_of,
        blocks_of_apertures,
        write_plate,
    )
    from xfrustum.reports.plate.store import plate_size
    from xfrustum.scenes.model.images import Channel, ColorType, PlateContent

    placed = (
        None if request.layout is None else LaidOutPlate(out=request.out, layout=request.layout)
    )
    chosen = blocks_of_apertures(opened.plate, request.blocks or [(None, None)])
    options.look_at(opened, chosen, black_is_right=True)
    if request.settings is not None:
        options.warn_of_culling(opened, request.settings.cull)
    content = PlateContent(
        color=ColorType(request.color),
        ids=request.ids,
        channels=tuple(map(Channel, request.channels)),
        effects=light.chosen(opened, drawn=request.settings),
    )
    if placed is not None:
        # A layout that cannot store these channels fails before anything is drawn.
        placed.check(opened, content, judged=request.judge)
    how = PlateOptions(
        content=content,
        block=request.block,
        judge=request.judge,
        check=request.check,
        engine=request.engine or HERE,
        progress=request.progress,
    )
    group = request.out if placed is None else placed.group
    by, reason = choose(
        opened,
        Request(
            by=By(request.by),
            out=group,
            options=how,
            truth=request.truth,
            near=request.settings is not None,
            some=bool(request.blocks),
            memory=request.memory,
        ),
    )
    if reason:
        options.note(reason)
    arrays = arrays_of(opened, content, None, judged=request.judge)
    size = plate_size(group, arrays, chosen, files=placed is not None)
    # The estimate is an upper bound: compressed hogels usually need less.
    if not request.ignore_disk_space:
        size.require_room()

    begun = partial(_begun, size.words)
    if by is By.DIRECTIONS:
        depth = None if request.truth else request.named.get("depth", DEPTH)
        files = write_directions(opened, depth, group, how, request.memory, begun)
    else:
        files = write_plate(opened, request.settings, group, chosen, how, begun)
    for line in files.notes:
        options.note(line)
    written = None if placed is None else placed.write(opened)
    summary: dict[str, Any] = {
        # A group that was drawn only for the files of a layout is deleted.
        "out": files.out if files.out.exists() else None,
        "drawn": files.drawn,
        "found": files.present,
        "damaged": files.damaged,
        "bytes_at_most": size.needed,
        "by": by,
        "passes": files.passes,
        "tiles": files.tiles,
        "wall_s": time.monotonic() - started,
        "layout": None,
    }
    unit = "views" if by is By.DIRECTIONS else "hogels"
    lines = [f"{files.passes:,} {unit} drawn, {files.kept:,} kept from an earlier run"]
    lines += [str(files.out)] if summary["out"] else []
    if written is not None:
        tell_losses(written)
        lines += [f"{written.files} files ({written.written_as})", str(written.out)]
        names = ("out", "files", "losses", "notes")
        summary["layout"] = {
            "layout": written.written_as,
            **{name: getattr(written, name) for name in names},
        }
    request.tell(lambda: summary, lambda: "\n".join(lines))


if TYPE_CHECKING:
    from xfrustum.compare.sampling import SampleRequest
    from xfrustum.scenes.plate import DoubleFrustum


def _settings(nears: tuple[float, ...] | None, **values: Any) -> tuple[DoubleFrustum, ...]:
    """Return the settings of one near or of several nears; empty without a near."""
    # Each value of --nears is a setting; an additional --near would be ambiguous.
    if nears is not None and values["near"] is not None:
        raise click.UsageError("--near is one setting and --nears are several: give one of them")
    several = [values] if nears is None else [{**values, "near": near} for near in nears]
    return tuple(
        settings for choice in several if (settings := options.settings_of(**choice)) is not None
    )


class _Survey(options.Measured):
    scene = options.scene_argument
    settings = group(
        _settings,
        nears=option(options.NUMBERS, "Several near offsets, each judged as a setting of its own."),
        **options.settings_members(),
    )
    everything = flag("Judge every hogel: exact shares instead of bounds.", "--all")
    sample = option(options.COUNT_FROM_1, "Number of random hogels to judge.  [default: 300]")
    until = option(
        options.SHARE,
        "Judge random hogels until at most this share, such as 1%, is beyond (95 % confidence).",
    )
    tolerance_px = options.tolerance_option
    seed = options.seed_option
    tracer = options.tracer_option
    truth_by = options.truth_option
    resolution = option(
        options.RESOLUTION,
        "Pixels of a hogel; the unit of the tolerance.  [default: the scene's]",
    )
    images: str | None = option(options.TEXT, "Replaced by verify.", default=None, hidden=True)
    engine = options.engine_options("one per processor or GPU")
    out = option(options.FOLDER, "Folder for the rows and the page.", required=True)


def sample_request(
    *, everything: bool, sample: int | None, until: float | None, seed: int
) -> SampleRequest:
    """Return the request of --all, --sample N or --until Q%."""
    from xfrustum.compare.sampling import DEFAULT_SAMPLE, SampleRequest

    # Click has no mutually exclusive options.
    if sum((everything, sample is not None, until is not None)) > 1:
        raise click.UsageError("--all, --sample and --until exclude each other: give one of them")
    # With --until the default is the size of the first sample.
    hogels = None if everything else sample or DEFAULT_SAMPLE
    return SampleRequest(sample=hogels, until=until, seed=seed)


@options.command(
    "xfrustum survey asymmetric --near 0.1 --sample 40 --resolution 64,64 --out survey"
)
def survey(request: _Survey) -> int:
    """Judge hogels all over a plate: the share beyond a tolerance, with places and causes.

    Write survey.parquet (one row for each hogel and setting), survey.json, index.html and
    inspect.html. A stopped run continues when the command is repeated with the same --out; several
    processes may do one survey at once. A hogel is beyond if more than 1 % of its points are
    displaced by more than the tolerance, or more than 1 % of its pixels show a wrong surface. Exit
    status 1 if the share is above --until; without --until, if --tolerance-px is given and a judged
    hogel is beyond.
    """
    if request.images is not None:
        raise click.UsageError(
            "survey --images is replaced by `xfrustum verify SCENE SOURCE --sample N`, or by "
            "--until Q%"
        )
    opened = options.open_scene(request.scene)
    from xfrustum.reports.survey import PAGE
    from xfrustum.reports.survey import survey as surveyed

    if not request.settings:
        raise click.UsageError("give --near or --nears")
    if request.resolution is not None and request.resolution != (own := opened.frustum.resolution):
        coarser = max(map(truediv, own, request.resolution))
        options.note(
            f"hogels have {request.resolution} in place of the scene's {own} pixels: "
            f"{request.tolerance_px:g} px are {request.tolerance_px * coarser:.3g} of the scene's"
        )
        opened = replace(opened, frustum=replace(opened.frustum, resolution=request.resolution))
    process.advice = process.CONTINUES
    names = ("everything", "sample", "until", "seed")
    sampling = sample_request(**{name: getattr(request, name) for name in names})
    answer = surveyed(
        opened,
        request.settings,
        request.out,
        sampling,
        tolerance_px=request.tolerance_px,
        tracer=request.tracer,
        truth_by=request.truth_by,
        note=options.note,
        progress=request.progress,
        engine=request.engine,
    )
    options.warn_of(opened)
    # A part of a job array writes no page.
    place = request.out / PAGE if answer.extent.complete else request.out
    request.tell(answer.summary, lambda: f"{answer.table()}\n{place}")
    # The command fails only if a limit set by the user is exceeded, never by the default tolerance.
    limited = request.until is not None or options.is_given("tolerance_px")
    return options.LIMIT_EXCEEDED if limited and answer.extent.complete and answer.exceeded else 0
