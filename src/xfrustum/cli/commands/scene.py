"""`scenes`, `new`, `check`: built-in scenes, a scene file that fits a mesh, and its content."""

from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, LENGTH, SIZE, TEXT, flag, one_of, option, several
from xfrustum.scenes.plate import DoubleFrustum
from xfrustum.terminal import say


class _Scenes(options.Printed):
    hard = flag("List the hard cases instead.")


@options.command("xfrustum scenes")
def scenes(request: _Scenes) -> None:
    """List the built-in scenes, each with its purpose."""
    library = import_module(
        f"xfrustum.scenes.library.{'hard_cases' if request.hard else 'builtin'}"
    )
    entries = library.listing()
    width = max(len(entry.name) for entry in entries)
    request.tell(
        lambda: {
            "scenes": [
                {"name": s.name, "purpose": s.purpose, "triangles": s.triangles} for s in entries
            ]
        },
        lambda: "\n".join(
            f"{s.name:<{width}}  {s.triangles:>7,} triangles  {s.purpose}" for s in entries
        ),
    )


_PLACES = {
    "through": "Place the mesh across the plate.  [default, unless the mesh is flat]",
    "behind": "Place the whole mesh behind the plate.",
    "before": "Place the whole mesh in front of the plate.",
}


class _New(options.Printed):
    mesh: Path = options.argument(type=FOLDER)
    out = option(FOLDER, "Scene file.  [default: NAME.toml in the current folder]")
    units = option(TEXT, "Name of the length unit.  [default: m for glTF, else units]")
    size = option(
        LENGTH, "Longest side of the mesh, such as 80mm.  [default: unscaled, or to fit --plate]"
    )
    display = several(
        plate=option(
            SIZE, "Width and height of the plate, such as 600,400mm.  [default: to fit the mesh]"
        ),
        pitch=option(
            LENGTH, "Largest distance between apertures, such as 0.5mm.  [default: by --viewer]"
        ),
        viewer=option(
            LENGTH, "Viewing distance, such as 600mm, at which hogels must not be visible as cells."
        ),
    )
    up = option(one_of("yz"), "Axis of the mesh that points up.", default="y")
    places = several(**{place: flag(words) for place, words in _PLACES.items()})
    force = flag("Replace a scene file that exists.")


@options.command("xfrustum new beetle.obj --size 100 --units mm")
def new(request: _New) -> None:
    """Write a scene file whose plate, reach and field of view fit MESH."""
    from xfrustum.scenes.disk import check_mesh_file

    check_mesh_file(request.mesh)
    from xfrustum.reports.scene_check.new_scene import new_scene

    place = next((place for place in reversed(_PLACES) if request.places[place]), None)
    how: dict[str, Any] = {
        "units": request.units,
        "size": request.size,
        "force": request.force,
        "up": request.up,
    }
    written = new_scene(request.mesh, request.out, place=place, **how, **request.display)
    for feature in written.unread:
        say(f"warning: {request.mesh}: {feature}")
    if written.warning is not None:
        say(f"warning: {written.warning}")
    more = {"path": str(written.path), "pitch": written.pitch, "cells_within": written.cells_within}
    request.tell(lambda: {**asdict(written), **more}, lambda: written.sentence)


class _Check(options.Printed):
    scene = options.scene_argument
    aperture = options.aperture_option
    near = option(
        options.POSITIVE, "Near offset for which errors by depth are listed.  [default: reach/1000]"
    )
    slabs = option(options.NUMBERS, "Heights |z| at which both frusta are cut.", default=())
    viewer = option(
        LENGTH, "Viewing distance, such as 600mm: adds the near offset that a viewer notices."
    )
    out = option(FOLDER, "Folder for side.svg and top.svg.")


@options.command("xfrustum check car --viewer 600 --near 0.1 --out views")
def check(request: _Check) -> int:
    """List the place of each object, the apertures that show it, likely mistakes, and effects.

    Effects are listed if images of the aperture need them, each with the reason. Errors of near
    offset, depth buffer, shear and band limiting are listed by depth, in closed form. Exit status 1
    if no aperture of the plate shows anything.
    """
    from xfrustum.scenes import open_scene

    opened = open_scene(request.scene)
    from xfrustum.reports.scene_check import checking
    from xfrustum.reports.scene_check.effects import default_near

    options.check_out(request.out, checking.FILES)
    aperture = options.chosen_aperture(opened, request.aperture)
    near = request.near or default_near(opened)
    distance = None
    if request.viewer is not None:
        from xfrustum.compare.noticeable import scene_length

        distance = scene_length(request.viewer, opened)
    report = checking.check(
        opened, aperture, DoubleFrustum(near=near, slabs=request.slabs), distance
    )
    files = () if request.out is None else checking.write_check(report, request.out)
    for warning in report.warnings:
        say(f"warning: {warning}")
    request.tell(
        lambda: {**report.summary(), "files": [str(file) for file in files]},
        lambda: "\n".join([report.table(), *([""] if files else []), *map(str, files)]),
    )
    return 0 if report.seen else options.LIMIT_EXCEEDED
