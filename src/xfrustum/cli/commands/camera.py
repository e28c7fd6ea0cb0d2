"""`camera`: the cameras of a plate, for other renderers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@options.command("xfrustum camera asymmetric --for json --near 0.1 --out cameras")
@options.scene_argument
@option(
    "--for",
    "renderer",
    click.Choice(["blender", "json", "gltf", "mitsuba"]),
    "Blender: the crossed frustum itself and a script that renders it; else C and C*.",
    required=True,
)
@option("--apertures", options.INDICES, "Column,row of each.  [default: as `report`; blender: all]")
@options.optional_double_frustum_options
@options.out_option("Folder.", required=True)
@options.json_option
def camera(
    *,
    scene: str,
    renderer: str,
    apertures: tuple[tuple[int, int], ...] | None,
    settings: DoubleFrustum | None,
    out: Path,
    as_json: bool,
) -> None:
    """Write the cameras of a plate for another renderer.

    `json` has matrices, planes, depth functions and tests of every pass; `gltf` a node for each camera;
    `mitsuba` a sensor plugin for each as a dict. `blender` has DIR/render.py, which renders any apertures in
    Blender 4.5 or newer, exactly and in one pass each (docs/blender.md).
    """
    opened = options.open_scene(scene)
    from xfrustum.reports.exchange.cameras import write_cameras

    chosen = None if apertures is None else [opened.plate.aperture(*index) for index in apertures]
    written = write_cameras(opened, renderer, out, settings, chosen)
    options.tell(
        as_json,
        lambda: {"for": written.renderer, "files": written.files, "next": written.next_step},
        lambda: "\n".join((*map(str, written.files), written.next_step)),
    )
