"""`camera`: the cameras of a plate, for other renderers."""

from __future__ import annotations

import click

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, INDICES, option


class _Asked(options.Printed):
    scene = options.scene_argument
    renderer = option(
        click.Choice(["blender", "json", "gltf", "mitsuba"]),
        "Blender: the crossed frustum itself and a script that renders it; else C and C*.",
        "--for",
        required=True,
    )
    apertures = option(INDICES, "Column,row of each.  [default: as `report`; blender: all]")
    settings = options.settings_options()
    out = option(FOLDER, "Folder.", required=True)


@options.command("xfrustum camera asymmetric --for json --near 0.1 --out cameras")
def camera(asked: _Asked) -> None:
    """Write the cameras of a plate for another renderer.

    `json` has matrices, planes, depth functions and tests of every pass; `gltf` a node for each camera;
    `mitsuba` a sensor plugin for each as a dict. `blender` has DIR/render.py, which renders any apertures in
    Blender 4.5 or newer, exactly and in one pass each (docs/blender.md).
    """
    opened = options.open_scene(asked.scene)
    from xfrustum.reports.exchange.cameras import write_cameras

    indices = asked.apertures
    chosen = None if indices is None else [opened.plate.aperture(*index) for index in indices]
    written = write_cameras(opened, asked.renderer, asked.out, asked.settings, chosen)
    asked.tell(
        lambda: {"for": written.renderer, "files": written.files, "next": written.next_step},
        lambda: "\n".join((*map(str, written.files), written.next_step)),
    )
