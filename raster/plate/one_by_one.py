"""Hogels drawn one after the other by `Rasterizer`, for scenes that ask for several samples a pixel."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Self

from xfrustum.raster.plate.averaging import stored
from xfrustum.raster.rasterizer import Rasterizer
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


class OneByOne:
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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Free the rasterizer."""
        self._rasterizer.release()

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw apertures and yield their images in the same order."""
        normals = Channel.NORMAL in self.content.channels
        for aperture in apertures:
            yield plate_hogel(self._rasterizer.render(aperture, self.settings, normals=normals), self.content)


def plate_hogel(image: HogelImage, content: PlateContent) -> PlateHogel:
    """Return the images of a hogel that a plate stores, in the types in which it stores them.

    Parameters
    ----------
    image
        Image of the hogel, with color.
    content
        The images that are wanted; the hogel's image has them.
    """
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
