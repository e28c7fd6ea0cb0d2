"""Commands that only the fuzzer has: each reads what a command reads, without the slow verdict.

They run inside the program like every other command, so that standard streams, messages and exit statuses are
those of `xfrustum`. The child adds them to the command line.
"""

from __future__ import annotations

import json
from pathlib import Path

import click

from xfrustum.terminal import say


@click.command("read-scene")
@click.argument("scene")
def read_scene(scene: str) -> None:
    """Read a scene, with its meshes, textures and maps."""
    from xfrustum.scenes import open_scene
    from xfrustum.scenes.model.look import look_hash

    opened = open_scene(scene)
    for warning in opened.warnings:
        say(f"warning: {warning}")
    click.echo(f"{len(opened.faces)} {opened.content_hash} {look_hash(opened)}")


@click.command("read-picture")
@click.argument("scene")
@click.argument("picture", type=click.Path(path_type=Path))
def read_picture(scene: str, picture: Path) -> None:
    """Read a foreign renderer's picture of the middle aperture, as `verify` does."""
    from xfrustum.reference import Reference
    from xfrustum.scenes import open_scene
    from xfrustum.scenes.files.foreign_images import Encoding, read_foreign

    opened = open_scene(scene)
    camera = Reference(opened).camera(opened.plate.middle)
    image = read_foreign(picture, camera, Encoding.TRIANGLE_ID)
    click.echo(str(int((image.triangle >= 0).sum())))


@click.command("go-on-with-plate")
@click.argument("scene")
@click.argument("description", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path))
def go_on_with_plate(scene: str, description: Path, out: Path) -> None:
    """Open a plate with a known description, look at all hogels, and write black ones where some are missing.

    This is `plate --check` without OpenGL.
    """
    import numpy as np

    from xfrustum.reports.plate.layout import Layout
    from xfrustum.reports.plate.store import open_store
    from xfrustum.scenes import open_scene
    from xfrustum.scenes.model.plate_content import PlateContent, PlateHogel

    opened = open_scene(scene)
    content = PlateContent(ids=True)
    width, height = opened.frustum.resolution
    black = np.zeros((height, width, 3), dtype=content.color.dtype)
    nothing = np.full((height, width), -1, dtype=np.int32)
    layout = Layout(
        plate=opened.plate, frustum=opened.frustum, units=opened.units, content=content, side=(1, 1)
    )
    store = open_store(out, layout, json.loads(description.read_text(encoding="utf-8")))
    for block in store.layout.blocks(opened.plate.apertures()):
        missing, _ = store.missing(block, check=True)
        hogels = [PlateHogel(aperture=one, color=black, triangle=nothing) for one in missing]
        if hogels:
            store.write(block, {hogel.aperture: hogel for hogel in hogels})
        if store.missing(block, check=True)[0]:
            raise AssertionError(f"block {block.number} is not whole after it was written")


ENTRIES = (read_scene, read_picture, go_on_with_plate)
