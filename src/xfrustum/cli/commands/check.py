"""`check`: what lies where in a scene, and what looks like a mistake."""

from __future__ import annotations

from pathlib import Path

from xfrustum.cli import options
from xfrustum.terminal import say


@options.command("xfrustum check car --out views")
@options.scene_argument
@options.out_option("Folder for side.svg and top.svg.")
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
        say(f"warning: {warning}")
    options.tell(
        as_json,
        lambda: {**found.summary(), "files": [str(file) for file in files]},
        lambda: "\n".join([table(found), *([""] if files else []), *map(str, files)]),
    )
    return 0 if found.seen else options.LIMIT_EXCEEDED
