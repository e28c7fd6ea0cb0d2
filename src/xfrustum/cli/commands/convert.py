"""`convert`: plates from one layout of files into another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, LAYOUT_OR_ZARR, RESOLUTION, option

if TYPE_CHECKING:
    from xfrustum.reports.exchange.convert import Conversion

_COUNTS = options.Read(
    "COLUMNS,ROWS", lambda text: RESOLUTION.read(text.replace("x", ",")), "COLUMNS,ROWS such as 8,6"
)


class _Asked(options.Measured):
    source: Path = options.argument(metavar="IN", type=FOLDER)
    out: Path = options.argument(type=FOLDER)
    read_as = option(LAYOUT_OR_ZARR, "Layout of IN.  [default: what it looks like]", "--from")
    write_as = option(LAYOUT_OR_ZARR, "Layout of OUT.  [default: zarr for NAME.zarr]", "--to")
    hogels = option(_COUNTS, "Columns and rows of hogels, which a mosaic does not state.")
    tiles = option(_COUNTS, "Columns and rows of tiles of a quilt.  [default: by its views]")
    suffix = option(
        click.Choice([".png", ".ppm", ".exr", ".avi"]),
        "Format of pictures.  [default: .png; .exr for floats]",
    )
    array = option(click.Choice(["color", "triangle"]), "Array of a Zarr group.  [default: color]")


@options.command("xfrustum convert plate.zarr plate.png --to mosaic")
def convert(asked: _Asked) -> None:
    """Write a plate in another layout of files, or from and into Zarr.

    IN is a folder of pictures or videos, one picture, or a Zarr group; OUT the same. Pixels are moved and
    never computed; what a layout cannot hold is said.
    """
    from xfrustum.reports.exchange import convert as converting

    facts = converting.ConversionOptions(
        hogels=asked.hogels, tiles=asked.tiles, suffix=asked.suffix, array=asked.array
    )
    done = converting.convert(
        asked.source, asked.out, asked.read_as, asked.write_as, facts, progress=asked.progress
    )
    tell_losses(done)
    (columns, rows), (width, height) = done.hogels, done.resolution
    asked.tell(
        lambda: done,
        lambda: (
            f"read as {done.read_as}: {'; '.join(done.reasons)}\n"
            f"{columns} x {rows} hogels of {width} x {height} pixels in {done.files} files "
            f"({done.written_as})\n{done.out}"
        ),
    )


def tell_losses(done: Conversion) -> None:
    """Print on standard error what files in a layout have lost, and what their readers may miss."""
    for line in (*(f"lost: {lost}" for lost in done.losses), *done.notes):
        options.note(line)
