"""`check`: what lies where in a scene, and what looks like a mistake."""

from __future__ import annotations

from xfrustum.cli import options
from xfrustum.cli.options import FOLDER, option
from xfrustum.terminal import say


class _Asked(options.Printed):
    scene = options.scene_argument
    out = option(FOLDER, "Folder for side.svg and top.svg.")


@options.command("xfrustum check car --out views")
def check(asked: _Asked) -> int:
    """Say where each object lies, which apertures see it, and what looks like a mistake.

    Exit status 1 if no aperture of the plate sees anything.
    """
    from xfrustum.scenes import open_scene

    opened = open_scene(asked.scene)
    from xfrustum.reports.scene_check import checking

    options.check_out(asked.out, checking.FILES)
    found = checking.check(opened)
    files = () if asked.out is None else checking.write_check(found, asked.out)
    for warning in found.warnings:
        say(f"warning: {warning}")
    asked.tell(
        lambda: {**found.summary(), "files": [str(file) for file in files]},
        lambda: "\n".join([checking.table(found), *([""] if files else []), *map(str, files)]),
    )
    return 0 if found.seen else options.LIMIT_EXCEEDED
