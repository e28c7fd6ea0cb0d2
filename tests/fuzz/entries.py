"""Commands for fuzzing: each reads the input of a command, without its slow verdict.

They run like all commands of the program, with equal streams, messages and exit statuses. The child
process adds them to the command line.
"""

import json
from pathlib import Path

import click

from xfrustum.process import say


@click.command("read-scene")
@click.argument("scene")
def read_scene(scene: str) -> None:
    """Read a scene, with its meshes, textures and maps."""
    from xfrustum.scenes import open_scene
    from xfrustum.scenes.model.scene import look_hash

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
    from xfrustum.scenes.files.pictures import Encoding, read_foreign

    opened = open_scene(scene)
    camera = Reference(opened).camera(opened.plate.middle)
    image = read_foreign(picture, camera, Encoding.TRIANGLE_ID)
    click.echo(str(int((image.triangle >= 0).sum())))


@click.command("read-parts")
@click.argument("out", type=click.Path(path_type=Path))
def read_parts(out: Path) -> None:
    """Read the complete parts of a survey, as the command does to resume it."""
    from xfrustum.reports.parts import DESCRIPTION, ParquetParts
    from xfrustum.scenes.disk import read_small

    parts = ParquetParts(out=out, name="survey.parquet")
    described = read_small(parts.folder / DESCRIPTION, "description", 1 << 20)
    try:
        description = json.loads(described)
    except (ValueError, RecursionError):
        description = {}
    if isinstance(description, dict):
        parts.open(description)
    whole = [number for number in range(6) if parts.finished(number)]
    click.echo(str(sum(parts.read(number).num_rows for number in whole)))


@click.command("read-device")
@click.argument("path", type=click.Path(path_type=Path))
def read_device(path: Path) -> None:
    """Read a device.json."""
    from xfrustum.scenes.model.device_model import DeviceModel

    click.echo(DeviceModel.read(path).name)


@click.command("read-archive")
@click.argument("path", type=click.Path(path_type=Path))
@click.argument("name")
def read_archive(path: Path, name: str) -> None:
    """Read the truths of a case from an archive, as `conformance judge --truth` does."""
    from xfrustum.reports.conformance_cases import Archive
    from xfrustum.scenes.conformance_suite import chosen

    (case,) = chosen(names=(name,))
    click.echo(str(len(Archive(path=path)(case, case.open()))))


ENTRIES = (read_scene, read_picture, read_parts, read_device, read_archive)
