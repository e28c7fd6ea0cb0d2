"""`plate`: whole plates, drawn into a store."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.commands.convert import layout_option, tell_losses
from xfrustum.cli.where import Where, engine_options
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.exchange.convert import Conversion
    from xfrustum.reports.exchange.drawn import LaidOutPlate
    from xfrustum.reports.plate.plate import PlateFiles
    from xfrustum.scenes.model.plate_content import PlateContent
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

Span = tuple[int, int] | None

_SPAN = re.compile(r"(\*)|(\d+)(?:-(\d+))?")


class Blocks(click.ParamType[tuple[tuple[Span, Span], ...]]):
    """Blocks of apertures as columns,rows separated by semicolons; each is N, N-M or *."""

    name = "I-I,J-J;.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[tuple[Span, Span], ...]:
        """Return the columns and rows of each block."""
        try:
            blocks = [[_span(part) for part in block.split(",")] for block in str(value).split(";")]
            return tuple((columns, rows) for columns, rows in blocks)
        except ValueError:
            self.fail(f"{value!r} is not a list of columns,rows such as 0-80,30;*,0-5", param, ctx)


def _span(text: str) -> Span:
    match = _SPAN.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    every, first, last = match.groups()
    if every:
        return None
    span = (int(first), int(last or first))
    if span[0] > span[1]:
        raise ValueError(text)
    return span


class Channels(click.ParamType[tuple[str, ...]]):
    """Names of a hogel's images, separated by commas."""

    name = "NAME,NAME,.."
    _names = ("color", "height", "triangle", "normal", "certainty")

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Return the names."""
        names = tuple(part.strip().lower() for part in str(value).split(","))
        for name in names:
            if name not in self._names:
                self.fail(f"{name!r} is not one of {', '.join(self._names)}", param, ctx)
        return names


class BlockSize(click.ParamType[tuple[int, int]]):
    """Columns and rows of hogels as COLUMNSxROWS."""

    name = "CxR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return columns and rows."""
        match = re.fullmatch(r"([1-9]\d{0,8})x([1-9]\d{0,8})", str(value).strip().lower())
        if match is None:
            self.fail(f"{value!r} is not columns x rows such as 8x8", param, ctx)
        return int(match[1]), int(match[2])


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


def _written(
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path,
    apertures: ApertureBlocks,
    content: PlateContent,
    where: Where,
    **asked: Any,
) -> PlateFiles:
    """Draw a plate in this process, or where the options say; print its notes on standard error."""
    if where.asked:
        from xfrustum.reports.plate.engine import write_plate_on

        if asked.pop("check"):
            raise click.UsageError("--check reads a plate in this process: leave out --workers and the like")
        engine, told = where.engine(), lambda line: say(f"note: {line}")
        files = write_plate_on(engine, scene, settings, out, apertures, content, told=told, **asked)
    else:
        from xfrustum.reports.plate.plate import write_plate

        files = write_plate(scene, settings, out, apertures, content, **asked)
    for note in files.notes:
        say(f"note: {note}")
    return files


def _laid_out(name: str, out: Path, blocks: object, part: tuple[int, int] | None) -> LaidOutPlate:
    """Return the places of a plate in a layout, which is written when all of it is there."""
    if blocks is not None or part is not None:
        raise click.UsageError(
            "--layout writes whole plates: leave out --apertures and --part, or draw these first, without it"
        )
    from xfrustum.reports.exchange.drawn import LaidOutPlate

    return LaidOutPlate(out=out, layout=name)


def _tell(files: PlateFiles, written: Conversion | None, *, as_json: bool) -> None:
    """Print what became of a plate on standard output."""
    laid_out = None
    if written is not None:
        tell_losses(written)
        laid_out = {"layout": written.written_as, "out": written.out, "files": written.files}
        laid_out |= {"losses": written.losses, "notes": written.notes}
    # A group that was drawn for the files alone is gone.
    group = files.out if files.out.exists() else None
    options.tell(
        as_json,
        lambda: {
            **{"out": group, "drawn": files.drawn, "found": files.found, "damaged": files.damaged},
            **{"table": files.table, "layout": laid_out},
        },
        lambda: "\n".join(
            [
                f"{files.drawn} hogels drawn, {files.found} found",
                *map(str, filter(None, (group, files.table))),
                *(
                    []
                    if written is None
                    else [f"{written.files} files ({written.written_as})", str(written.out)]
                ),
            ]
        ),
    )


@click.command()
@options.scene_argument
@click.option(
    "--apertures",
    "blocks",
    type=Blocks(),
    help="Columns,rows of rectangles, such as 0-80,30;*,0-5.  [default: all]",
)
@options.optional_double_frustum_options
@cli_light.light_options(*cli_light.ALL)
@click.option(
    "--color",
    type=click.Choice(["uint8", "float16", "float32"]),
    default="float16",
    show_default=True,
    help="Number type of the linear RGB.",
)
@click.option("--ids", is_flag=True, help="Store triangle numbers too: the channel triangle.")
@click.option(
    "--channels",
    type=Channels(),
    help="Images: color, height, triangle, normal; of truths certainty too.  [default: color]",
)
@click.option(
    "--block",
    type=BlockSize(),
    help="Columns x rows of hogels in one shard, such as 8x8.  [default: at most 16x16 and 64 MiB]",
)
@click.option(
    "--truth",
    is_flag=True,
    help="Store truths: traced and certified, with shadows and interreflection; instead of --near.",
)
@click.option(
    "--judge",
    is_flag=True,
    help="Trace every hogel too, and store how it differs: in arrays over (row, column), and as Parquet.",
)
@click.option("--check", is_flag=True, help="Read all finished hogels in full, and draw damaged ones again.")
@layout_option(
    "--layout",
    "Write the plate in a layout too, into NAME-LAYOUT; or, where --out is not NAME.zarr, only so.",
)
@engine_options("this process")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of a Zarr group.")
@options.quiet_option
@options.json_option
def plate(
    *,
    scene: str,
    blocks: tuple[tuple[Span, Span], ...] | None,
    settings: DoubleFrustum | None,
    light: Light,
    color: str,
    ids: bool,
    channels: tuple[str, ...] | None,
    block: tuple[int, int] | None,
    truth: bool,
    judge: bool,
    check: bool,
    layout: str | None,
    where: Where,
    out: Path,
    quiet: bool,
    as_json: bool,
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
    from xfrustum.reports.plate.plate import blocks_of_apertures
    from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent

    spans = [(None, None)] if blocks is None else blocks
    placed = None if layout is None else _laid_out(layout, out, blocks, where.part)
    chosen = blocks_of_apertures(opened.plate, spans)
    options.look_at(opened, chosen, black_is_right=True)
    content = PlateContent(
        color=ColorType(color),
        ids=ids,
        channels=tuple(map(Channel, channels or ())),
        effects=light.chosen(opened, settings=settings),
    )
    if placed is not None:
        placed.check(opened, content, judged=judge)
        out = placed.group
    asked = {"block": block, "judge": judge, "check": check, "progress": not quiet}
    files = _written(opened, settings, out, chosen, content, where, **asked)
    _tell(files, None if placed is None else placed.write(opened), as_json=as_json)
