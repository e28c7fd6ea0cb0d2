"""`convert`: plates from one layout of files into another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.reports.exchange.convert import Conversion

_COUNTS = options.Read(
    "COLUMNS,ROWS", lambda text: options.RESOLUTION.read(text.replace("x", ",")), "COLUMNS,ROWS such as 8,6"
)


@options.command("xfrustum convert plate.zarr plate.png --to mosaic")
@click.argument("source", metavar="IN", type=options.FOLDER)
@click.argument("out", type=options.FOLDER)
@options.layout_option("--from", "Layout of IN.  [default: what it looks like]", "zarr")
@options.layout_option("--to", "Layout of OUT.  [default: zarr for NAME.zarr]", "zarr")
@option("--hogels", _COUNTS, "Columns and rows of hogels, which a mosaic does not state.")
@option("--tiles", _COUNTS, "Columns and rows of tiles of a quilt.  [default: by its views]")
@option(
    "--suffix",
    click.Choice([".png", ".ppm", ".exr", ".avi"]),
    "Format of pictures.  [default: .png; .exr for floats]",
)
@option("--array", click.Choice(["color", "triangle"]), "Array of a Zarr group.  [default: color]")
@options.quiet_and_json
def convert(*, source: Path, out: Path, quiet: bool, as_json: bool, to: str | None, **facts: Any) -> None:
    """Write a plate in another layout of files, or from and into Zarr.

    IN is a folder of pictures or videos, one picture, or a Zarr group; OUT the same. Pixels are moved and
    never computed; what a layout cannot hold is said.
    """
    from xfrustum.reports.exchange.convert import ConversionOptions
    from xfrustum.reports.exchange.convert import convert as converted

    read_as = facts.pop("from")
    done = converted(source, out, read_as, to, ConversionOptions(**facts), progress=not quiet)
    tell_losses(done)
    options.tell(as_json, lambda: done, lambda: _words(done))


def tell_losses(done: Conversion) -> None:
    """Print on standard error what files in a layout have lost, and what their readers may miss."""
    for line in (*(f"lost: {lost}" for lost in done.losses), *done.notes):
        options.note(line)


def _words(done: Conversion) -> str:
    (columns, rows), (width, height) = done.hogels, done.resolution
    return (
        f"read as {done.read_as}: {'; '.join(done.reasons)}\n"
        f"{columns} x {rows} hogels of {width} x {height} pixels in {done.files} files ({done.written_as})\n"
        f"{done.out}"
    )
