"""The cameras C and C* as nodes of a glTF file, and as sensors of Mitsuba 3."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from xfrustum.reports.exchange.cameras import CameraPass, Cameras
from xfrustum.scenes.errors import InputError

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


@dataclass(frozen=True, kw_only=True)
class Ordinary:
    """An ordinary camera that contains the film of a pass.

    Attributes
    ----------
    half_extent
        Half-extents of its picture, slopes.
    film
        Left, right, bottom and top of the film in its picture, which runs from -1 to 1.
    rows_reversed
        Whether the film's rows run upward in its picture.
    """

    half_extent: tuple[float, float]
    film: tuple[float, float, float, float]
    rows_reversed: bool


def ordinary(one: CameraPass) -> Ordinary:
    """Return the smallest camera with a centered picture that contains the film of a pass.

    A camera that looks to +z is an ordinary one turned about its y axis: the film of C* is that picture with
    its rows reversed, for slopes k + u t grow with its x, and k + v t against its y.
    """
    (kx, ky), (tx, ty) = one.shear, one.half_extent
    half = abs(kx) + tx, abs(ky) + ty
    middle = -ky if one.film_flipped else ky
    film = ((kx - tx) / half[0], (kx + tx) / half[0], (middle - ty) / half[1], (middle + ty) / half[1])
    return Ordinary(half_extent=half, film=film, rows_reversed=one.film_flipped)


def gltf(cameras: Cameras) -> dict[str, object]:
    """Return a glTF 2.0 document with a camera and a node for each pass."""
    lenses, nodes = [], []
    for one in cameras.apertures:
        for number, camera in enumerate(one.passes):
            lens = ordinary(camera)
            column, row = one.aperture
            name = f"{camera.camera} {column},{row} pass {number}"
            lenses.append(
                {
                    "name": name,
                    "type": "perspective",
                    "perspective": {
                        "yfov": 2 * math.atan(lens.half_extent[1]),
                        "aspectRatio": lens.half_extent[0] / lens.half_extent[1],
                        "znear": camera.near,
                        "zfar": camera.far,
                    },
                }
            )
            node: dict[str, object] = {
                "name": name,
                "camera": len(lenses) - 1,
                "translation": camera.position,
                "extras": {
                    "aperture": one.aperture,
                    "pass": number,
                    "film": dict(zip(("left", "right", "bottom", "top"), lens.film, strict=True)),
                    "rows_reversed": lens.rows_reversed,
                    "wins": camera.wins,
                    "clip_from_scene": camera.clip_from_scene,
                },
            }
            if camera.looks_to == "+z":
                node["rotation"] = HALF_TURN_ABOUT_Y
            nodes.append(node)
    return {
        "asset": {
            "version": "2.0",
            "generator": "xfrustum",
            "extras": {"note": GLTF_NOTE, "units": cameras.units},
        },
        "scene": 0,
        "scenes": [{"name": cameras.scene, "nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": lenses,
    }


def mitsuba(cameras: Cameras) -> dict[str, object]:
    """Return a sensor plugin of Mitsuba 3 as a dict for each pass.

    `to_world` is a list of rows: give it to `mitsuba.ScalarTransform4f` before `mitsuba.load_dict`.

    Raises
    ------
    InputError
        The pixels of the film are not square, which Mitsuba's sensor takes for granted.
    """
    width, height = cameras.frustum.resolution
    sensors = []
    for one in cameras.apertures:
        for number, camera in enumerate(one.passes):
            sensors.append(
                {
                    "aperture": one.aperture,
                    "pass": number,
                    "camera": camera.camera,
                    "wins": camera.wins,
                    "rows_reversed": camera.film_flipped,
                    "sensor": _sensor(camera, (width, height)),
                }
            )
    return {"scene": cameras.scene, "units": cameras.units, "sensors": sensors}


def _sensor(camera: CameraPass, resolution: tuple[int, int]) -> dict[str, object]:
    """Return the dict of a `perspective` sensor, which may have its principal point off the center."""
    (kx, ky), (tx, ty) = camera.shear, camera.half_extent
    width, height = resolution
    if abs(ty * width / (tx * height) - 1) > MAX_PIXEL_ASPECT_DEVIATION:
        raise InputError(
            f"a pixel of this film is {tx / width / (ty / height):.6g} times as wide as high, and Mitsuba's "
            f"sensors have "
            "square pixels; choose another resolution, or --for json"
        )
    up = -ky if camera.film_flipped else ky
    to_world = np.eye(4)
    # In the sensor's own coordinates z points forward, y up and x to the left.
    forward = -1.0 if camera.looks_to == "-z" else 1.0
    to_world[:3, :3] = np.diag([forward, 1.0, forward])
    to_world[:3, 3] = camera.position
    return {
        "type": "perspective",
        "fov_axis": "x",
        "fov": math.degrees(2 * math.atan(tx)),
        "principal_point_offset_x": kx / (2 * tx),
        "principal_point_offset_y": -up / (2 * ty),
        "near_clip": camera.near,
        "far_clip": camera.far,
        "to_world": to_world,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
        },
    }
