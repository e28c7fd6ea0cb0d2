"""What the script needs: the plate, and the scene's triangles with their numbers."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from xfrustum.reports.common.outputs import Staging
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.plate import Aperture

SCRIPTS = SCRIPT, LONG_RUN, PIXEL_FILES = "render.py", "long_run.py", "pixel_files.py"
"""Names of the script, and of the files that it imports."""

PLATE, MESH = "plate.json", "scene.npz"
"""Names of the description of the plate, and of the scene's triangles."""


def write_blender(scene: Scene, out: Path, apertures: Sequence[Aperture] | None) -> tuple[Path, ...]:
    """Write the script that renders a scene's hogels in Blender, with what it reads beside it.

    Parameters
    ----------
    scene
        Scene whose plate, frustum and triangles are written.
    out
        Folder of the files.
    apertures
        Apertures that the script renders where nobody names others; the whole plate where None.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    with Staging(out, (*SCRIPTS, PLATE, MESH)) as staging:
        for name in SCRIPTS:
            shutil.copyfile(Path(__file__).with_name(name), staging.folder / name)
        text = json.dumps(_described(scene, apertures), allow_nan=False, indent=1)
        (staging.folder / PLATE).write_text(text + "\n", encoding="utf-8")
        first = np.cumsum([0, *(len(one.vertices) for one in scene.objects)])
        faces = [one.faces + start for one, start in zip(scene.objects, first[:-1], strict=True)]
        np.savez(
            staging.folder / MESH,
            vertices=np.concatenate([np.zeros((0, 3)), *(one.vertices for one in scene.objects)]),
            faces=np.concatenate([np.zeros((0, 3), np.int64), *faces]),
            first_vertex=first,
            first_triangle=np.cumsum([0, *(len(one.faces) for one in scene.objects)]),
        )
        return staging.commit()


def _described(scene: Scene, apertures: Sequence[Aperture] | None) -> dict[str, object]:
    frustum, screen = scene.frustum, scene.frustum.screen
    return {
        "scene": scene.name,
        "scene_hash": scene.content_hash,
        "units": scene.units,
        "size": scene.plate.size,
        "hogels": scene.plate.hogels,
        "resolution": frustum.resolution,
        "reach": frustum.reach,
        "fov": frustum.fov,
        "screen": None
        if screen is None
        else {"height": screen.height, "center": screen.center, "size": screen.size},
        "apertures": None if apertures is None else [aperture.index for aperture in apertures],
        "objects": [one.name for one in scene.objects],
        "colors": [material.diffuse for material in scene.materials],
        "lights": [{"direction": light.direction, "color": light.color} for light in scene.appearance.lights],
    }
