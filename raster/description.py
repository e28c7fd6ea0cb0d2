"""Description of the cameras C and C* for other renderers, at any settings and aperture.

`cameras_of` makes the full description, from which `gltf` and `mitsuba` make their cameras.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from xfrustum.raster.cameras import MAPPINGS, FilmWindow, SlabCamera, cameras_in_order, pass_of
from xfrustum.scenes import Aperture, DepthMapping, DoubleFrustum, InputError, Scene

#: a JSON object, or a part of it
Record = dict[str, Any]

#: Stored depth at distance w from a camera with near plane n and far plane f (CONVENTIONS.md,
#: "Depth")
DEPTH_FUNCTIONS = {
    DepthMapping.STANDARD: "f (w - n) / (w (f - n))",
    DepthMapping.GL: "f (w - n) / (w (f - n))",
    DepthMapping.REVERSED: "n (f - w) / (w (f - n))",
    DepthMapping.LOGARITHMIC: "ln(w/n) / ln(f/n)",
    DepthMapping.LINEAR: "(w - n) / (f - n)",
}

#: Conventions for readers of the file, as in CONVENTIONS.md
CONVENTIONS = (
    "Scene coordinates are right-handed: the plate is z = 0, +z points to the viewer, x right, y "
    "up.",
    "Matrices are row-major, named target-from-source, and multiply column vectors.",
    "Clip x/w and y/w are the film coordinates u (to the right) and v (up), both in [-1, 1]; the "
    "flips of C* are in its matrix. The center of pixel (column c, row r; row 0 at the top) is u "
    "= (2c + 1)/W - 1, v = 1 - (2r + 1)/H.",
    "Clip w is the distance from the camera along its axis. Only points with near <= w <= far are "
    "drawn.",
    "Passes are drawn in the order given, each with its depth buffer cleared to `clear`, over "
    "earlier passes. Depth tests are strict: of two surfaces at equal depth, the surface drawn "
    "first stays. No face is culled unless `culled_face` names it.",
)


def cameras_of(scene: Scene, settings: DoubleFrustum, apertures: Sequence[Aperture]) -> Record:
    """Return the cameras of some apertures: the JSON object of `camera --for json`.

    It has the settings of the scene file and the command line, angles in radians, and the passes of
    each aperture in drawing order, from the pass farthest from the viewer. Empty slabs are left
    out, as in `raster`. Raises InputError for impossible settings.
    """
    settings.check_against(scene.frustum)
    slabs, mapping = cameras_in_order(scene, settings), MAPPINGS[settings.mapping]

    def camera(aperture: Aperture, slab: SlabCamera) -> Record:
        drawn, window = (
            pass_of(scene, aperture, settings, slab),
            FilmWindow.from_frustum(scene.frustum, aperture),
        )
        rows = drawn.clip_from_scene[(0, 1, 3), :]
        # Clip x, y and w are zero at the position. Adding zero turns a negative zero into a
        # positive zero.
        x, y, z = np.linalg.solve(rows[:, :3], -rows[:, 3]) + 0.0
        return {
            "camera": "c" if slab.orthoscopic else "c-star",
            "clip_from_scene": drawn.clip_from_scene,
            "position": (float(x), float(y), float(z)),
            "looks_to": "-z" if slab.orthoscopic else "+z",
            # True if the film is flipped left-right and up-down, relative to a picture with y up.
            "film_flipped": not slab.orthoscopic,
            # Lines through the center of projection have -dx/dz = k + u t: `shear` is k, and
            # `half_extent` is t with the factor of the fit.
            "shear": (-window.axis[0], -window.axis[1]),
            "half_extent": (window.half_width * slab.scale, window.half_height * slab.scale),
            "near": slab.near,
            "far": slab.far,
            "heights": drawn.heights,
            "wins": "nearest" if slab.orthoscopic else "farthest",
            "depth": {
                "format": settings.depth,
                "mapping": settings.mapping,
                "function": DEPTH_FUNCTIONS[settings.mapping],
                "near_value": mapping.stored_near,
                "far_value": mapping.stored_far,
                # Range of clip depth over w.
                "clip_range": (-1.0, 1.0) if settings.mapping is DepthMapping.GL else (0.0, 1.0),
                "written_by_fragment": bool(
                    mapping.fragment_depth
                ),  # interpolation in the rasterizer cannot produce this depth
                "test": drawn.depth_function,
                "clear": drawn.clear,
            },
            # Window winding of faces that are turned to the camera, and culled faces, as in OpenGL.
            "front_face": drawn.front_face,
            "culled_face": drawn.culled_face,
        }

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
                "passes": [camera(aperture, slab) for slab in slabs],
            }
            for aperture in apertures
        ],
    }


# glTF and Mitsuba

#: Largest relative difference of width and height at which a pixel counts as square. At the end of
#: a film 1e4 pixels wide, the error is at most 1e-5 pixels.
MAX_PIXEL_ASPECT_DEVIATION = 1e-9

#: Quaternion (x, y, z, w) of the rotation that makes a camera look to +z
HALF_TURN_ABOUT_Y = (0.0, 1.0, 0.0, 0.0)

#: Conventions for readers of the glTF file
GLTF_NOTE = (
    "A glTF camera has neither an off-axis film nor a film that is flipped: each camera here is "
    "the smallest ordinary one that contains the film. From its picture (x to the right, y up, "
    "both from -1 to 1) cut the rectangle `film`, and reverse the rows where `rows_reversed` says "
    "so. In passes where the farthest surface wins, reverse the depth test and clear depth to the "
    "near plane."
)


def _passes(cameras: Record) -> Iterator[tuple[Record, Record]]:
    """Yield every camera with the notes common to glTF and Mitsuba."""
    for entry in cameras["apertures"]:
        for number, camera in enumerate(entry["passes"]):
            notes = {
                "aperture": entry["aperture"],
                "pass": number,
                "rows_reversed": camera["film_flipped"],
            }
            yield camera, notes | {"wins": camera["wins"]}


def gltf(cameras: Record) -> Record:
    """Return a glTF 2.0 document with a camera and a node for each pass.

    The camera has the smallest centered picture that contains the film. A camera that looks to +z
    is an ordinary camera turned about its y axis. The film of C* is this picture with rows
    reversed: slopes k + u t increase with the picture's x, but slopes k + v t decrease with its y.
    """
    lenses: list[Record] = []
    nodes: list[Record] = []
    for camera, notes in _passes(cameras):
        (kx, ky), (tx, ty) = camera["shear"], camera["half_extent"]
        across, up = abs(kx) + tx, abs(ky) + ty
        middle = -ky if camera["film_flipped"] else ky
        sides = ((kx - tx) / across, (kx + tx) / across, (middle - ty) / up, (middle + ty) / up)
        column, row = notes["aperture"]
        name = f"{camera['camera']} {column},{row} pass {notes['pass']}"
        ends = {"znear": camera["near"], "zfar": camera["far"]}
        perspective = {"yfov": 2 * math.atan(up), "aspectRatio": across / up, **ends}
        film = dict(zip(("left", "right", "bottom", "top"), sides, strict=True))
        extras = notes | {"film": film, "clip_from_scene": camera["clip_from_scene"]}
        node = {
            "name": name,
            "camera": len(lenses),
            "translation": camera["position"],
            "extras": extras,
        }
        lenses.append({"name": name, "type": "perspective", "perspective": perspective})
        nodes.append(node | ({"rotation": HALF_TURN_ABOUT_Y} if camera["looks_to"] == "+z" else {}))
    noted = {"note": GLTF_NOTE, "units": cameras["units"]}
    return {
        "asset": {"version": "2.0", "generator": "xfrustum", "extras": noted},
        "scene": 0,
        "scenes": [{"name": cameras["scene"], "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": lenses,
    }


def mitsuba(cameras: Record) -> Record:
    """Return a Mitsuba 3 sensor plugin for each pass, as a dict.

    `to_world` is a list of rows: convert it with `mitsuba.ScalarTransform4f` before
    `mitsuba.load_dict`. Raises InputError if pixels of the film are not square, because Mitsuba's
    sensor has only square pixels.
    """
    width, height = cameras["frustum"].resolution
    sensors = []
    for camera, notes in _passes(cameras):
        (kx, ky), (tx, ty) = camera["shear"], camera["half_extent"]
        if abs(ty * width / (tx * height) - 1) > MAX_PIXEL_ASPECT_DEVIATION:
            raise InputError(
                f"a pixel of this film is {tx / width / (ty / height):.6g} times as wide as high, "
                "and Mitsuba's sensors have square pixels; choose another resolution, or --for json"
            )
        to_world = np.eye(4)
        # In the sensor's own coordinates z points forward, y up and x to the left.
        forward = -1.0 if camera["looks_to"] == "-z" else 1.0
        to_world[:3, :3] = np.diag([forward, 1.0, forward])
        to_world[:3, 3] = camera["position"]
        sensor = {
            "type": "perspective",
            "fov_axis": "x",
            "fov": math.degrees(2 * math.atan(tx)),
            # The film may be off center.
            "principal_point_offset_x": kx / (2 * tx),
            "principal_point_offset_y": (ky if camera["film_flipped"] else -ky) / (2 * ty),
            "near_clip": camera["near"],
            "far_clip": camera["far"],
            "to_world": to_world,
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
            },
        }
        sensors.append(notes | {"camera": camera["camera"], "sensor": sensor})
    return {"scene": cameras["scene"], "units": cameras["units"], "sensors": sensors}
