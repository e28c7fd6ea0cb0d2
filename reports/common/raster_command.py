"""Words that reports share: commands to be copied, and what a truth is that nobody examined."""

from __future__ import annotations

import shlex
from pathlib import Path

from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import Cull, DoubleFrustum, Fit, Offset, Pivot
from xfrustum.scenes.plate.plate import Aperture


def raster_command(scene: Scene, aperture: Aperture, settings: DoubleFrustum) -> str:
    """Return the command that draws an aperture with these settings, quoted for a shell."""
    words = ["xfrustum", "raster", scene.source or scene.name]
    if aperture != scene.plate.middle:
        words += ["--aperture", f"{aperture.column},{aperture.row}"]
    return shlex.join([*words, *_options(settings), "--out", "raster.exr"])


def plate_command(scene: Scene, settings: DoubleFrustum) -> str:
    """Return the command that draws the whole plate with these settings, quoted for a shell."""
    source = scene.source or scene.name
    words = ["xfrustum", "plate", source, *_options(settings), "--out", f"{Path(source).stem}.zarr"]
    return shlex.join(words)


def plan_command(scene: Scene) -> str:
    """Return the command that asks which settings hold for the whole plate, quoted for a shell."""
    return shlex.join(["xfrustum", "plan", scene.source or scene.name])


def _options(settings: DoubleFrustum) -> list[str]:
    """Return the options that stand for these settings, the same for an aperture and the plate."""
    words = ["--near", f"{settings.near:g}", "--depth", str(settings.depth)]
    words += ["--mapping", str(settings.mapping)]
    # Options that are left out have their usual values.
    if settings.pivot is not Pivot.APERTURE:
        words += ["--pivot", str(settings.pivot)]
    if settings.fit is not None:
        words += ["--fit", str(settings.fit) if isinstance(settings.fit, Fit) else f"{settings.fit:g}"]
    if settings.offset is not Offset.PLATE:
        words += ["--offset", str(settings.offset)]
    if settings.slabs:
        words += ["--slabs", ",".join(f"{height:g}" for height in settings.slabs)]
    if settings.cull is not Cull.NONE:
        words += ["--cull", str(settings.cull)]
    return words


def unexamined_truth(tracer: str) -> str:
    """Say that a truth is what one tracer shows alone; `tracer` is its name, such as `embree`."""
    return f"truth: {tracer.capitalize()} alone, not examined"
