"""`view`: what eyes before the plate see."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.light import light_options
from xfrustum.cli.options import FOLDER, POSITIVE, RESOLUTION, TEXT, TILES, choice, option, several

if TYPE_CHECKING:
    from xfrustum.reports.view import Source
    from xfrustum.scenes.model.eye import Eye
    from xfrustum.scenes.model.scene import Scene

Place = tuple[float, float, float]


def _place(text: str) -> Place:
    x, y, z = map(float, text.split(","))
    return x, y, z


_PLACES = options.list_of(
    options.Read("X,Y,Z", _place, ""), ";", wants="a list of X,Y,Z such as 0,0,600;30,0,600"
)


class _Asked(options.Measured):
    scene = options.scene_argument
    places = option(
        _PLACES, "Positions before the plate, such as 0,0,600;30,0,600.", "--eye", required=True
    )
    path = option(click.IntRange(min=2), "Number of eyes on the way from the first to the last.")
    film = several(
        resolution=option(RESOLUTION, "Pixels of an eye's film.  [default: 400,300]"),
        pupil=option(POSITIVE, "Diameter of the pupil.  [default: a pinhole]"),
        focus=option(click.FLOAT, "Height z that eyes are focused on.  [default: 0, the plate]"),
        beam=choice(
            "box tent", "Beams that hogels replay: a pixel each, or means of four.  [default: box]"
        ),
    )
    stereo = option(POSITIVE, "Distance of two eyes that take the place of each eye.")
    settings = options.settings_options()
    plate = option(FOLDER, "Show the hogels of this Zarr group.")
    images = option(TEXT, "Show hogels of any renderer, such as 'DIR/{i}x{j}.png'.")
    encoding = options.encoding_option
    light = light_options("effects")
    quilt = option(TILES, "Write quilts alone: views 40 degrees wide, as tiles.")
    out = option(FOLDER, "Folder for the page and the pictures.")

    def eyes(self) -> tuple[Eye, ...]:
        """Return the eyes, along the path if there is one."""
        from xfrustum.reports.view import eyes_on_path
        from xfrustum.scenes.model.eye import Eye

        film = options.present(**self.film)
        return eyes_on_path([Eye(position=place, **film) for place in self.places], self.path)

    def source(self, scene: Scene) -> Source | None:
        """Return where the hogels come from; None where none are asked for."""
        from xfrustum.reports.view import Drawing, Images, StoredPlate
        from xfrustum.scenes.files.foreign_images import Encoding

        if self.settings is not None:
            return Drawing(scene, self.settings, self.light.chosen(scene, drawn=self.settings))
        if self.plate is not None:
            return StoredPlate(self.plate, scene)
        if self.images is not None:
            return Images(
                pattern=self.images, scene=scene, encoding=Encoding(self.encoding or Encoding.RGB)
            )
        return None


@options.command(
    "xfrustum view asymmetric --eye 0,0,600 --near 0.1 --resolution 160,120 --out seen"
)
def view(asked: _Asked) -> None:
    """Show what eyes before the plate see: the scene itself, its replayed truth, and a renderer's hogels.

    The renderer is ours with --near and its other options, a stored plate, or anybody's files;
    without any of these the display alone is judged. With --out, index.html has all pictures with
    their numbers, and beside it lie OpenEXR and PNG files and an animation.
    """
    out, quilt, stereo = asked.out, asked.quilt, asked.stereo
    if sum(given is not None for given in (asked.settings, asked.plate, asked.images)) > 1:
        raise click.UsageError(
            "--near, --plate and --images each name the hogels: give one of them"
        )
    if asked.encoding is not None and asked.images is None:
        raise click.UsageError("--encoding says what pixels of --images hold: give both")
    opened = asked.light.applied(options.open_scene(asked.scene))
    from xfrustum.reports.view import file_names, quilt_names, write_quilt, write_view
    from xfrustum.reports.view import view as viewed

    eyes = asked.eyes()
    if quilt is not None and (out is None or len(eyes) > 1 or stereo is not None):
        raise click.UsageError("--quilt needs --out, and one eye: leave out --path and --stereo")
    options.warn_of(opened)
    source = asked.source(opened)
    if opened.sampling.aperture * opened.sampling.supersample * opened.sampling.multisample > 1:
        options.note("views are made with one sample a pixel, whatever the scene asks for")
    how: dict[str, Any] = {"effects": asked.light.chosen(opened), "progress": asked.progress}
    if quilt is not None and out is not None:
        record = write_quilt(opened, eyes[0], quilt, source, out, **how)
        names = quilt_names(opened, quilt, drawn=source is not None)[1:]
        options.note("quilts are encoded as sRGB, which displays take them for")
        asked.tell(lambda: record, lambda: "\n".join(str(out / name) for name in names))
        return
    count = len(eyes) * (1 if stereo is None else 2)
    options.check_out(out, file_names(count, drawn=source is not None))
    found = viewed(opened, eyes, source, stereo=stereo, **how)
    files = () if out is None else write_view(found, out)
    page = [str(file) for file in files if file.suffix == ".html"]
    asked.tell(found.summary, lambda: "\n".join((found.table(), *page)))
