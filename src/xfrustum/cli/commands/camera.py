"""`camera`: the cameras of a plate, for other renderers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xfrustum.cli import options

if TYPE_CHECKING:
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@click.command()
@options.scene_argument
@click.option(
    "--for",
    "renderer",
    required=True,
    type=click.Choice(["blender", "json", "gltf", "mitsuba"]),
    help="Blender: the crossed frustum itself and a script that renders it; else C and C*.",
)
@click.option(
    "--apertures",
    type=options.Indices(),
    help="Column,row of each.  [default: the middle; if recentered, also two corners; blender: all]",
)
@options.optional_double_frustum_options
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder.")
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

    from xfrustum.reports.exchange.camera_files import write_cameras

    chosen = None if apertures is None else [opened.plate.aperture(*index) for index in apertures]
    written = write_cameras(opened, renderer, out, settings, chosen)
    options.tell(
        as_json,
        lambda: {"for": written.renderer, "files": written.files, "next": written.next_step},
        lambda: "\n".join((*map(str, written.files), written.next_step)),
    )
