"""`plate`: whole plates, drawn into a store."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.convert import tell_losses
from xfrustum.cli.light import ALL, light_options
from xfrustum.cli.options import FOLDER, LAYOUT, TILES, flag, option

Span = tuple[int, int] | None
CHANNELS = ("color", "height", "triangle", "normal", "certainty")


def _span(text: str) -> Span:
    """Return the first and the last index of N, N-M; None for *."""
    match = re.fullmatch(r"(\*)|(\d+)(?:-(\d+))?", text.strip())
    if match is None:
        raise ValueError
    every, first, last = match.groups()
    if every:
        return None
    if int(last or first) < int(first):
        raise ValueError
    return int(first), int(last or first)


def _block(text: str) -> tuple[Span, Span]:
    columns, rows = text.split(",")
    return _span(columns), _span(rows)


_BLOCKS = options.list_of(
    options.Read("I-I,J-J", _block, ""), ";", wants="a list of columns,rows such as 0-80,30;*,0-5"
)


class _Asked(options.Measured):
    scene = options.scene_argument
    blocks = option(_BLOCKS, "Columns,rows, such as 0-80,30;*,0-5.  [default: all]", "--apertures")
    settings = options.settings_options()
    light = light_options(*ALL)
    color = option(
        click.Choice(["uint8", "float16", "float32"]), "Number type of the linear RGB.", default="float16"
    )
    ids = flag("Store triangle numbers too: the channel triangle.")
    channels = option(
        options.list_of(options.one_of(CHANNELS), name="NAME,NAME,.."),
        "Images; certainty is of truths alone.  [default: color]",
        default=(),
    )
    block = option(TILES, "Hogels in one shard.  [default: at most 16x16 and 64 MiB]")
    truth = flag("Store truths, traced and certified, instead of --near.")
    judge = flag("Trace every hogel too, and store how it differs (plate.parquet).")
    check = flag("Read all finished hogels in full, and draw damaged ones again.")
    layout = option(
        LAYOUT,
        "Write the plate in a layout too, into NAME-LAYOUT; or, where --out is not NAME.zarr, only so.",
    )
    engine = options.engine_options("this process")
    out = option(FOLDER, "Folder of a Zarr group.", required=True)

    def refuse_contradictions(self) -> None:
        """Refuse a plate that is neither drawn nor traced, or both, and light that only a truth has."""
        if self.truth and self.settings is not None:
            raise click.UsageError(
                "--truth is traced with the true frustum: leave out --near and its options"
            )
        if not self.truth and self.settings is None:
            raise click.UsageError("Missing option '--near'; give it, or --truth for a plate of truths")
        if not self.truth and (self.light.shadows or self.light.interreflection or self.light.samples):
            raise click.UsageError(
                "a rasterizer has no shadows and no interreflection: add --truth, or leave out light "
                "transport"
            )
        part = self.engine is not None and not self.engine.part.everything
        if self.layout is not None and (self.blocks is not None or part):
            raise click.UsageError(
                "--layout writes whole plates: leave out --apertures and --part, or draw these first, "
                "without it"
            )
        if self.check and self.engine is not None:
            raise click.UsageError("--check reads a plate in this process: leave out --workers and the like")


@options.command("xfrustum plate hard/only-behind --near 0.1 --out plate.zarr")
def plate(asked: _Asked) -> None:
    """Draw a plate, or blocks of it, into a Zarr group: hogels are chunks, blocks of them shards.

    What is there already is kept: stopped at any moment and called again, it goes on where it was. Several
    processes may draw one plate at once, and --workers, --scheduler or --part divide it.
    Any reader of Zarr opens it, xarray with names and units.
    With --aperture-samples, a number or auto, each hogel is the mean over points of its area (band limiting).
    """
    asked.refuse_contradictions()
    light = asked.light
    opened = light.applied(options.open_scene(asked.scene))
    if asked.truth and opened.transport.simulated and not light.tracer(opened, None)[1]:
        opened = replace(opened, transport=replace(opened.transport, shadows=False, interreflection=False))
    from xfrustum.reports.blocks import HERE
    from xfrustum.reports.exchange.convert import LaidOutPlate
    from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
    from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent

    placed = None if asked.layout is None else LaidOutPlate(out=asked.out, layout=asked.layout)
    chosen = blocks_of_apertures(opened.plate, asked.blocks or [(None, None)])
    options.look_at(opened, chosen, black_is_right=True)
    content = PlateContent(
        color=ColorType(asked.color),
        ids=asked.ids,
        channels=tuple(map(Channel, asked.channels)),
        effects=light.chosen(opened, settings=asked.settings),
    )
    if placed is not None:
        placed.check(opened, content, judged=asked.judge)
    files = write_plate(
        opened,
        asked.settings,
        asked.out if placed is None else placed.group,
        chosen,
        content,
        block=asked.block,
        judge=asked.judge,
        check=asked.check,
        engine=asked.engine or HERE,
        progress=asked.progress,
    )
    for note in files.notes:
        options.note(note)
    written = None if placed is None else placed.write(opened)
    # A group that was drawn for the files of a layout alone is gone.
    summary: dict[str, Any] = {"out": files.out if files.out.exists() else None}
    summary |= {"drawn": files.drawn, "found": files.found, "damaged": files.damaged, "table": files.table}
    lines = [f"{files.drawn} hogels drawn, {files.found} found"]
    lines += [str(place) for place in (summary["out"], files.table) if place is not None]
    laid_out = None
    if written is not None:
        tell_losses(written)
        lines += [f"{written.files} files ({written.written_as})", str(written.out)]
        laid_out = {"layout": written.written_as, "out": written.out, "files": written.files}
        laid_out |= {"losses": written.losses, "notes": written.notes}
    asked.tell(lambda: {**summary, "layout": laid_out}, lambda: "\n".join(lines))
