"""`compare`: a raster image against the truth."""

from __future__ import annotations

from pathlib import Path

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, option


class _Asked(options.Printed):
    truth: Path = options.argument(type=FOLDER)
    raster: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Folder for error pictures.")


@options.command("xfrustum compare truth.exr raster.exr --out compared")
def compare(asked: _Asked) -> None:
    """Compare a raster image with the truth, both EXR."""
    from xfrustum.scenes.disk.input_files import regular_size

    options.check_out(asked.out, ())
    for image in (asked.truth, asked.raster):
        regular_size(image, "image file")
    from xfrustum.reports import comparison

    options.check_out(asked.out, comparison.FILES)
    compared = comparison.compare_files(asked.truth, asked.raster)
    for note in filter(None, (compared.note, compared.unexamined)):
        options.note(note)
    if asked.out is not None:
        comparison.write_comparison(compared, asked.out)
    asked.tell(compared.comparison.summary, lambda: comparison.table(compared.comparison))
