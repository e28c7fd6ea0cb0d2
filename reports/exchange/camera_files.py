"""Files of cameras for other renderers: JSON, glTF, Mitsuba and Blender."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.outputs import Staging
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


class Renderer(StrEnum):
    """The renderers for which cameras are written."""

    BLENDER = "blender"
    JSON = "json"
    GLTF = "gltf"
    MITSUBA = "mitsuba"


CAMERA_FILES = {
    Renderer.JSON: "cameras.json",
    Renderer.GLTF: "cameras.gltf",
    Renderer.MITSUBA: "sensors.json",
}
"""Name of the one file of each renderer but Blender."""


@dataclass(frozen=True, kw_only=True)
class CameraFiles:
    """Files of cameras.

    Attributes
    ----------
    renderer
        Renderer that they are for.
    files
        Paths of the files.
    next_step
        Words about what to do with them.
    """

    renderer: Renderer
    files: tuple[Path, ...]
    next_step: str


def write_cameras(
    scene: Scene,
    renderer: Renderer | str,
    out: Path,
    settings: DoubleFrustum | None = None,
    apertures: Sequence[Aperture] | None = None,
) -> CameraFiles:
    """Write the cameras of a scene for another renderer.

    Parameters
    ----------
    scene
        Scene whose plate and frustum the cameras belong to.
    renderer
        `json`, `gltf`, `mitsuba`: C and C* of some settings; `blender`: the crossed frustum itself.
    out
        Folder of the files.
    settings
        Settings of C and C*; not for Blender, whose camera needs none.
    apertures
        Apertures whose cameras are written; the default apertures of a report where None. For Blender, those
        that the script renders unless it is told others.

    Raises
    ------
    InputError
        Settings are missing or make no sense, or the folder cannot be written.
    """
    chosen = choice(Renderer, renderer, "--for")
    if chosen is Renderer.BLENDER:
        if settings is not None:
            raise InputError(
                "Blender's camera is the crossed frustum itself: leave out --near and its options"
            )
        from xfrustum.reports.exchange.blender.export import write_blender  # noqa: PLC0415

        return CameraFiles(
            renderer=chosen,
            files=write_blender(scene, out, apertures),
            next_step=f"run it: python {out / 'render.py'} --out HOGELS (with bpy), or in Blender: "
            f"blender -b -P {out / 'render.py'} -- --out HOGELS",
        )
    if settings is None:
        raise InputError("C and C* need --near, the distance by which they step back from the plate")
    # The rasterizer, which owns these matrices, takes a second to load.
    from xfrustum.reports.exchange.camera_formats import gltf, mitsuba  # noqa: PLC0415
    from xfrustum.reports.exchange.cameras import cameras_of  # noqa: PLC0415

    cameras = cameras_of(scene, settings, apertures or scene.default_apertures())
    written: object = cameras
    if chosen is not Renderer.JSON:
        written = gltf(cameras) if chosen is Renderer.GLTF else mitsuba(cameras)
    name = CAMERA_FILES[chosen]
    with Staging(out, (name,)) as staging:
        text = json.dumps(json_ready(written), allow_nan=False, indent=1)
        (staging.folder / name).write_text(text + "\n", encoding="utf-8")
        files = staging.commit()
    return CameraFiles(renderer=chosen, files=files, next_step=f"read CONVENTIONS.md, and {files[0]}")
