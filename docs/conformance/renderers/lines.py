"""The lines of a hogel's pixels, for renderers that cast rays: from the viewer's end of the reach."""

from pathlib import Path
from typing import Any

import numpy as np


def lines(asked: dict[str, Any], hogel: tuple[int, int]) -> tuple[Any, Any]:
    """Return origins and directions (H * W, 3); a point at s behind the plate lies at t = s + reach[0]."""
    if asked["near"]:
        raise NotImplementedError("the true frustum only")
    if asked["asked"] not in ("triangle-id", "object-id"):
        raise NotImplementedError("no colors")
    (one,) = [a for a in asked["apertures"] if a["hogel"] == list(hogel)]
    width, height = asked["resolution"]
    u, v = (2 * np.arange(width) + 1) / width - 1, 1 - (2 * np.arange(height) + 1) / height
    (kx, ky), (tx, ty) = one["shear"], one["half_extent"]
    x, y = np.meshgrid(kx + u * tx, ky + v * ty)
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=-1).reshape(-1, 3)
    return np.asarray(one["center"]) - asked["reach"][0] * directions, directions


def numbers(folder: Path, asked: dict[str, Any], hogel: tuple[int, int], first: Any) -> Any:
    """Return what a case asks for from first triangles (H * W,), -1 for none or beyond the reach."""
    scene = np.load(folder / "scene.npz")
    origins, directions = lines(asked, hogel)
    a, b, c = np.moveaxis(scene["vertices"][scene["faces"][np.maximum(first, 0)]], 1, 0)
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ni,ni->n", a - origins, normal) / np.einsum("ni,ni->n", directions, normal)
    shown = np.where((first >= 0) & (t <= sum(asked["reach"])), first, -1)
    if asked["asked"] == "object-id":
        shown = np.append(scene["object_of_triangle"], -1)[shown]
    width, height = asked["resolution"]
    return shown.reshape(height, width) + 1
