"""`trace`, `raster`, `view`: pictures of one aperture, traced or drawn, and of eyes."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from xfrustum.cli import options
from xfrustum.cli.light import RASTER, REFERENCE, light_options
from xfrustum.cli.options import FOLDER, POSITIVE, RESOLUTION, TEXT, TILES, choice, option, several

if TYPE_CHECKING:
    from xfrustum.reports.view import Source
    from xfrustum.scenes.model.scene import Scene


def check_no_other_tracer(tracer: str | None, decided_by: str) -> None:
    """Refuse a tracer for second opinions if an uncertified tracer decides."""
    if decided_by != "certified" and tracer not in (None, decided_by):
        raise click.UsageError(
            f"--tracer {tracer} gives a second opinion, and --decided-by {decided_by} uses none"
        )


class _Trace(options.Measured):
    scene = options.scene_argument
    aperture = options.aperture_option
    tracer = option(
        options.one_of(options.TRACERS), "Ray tracer.  [default: embree; for light paths mitsuba]"
    )
    decided_by = options.decided_by_option
    light = light_options(*REFERENCE)
    out = option(FOLDER, "EXR file, NAME.exr.", required=True)


@options.command("xfrustum trace car --out truth.exr")
def trace(request: _Trace) -> None:
    """Trace the truth of one aperture and write it as EXR.

    With --json, count the pixels that Embree alone and Mitsuba alone would get wrong.

    With interreflection, the color of a pixel is the mean of light paths traced by Mitsuba; the
    channels variance.R, variance.G and variance.B have its variance. Shadows without
    interreflection are exact.
    """
    opened = request.light.applied(options.open_scene(request.scene))
    chosen = options.chosen_aperture(opened, request.aperture)
    from xfrustum.reference import Reference
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.reports.image_files import forecast, trace_alone, trace_to_file, trace_transported

    check_writable_image(request.out)
    options.look_at(opened, [chosen], black_is_right=True)
    effects = request.light.chosen(opened, (chosen,))
    record: Any
    if request.decided_by != "certified":
        check_no_other_tracer(request.tracer, request.decided_by)
        reference = Reference(opened, tracer=request.decided_by, effects=effects)
        record = trace_alone(reference, chosen, request.out)
    else:
        who, transported = request.light.tracer(opened, request.tracer)
        # Light paths may take hours: estimate the duration before they start.
        ahead = None if request.quiet else forecast(opened, transported=transported)
        if ahead is not None:
            options.note(ahead)
        reference = Reference(opened, tracer=who, effects=effects)
        if transported:
            if request.as_json:
                words = "--json counts pixels of the certified truth: leave out light transport"
                raise click.UsageError(words)
            trace_transported(reference, chosen, request.out, progress=request.progress)
            return
        record = trace_to_file(
            reference, chosen, request.out, compared=request.as_json, progress=request.progress
        )
    if request.as_json:
        request.tell(lambda: record, str)


class _Raster(options.Asked):
    scene = options.scene_argument
    aperture = options.aperture_option
    settings = options.settings_options(required=True)
    light = light_options(*RASTER)
    out = option(FOLDER, "EXR file, NAME.exr.", required=True)


@options.command("xfrustum raster car --near 0.1 --out raster.exr")
def raster(request: _Raster) -> None:
    """Draw one aperture with the two cameras and write it as EXR."""
    settings = request.settings
    opened = request.light.applied(options.open_scene(request.scene))
    chosen = options.chosen_aperture(opened, request.aperture)
    # Refuse impossible options before OpenGL is loaded.
    settings.check_against(opened.frustum)
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.scenes.files.exr import write_image

    check_writable_image(request.out)
    options.look_at(opened, [chosen], black_is_right=True)
    options.warn_of_culling(opened, settings.cull)
    with Rasterizer(
        opened, effects=request.light.chosen(opened, (chosen,), settings)
    ) as rasterizer:
        write_image(request.out, rasterizer.render(chosen, settings, normals=True, color=True))


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
        _PLACES,
        "Positions of eyes in front of the plate, such as 0,0,600;30,0,600.",
        "--eye",
        required=True,
    )
    film = several(
        resolution=option(
            RESOLUTION, "Width and height of each picture, pixels.  [default: 400,300]"
        ),
        pupil=option(POSITIVE, "Diameter of the pupil.  [default: a pinhole]"),
        focus=option(click.FLOAT, "Height z of the plane in focus.  [default: 0, the plate]"),
        beam=choice(
            "box tent",
            "Filter of a hogel: the nearest pixel (box), or four averaged (tent).  [default: box]",
        ),
    )
    settings = options.settings_options()
    plate = option(FOLDER, "Show the hogels of this Zarr group, written by `plate`.")
    images = option(TEXT, "Show hogels of any renderer, such as 'DIR/{i}x{j}.png'.")
    encoding = options.encoding_option
    light = light_options("effects")
    quilt = option(TILES, "Write only quilts, CxR tiles: views across 40 degrees.")
    out = option(FOLDER, "Folder for the page and the pictures.")

    def source(self, scene: Scene) -> Source | None:
        """Return the source of the hogels; None without a renderer."""
        from xfrustum.reports.view import drawing, image_files, stored_plate
        from xfrustum.scenes.files.pictures import Encoding

        if self.settings is not None:
            return drawing(scene, self.settings, self.light.chosen(scene, drawn=self.settings))
        if self.plate is not None:
            return stored_plate(self.plate, scene)
        if self.images is not None:
            return image_files(self.images, scene, Encoding(self.encoding or Encoding.RGB))
        return None


@options.command(
    "xfrustum view asymmetric --eye 0,0,600 --near 0.1 --resolution 160,120 --out seen"
)
def view(request: _Asked) -> None:
    """Draw an eye's view of the scene, of a display of the true hogels, and of a renderer's hogels.

    The renderer's hogels are drawn by xfrustum (--near and its other options), or read from a
    stored plate (--plate) or image files (--images); without these only the display is judged.
    --out writes a page, OpenEXR and PNG files.
    """
    out = request.out
    # A view has a single source of hogels, because errors of two sources would mix.
    if sum(source is not None for source in (request.settings, request.plate, request.images)) > 1:
        raise click.UsageError(
            "--near, --plate and --images each name the hogels: give one of them"
        )
    if request.encoding is not None and request.images is None:
        raise click.UsageError("--encoding needs --images, whose pixels it describes")
    opened = request.light.applied(options.open_scene(request.scene))
    from xfrustum.reports import view as own
    from xfrustum.scenes.model.eye import Eye

    eyes = [Eye(position=place, **options.present(**request.film)) for place in request.places]
    # A quilt has a row of eyes around the given eye, and writes only files.
    if request.quilt is not None and (out is None or len(eyes) > 1):
        raise click.UsageError("--quilt needs --out and one eye")
    options.warn_of(opened)
    source = request.source(opened)
    # Rays of an eye pass through one point of a hogel: there is no area to average over.
    if opened.sampling.aperture * opened.sampling.supersample * opened.sampling.multisample > 1:
        options.note("views have one sample a pixel; the sampling of the scene is ignored")
    show = partial(
        own.view,
        opened,
        source=source,
        effects=request.light.chosen(opened),
        progress=request.progress,
    )
    if request.quilt is not None and out is not None:
        record, files = own.write_quilt(show, eyes[0], request.quilt, out)
        options.note("quilts are encoded in sRGB, as displays expect")
        request.tell(lambda: record, lambda: "\n".join(map(str, files)))
        return
    # File names depend on the number of eyes, and on whether there is a renderer.
    options.check_out(out, own.file_names(len(eyes), drawn=source is not None))
    seen = show(eyes)
    files = () if out is None else own.write_view(seen, out)
    page = [str(file) for file in files if file.suffix == ".html"]
    request.tell(seen.summary, lambda: "\n".join((seen.table(), *page)))
