"""Hogels averaged over sub-apertures, from a stream of single images (paper, section 6: band limiting)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent, PlateHogel
from xfrustum.scenes.plate.plate import Aperture


def averaged(
    apertures: Iterable[Aperture],
    points: Callable[[Aperture], Sequence[Aperture]],
    draw: Callable[[Iterable[Aperture]], Iterator[PlateHogel]],
    content: PlateContent,
) -> Iterator[PlateHogel]:
    """Yield hogels whose color is the mean of images drawn at several points of their area.

    Triangle numbers, heights and normals are those seen through the aperture itself, which is drawn besides
    for them.

    Parameters
    ----------
    apertures
        Apertures in the order in which they are wanted.
    points
        Function that returns the points of an aperture's area.
    draw
        Function that yields the image of each point, in order, with colors in float32.
    content
        Type of color, and the images that come along.
    """
    waiting: deque[tuple[Aperture, int]] = deque()
    surfaces = content.channels != (Channel.COLOR,)

    def drawn() -> Iterator[Aperture]:
        for aperture in apertures:
            some = points(aperture)
            waiting.append((aperture, len(some)))
            if surfaces:
                yield aperture
            yield from some

    images = draw(drawn())
    for first in images:
        aperture, count = waiting.popleft()
        total = np.zeros(first.color.shape)
        if not surfaces:
            total += first.color
        for _ in range(count - (not surfaces)):
            total += next(images).color
        mean = (total / count).astype(np.float32)
        yield replace(first, aperture=aperture, color=stored(mean, content.color))


def stored(color: Singles, kind: ColorType) -> NDArray[Any]:
    """Return linear RGB in the type in which it is stored, as the device rounds it."""
    if kind is ColorType.UINT8:
        return np.asarray(np.rint(np.clip(color, 0.0, 1.0) * np.float32(255)), dtype=np.uint8)
    with np.errstate(over="ignore"):
        rounded: NDArray[Any] = color.astype(kind.dtype)
    return rounded
