"""Renderers for the conformance suite: the ray caster of `tests.wrong_renderers`.

It reads only the folder of a case. The environment variable XFRUSTUM_TOY selects a mistake, a toy
of `tests.wrong_renderers`.
"""

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.wrong_renderers import ray_caster
from tests.wrong_renderers.new_toys import TOYS
from tests.wrong_renderers.ray_caster import RIGHT, Picture
from tests.wrong_renderers.worlds import Floats, Ints, Part, World


@cache
def world_of(folder: Path, name: str) -> World:
    """Return the scene in a case's folder."""
    case = json.loads((folder / "case.json").read_text())
    scene, objects, lights = np.load(folder / "scene.npz"), case["objects"], case["lights"]
    if case["asked"] in ("rgb", "srgb"):
        shiny = any(any(part["material"]["reflectivity"]) for part in objects)
        if case["environment"] or shiny or any(part["textured"] for part in objects):
            raise NotImplementedError("reflection and textures")
        if len(lights) != 1 or lights[0]["color"] != [1.0, 1.0, 1.0]:
            raise NotImplementedError("one white light")
        if case["apertures"][0]["sub_apertures"]:
            raise NotImplementedError("band limiting")
    parts = []
    for number, part in enumerate(objects):
        begin, end = scene["first_triangle"][number : number + 2]
        first, last = scene["first_vertex"][number : number + 2]
        look, corners = part["material"], scene["vertices"][first:last]
        parts.append(
            Part(
                name=part["name"],
                corners=corners,
                faces=scene["faces"][begin:end] - first,
                diffuse=tuple(look["diffuse"]),
                ambient=look["ambient"][0],
                specular=look["specular"][0],
                exponent=look["exponent"],
                smooth=part["smooth"],
                hidden=name == "L0-numbers" and bool((corners[:, 0] > 300).all()),
            )
        )
    screen = case["screen"]
    return World(
        name=name,
        size=tuple(case["plate"]["size"]),
        hogels=tuple(case["plate"]["hogels"]),
        resolution=tuple(case["resolution"]),
        reach=tuple(case["reach"]),
        parts=tuple(parts),
        light=tuple(lights[0]["direction"]),
        fov_deg=tuple(np.degrees(case["fov"]).tolist()) if case["fov"] else (0.0, 0.0),
        screen=screen and (screen["height"], *screen["center"], *screen["size"]),
    )


def draw(folder: Path, case: dict[str, Any], hogel: tuple[int, int]) -> Floats | Ints:
    """Draw a hogel with the ray caster and the stated near offset."""
    if not case["objects"]:
        width, height = case["resolution"]
        return np.zeros((height, width), dtype=np.int64)
    world = world_of(folder, case["name"])
    shown = ray_caster.draw(world, *hogel, replace(RIGHT, near=case["near"] or RIGHT.near))
    if case["asked"] in ("rgb", "srgb"):
        return shown.radiance
    return ray_caster.numbers(world, shown, case["asked"])


def bars(folder: Path, case: dict[str, Any], hogel: tuple[int, int]) -> Floats:
    """Draw surfaces in their vertex colors, averaged over the sub-apertures."""
    scene = np.load(folder / "scene.npz")
    (aperture,) = [a for a in case["apertures"] if a["hogel"] == list(hogel)]
    width, height = case["resolution"]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    (kx, ky), (tx, ty) = aperture["shear"], aperture["half_extent"]
    x, y = np.meshgrid(kx + u * tx, ky + v * ty)
    lines = np.stack([x, y, np.full(x.shape, -1.0)], axis=-1)
    corners = scene["vertices"][scene["faces"]]
    colors, mean = scene["vertex_colors"][scene["faces"]], np.zeros(lines.shape)
    for px, py in aperture["sub_apertures"]:
        # Weights of a triangle's corners (F, H, W, 3) whose sum is the point at s = 1.
        weights = lines @ np.linalg.inv(corners - (px, py, 0.0))[:, None]
        total = weights.sum(axis=-1)
        met = np.all(weights * total[..., None] >= 0, axis=-1) & (total != 0)
        s = np.divide(1.0, total, out=np.full(total.shape, np.inf), where=met)
        first, nearest = s.argmin(axis=0), s.min(axis=0)
        nearest[np.isinf(nearest)] = 0.0
        shown = np.take_along_axis(weights, first[None, ..., None], axis=0)[0] * nearest[..., None]
        mean += np.einsum("hwk,hwkc->hwc", shown, colors[first]) / len(aperture["sub_apertures"])
    return mean


def toy(folder: Path, case: dict[str, Any], hogel: tuple[int, int]) -> Picture | Ints | Floats:
    """Draw a hogel with the wrong renderer that the environment variable selects."""
    name = os.environ["XFRUSTUM_TOY"]
    if case["near"]:
        raise NotImplementedError("no stated near offset")
    picture = TOYS[name].draw(world_of(folder, case["name"]), *hogel, case["asked"])
    if case["asked"] in ("rgb", "srgb"):
        return picture
    return np.asarray(picture.astype(np.int64) @ [65536, 256, 1])
