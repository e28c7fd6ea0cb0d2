"""The command that shows what eyes before the plate see."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.numbers import Positive
from xfrustum.cli.options import Command
from xfrustum.terminal import say

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.eye.sources import Source
    from xfrustum.scenes.model.effects import Effect
    from xfrustum.scenes.model.eye import Eye
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

Place = tuple[float, float, float]


class Places(click.ParamType[tuple[Place, ...]]):
    """Points as X,Y,Z separated by semicolons."""

    name = "X,Y,Z;.."

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[Place, ...]:
        """Return the points in the order given."""
        try:
            points = [[float(part) for part in point.split(",")] for point in str(value).split(";")]
            return tuple((x, y, z) for x, y, z in points)
        except ValueError:
            self.fail(f"{value!r} is not a list of X,Y,Z such as 0,0,600;30,0,600", param, ctx)


class Resolution(click.ParamType[tuple[int, int]]):
    """Width and height in pixels."""

    name = "W,H"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return both."""
        try:
            width, height = (int(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not W,H such as 400,300", param, ctx)
        return width, height


class Tiles(click.ParamType[tuple[int, int]]):
    """Columns and rows of a quilt."""

    name = "CxR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Return both."""
        try:
            columns, rows = (int(part) for part in str(value).split("x"))
        except ValueError:
            self.fail(f"{value!r} is not COLUMNSxROWS such as 8x6", param, ctx)
        return columns, rows


_EYE_OPTIONS = (
    click.option(
        "--eye",
        "places",
        type=Places(),
        required=True,
        help="Positions before the plate, such as 0,0,600;30,0,600.",
    ),
    click.option(
        "--path", type=click.IntRange(min=2), help="Number of eyes on the way from the first to the last."
    ),
    click.option("--resolution", type=Resolution(), help="Pixels of an eye's film.  [default: 400,300]"),
    click.option("--pupil", type=Positive(), help="Diameter of the pupil.  [default: a pinhole]"),
    click.option("--focus", type=float, help="Height z that eyes are focused on.  [default: 0, the plate]"),
    click.option(
        "--beam",
        type=click.Choice(["box", "tent"]),
        help="Profile of the beams that hogels replay: the nearest pixel, or a mean of four.  [default: box]",
    ),
)


def _eye_options(command: Command) -> Command:
    """Add the options of eyes; the command receives a function that makes them, as `eyes`."""

    @functools.wraps(command)
    def with_eyes(places: tuple[Place, ...], path: int | None, **others: Any) -> Any:
        names = ("resolution", "pupil", "focus", "beam")
        given = {name: value for name in names if (value := others.pop(name)) is not None}
        return command(eyes=functools.partial(_eyes, places, path, given), **others)

    for option in reversed(_EYE_OPTIONS):
        with_eyes = option(with_eyes)
    return with_eyes  # type: ignore[return-value]  # wraps() keeps the name, not the type


def _eyes(places: tuple[Place, ...], path: int | None, given: dict[str, Any]) -> tuple[Eye, ...]:
    from xfrustum.reports.eye.viewing import eyes_on_path
    from xfrustum.scenes.model.eye import Eye

    return eyes_on_path([Eye(position=place, **given) for place in places], path)


@dataclass(frozen=True, kw_only=True)
class _Hogels:
    """Options that say where the hogels come from: cameras that draw them, a stored plate, or files."""

    settings: DoubleFrustum | None
    plate: Path | None
    images: str | None
    encoding: str | None

    def check(self) -> None:
        """Raise UsageError where the options contradict each other."""
        if sum(given is not None for given in (self.settings, self.plate, self.images)) > 1:
            raise click.UsageError("--near, --plate and --images each name the hogels: give one of them")
        if self.encoding is not None and self.images is None:
            raise click.UsageError("--encoding says what pixels of --images hold: give both")

    def source(self, scene: Scene, light: Light) -> Source | None:
        """Return where the hogels come from; None where none are asked for."""
        from xfrustum.reports.eye.sources import Drawing, Images, StoredPlate
        from xfrustum.scenes.files.foreign_images import Encoding

        if self.settings is not None:
            return Drawing(scene, self.settings, light.chosen(scene, settings=self.settings))
        if self.plate is not None:
            return StoredPlate(self.plate, scene)
        if self.images is not None:
            return Images(pattern=self.images, scene=scene, encoding=Encoding(self.encoding or Encoding.RGB))
        return None


_HOGEL_OPTIONS = (
    click.option(
        "--plate",
        type=click.Path(path_type=Path),
        help="Show the hogels of this Zarr group, which `xfrustum plate` has drawn.",
    ),
    click.option(
        "--images", help="Show hogels of any renderer: a pattern of files, {i} the column, {j} the row."
    ),
    click.option(
        "--encoding",
        type=click.Choice(["rgb", "srgb", "triangle-id", "object-id"]),
        help="What pixels of --images hold; not for OpenEXR.  [default: rgb]",
    ),
)


def _hogel_options(command: Command) -> Command:
    """Add the options about hogels; the command receives them as one `hogels`."""

    @functools.wraps(command)
    def with_hogels(**others: Any) -> Any:
        given = {field.name: others.pop(field.name) for field in fields(_Hogels)}
        return command(hogels=_Hogels(**given), **others)

    for option in reversed(_HOGEL_OPTIONS):
        with_hogels = option(with_hogels)
    return options.optional_double_frustum_options(with_hogels)  # type: ignore[return-value]  # likewise


@click.command()
@options.scene_argument
@_eye_options
@click.option("--stereo", type=Positive(), help="Distance of two eyes that take the place of each eye.")
@_hogel_options
@cli_light.light_options("effects")
@click.option(
    "--quilt",
    type=Tiles(),
    help="Write quilts alone: views from a line through the eye, 40 degrees wide, as tiles of one picture.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the page and the pictures.")
@options.quiet_option
@options.json_option
def view(
    *,
    scene: str,
    eyes: Callable[[], tuple[Eye, ...]],
    stereo: float | None,
    hogels: _Hogels,
    light: Light,
    quilt: tuple[int, int] | None,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Show what eyes before the plate see: the scene itself, its replayed truth, and a renderer's hogels.

    The renderer is ours with --near and its other options, a stored plate, or anybody's files; without any
    of these the display alone is judged. With --out, index.html has all pictures with their numbers, and
    beside it lie OpenEXR and PNG files and an animation.
    """
    hogels.check()
    opened = light.applied(options.open_scene(scene))

    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.eye.files import file_names, table, write_view
    from xfrustum.reports.eye.viewing import view as viewed

    chosen = eyes()
    if quilt is not None and (out is None or len(chosen) > 1 or stereo is not None):
        raise click.UsageError("--quilt needs --out, and one eye: leave out --path and --stereo")
    options.warn_of(opened)
    source = hogels.source(opened, light)
    if opened.sampling.aperture * opened.sampling.supersample * opened.sampling.multisample > 1:
        say("note: views are made with one sample a pixel, whatever the scene asks for")
    effects = light.chosen(opened)
    if quilt is not None and out is not None:
        _write_quilt(opened, chosen[0], quilt, source, effects, out, quiet=quiet, as_json=as_json)
        return
    if out is not None:
        count = len(chosen) * (1 if stereo is None else 2)
        check_writable_folder(out, file_names(count, drawn=source is not None))
    found = viewed(opened, chosen, source, stereo=stereo, effects=effects, progress=not quiet)
    files = () if out is None else write_view(found, out)
    page = [str(file) for file in files if file.suffix == ".html"]
    options.tell(as_json, found.summary, lambda: "\n".join((table(found), *page)))


def _write_quilt(
    scene: Scene,
    eye: Eye,
    tiles: tuple[int, int],
    source: Source | None,
    effects: frozenset[Effect],
    out: Path,
    *,
    quiet: bool,
    as_json: bool,
) -> None:
    from xfrustum.reports.common.json_ready import json_object
    from xfrustum.reports.eye.quilt import quilt_names, write_quilt

    record = write_quilt(scene, eye, tiles, source, out, effects=effects, progress=not quiet)
    names = quilt_names(scene, tiles, drawn=source is not None)[1:]
    options.tell(as_json, lambda: json_object(record), lambda: "\n".join(str(out / name) for name in names))
