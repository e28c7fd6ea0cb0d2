"""`plate`: whole plates, drawn into a store."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.streams import say

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
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


@click.command()
@options.scene_argument
@click.option(
    "--apertures",
    "blocks",
    type=Blocks(),
    help="Columns,rows of blocks, such as 0-80,30;*,0-5.  [default: all]",
)
@options.double_frustum_options
@cli_light.light_options(*cli_light.RASTER)
@click.option(
    "--color",
    type=click.Choice(["uint8", "float16", "float32"]),
    default="float16",
    show_default=True,
    help="Number type of the linear RGB.",
)
@click.option("--ids", is_flag=True, help="Store triangle numbers too.")
@click.option("--check", is_flag=True, help="Read all finished hogels in full, and draw damaged ones again.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of a Zarr group.")
@options.quiet_option
@options.json_option
def plate(
    *,
    scene: str,
    blocks: tuple[tuple[Span, Span], ...] | None,
    settings: DoubleFrustum,
    light: Light,
    color: str,
    ids: bool,
    check: bool,
    out: Path,
    quiet: bool,
    as_json: bool,
) -> None:
    """Draw a plate, or blocks of it, into a Zarr group with one chunk for each hogel.

    What is there already is kept: stopped at any moment and called again, it goes on where it was. Several
    processes may draw one plate at once.
    Plates are drawn with one sample a pixel: a scene that asks for more needs them set to 1. With
    --aperture-samples, a number or auto, each hogel is the mean over points of its area (band limiting).
    """
    opened = light.applied(options.open_scene(scene))
    from xfrustum.reports.plate.plate import blocks_of_apertures, write_plate
    from xfrustum.scenes.model.plate_content import ColorType, PlateContent

    spans = [(None, None)] if blocks is None else blocks
    chosen = blocks_of_apertures(opened.plate, spans)
    options.look_at(opened, chosen, black_is_right=True)
    content = PlateContent(color=ColorType(color), ids=ids, effects=light.chosen(opened, settings=settings))
    files = write_plate(opened, settings, out, chosen, content, check=check, progress=not quiet)
    for note in files.notes:
        say(f"note: {note}")
    options.tell(
        as_json,
        lambda: {"out": files.out, "drawn": files.drawn, "found": files.found, "damaged": files.damaged},
        lambda: f"{files.drawn} hogels drawn, {files.found} found\n{files.out}",
    )
