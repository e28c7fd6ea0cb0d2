"""`new`: a scene file that fits a mesh."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, POSITIVE, TEXT, flag, group, option
from xfrustum.terminal import say

_PLACES = {
    "through": "Place the mesh across the plate.  [default, unless it is flat]",
    "behind": "Place all of the mesh behind the plate.",
    "before": "Place all of the mesh on the viewer's side.",
}


def _place(**given: bool) -> str | None:
    """Return the place that is asked for; of several, the last of `_PLACES`."""
    return next((place for place in reversed(_PLACES) if given[place]), None)


class _Asked(options.Printed):
    mesh: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Scene file.  [default: NAME.toml in this folder]")
    units = option(TEXT, "Name of the length unit.  [default: m for glTF, else units]")
    size = option(POSITIVE, "Length to which the mesh's longest side is scaled.  [default: unscaled]")
    place = group(_place, **{place: flag(words) for place, words in _PLACES.items()})
    force = flag("Replace a scene file that exists.")


@options.command("xfrustum new beetle.obj --size 100 --units mm")
def new(asked: _Asked) -> None:
    """Write a scene file whose plate, reach and field of view fit MESH."""
    from xfrustum.scenes.disk.input_files import check_mesh_file

    check_mesh_file(asked.mesh)
    from xfrustum.reports.scene_check.new_scene import new_scene

    written = new_scene(
        asked.mesh, asked.out, units=asked.units, size=asked.size, place=asked.place, force=asked.force
    )
    if written.warning is not None:
        say(f"warning: {written.warning}")
    asked.tell(lambda: {**asdict(written), "path": str(written.path)}, lambda: written.sentence)
