"""Renderers that are taken through the conformance suite: the ray caster of `tests.wrong_renderers`.

It reads the folder of a case alone. What it gets wrong is a toy of `tests.wrong_renderers`, chosen
by the variable XFRUSTUM_TOY, or a mistake that is made here.
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
from tests.wrong_renderers.ray_caster import RIGHT, Mistakes, Picture
from tests.wrong_renderers.worlds import Floats, Ints, Part, World


@cache
def world_of(folder: Path, asked_name: str) -> World:
    """Return the scene of a case's folder."""
    asked = json.loads((folder / "case.json").read_text())
    scene = np.load(folder / "scene.npz")
    parts = []
    lit = asked["asked"] in ("rgb", "srgb")
    if lit:
        shiny = [any(one["material"]["reflectivity"]) for one in asked["objects"]]
        if asked["environment"] or any(shiny) or any(one["textured"] for one in asked["objects"]):
            raise NotImplementedError("reflection and textures")
        if len(asked["lights"]) != 1 or asked["lights"][0]["color"] != [1.0, 1.0, 1.0]:
            raise NotImplementedError("one white light")
        if asked["apertures"][0]["sub_apertures"]:
            raise NotImplementedError("band limiting")
    for number, one in enumerate(asked["objects"]):
        begin, end = scene["first_triangle"][number : number + 2]
        first, last = scene["first_vertex"][number : number + 2]
        look = one["material"]
        corners, faces = scene["vertices"][first:last], scene["faces"][begin:end] - first
        parts.append(
            Part(
                name=one["name"], corners=corners, faces=faces, diffuse=tuple(look["diffuse"]),
                ambient=look["ambient"][0], specular=look["specular"][0], exponent=look["exponent"],
                smooth=one["smooth"], hidden=asked_name == "L0-numbers" and bool((corners[:, 0] > 300).all()),
            )
        )  # fmt: skip
    screen = asked["screen"]
    return World(
        name=asked_name,
        size=tuple(asked["plate"]["size"]),
        hogels=tuple(asked["plate"]["hogels"]),
        resolution=tuple(asked["resolution"]),
        reach=tuple(asked["reach"]),
        parts=tuple(parts),
        light=tuple(asked["lights"][0]["direction"]),
        fov_deg=tuple(np.degrees(asked["fov"]).tolist()) if asked["fov"] else (0.0, 0.0),
        screen=screen and (screen["height"], *screen["center"], *screen["size"]),
    )


def drawn_right(
    folder: Path, asked: dict[str, Any], hogel: tuple[int, int], wrong: Mistakes = RIGHT
) -> Floats | Ints:
    """Draw a hogel as the ray caster does, with the near offset that is stated."""
    if not asked["objects"]:
        width, height = asked["resolution"]
        return np.zeros((height, width), dtype=np.int64)
    world = world_of(folder, asked["name"])
    mistakes = replace(wrong, near=asked["near"]) if asked["near"] and not wrong.near else wrong
    shown = ray_caster.draw(world, *hogel, mistakes)
    if asked["asked"] in ("rgb", "srgb"):
        return shown.radiance
    return ray_caster.numbers(world, shown, asked["asked"])


def draw(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Floats | Ints:
    """Draw a hogel as the ray caster does, rightly."""
    return drawn_right(folder, asked, hogel)


def bars(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Floats:
    """Draw surfaces that show their vertex colors alone, as the mean over the sub-apertures."""
    scene = np.load(folder / "scene.npz")
    (one,) = [a for a in asked["apertures"] if a["hogel"] == list(hogel)]
    width, height = asked["resolution"]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    (kx, ky), (tx, ty) = one["shear"], one["half_extent"]
    x, y = np.meshgrid(kx + u * tx, ky + v * ty)
    lines, corners = (
        np.stack([x, y, np.full(x.shape, -1.0)], axis=-1),
        scene["vertices"][scene["faces"]],
    )
    colors, mean = scene["vertex_colors"][scene["faces"]], np.zeros(lines.shape)
    for px, py in one["sub_apertures"]:
        # The weights of the corners of a triangle (F, H, W, 3) are those that add up to the point
        # at s = 1.
        weights = lines @ np.linalg.inv(corners - (px, py, 0.0))[:, None]
        total = weights.sum(axis=-1)
        met = np.all(weights * total[..., None] >= 0, axis=-1) & (total != 0)
        s = np.divide(1.0, total, out=np.full(total.shape, np.inf), where=met)
        first, nearest = s.argmin(axis=0), s.min(axis=0)
        nearest[np.isinf(nearest)] = 0.0
        shown = np.take_along_axis(weights, first[None, ..., None], axis=0)[0] * nearest[..., None]
        mean += np.einsum("hwk,hwkc->hwc", shown, colors[first]) / len(one["sub_apertures"])
    return mean


def toy(folder: Path, asked: dict[str, Any], hogel: tuple[int, int]) -> Picture | Ints | Floats:
    """Draw a hogel as the wrong renderer does that the environment names."""
    name = os.environ["XFRUSTUM_TOY"]
    if asked["near"]:
        raise NotImplementedError("no stated near offset")
    picture = TOYS[name].draw(world_of(folder, asked["name"]), *hogel, asked["asked"])
    if asked["asked"] in ("rgb", "srgb"):
        return picture
    return np.asarray(picture.astype(np.int64) @ [65536, 256, 1])
