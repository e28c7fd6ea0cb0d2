"""Camera files for other renderers, with the numbered triangles.

Cameras C and C* come from `raster.description`; Blender gets the crossed frustum itself
(`blender`, written as render.py).
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from xfrustum.raster.description import cameras_of, gltf, mitsuba
from xfrustum.reports.common.outputs import Staging
from xfrustum.scenes import Aperture, DoubleFrustum, InputError, Scene
from xfrustum.scenes.arguments import choice


class Renderer(StrEnum):
    """Renderer with a format of camera files."""

    BLENDER = "blender"
    JSON = "json"
    GLTF = "gltf"
    MITSUBA = "mitsuba"


#: files of the cameras C and C*
CAMERA_FILES = {"json": "cameras.json", "gltf": "cameras.gltf", "mitsuba": "sensors.json"}
#: numbered triangles and objects (`write_triangles`)
TRIANGLES_FILE = "scene.npz"


@dataclass(frozen=True, kw_only=True)
class CameraFiles:
    """Camera files for a renderer."""

    renderer: Renderer
    files: tuple[Path, ...]
    #: advice to the user, one sentence
    next_step: str


def write_cameras(
    scene: Scene,
    renderer: Renderer | str,
    out: Path,
    settings: DoubleFrustum | None = None,
    apertures: Sequence[Aperture] | None = None,
) -> CameraFiles:
    """Write the cameras of a scene for another renderer into a folder.

    Parameters
    ----------
    settings
        Settings of C and C*; required for `json`, `gltf` and `mitsuba`, and refused for `blender`.
    apertures
        Apertures of the cameras, by default a report's; for `blender` the apertures that the script
        renders without --apertures, by default the whole plate.

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
        files, script = write_blender(scene, out, apertures), out / "render.py"
        # A scene file without objects only states the plate: geometry comes from the user's file.
        blend, option = ("", "") if scene.objects else ("SCENE.blend ", "--blend SCENE.blend ")
        next_step = (
            f"run it: python {script} {option}--out HOGELS (with bpy), or in Blender: "
            f"blender -b {blend}-P {script} -- --out HOGELS"
        )
        return CameraFiles(renderer=chosen, files=files, next_step=next_step)
    if settings is None:
        raise InputError(
            "C and C* need --near, the distance by which they step back from the plate"
        )
    cameras = cameras_of(scene, settings, apertures or scene.default_apertures())
    written = {Renderer.GLTF: gltf, Renderer.MITSUBA: mitsuba}.get(chosen, dict)(cameras)
    name = CAMERA_FILES[chosen]
    # The cameras come first in the result, independent of their names.
    with Staging(out, (name, TRIANGLES_FILE)) as staging:
        staging.write(name, written)
        write_triangles(scene, staging.folder / TRIANGLES_FILE)
        cameras_file, triangles_file = sorted(staging.commit(), key=lambda file: file.name != name)
    next_step = (
        f"read CONVENTIONS.md, and {cameras_file}; {triangles_file} has the numbered triangles"
    )
    return CameraFiles(renderer=chosen, files=(cameras_file, triangles_file), next_step=next_step)


def write_triangles(scene: Scene, path: Path) -> None:
    """Write all triangles, in scene units, with their object numbers and shading."""
    objects, environment = scene.objects, scene.appearance.environment
    shading = {
        name: getattr(scene.surface, name) for name in ("vertex_normals", "vertex_colors", "uv")
    }
    shading["environment"] = None if environment is None else environment.radiance
    # Write it uncompressed, because readers in other languages parse it.
    np.savez(
        path,
        vertices=scene.vertices,
        faces=scene.faces,
        object_of_triangle=scene.object_of_triangle,
        # One more entry than objects: entries i and i + 1 are the ends of object i.
        first_vertex=np.cumsum([0, *(len(part.vertices) for part in objects)]),
        first_triangle=np.cumsum([0, *(len(part.faces) for part in objects)]),
        # Store fixed-width text: object arrays would need pickle to be read.
        names=np.array([part.name for part in objects], dtype=np.str_),
        **{name: values for name, values in shading.items() if values is not None},
    )


def write_blender(
    scene: Scene, out: Path, apertures: Sequence[Aperture] | None
) -> tuple[Path, ...]:
    """Write the script that renders a scene's hogels in Blender, the plate and the triangles."""
    frustum, objects = scene.frustum, scene.objects
    described = {
        "scene": scene.name,
        "scene_hash": scene.content_hash,
        "units": scene.units,
        "size": scene.plate.size,
        "hogels": scene.plate.hogels,
        "resolution": frustum.resolution,
        "reach": frustum.reach,
        "fov": frustum.fov,
        "screen": frustum.screen,
        "apertures": None if apertures is None else [aperture.index for aperture in apertures],
        "objects": [part.name for part in objects],
        "colors": [material.diffuse for material in scene.materials],
        "lights": [
            {"direction": light.direction, "color": light.color}
            for light in scene.appearance.lights
        ],
    }
    with Staging(out, ("render.py", "plate.json", TRIANGLES_FILE)) as staging:
        shutil.copyfile(Path(__file__).with_name("blender.py"), staging.folder / "render.py")
        staging.write("plate.json", described)
        write_triangles(scene, staging.folder / TRIANGLES_FILE)
        return staging.commit()
