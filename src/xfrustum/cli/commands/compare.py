"""`compare`: a raster image against the truth."""

from __future__ import annotations

from pathlib import Path

import click

from xfrustum.cli import options


@options.command("xfrustum compare truth.exr raster.exr --out compared")
@click.argument("truth", type=options.FOLDER)
@click.argument("raster", type=options.FOLDER)
@options.out_option("Folder for error pictures.")
@options.json_option
def compare(truth: Path, raster: Path, out: Path | None, as_json: bool) -> None:
    """Compare a raster image with the truth, both EXR."""
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.scenes.disk.input_files import regular_size

    if out is not None:
        check_writable_folder(out, ())
    for image in (truth, raster):
        regular_size(image, "image file")
    from xfrustum.reports.comparison import FILES, compare_files, table, write_comparison

    if out is not None:
        check_writable_folder(out, FILES)
    compared = compare_files(truth, raster)
    for note in filter(None, (compared.note, compared.unexamined)):
        options.note(note)
    if out is not None:
        write_comparison(compared, out)
    options.tell(as_json, compared.comparison.summary, lambda: table(compared.comparison))
