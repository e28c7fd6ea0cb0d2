"""`figure7`: C alone, C* alone and both, as in the paper's figure 7."""

from __future__ import annotations

from pathlib import Path

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, INDEX, POSITIVE, option


class _Asked(options.Asked):
    scene: str = options.argument(default="car-studio")
    aperture = options.aperture_option
    other = option(INDEX, "Second perspective of C*.  [default: where it shows most]")
    near = option(POSITIVE, "Offset of both cameras.  [default: 1e-6 of the reach]")
    out = option(FOLDER, "Folder.  [default: figure7/NAME]")


@options.command("xfrustum figure7 car --out figure7")
def figure7(asked: _Asked) -> None:
    """Draw C alone, two perspectives of C*, and both cameras, as in the paper's figure 7; write a page.

    C* is shown as the camera sees it, looking back at the viewer, and as its picture is overlaid.
    """
    opened = options.open_scene(asked.scene)
    chosen = options.chosen_aperture(opened, asked.aperture)
    second = None if asked.other is None else opened.plate.aperture(*asked.other)
    from xfrustum.reports import figure7 as figures
    from xfrustum.reports.error_report.report import default_folder

    folder = asked.out or Path("figure7") / default_folder(opened).name
    options.check_out(folder, figures.FILES)
    options.look_at(opened, [chosen])
    settings = figures.default_settings(opened, asked.near)
    figures.write_figure(figures.draw_figure(opened, chosen, settings, second), folder)
    options.echo(str(folder / "index.html"))
