"""Hogels drawn one after the other, and hogels averaged over sub-apertures (paper, section 6)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from xfrustum.raster.device.context import ContextOwner
from xfrustum.raster.rasterizer import Rasterizer
from xfrustum.scenes.arrays import Singles
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


def averaged(
    apertures: Iterable[Aperture],
    points: Callable[[Aperture], Sequence[Aperture]],
    draw: Callable[[Iterable[Aperture]], Iterator[PlateHogel]],
    content: PlateContent,
) -> Iterator[PlateHogel]:
    """Yield hogels whose color is the mean of images drawn at several points of their area.

    Triangle numbers, heights and normals are those seen through the aperture itself, which is drawn besides
    for them. `points` returns the points of an aperture's area, `draw` yields the image of each point, in
    order, with colors in float32.
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


class OneByOne(ContextOwner):
    """The stream of `PlateRenderer` with the sampling of `Rasterizer`: any number of samples a pixel.

    A context manager: leaving it frees the rasterizer.

    Parameters
    ----------
    scene, settings, content
        As for `PlateRenderer`.

    Raises
    ------
    InputError
        The settings do not fit the frustum, or see `Rasterizer`.
    """

    def __init__(self, scene: Scene, settings: DoubleFrustum, content: PlateContent | None = None) -> None:
        settings.check_against(scene.frustum)
        self.scene, self.settings, self.content = scene, settings, content or PlateContent()
        self._rasterizer = Rasterizer(scene, self.content.effects)
        self.device = self._rasterizer.device
        try:
            self._rasterizer.check_sampling(scene.sampling)
        except InputError:
            self._rasterizer.release()
            raise
        self.effects = self._rasterizer.effects_for(settings)

    def release(self) -> None:
        """Free the rasterizer."""
        self._rasterizer.release()

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw apertures and yield their images in the same order."""
        normals = Channel.NORMAL in self.content.channels
        for aperture in apertures:
            yield plate_hogel(self._rasterizer.render(aperture, self.settings, normals=normals), self.content)


def plate_hogel(image: HogelImage, content: PlateContent) -> PlateHogel:
    """Return the images of a hogel in color that a plate stores, in the types in which it stores them."""
    assert image.color is not None
    wanted = content.channels
    normal = image.normal if Channel.NORMAL in wanted else None
    return PlateHogel(
        aperture=image.camera.aperture,
        color=stored(image.color, content.color),
        triangle=image.triangle if Channel.TRIANGLE in wanted else None,
        height=image.height.astype("f4") if Channel.HEIGHT in wanted else None,
        normal=None if normal is None else normal.astype("f4"),
        certainty=image.certainty if Channel.CERTAINTY in wanted else None,
    )
