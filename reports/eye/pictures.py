"""Pictures of views: as an eye sees them, as numbers that a page can read, and as maps of what is lost."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image

from xfrustum.compare.eye.loss import LossMaps
from xfrustum.scenes.appearance.display import LEVELS
from xfrustum.scenes.arrays import Bytes, Floats
from xfrustum.scenes.model.eye import EyeImage
from xfrustum.scenes.notebook import as_shown, marked

SEEN_ARCMIN = 1.0
"""Displacement from which on a map is in full color: what a good eye resolves."""

HEIGHT_STEPS = 65535
"""Steps between the lowest and the highest z in a picture of heights; the last one stands for no surface."""

FRAME_MS = 350
"""Time that an animation shows each eye's picture."""


def shown(image: EyeImage) -> Bytes:
    """Return a view as a screen shows it, (H, W, 3); without colors, surfaces are gray by their height."""
    return as_shown(image.color, image.covered, image.position[..., 2])


def loss_map(image: EyeImage, maps: LossMaps) -> Bytes:
    """Return a dimmed view on which wrong surfaces are red and displaced points blue, (H, W, 3)."""
    return marked(shown(image), maps.wrong, maps.displacement_arcmin / SEEN_ARCMIN)


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
