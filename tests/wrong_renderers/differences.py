"""Errors of a picture by brute force: each pixel against every surface that its line meets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.wrong_renderers.ray_caster import Picture, draw, linear, met, numbers, picture
from tests.wrong_renderers.worlds import Ints, World

Mask = NDArray[np.bool_]

# smallest difference in linear radiance of different surfaces; rounding is 1/510
COLOR = 0.1


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Wrong pixels in the worst hogel, relative to pixels with a surface in truth or picture."""

    different: float
    """Share of pixels with any difference (colors: beyond rounding)."""
    wrong: float
    """Share of pixels with a wrong, missing or invalid object, or with a triangle that their line
    does not meet first, or does not meet within a pixel; in plain pictures, share of pixels whose
    colors differ by more than `COLOR`.
    """
    pixels: int  # number of wrong pixels in all hogels


def difference(world: World, pictures: dict[tuple[int, int], Picture], encoding: str) -> Difference:
    """Compare a renderer's pictures with the truth."""
    each = [_of_hogel(world, i, j, made, encoding) for (i, j), made in pictures.items()]
    return Difference(
        different=max(_share(different, shown) for different, _, shown in each),
        wrong=max(_share(wrong, shown) for _, wrong, shown in each),
        pixels=sum(int(wrong.sum()) for _, wrong, _ in each),
    )


def _of_hogel(
    world: World, i: int, j: int, made: Picture, encoding: str
) -> tuple[Mask, Mask, Mask]:
    if encoding in ("rgb", "srgb"):
        right = picture(world, i, j, encoding)
        apart = np.abs(made.astype(int) - right).max(axis=2)
        colors = [linear(of / 255) if encoding == "srgb" else of / 255 for of in (made, right)]
        shown = made.any(axis=2) | (draw(world, i, j).triangle >= 0)
        return apart > 1, np.abs(colors[0] - colors[1]).max(axis=2) > COLOR, shown
    truth = numbers(world, draw(world, i, j), encoding)
    claims = (made.astype(int) * [65536, 256, 1]).sum(axis=2)
    shown, different = (claims != 0) | (truth != 0), claims != truth
    wrong = (
        different
        if encoding == "object-id"
        else different & ~_misplaced(world, i, j, claims, truth)
    )
    return different, wrong, shown


def _share(of: Mask, shown: Mask) -> float:
    return float(of.sum() / max(shown.sum(), 1))


def _misplaced(world: World, i: int, j: int, claims: Ints, truth: Ints) -> Mask:
    """Return pixels whose triangle, of the right object, lies beside the pixel but not under it."""
    count = len(world.triangles)
    object_of = np.append(world.object_of, -1)
    valid = (claims > 0) & (claims <= count) & (truth > 0)
    claimed, true = np.where(valid, claims - 1, count), np.where(truth > 0, truth - 1, count)
    height, width = claims.shape
    under = np.zeros(claims.shape, dtype=bool)
    rows, columns = np.indices(claims.shape)
    near = np.zeros(claims.shape, dtype=bool)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            row, column = rows + down, columns + right
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            keys = (row * width + column) * (count + 1) + claimed
            there = inside & np.isin(keys, met(world, i, j))
            if down == right == 0:
                under = there
            near |= there
    return np.asarray(valid & near & ~under & (object_of[claimed] == object_of[true]))
