"""The command that draws with some settings, to be copied."""

from __future__ import annotations

import shlex

from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


def raster_command(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> str:
    """Return the command that draws an aperture with near, depth, cuts and culling, quoted for a shell."""
    words = ["xfrustum", "raster", scene.source or scene.name]
    if aperture != scene.plate.middle:
        words += ["--aperture", f"{aperture.column},{aperture.row}"]
    words += ["--near", f"{settings.near:g}", "--depth", str(settings.depth)]
    words += ["--mapping", str(settings.mapping)]
    if settings.slabs:
        words += ["--slabs", ",".join(f"{height:g}" for height in settings.slabs)]
    if settings.cull is not Cull.NONE:
        words += ["--cull", str(settings.cull)]
    return shlex.join([*words, "--out", "raster.exr"])
