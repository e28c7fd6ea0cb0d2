"""Images as pictures: as a screen shows them, by height, and with wrong pixels marked."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.appearance.display import LEVELS, encoded
from xfrustum.scenes.arrays import Bytes, Floats, Mask, Singles

SHADES = (0.35, 0.9)
"""Darkest and lightest gray of surfaces in pictures without color, by height."""

WRONG = (224, 49, 49)
"""Color of pixels that show a wrong surface."""

MOVED = (49, 130, 224)
"""Color of pixels that show a point displaced by a stated amount, or more."""

DIMMED, MARKED = 0.5, 0.8
"""Brightness of a picture under marks, and opacity of the mark of a displaced pixel."""

MIN_SIDE_PX = 280
"""Longest side that smaller pictures are enlarged to, as far as pixels become squares of whole pixels."""

MAX_SIDE_PX = 512
"""Longest side of a picture in a notebook; larger images are reduced, so that notebooks stay small."""


def as_shown(color: Singles | None, covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return an image as a screen shows it, (H, W, 3); without colors, surfaces are gray by their height.

    Parameters
    ----------
    color
        (H, W, 3) linear RGB; None where there is none.
    covered
        (H, W) pixels that show a surface.
    height
        (H, W) height of the surface, NaN where it is not known.
    """
    return by_height(covered, height) if color is None else levels(encoded(color))


def by_height(covered: Mask, height: NDArray[np.floating]) -> Bytes:
    """Return surfaces as shades of gray, (H, W, 3): the lowest dark, the highest light, black for none."""
    gray = np.zeros(covered.shape)
    known = np.isfinite(height)
    gray[covered] = SHADES[0]
    if known.any():
        low, high = float(height[known].min()), float(height[known].max())
        share = (height[known] - low) / (high - low if high > low else 1.0)
        gray[known] = SHADES[0] + share * (SHADES[1] - SHADES[0])
    return levels(np.repeat(gray[..., None], 3, axis=-1))


def levels(values: Singles | Floats) -> Bytes:
    """Return values from 0 to 1 as levels of 8 bits."""
    found: Bytes = np.rint(LEVELS * np.asarray(values)).astype(np.uint8)
    return found


def marked(picture: Bytes, wrong: Mask | None, moved: Floats) -> Bytes:
    """Return a dimmed gray picture on which wrong surfaces are red and displaced points blue, (H, W, 3).

    Parameters
    ----------
    picture
        (H, W, 3) picture.
    wrong
        (H, W) pixels that show a wrong surface; None where they are not known.
    moved
        (H, W) displacement as a share of the one that is shown in full color; NaN where there is none.
    """
    gray = picture.mean(axis=-1, keepdims=True) * DIMMED
    found = np.repeat(gray, 3, axis=-1)
    share = np.nan_to_num(np.clip(moved, 0.0, 1.0))[..., None]
    found = found * (1 - MARKED * share) + MARKED * share * np.array(MOVED)
    if wrong is not None:
        found[wrong] = WRONG
    rounded: Bytes = np.rint(found).astype(np.uint8)
    return rounded


def map_of(values: Floats) -> Bytes:
    """Return numbers (rows, columns) as squares, the largest the brightest; black where there is none."""
    known = np.isfinite(values)
    largest = float(values.max(where=known, initial=0.0))
    share = np.where(known, SHADES[0] + (1 - SHADES[0]) * np.nan_to_num(values) / (largest or 1.0), 0.0)
    return levels(np.repeat(share[..., None], 3, axis=-1))


def png(picture: Bytes) -> bytes:
    """Return a picture (H, W, 3) as PNG of `MIN_SIDE_PX` to `MAX_SIDE_PX` pixels, in whole steps of size."""
    from PIL import Image  # noqa: PLC0415 - images are opened without it

    longest = max(picture.shape[:2])
    factor = max(1, MIN_SIDE_PX // longest)
    larger = picture.repeat(factor, axis=0).repeat(factor, axis=1)
    image = Image.fromarray(np.ascontiguousarray(larger))
    divisor = -(-longest // MAX_SIDE_PX)
    stream = io.BytesIO()
    (image if divisor == 1 else image.reduce(divisor)).save(stream, format="PNG", optimize=True)
    return stream.getvalue()
