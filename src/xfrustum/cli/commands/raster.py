"""`raster`: one aperture drawn with the two cameras."""

from __future__ import annotations

from xfrustum.cli import options
from xfrustum.cli.light import RASTER, light_options
from xfrustum.cli.options import FOLDER, option


class _Asked(options.Asked):
    scene = options.scene_argument
    aperture = options.aperture_option
    settings = options.settings_options(required=True)
    light = light_options(*RASTER)
    out = option(FOLDER, "EXR file, NAME.exr.", required=True)


@options.command("xfrustum raster car --near 0.1 --out raster.exr")
def raster(asked: _Asked) -> None:
    """Draw one aperture with the two cameras and write it as EXR."""
    settings = asked.settings
    opened = asked.light.applied(options.open_scene(asked.scene))
    chosen = options.chosen_aperture(opened, asked.aperture)
    settings.check_against(opened.frustum)
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.scenes.files.exr import write_image

    check_writable_image(asked.out)
    options.look_at(opened, [chosen], black_is_right=True)
    with Rasterizer(opened, effects=asked.light.chosen(opened, (chosen,), settings)) as rasterizer:
        write_image(asked.out, rasterizer.render(chosen, settings, normals=True, color=True))
