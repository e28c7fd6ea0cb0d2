"""`new`: a scene file that fits a mesh."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from xfrustum.cli import options
from xfrustum.cli.options import option
from xfrustum.terminal import say


@options.command("xfrustum new beetle.obj --size 100 --units mm")
@click.argument("mesh", type=options.FOLDER)
@options.out_option("Scene file.  [default: NAME.toml in this folder]")
@click.option("--units", help="Name of the length unit.  [default: m for glTF, else units]")
@option("--size", options.POSITIVE, "Length to which the mesh's longest side is scaled.  [default: unscaled]")
@click.option(
    "--through",
    "place",
    flag_value="through",
    help="Place the mesh across the plate.  [default, unless it is flat]",
)
@click.option("--behind", "place", flag_value="behind", help="Place all of the mesh behind the plate.")
@click.option("--before", "place", flag_value="before", help="Place all of the mesh on the viewer's side.")
@click.option("--force", is_flag=True, help="Replace a scene file that exists.")
@options.json_option
def new(*, mesh: Path, out: Path | None, as_json: bool, **asked: Any) -> None:
    """Write a scene file whose plate, reach and field of view fit MESH."""
    from xfrustum.scenes.disk.input_files import check_mesh_file

    check_mesh_file(mesh)
    from xfrustum.reports.scene_check.new_scene import new_scene

    written = new_scene(mesh, out, **asked)
    if written.warning is not None:
        say(f"warning: {written.warning}")
    options.tell(as_json, lambda: {**asdict(written), "path": str(written.path)}, lambda: written.sentence)
