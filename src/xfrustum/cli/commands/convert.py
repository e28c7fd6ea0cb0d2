"""`convert`: plates from one layout of files into another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.reports.exchange.convert import Conversion


class LayoutName(click.ParamType[str]):
    """Name of a layout of files."""

    name = "LAYOUT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name in lower case."""
        from xfrustum.scenes.files.layouts.catalogue import NAMES

        given = str(value).lower()
        if given not in NAMES:
            self.fail(f"{value!r} is not one of {', '.join(NAMES)}", param, ctx)
        return given


def layout_option(name: str, words: str) -> Callable[[options.Command], options.Command]:
    """Return the option that names a layout of files."""
    return click.option(name, type=LayoutName(), help=words)


class LayoutOrZarr(LayoutName):
    """Name of a layout of files, or `zarr`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name in lower case."""
        given = str(value).lower()
        return given if given == "zarr" else super().convert(value, param, ctx)


class Counts(click.ParamType[tuple[int, int]]):
    """Two positive numbers, columns before rows."""

    name = "COLUMNS,ROWS"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return the two numbers."""
        try:
            columns, rows = (int(part) for part in str(value).replace("x", ",").split(","))
        except ValueError:
            columns = rows = 0
        if min(columns, rows) < 1:
            self.fail(f"{value!r} is not COLUMNS,ROWS such as 8,6", param, ctx)
        return columns, rows


@click.command()
@click.argument("source", metavar="IN", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--from", "read_as", type=LayoutOrZarr(), help="Layout of IN.  [default: what it looks like]")
@click.option("--to", "write_as", type=LayoutOrZarr(), help="Layout of OUT.  [default: zarr for NAME.zarr]")
@click.option("--hogels", type=Counts(), help="Columns and rows of hogels, which a mosaic does not state.")
@click.option("--tiles", type=Counts(), help="Columns and rows of tiles of a quilt.  [default: by its views]")
@click.option(
    "--suffix",
    type=click.Choice([".png", ".ppm", ".exr", ".avi"]),
    help="Format of pictures; .avi for rows of hogels (burnett).  [default: .png; .exr for floating point]",
)
@click.option(
    "--array",
    type=click.Choice(["color", "triangle"]),
    help="Array of a Zarr group; numbers become pixels as in --encoding triangle-id.  [default: color]",
)
@options.quiet_option
@options.json_option
def convert(
    *,
    source: Path,
    out: Path,
    read_as: str | None,
    write_as: str | None,
    quiet: bool,
    as_json: bool,
    **facts: Any,
) -> None:
    """Write a plate in another layout of files, or from and into Zarr.

    IN is a folder of pictures or videos, one picture, or a Zarr group; OUT the same. Pixels are moved and
    never computed; what a layout cannot hold is said.
    """
    from xfrustum.reports.exchange.convert import ConversionOptions
    from xfrustum.reports.exchange.convert import convert as converted

    told = ConversionOptions(**facts)
    done = converted(source, out, read_as, write_as, told, progress=not quiet)
    tell_losses(done)
    options.tell(as_json, lambda: asdict(done), lambda: _words(done))


def tell_losses(done: Conversion) -> None:
    """Print on standard error what files in a layout have lost, and what their readers may miss."""
    for lost in done.losses:
        say(f"note: lost: {lost}")
    for note in done.notes:
        say(f"note: {note}")


def _words(done: Conversion) -> str:
    (columns, rows), (width, height) = done.hogels, done.resolution
    return (
        f"read as {done.read_as}: {'; '.join(done.reasons)}\n"
        f"{columns} x {rows} hogels of {width} x {height} pixels in {done.files} files ({done.written_as})\n"
        f"{done.out}"
    )
