"""Pictures of views: as an eye sees them, as numbers that a page can read, and as maps of what is lost."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

from xfrustum.compare.eye.loss import LossMaps
from xfrustum.compare.metrics.display import LEVELS, encoded
from xfrustum.scenes.arrays import Bytes, Floats, Singles
from xfrustum.scenes.model.eye_image import EyeImage

SHADES = (0.35, 0.9)
"""Darkest and lightest gray of surfaces in pictures without color, by height."""

WRONG = (224, 49, 49)
"""Color of pixels that show a wrong surface."""

MOVED = (49, 130, 224)
"""Color of pixels that show a point displaced by as much as an eye can see, or more."""

SEEN_ARCMIN = 1.0
"""Displacement from which on a map is in full color: what a good eye resolves."""

HEIGHT_STEPS = 65535
"""Steps between the lowest and the highest z in a picture of heights; the last one stands for no surface."""

FRAME_MS = 350
"""Time that an animation shows each eye's picture."""


def shown(image: EyeImage) -> Bytes:
    """Return a view as a screen shows it, (H, W, 3); without colors, surfaces are gray by their height."""
    if image.color is not None:
        return _levels(encoded(image.color))
    gray = np.zeros(image.triangle.shape)
    height = image.position[..., 2]
    known = np.isfinite(height)
    gray[image.covered] = SHADES[0]
    if known.any():
        low, high = float(height[known].min()), float(height[known].max())
        share = (height[known] - low) / (high - low if high > low else 1.0)
        gray[known] = SHADES[0] + share * (SHADES[1] - SHADES[0])
    return _levels(np.repeat(gray[..., None], 3, axis=-1))


def loss_map(image: EyeImage, maps: LossMaps) -> Bytes:
    """Return a dimmed view on which wrong surfaces are red and displaced points blue, (H, W, 3)."""
    gray = shown(image).mean(axis=-1, keepdims=True) * 0.5
    picture = np.repeat(gray, 3, axis=-1)
    moved = np.nan_to_num(np.clip(maps.displacement_arcmin / SEEN_ARCMIN, 0.0, 1.0))[..., None]
    picture = picture * (1 - 0.8 * moved) + 0.8 * moved * np.array(MOVED)
    if maps.wrong is not None:
        picture[maps.wrong] = WRONG
    levels: Bytes = np.rint(picture).astype(np.uint8)
    return levels


def numbers_picture(image: EyeImage) -> Bytes:
    """Return triangle numbers plus one as red * 65536 + green * 256 + blue, (H, W, 3)."""
    packed = (image.triangle + 1).astype(np.uint32)
    picture: Bytes = np.stack((packed >> 16 & 255, packed >> 8 & 255, packed & 255), axis=-1).astype(np.uint8)
    return picture


def heights_picture(image: EyeImage, low: float, high: float) -> Bytes:
    """Return heights between two ends in `HEIGHT_STEPS` as red * 256 + green, the last one for none."""
    height = image.position[..., 2]
    known = np.isfinite(height)
    share = np.clip((np.where(known, height, low) - low) / (high - low), 0.0, 1.0)
    steps = np.where(known, np.rint(share * (HEIGHT_STEPS - 1)), HEIGHT_STEPS).astype(np.uint32)
    return np.stack((steps >> 8, steps & 255, 0 * steps), axis=-1).astype(np.uint8)


def height_ends(images: Sequence[EyeImage]) -> tuple[float, float]:
    """Return the lowest and the highest z that any of some views shows; different from each other."""
    known = [image.position[..., 2][np.isfinite(image.position[..., 2])] for image in images]
    values: Floats = np.concatenate([np.zeros(1), *known])
    low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + 1.0


def png(picture: Bytes) -> bytes:
    """Return a picture as PNG."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


def animation(frames: Sequence[Bytes]) -> bytes:
    """Return pictures as an animated GIF that goes along the path and back, for ever."""
    there_and_back = [*frames, *frames[-2:0:-1]]
    pictures = [Image.fromarray(frame) for frame in there_and_back]
    stream = io.BytesIO()
    pictures[0].save(
        stream, format="GIF", save_all=True, append_images=pictures[1:], duration=FRAME_MS, loop=0
    )
    return stream.getvalue()


def side_by_side(pictures: Sequence[Bytes]) -> Bytes:
    """Return pictures of one size in a row, with a gap of a few pixels."""
    gap = np.full((pictures[0].shape[0], 4, 3), LEVELS, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def _levels(values: Singles | Floats) -> Bytes:
    levels: Bytes = np.rint(LEVELS * np.asarray(values)).astype(np.uint8)
    return levels
