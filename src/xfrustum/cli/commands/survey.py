"""`survey`: hogels judged all over a plate."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import (
    ACCEPTED,
    FOLDER,
    LAYOUT,
    NUMBERS,
    RESOLUTION,
    SHARE,
    TEXT,
    flag,
    group,
    option,
)

if TYPE_CHECKING:
    from xfrustum.reports.survey.survey import Chosen
    from xfrustum.reports.verification.sources import ForeignRenderer
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


def _several(nears: tuple[float, ...] | None, **given: Any) -> tuple[DoubleFrustum, ...]:
    """Return the settings of one near or of several; none where no near is given."""
    if nears is not None and given["near"] is not None:
        raise click.UsageError("--near is one setting and --nears are several: give one of them")
    several = [given] if nears is None else [{**given, "near": near} for near in nears]
    return tuple(settings for one in several if (settings := options.settings_of(**one)) is not None)


class _Asked(options.Measured):
    scene = options.scene_argument
    settings = group(
        _several,
        nears=option(NUMBERS, "Several offsets, each of which is a setting."),
        **options.settings_members(),
    )
    everything = flag("Judge every hogel: facts, not bounds.", "--all")
    sample = option(click.IntRange(1), "Hogels drawn at random.  [default: 300]")
    until = option(SHARE, "Go on until at most this share, such as 1%, is beyond (95 %).")
    tolerance_px = options.tolerance_option
    seed = options.seed_option
    tracer = options.tracer_option
    resolution = option(RESOLUTION, "Pixels of each hogel.  [default: the scene's]")
    images = option(TEXT, "Judge another renderer's files instead, as verify does: 'DIR/{i}x{j}.png'.")
    encoding = options.encoding_option
    layout = option(LAYOUT, "Layout of --images.  [default: what it looks like]")
    accept = option(ACCEPTED, "Conventions of --images that are no faults; see verify.")
    engine = options.engine_options("one per processor or GPU")
    out = option(FOLDER, "Folder.", required=True)

    def judged(self) -> tuple[DoubleFrustum, ...] | ForeignRenderer:
        """Return what is judged: settings of our own rasterizer, or another renderer's plate."""
        from xfrustum.reports.verification.sources import ForeignRenderer
        from xfrustum.scenes.files.foreign_images import Encoding

        if self.images is None:
            if any(one is not None for one in (self.encoding, self.layout, self.accept)):
                raise click.UsageError(
                    "--encoding, --layout and --accept say how --images are read: give --images too"
                )
            if not self.settings:
                raise click.UsageError("give --near or --nears, or the --images of another renderer")
            return self.settings
        if len(self.settings) > 1:
            raise click.UsageError("--images were drawn with one near offset: give --near, or none")
        return ForeignRenderer(
            source=self.images,
            encoding=None if self.encoding is None else Encoding(self.encoding),
            near=self.settings[0].near if self.settings else None,
            accept=self.accept or (),
            layout=self.layout,
        )

    def chosen(self) -> Chosen:
        """Return which hogels are judged."""
        from xfrustum.reports.survey.survey import DEFAULT_SAMPLE, Chosen

        if sum((self.everything, self.sample is not None, self.until is not None)) > 1:
            raise click.UsageError("--all, --sample and --until exclude each other: give one of them")
        sample = None if self.everything else self.sample or DEFAULT_SAMPLE
        return Chosen(sample=sample, until=self.until, seed=self.seed)


@options.command("xfrustum survey asymmetric --near 0.1 --sample 40 --resolution 64,64 --out survey")
def survey(asked: _Asked) -> int:
    """Judge hogels all over a plate: which share is beyond a tolerance, where, and why.

    Writes survey.parquet, one row for each hogel and setting, survey.json, index.html, and inspect.html.
    Stopped at any moment and called again with the same --out, it goes on where it was; any number of
    processes may do one survey at once. Exit status 1 if the share is above --until; without it, if
    --tolerance-px was given, or --images, and any judged hogel is beyond.
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.reports.survey.page import PAGE
    from xfrustum.reports.survey.survey import survey as surveyed

    if asked.resolution is not None:
        opened = replace(opened, frustum=replace(opened.frustum, resolution=asked.resolution))
    found = surveyed(
        opened,
        asked.judged(),
        asked.out,
        asked.chosen(),
        tolerance_px=asked.tolerance_px,
        tracer=asked.tracer,
        engine=asked.engine,
        told=options.note,
        progress=asked.progress,
    )
    options.warn_of(opened)
    # A part of a job array leaves no page.
    place = asked.out / PAGE if found.extent.complete else asked.out
    asked.tell(found.summary, lambda: f"{found.table()}\n{place}")
    limited = asked.until is not None or asked.images is not None or options.is_given("tolerance_px")
    return options.LIMIT_EXCEEDED if limited and found.extent.complete and found.exceeded else 0
