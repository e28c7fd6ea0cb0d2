"""Commands about scene files: `new` writes one that fits a mesh, `check` looks for mistakes in one."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from xfrustum.cli import options
from xfrustum.cli.commands.checks import LIMIT_EXCEEDED
from xfrustum.cli.numbers import Positive


@click.command()
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), help="Scene file.  [default: NAME.toml in this folder]"
)
@click.option("--units", help="Name of the length unit.  [default: m for glTF, else units]")
@click.option(
    "--size", type=Positive(), help="Length to which the mesh's longest side is scaled.  [default: unscaled]"
)
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
def new(
    *,
    mesh: Path,
    out: Path | None,
    units: str | None,
    size: float | None,
    place: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Write a scene file whose plate, reach and field of view fit MESH."""
    from xfrustum.scenes.disk.input_files import check_mesh_file

    check_mesh_file(mesh)
    from xfrustum.reports.scene_check.new_scene import new_scene

    written = new_scene(mesh, out, units=units, size=size, place=place, force=force)
    if written.warning is not None:
        options.warn(written.warning)
    options.tell(as_json, lambda: {**asdict(written), "path": str(written.path)}, lambda: written.sentence)


@click.command()
@options.scene_argument
@click.option("--out", type=click.Path(path_type=Path), help="Folder for side.svg and top.svg.")
@options.json_option
def check(scene: str, out: Path | None, as_json: bool) -> int:
    """Say where each object lies, which apertures see it, and what looks like a mistake.

    Exit status 1 if no aperture of the plate sees anything.
    """
    from xfrustum.scenes import open_scene

    opened = open_scene(scene)
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.scene_check.checking import FILES, table, write_check
    from xfrustum.reports.scene_check.checking import check as checked

    if out is not None:
        check_writable_folder(out, FILES)
    found = checked(opened)
    files = () if out is None else write_check(found, out)
    for warning in found.warnings:
        options.warn(warning)
    options.tell(
        as_json,
        lambda: {**found.summary(), "files": [str(file) for file in files]},
        lambda: "\n".join([table(found), *([""] if files else []), *map(str, files)]),
    )
    return 0 if found.seen else LIMIT_EXCEEDED
