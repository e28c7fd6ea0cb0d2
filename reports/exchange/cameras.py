"""The cameras C and C* of any settings and aperture, in files for renderers that somebody else writes.

`camera --for json` writes all of it; glTF and Mitsuba have cameras of their own.
Blender's camera is the crossed frustum itself: blender/render.py.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.raster.cameras.cameras import FilmWindow, SlabCamera
from xfrustum.raster.cameras.depth_formats import MAPPINGS
from xfrustum.raster.cameras.passes import Pass, cameras_in_order, pass_of
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.outputs import Staging
from xfrustum.reports.exchange.blender.export import write_blender
from xfrustum.scenes.arguments import choice
from xfrustum.scenes.arrays import Floats
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DepthMapping, DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

Record = dict[str, Any]
"""A JSON object, or a part of it."""


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
    """Files of cameras for a renderer, and words about what to do with them."""

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
        return CameraFiles(
            renderer=chosen,
            files=write_blender(scene, out, apertures),
            next_step=f"run it: python {out / 'render.py'} --out HOGELS (with bpy), or in Blender: "
            f"blender -b -P {out / 'render.py'} -- --out HOGELS",
        )
    if settings is None:
        raise InputError("C and C* need --near, the distance by which they step back from the plate")
    cameras = cameras_of(scene, settings, apertures or scene.default_apertures())
    written = {Renderer.GLTF: gltf, Renderer.MITSUBA: mitsuba}.get(chosen, dict)(cameras)
    name = CAMERA_FILES[chosen]
    with Staging(out, (name,)) as staging:
        text = json.dumps(json_ready(written), allow_nan=False, indent=1)
        (staging.folder / name).write_text(text + "\n", encoding="utf-8")
        files = staging.commit()
    return CameraFiles(renderer=chosen, files=files, next_step=f"read CONVENTIONS.md, and {files[0]}")


DEPTH_FUNCTIONS = {
    DepthMapping.STANDARD: "f (w - n) / (w (f - n))",
    DepthMapping.GL: "f (w - n) / (w (f - n))",
    DepthMapping.REVERSED: "n (f - w) / (w (f - n))",
    DepthMapping.LOGARITHMIC: "ln(w/n) / ln(f/n)",
    DepthMapping.LINEAR: "(w - n) / (f - n)",
}
"""Stored depth at distance w from a camera with near plane n and far plane f (CONVENTIONS.md, "Depth")."""

CONVENTIONS = (
    "Scene coordinates are right-handed: the plate is z = 0, +z points to the viewer, x right, y up.",
    "Matrices are row-major, named target-from-source, and multiply column vectors.",
    "Clip x/w and y/w are the film coordinates u (to the right) and v (up), both in [-1, 1]; the flips of "
    "C* are in its "
    "matrix. The center of pixel (column c, row r; row 0 at the top) is u = (2c + 1)/W - 1, v = 1 - (2r + "
    "1)/H.",
    "Clip w is the distance from the camera along its axis. Only points with near <= w <= far are drawn.",
    "Passes are drawn in the order given, each with its depth buffer cleared to `clear`, over those before "
    "it. Depth tests "
    "are strict: of equal depths the one drawn first stays. Nothing is culled unless `culled_face` says so.",
)
"""What a reader of the file must know, in the words of CONVENTIONS.md."""


def cameras_of(scene: Scene, settings: DoubleFrustum, apertures: Sequence[Aperture]) -> Record:
    """Return the cameras of some apertures: the JSON object of `camera --for json`.

    It has the question as the scene file and the command line put it, angles in radians, and the passes of
    each aperture in drawing order, the farthest from the viewer first. Slabs in which the scene has nothing
    are left out, as `raster` leaves them out.

    Raises
    ------
    InputError
        The settings make no sense for the scene.
    """
    settings.check_against(scene.frustum)
    slabs = cameras_in_order(scene, settings)
    return {
        "scene": scene.name,
        "scene_hash": scene.content_hash,
        "units": scene.units,
        "conventions": CONVENTIONS,
        "plate": scene.plate,
        "frustum": scene.frustum,
        "settings": settings,
        "apertures": [
            {
                "aperture": aperture.index,
                "center": (aperture.x, aperture.y, 0.0),
                "passes": [_camera_pass(scene, settings, aperture, slab) for slab in slabs],
            }
            for aperture in apertures
        ],
    }


def _camera_pass(scene: Scene, settings: DoubleFrustum, aperture: Aperture, slab: SlabCamera) -> Record:
    """Return one camera of one aperture, and what it draws.

    `film_flipped` says whether the film is flipped left-right and up-down against the ordinary picture of a
    camera that looks that way with its y axis up and its x axis to the right as the viewer sees them; `shear`
    and `half_extent` are k and t of the film in slopes about the center of projection, the factor of the fit
    included; `heights` the lowest and highest z between the two planes; `front_face` is the window winding of
    faces that are turned to the camera, `culled_face` those that are left out, as OpenGL names them.
    """
    drawn = pass_of(scene, aperture, settings, slab)
    window = FilmWindow.of(scene.frustum, aperture)
    return {
        "camera": "c" if slab.orthoscopic else "c-star",
        "clip_from_scene": drawn.clip_from_scene,
        "position": center_of_projection(drawn.clip_from_scene),
        "looks_to": "-z" if slab.orthoscopic else "+z",
        "film_flipped": not slab.orthoscopic,
        "shear": (-window.axis[0], -window.axis[1]),
        "half_extent": (window.half_width * slab.scale, window.half_height * slab.scale),
        "near": slab.near,
        "far": slab.far,
        "heights": drawn.heights,
        "wins": "nearest" if slab.orthoscopic else "farthest",
        "depth": _depth(settings, drawn),
        "front_face": drawn.front_face,
        "culled_face": drawn.culled_face,
    }


def _depth(settings: DoubleFrustum, drawn: Pass) -> Record:
    """Return the depth buffer of a pass.

    What is stored at both planes, between which depths over w it clips, whether the fragment writes it
    because no interpolation gives it, and its test and clear value.
    """
    mapping = MAPPINGS[settings.mapping]
    return {
        "format": settings.depth,
        "mapping": settings.mapping,
        "function": DEPTH_FUNCTIONS[settings.mapping],
        "near_value": mapping.stored_near,
        "far_value": mapping.stored_far,
        "clip_range": (-1.0, 1.0) if settings.mapping is DepthMapping.GL else (0.0, 1.0),
        "written_by_fragment": bool(mapping.fragment_depth),
        "test": drawn.test.function,
        "clear": drawn.test.clear,
    }


def center_of_projection(clip_from_scene: Floats) -> tuple[float, float, float]:
    """Return the point at which clip x, y and w are all zero."""
    rows = clip_from_scene[(0, 1, 3), :]
    x, y, z = np.linalg.solve(rows[:, :3], -rows[:, 3])
    # Adding zero turns a negative zero into a positive one.
    return float(x) + 0.0, float(y) + 0.0, float(z) + 0.0


# glTF and Mitsuba

MAX_PIXEL_ASPECT_DEVIATION = 1e-9
"""Largest relative deviation of a pixel's width from its height at which it counts as square. A film 1e4
pixels wide then ends within 1e-5 pixels of where it should."""

HALF_TURN_ABOUT_Y = (0.0, 1.0, 0.0, 0.0)
"""Quaternion (x, y, z, w) of the rotation that makes a camera look to +z."""

GLTF_NOTE = (
    "A glTF camera has neither an off-axis film nor a film that is flipped: each camera here is the "
    "smallest ordinary one "
    "that contains the film. From its picture (x to the right, y up, both from -1 to 1) cut the rectangle "
    "`film`, and "
    "reverse the rows where `rows_reversed` says so. In passes where the farthest surface wins, reverse the "
    "depth test and "
    "clear depth to the near plane."
)
"""What a reader of the glTF file must know."""


def _passes(cameras: Record) -> Iterator[tuple[tuple[int, int], int, Record]]:
    """Yield aperture, number and camera of every pass."""
    for one in cameras["apertures"]:
        for number, camera in enumerate(one["passes"]):
            yield one["aperture"], number, camera


@dataclass(frozen=True, kw_only=True)
class Ordinary:
    """An ordinary camera that contains the film of a pass.

    Half-extents of its picture, slopes; left, right, bottom and top of the film in its picture, which runs
    from -1 to 1; and whether the film's rows run upward in it.
    """

    half_extent: tuple[float, float]
    film: tuple[float, float, float, float]
    rows_reversed: bool


def ordinary(camera: Record) -> Ordinary:
    """Return the smallest camera with a centered picture that contains the film of a pass.

    A camera that looks to +z is an ordinary one turned about its y axis: the film of C* is that picture with
    its rows reversed, for slopes k + u t grow with its x, and k + v t against its y.
    """
    (kx, ky), (tx, ty) = camera["shear"], camera["half_extent"]
    half = abs(kx) + tx, abs(ky) + ty
    middle = -ky if camera["film_flipped"] else ky
    film = ((kx - tx) / half[0], (kx + tx) / half[0], (middle - ty) / half[1], (middle + ty) / half[1])
    return Ordinary(half_extent=half, film=film, rows_reversed=camera["film_flipped"])


def gltf(cameras: Record) -> Record:
    """Return a glTF 2.0 document with a camera and a node for each pass."""
    lenses: list[Record] = []
    nodes: list[Record] = []
    for aperture, number, camera in _passes(cameras):
        lens = ordinary(camera)
        name = f"{camera['camera']} {aperture[0]},{aperture[1]} pass {number}"
        perspective = {
            "yfov": 2 * math.atan(lens.half_extent[1]),
            "aspectRatio": lens.half_extent[0] / lens.half_extent[1],
            "znear": camera["near"],
            "zfar": camera["far"],
        }
        told = {
            "aperture": aperture,
            "pass": number,
            "film": dict(zip(("left", "right", "bottom", "top"), lens.film, strict=True)),
            "rows_reversed": lens.rows_reversed,
            "wins": camera["wins"],
            "clip_from_scene": camera["clip_from_scene"],
        }
        node = {"name": name, "camera": len(lenses), "translation": camera["position"], "extras": told}
        lenses.append({"name": name, "type": "perspective", "perspective": perspective})
        nodes.append(node | ({"rotation": HALF_TURN_ABOUT_Y} if camera["looks_to"] == "+z" else {}))
    told = {"note": GLTF_NOTE, "units": cameras["units"]}
    return {
        "asset": {"version": "2.0", "generator": "xfrustum", "extras": told},
        "scene": 0,
        "scenes": [{"name": cameras["scene"], "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": lenses,
    }


def mitsuba(cameras: Record) -> Record:
    """Return a sensor plugin of Mitsuba 3 as a dict for each pass.

    `to_world` is a list of rows: give it to `mitsuba.ScalarTransform4f` before `mitsuba.load_dict`.

    Raises
    ------
    InputError
        The pixels of the film are not square, which Mitsuba's sensor takes for granted.
    """
    sensors = [
        {
            "aperture": aperture,
            "pass": number,
            "camera": camera["camera"],
            "wins": camera["wins"],
            "rows_reversed": camera["film_flipped"],
            "sensor": _sensor(camera, cameras["frustum"].resolution),
        }
        for aperture, number, camera in _passes(cameras)
    ]
    return {"scene": cameras["scene"], "units": cameras["units"], "sensors": sensors}


def _sensor(camera: Record, resolution: tuple[int, int]) -> Record:
    """Return the dict of a `perspective` sensor, which may have its principal point off the center."""
    (kx, ky), (tx, ty) = camera["shear"], camera["half_extent"]
    width, height = resolution
    if abs(ty * width / (tx * height) - 1) > MAX_PIXEL_ASPECT_DEVIATION:
        raise InputError(
            f"a pixel of this film is {tx / width / (ty / height):.6g} times as wide as high, and Mitsuba's "
            "sensors have square pixels; choose another resolution, or --for json"
        )
    up = -ky if camera["film_flipped"] else ky
    to_world = np.eye(4)
    # In the sensor's own coordinates z points forward, y up and x to the left.
    forward = -1.0 if camera["looks_to"] == "-z" else 1.0
    to_world[:3, :3] = np.diag([forward, 1.0, forward])
    to_world[:3, 3] = camera["position"]
    return {
        "type": "perspective",
        "fov_axis": "x",
        "fov": math.degrees(2 * math.atan(tx)),
        "principal_point_offset_x": kx / (2 * tx),
        "principal_point_offset_y": -up / (2 * ty),
        "near_clip": camera["near"],
        "far_clip": camera["far"],
        "to_world": to_world,
        "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
    }
