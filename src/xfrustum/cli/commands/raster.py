"""`raster`: one aperture drawn with the two cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from xfrustum.cli import options
from xfrustum.cli.light import RASTER, light_options

if TYPE_CHECKING:
    from xfrustum.cli.light import Light
    from xfrustum.scenes.plate.double_frustum import DoubleFrustum


@options.command("xfrustum raster car --near 0.1 --out raster.exr")
@options.scene_argument
@options.aperture_option
@options.double_frustum_options
@light_options(*RASTER)
@options.out_option("EXR file, NAME.exr.", required=True)
def raster(
    *, scene: str, aperture: tuple[int, int] | None, settings: DoubleFrustum, light: Light, out: Path
) -> None:
    """Draw one aperture with the two cameras and write it as EXR."""
    opened = light.applied(options.open_scene(scene))
    chosen = options.chosen_aperture(opened, aperture)
    settings.check_against(opened.frustum)
    from xfrustum.raster import Rasterizer
    from xfrustum.reports.common.outputs import check_writable_image
    from xfrustum.scenes.files.exr import write_image

    check_writable_image(out)
    options.look_at(opened, [chosen], black_is_right=True)
    with Rasterizer(opened, effects=light.chosen(opened, (chosen,), settings)) as rasterizer:
        write_image(out, rasterizer.render(chosen, settings, normals=True, color=True))
