"""`survey`: hogels judged all over a plate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.reports.blocks import Engine
    from xfrustum.reports.survey.survey import Chosen
    from xfrustum.reports.verification.workers import ForeignRenderer
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


def _several(nears: tuple[float, ...] | None, **given: Any) -> tuple[DoubleFrustum, ...]:
    """Return the settings of one near or of several; none where no near is given."""
    if nears is not None and given["near"] is not None:
        raise click.UsageError("--near is one setting and --nears are several: give one of them")
    several = [given] if nears is None else [{**given, "near": near} for near in nears]
    return tuple(settings for one in several if (settings := options.settings_of(**one)) is not None)


_several_options = options.gathered(
    "settings",
    _several,
    option("--nears", options.NUMBERS, "Several offsets, each of which is a setting."),
    *options.settings_options(),
)


@options.command("xfrustum survey asymmetric --near 0.1 --sample 40 --resolution 64,64 --out survey")
@options.scene_argument
@_several_options
@click.option("--all", "everything", is_flag=True, help="Judge every hogel: facts, not bounds.")
@option("--sample", click.IntRange(1), "Hogels drawn at random.  [default: 300]")
@option("--until", options.SHARE, "Go on until at most this share, such as 1%, is beyond (95 %).")
@options.tolerance_option
@options.seed_option
@options.tracer_option
@option("--resolution", options.RESOLUTION, "Pixels of each hogel.  [default: the scene's]")
@click.option("--images", help="Judge another renderer's files instead, as verify does: 'DIR/{i}x{j}.png'.")
@options.encoding_option
@options.layout_option("--layout", "Layout of --images.  [default: what it looks like]")
@options.accept_option("Conventions of --images that are no faults; see verify.")
@options.engine_options("one per processor or GPU")
@options.out_option("Folder.", required=True)
@options.quiet_and_json
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
    engine: Engine | None,
    out: Path,
    quiet: bool,
    as_json: bool,
    **reading: Any,
) -> int:
    """Judge hogels all over a plate: which share is beyond a tolerance, where, and why.

    Writes survey.parquet, one row for each hogel and setting, survey.json, index.html, and inspect.html.
    Stopped at any moment and called again with the same --out, it goes on where it was; any number of
    processes may do one survey at once. Exit status 1 if the share is above --until; without it, if
    --tolerance-px was given, or --images, and any judged hogel is beyond.
    """
    opened = options.open_scene(scene)
    from xfrustum.reports.blocks import Engine
    from xfrustum.reports.survey.page import PAGE
    from xfrustum.reports.survey.survey import survey as surveyed

    if resolution is not None:
        opened = replace(opened, frustum=replace(opened.frustum, resolution=resolution))
    found = surveyed(
        opened,
        _asked(settings, images, **reading),
        out,
        _chosen(everything, sample, until, seed),
        tolerance_px=tolerance_px,
        tracer=tracer,
        engine=engine or Engine(),
        told=options.note,
        progress=not quiet,
    )
    options.warn_of(opened)
    # A part of a job array leaves no page.
    place = out / PAGE if found.extent.complete else out
    options.tell(as_json, found.summary, lambda: f"{found.table()}\n{place}")
    limited = until is not None or images is not None or options.is_given("tolerance_px")
    return options.LIMIT_EXCEEDED if limited and found.extent.complete and found.exceeded else 0


def _asked(
    settings: tuple[DoubleFrustum, ...],
    images: str | None,
    *,
    encoding: str | None,
    layout: str | None,
    accept: tuple[str, ...] | None,
) -> tuple[DoubleFrustum, ...] | ForeignRenderer:
    """Return what is judged: settings of our own rasterizer, or another renderer's plate."""
    from xfrustum.reports.verification.workers import ForeignRenderer
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
    return ForeignRenderer(
        source=images,
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
