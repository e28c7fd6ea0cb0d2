"""`plate`: whole plates, drawn into a store."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.commands.convert import tell_losses
from xfrustum.cli.light import ALL, light_options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.blocks import Engine
    from xfrustum.reports.exchange.convert import Conversion
    from xfrustum.reports.plate.plate import PlateFiles
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

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


@options.command("xfrustum plate hard/only-behind --near 0.1 --out plate.zarr")
@options.scene_argument
@option("--apertures", "blocks", _BLOCKS, "Columns,rows, such as 0-80,30;*,0-5.  [default: all]")
@options.optional_double_frustum_options
@light_options(*ALL)
@option(
    "--color",
    click.Choice(["uint8", "float16", "float32"]),
    "Number type of the linear RGB.",
    default="float16",
)
@click.option("--ids", is_flag=True, help="Store triangle numbers too: the channel triangle.")
@option(
    "--channels",
    options.list_of(options.one_of(CHANNELS), name="NAME,NAME,.."),
    "Images; certainty is of truths alone.  [default: color]",
    default=(),
)
@option("--block", options.TILES, "Hogels in one shard.  [default: at most 16x16 and 64 MiB]")
@click.option("--truth", is_flag=True, help="Store truths, traced and certified, instead of --near.")
@click.option(
    "--judge", is_flag=True, help="Trace every hogel too, and store how it differs (plate.parquet)."
)
@click.option("--check", is_flag=True, help="Read all finished hogels in full, and draw damaged ones again.")
@options.layout_option(
    "--layout",
    "Write the plate in a layout too, into NAME-LAYOUT; or, where --out is not NAME.zarr, only so.",
)
@options.engine_options("this process")
@options.out_option("Folder of a Zarr group.", required=True)
@options.quiet_and_json
def plate(
    *,
    scene: str,
    blocks: tuple[tuple[Span, Span], ...] | None,
    settings: DoubleFrustum | None,
    light: Light,
    color: str,
    ids: bool,
    channels: tuple[str, ...],
    truth: bool,
    judge: bool,
    layout: str | None,
    engine: Engine | None,
    out: Path,
    quiet: bool,
    as_json: bool,
    **asked: Any,
) -> None:
    """Draw a plate, or blocks of it, into a Zarr group: hogels are chunks, blocks of them shards.

    What is there already is kept: stopped at any moment and called again, it goes on where it was. Several
    processes may draw one plate at once, and --workers, --scheduler or --part divide it.
    Any reader of Zarr opens it, xarray with names and units.
    With --aperture-samples, a number or auto, each hogel is the mean over points of its area (band limiting).
    """
    _check_question(settings, light, truth)
    opened = light.applied(options.open_scene(scene))
    if truth and opened.transport.simulated and not light.tracer(opened, None)[1]:
        opened = replace(opened, transport=replace(opened.transport, shadows=False, interreflection=False))
    from xfrustum.reports.exchange.convert import LaidOutPlate
    from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
    from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent

    if layout is not None and (blocks is not None or not (engine is None or engine.part.everything)):
        raise click.UsageError(
            "--layout writes whole plates: leave out --apertures and --part, or draw these first, without it"
        )
    placed = None if layout is None else LaidOutPlate(out=out, layout=layout)
    chosen = blocks_of_apertures(opened.plate, [(None, None)] if blocks is None else blocks)
    options.look_at(opened, chosen, black_is_right=True)
    content = PlateContent(
        color=ColorType(color),
        ids=ids,
        channels=tuple(map(Channel, channels)),
        effects=light.chosen(opened, settings=settings),
    )
    if placed is not None:
        placed.check(opened, content, judged=judge)
        out = placed.group
    asked |= {"judge": judge, "progress": not quiet}
    if engine is not None:
        if asked["check"]:
            raise click.UsageError("--check reads a plate in this process: leave out --workers and the like")
        asked["engine"] = engine
    files = write_plate(opened, settings, out, chosen, content, **asked)
    for note in files.notes:
        options.note(note)
    _tell(files, None if placed is None else placed.write(opened), as_json=as_json)


def _check_question(settings: DoubleFrustum | None, light: Light, truth: bool) -> None:
    """Refuse a plate that is neither drawn nor traced, or both, and light that only a truth has."""
    if truth and settings is not None:
        raise click.UsageError("--truth is traced with the true frustum: leave out --near and its options")
    if not truth and settings is None:
        raise click.UsageError("Missing option '--near'; give it, or --truth for a plate of truths")
    if not truth and (light.shadows or light.interreflection or light.samples):
        raise click.UsageError(
            "a rasterizer has no shadows and no interreflection: add --truth, or leave out light transport"
        )


def _tell(files: PlateFiles, written: Conversion | None, *, as_json: bool) -> None:
    """Print what became of a plate on standard output."""
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
    options.tell(as_json, lambda: {**summary, "layout": laid_out}, lambda: "\n".join(lines))
