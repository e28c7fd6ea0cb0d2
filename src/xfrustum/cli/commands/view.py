"""`view`: what eyes before the plate see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.light import light_options
from xfrustum.cli.options import option

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.reports.eye.view import Source
    from xfrustum.scenes.model.eye import Eye
    from xfrustum.scenes.model.scene import Scene
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum

Place = tuple[float, float, float]


def _place(text: str) -> Place:
    x, y, z = map(float, text.split(","))
    return x, y, z


_PLACES = options.list_of(
    options.Read("X,Y,Z", _place, ""), ";", wants="a list of X,Y,Z such as 0,0,600;30,0,600"
)


def _eyes(places: tuple[Place, ...], path: int | None, **given: Any) -> Callable[[], tuple[Eye, ...]]:
    """Return a function that makes the eyes, for that loads what `--help` does not need."""

    def eyes() -> tuple[Eye, ...]:
        from xfrustum.reports.eye.view import eyes_on_path
        from xfrustum.scenes.model.eye import Eye

        known = {name: value for name, value in given.items() if value is not None}
        return eyes_on_path([Eye(position=place, **known) for place in places], path)

    return eyes


_eye_options = options.gathered(
    "eyes",
    _eyes,
    option(
        "--eye", "places", _PLACES, "Positions before the plate, such as 0,0,600;30,0,600.", required=True
    ),
    option("--path", click.IntRange(min=2), "Number of eyes on the way from the first to the last."),
    option("--resolution", options.RESOLUTION, "Pixels of an eye's film.  [default: 400,300]"),
    option("--pupil", options.POSITIVE, "Diameter of the pupil.  [default: a pinhole]"),
    option("--focus", float, "Height z that eyes are focused on.  [default: 0, the plate]"),
    option(
        "--beam",
        click.Choice(["box", "tent"]),
        "Beams that hogels replay: a pixel each, or means of four.  [default: box]",
    ),
)


@dataclass(frozen=True, kw_only=True)
class _Hogels:
    """Options that say where the hogels come from: a stored plate or files, instead of cameras."""

    plate: Path | None
    images: str | None
    encoding: str | None

    def source(self, scene: Scene, settings: DoubleFrustum | None, light: Light) -> Source | None:
        """Return where the hogels come from; None where none are asked for."""
        from xfrustum.reports.eye.view import Drawing, Images, StoredPlate
        from xfrustum.scenes.files.foreign_images import Encoding

        if settings is not None:
            return Drawing(scene, settings, light.chosen(scene, settings=settings))
        if self.plate is not None:
            return StoredPlate(self.plate, scene)
        if self.images is not None:
            return Images(pattern=self.images, scene=scene, encoding=Encoding(self.encoding or Encoding.RGB))
        return None


_hogel_options = options.gathered(
    "hogels",
    _Hogels,
    option("--plate", options.FOLDER, "Show the hogels of this Zarr group."),
    click.option("--images", help="Show hogels of any renderer, such as 'DIR/{i}x{j}.png'."),
    options.encoding_option,
)


@options.command("xfrustum view asymmetric --eye 0,0,600 --near 0.1 --resolution 160,120 --out seen")
@options.scene_argument
@_eye_options
@option("--stereo", options.POSITIVE, "Distance of two eyes that take the place of each eye.")
@options.optional_double_frustum_options
@_hogel_options
@light_options("effects")
@option("--quilt", options.TILES, "Write quilts alone: views 40 degrees wide, as tiles.")
@options.out_option("Folder for the page and the pictures.")
@options.quiet_and_json
def view(
    *,
    scene: str,
    eyes: Callable[[], tuple[Eye, ...]],
    stereo: float | None,
    settings: DoubleFrustum | None,
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
    if sum(given is not None for given in (settings, hogels.plate, hogels.images)) > 1:
        raise click.UsageError("--near, --plate and --images each name the hogels: give one of them")
    if hogels.encoding is not None and hogels.images is None:
        raise click.UsageError("--encoding says what pixels of --images hold: give both")
    opened = light.applied(options.open_scene(scene))
    from xfrustum.reports.common.outputs import check_writable_folder
    from xfrustum.reports.eye import quilt as quilts
    from xfrustum.reports.eye.page import file_names, table, write_view
    from xfrustum.reports.eye.view import view as viewed

    chosen = eyes()
    if quilt is not None and (out is None or len(chosen) > 1 or stereo is not None):
        raise click.UsageError("--quilt needs --out, and one eye: leave out --path and --stereo")
    options.warn_of(opened)
    source = hogels.source(opened, settings, light)
    if opened.sampling.aperture * opened.sampling.supersample * opened.sampling.multisample > 1:
        options.note("views are made with one sample a pixel, whatever the scene asks for")
    how: dict[str, Any] = {"effects": light.chosen(opened), "progress": not quiet}
    if quilt is not None and out is not None:
        record = quilts.write_quilt(opened, chosen[0], quilt, source, out, **how)
        names = quilts.quilt_names(opened, quilt, drawn=source is not None)[1:]
        options.tell(as_json, lambda: record, lambda: "\n".join(str(out / name) for name in names))
        return
    if out is not None:
        count = len(chosen) * (1 if stereo is None else 2)
        check_writable_folder(out, file_names(count, drawn=source is not None))
    found = viewed(opened, chosen, source, stereo=stereo, **how)
    files = () if out is None else write_view(found, out)
    page = [str(file) for file in files if file.suffix == ".html"]
    options.tell(as_json, found.summary, lambda: "\n".join((table(found), *page)))
