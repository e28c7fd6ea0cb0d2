"""The command that shows what eyes before the plate see."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import light as cli_light
from xfrustum.cli import options
from xfrustum.cli.numbers import Positive
from xfrustum.cli.streams import say

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.eye.sources import Source
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


@click.command()
@options.scene_argument
@click.option(
    "--eye",
    "places",
    type=Places(),
    required=True,
    help="Positions before the plate, such as 0,0,600;30,0,600.",
)
@click.option(
    "--path", type=click.IntRange(min=2), help="Number of eyes on the way from the first to the last."
)
@click.option("--stereo", type=Positive(), help="Distance of two eyes that take the place of each eye.")
@click.option("--resolution", type=Resolution(), help="Pixels of an eye's film.  [default: 400,300]")
@click.option("--pupil", type=Positive(), help="Diameter of the pupil.  [default: a pinhole]")
@click.option("--focus", type=float, help="Height z that eyes are focused on.  [default: 0, the plate]")
@click.option(
    "--beam",
    type=click.Choice(["box", "tent"]),
    default="box",
    show_default=True,
    help="Profile of the beams that hogels replay: the nearest pixel, or a mean of four.",
)
@options.free_double_frustum_options
@click.option(
    "--plate",
    "stored",
    type=click.Path(path_type=Path),
    help="Show the hogels of this Zarr group, which `xfrustum plate` has drawn.",
)
@click.option(
    "--images", help="Show hogels of any renderer: a pattern of files, {i} the column, {j} the row."
)
@click.option(
    "--encoding",
    type=click.Choice(["rgb", "srgb", "triangle-id", "object-id"]),
    help="What pixels of --images hold; not for OpenEXR.  [default: rgb]",
)
@cli_light.light_options("effects")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the page and the pictures.")
@options.quiet_option
@options.json_option
def view(
    *,
    scene: str,
    places: tuple[Place, ...],
    path: int | None,
    stereo: float | None,
    resolution: tuple[int, int] | None,
    pupil: float | None,
    focus: float | None,
    beam: str,
    settings: DoubleFrustum | None,
    stored: Path | None,
    images: str | None,
    encoding: str | None,
    light: Light,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Show what eyes before the plate see: the scene itself, its replayed truth, and a renderer's hogels.

    The renderer is ours with --near and its other options, a stored plate, or anybody's files; without any
    of these the display alone is judged. With --out, index.html has all pictures with their numbers, and
    beside it lie OpenEXR and PNG files and an animation.
    """
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.eye.files import file_names, table, write_view
    from xfrustum.reports.eye.viewing import eyes_on_path
    from xfrustum.reports.eye.viewing import view as viewed
    from xfrustum.scenes.model.eye import RESOLUTION, Beam, Eye

    if sum(given is not None for given in (settings, stored, images)) > 1:
        raise click.UsageError("--near, --plate and --images each name the hogels: give one of them")
    if encoding is not None and images is None:
        raise click.UsageError("--encoding says what pixels of --images hold: give both")
    eyes = eyes_on_path(
        [
            Eye(
                position=place,
                resolution=resolution or RESOLUTION,
                pupil=pupil or 0.0,
                focus=focus or 0.0,
                beam=Beam(beam),
            )
            for place in places
        ],
        path,
    )
    opened = light.applied(options.open_scene(scene))
    options.warn_of(opened)
    source = _source(opened, settings, stored, (images, encoding), light)
    count = len(eyes) * (1 if stereo is None else 2)
    if out is not None:
        check_writable_folder(out, file_names(count, drawn=source is not None))
    if opened.sampling.aperture * opened.sampling.supersample * opened.sampling.multisample > 1:
        say("note: views are made with one sample a pixel, whatever the scene asks for")
    effects = light.chosen(opened)
    found = viewed(opened, eyes, source, stereo=stereo, effects=effects, progress=not quiet)
    files = () if out is None else write_view(found, out)
    page = [str(file) for file in files if file.suffix == ".html"]
    options.tell(as_json, found.summary, lambda: "\n".join((table(found), *page)))


def _source(
    scene: Scene,
    settings: DoubleFrustum | None,
    stored: Path | None,
    images: tuple[str | None, str | None],
    light: Light,
) -> Source | None:
    """Return where the hogels come from; None where none are asked for."""
    from xfrustum.reports.eye.sources import Drawing, Images, StoredPlate
    from xfrustum.scenes.files.foreign_images import Encoding

    pattern, encoding = images
    if settings is not None:
        return Drawing(scene, settings, light.chosen(scene, settings=settings))
    if stored is not None:
        return StoredPlate(stored, scene)
    if pattern is not None:
        return Images(pattern=pattern, scene=scene, encoding=Encoding(encoding or Encoding.RGB))
    return None
