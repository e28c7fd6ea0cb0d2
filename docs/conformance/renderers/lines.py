"""Lines of pixels, and checks of known limits, shared by the renderers of this folder."""

from pathlib import Path
from typing import Any

import numpy as np


def film(asked: dict[str, Any]) -> tuple[Any, Any]:
    """Return u and v (H, W) of the pixels' centers."""
    width, height = asked["resolution"]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    return tuple(np.meshgrid(u, v))


def lines(asked: dict[str, Any], hogel: tuple[int, int]) -> tuple[Any, Any]:
    """Return origins and directions (H * W, 3); a point at depth s has t = s + reach[0]."""
    check_numbers(asked)
    if asked["near"]:
        raise NotImplementedError("the true frustum only")
    (one,) = [a for a in asked["apertures"] if a["hogel"] == list(hogel)]
    (kx, ky), (tx, ty) = one["shear"], one["half_extent"]
    u, v = film(asked)
    x, y = kx + u * tx, ky + v * ty
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=-1).reshape(-1, 3)
    return np.asarray(one["center"]) - asked["reach"][0] * directions, directions


def numbers(folder: Path, asked: dict[str, Any], hogel: tuple[int, int], first: Any) -> Any:
    """Return the numbers that a case requests (H, W); `first` has triangles (H * W,), or -1."""
    scene = np.load(folder / "scene.npz")
    origins, directions = lines(asked, hogel)
    corners = scene["vertices"][scene["faces"][np.maximum(first, 0)]]
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ni,ni->n", a - origins, normal) / np.einsum("ni,ni->n", directions, normal)
    # A line in the plane of a triangle meets the triangle anywhere between its corners.
    ends = asked["reach"][0] - corners[..., 2]
    t = np.clip(np.nan_to_num(t), ends.min(axis=1), ends.max(axis=1))
    shown = np.where((first >= 0) & (t <= sum(asked["reach"])), first + 1, 0)
    width, height = asked["resolution"]
    return asked_for(scene, asked, shown.reshape(height, width))


def asked_for(scene: Any, asked: dict[str, Any], shown: Any) -> Any:
    """Return the numbers (H, W) that a case requests, from triangle numbers plus one."""
    return (
        np.append(-1, scene["object_of_triangle"])[shown] + 1
        if asked["asked"] == "object-id"
        else shown
    )


def check_numbers(asked: dict[str, Any]) -> None:
    """Raise NotImplementedError if the case requests colors."""
    if asked["asked"] not in ("triangle-id", "object-id"):
        raise NotImplementedError("no colors")


SMALLEST = float(np.finfo(np.float32).tiny)
"""Smallest normal float32: 1.2e-38."""


def check_float32(scene: Any, origins: Any = 0.0) -> None:
    """Raise NotImplementedError if float32 cannot store the scene's lengths or line origins."""
    size = np.abs(scene["vertices"])
    if ((size > 0) & (size < SMALLEST)).any():
        raise NotImplementedError("lengths below 1.2e-38, which float32 does not hold")
    if np.abs(origins).max() * 2.0**-24 > size.max(initial=0.0) > 0:
        raise NotImplementedError("lines that begin so far off that float32 misses the whole scene")


def check_two_cameras(scene: Any, asked: dict[str, Any], cameras: dict[str, Any]) -> None:
    """Raise NotImplementedError if two float32 cameras with offset n cannot show the true frustum.

    They draw a point at height z at |z| / (|z| + n) of its distance from the film's middle.
    Therefore they show almost no part of a triangle that is nearer to the plate than n, and no
    useful picture of a scene that is narrower than the film at the distance n.
    """
    check_float32(scene)
    if asked["near"]:
        return
    height = np.abs(scene["vertices"][scene["faces"]][..., 2]).max(axis=1)
    for aperture in cameras["apertures"]:
        for one in aperture["passes"]:
            if ((height > 0) & (height < one["near"])).any():
                raise NotImplementedError("triangles nearer to the plate than the cameras' step")
            extent = np.abs(scene["vertices"][:, :2] - aperture["center"][:2]).max()
            if max(one["half_extent"]) * one["near"] > extent:
                raise NotImplementedError(
                    "a film that is wider than the scene at the cameras' step"
                )
