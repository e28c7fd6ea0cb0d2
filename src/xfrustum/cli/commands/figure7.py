"""`figure7`: C alone, C* alone and both, as in the paper's figure 7."""

from __future__ import annotations

from pathlib import Path

import click

from xfrustum.cli import options
from xfrustum.cli.options import option


@options.command("xfrustum figure7 car --out figure7")
@click.argument("scene", default="car-studio")
@options.aperture_option
@option("--other", options.INDEX, "Second perspective of C*.  [default: where it shows most]")
@option("--near", options.POSITIVE, "Offset of both cameras.  [default: 1e-6 of the reach]")
@options.out_option("Folder.  [default: figure7/NAME]")
def figure7(
    *,
    scene: str,
    aperture: tuple[int, int] | None,
    other: tuple[int, int] | None,
    near: float | None,
    out: Path | None,
) -> None:
    """Draw C alone, two perspectives of C*, and both cameras, as in the paper's figure 7; write a page.

    C* is shown as the camera sees it, looking back at the viewer, and as its picture is overlaid.
    """
    opened = options.open_scene(scene)
    chosen = options.chosen_aperture(opened, aperture)
    second = None if other is None else opened.plate.aperture(*other)
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.error_report.report import default_folder
    from xfrustum.reports.figure7 import FILES, default_settings, draw_figure, write_figure

    folder = Path("figure7") / default_folder(opened).name if out is None else out
    check_writable_folder(folder, FILES)
    options.look_at(opened, [chosen])
    write_figure(draw_figure(opened, chosen, default_settings(opened, near), second), folder)
    options.echo(str(folder / "index.html"))
