"""Sources of a plate's hogels: many at once, one after the other with finer sampling, or truths."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import replace
from types import TracebackType
from typing import Self

import numpy as np

from xfrustum.compare.metrics.left_out import transported
from xfrustum.raster.plate.one_by_one import OneByOne, plate_hogel
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reference import Reference
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, needed
from xfrustum.scenes.model.hogel_image import HogelImage
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture


class HogelSource(ABC):
    """Anything that makes the hogels of a scene; a context manager.

    `settings` are None where hogels are traced. `judged` says whether hogels come with measures,
    `transported` whether colors are means over light paths, `simulated` the effects that change the pixels,
    and `renderer` the name of the device or of the tracer.
    """

    scene: Scene
    settings: DoubleFrustum | None = None
    content: PlateContent
    simulated: frozenset[Effect]
    renderer: str
    judged: bool = False
    transported: bool = False

    @abstractmethod
    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Make hogels and yield them in the order of their apertures."""

    def release(self) -> None:  # noqa: B027 - what traces holds nothing that must be freed
        """Free what draws."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def check_drawable(content: PlateContent) -> None:
    """Raise InputError where images are asked for that no drawing has."""
    if Channel.CERTAINTY in content.channels:
        raise InputError("certainty is the truth's alone: leave it out of the channels, or add --truth")


def visible_effects(effects: frozenset[Effect], scene: Scene, settings: DoubleFrustum) -> frozenset[Effect]:
    """Return those of some effects that change pixels of a scene's drawings with these settings."""
    # More than the scene calls for changes no pixel.
    return effects & needed(scene, question=Question(camera=settings.camera, settings=(settings,)))


class Drawn(HogelSource):
    """Hogels that OpenGL draws: many at once, or one after the other where a pixel has several samples.

    Raises
    ------
    InputError
        The truth's certainty is asked for; or see `PlateRenderer` and `Rasterizer`.
    """

    def __init__(self, scene: Scene, settings: DoubleFrustum, content: PlateContent) -> None:
        check_drawable(content)
        fine = scene.sampling != Sampling(aperture=scene.sampling.aperture)
        self.scene, self.content = scene, content
        self.settings = settings
        self._renderer = (OneByOne if fine else PlateRenderer)(scene, settings, content)
        self.simulated = visible_effects(self._renderer.effects, scene, settings)
        self.renderer = str(self._renderer.device["renderer"])

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Draw hogels and yield them in the order of their apertures."""
        return self._renderer.hogels(apertures)

    def release(self) -> None:
        """Free the renderer."""
        self._renderer.release()


class Truths(HogelSource):
    """Hogels that are traced and certified; their colors are means of light paths where the scene has any."""

    def __init__(self, scene: Scene, content: PlateContent) -> None:
        self.scene, self.content = scene, content
        self.transported = scene.transport.simulated
        tracer = "mitsuba" if self.transported else "embree"
        self._reference = Reference(scene, tracer=tracer, effects=content.effects)
        simulated = frozenset(self._reference.rendering().effects) & needed(scene)
        self.simulated = ALL_EFFECTS if self.transported else simulated
        self.renderer = f"reference, {'colored by Mitsuba' if self.transported else 'certified'}"

    def hogels(self, apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        """Trace hogels and yield them in the order of their apertures."""
        images = map(self._colored, apertures) if self.transported else self._reference.stream(apertures)
        return (plate_hogel(image, self.content) for image in images)

    def _colored(self, aperture: Aperture) -> HogelImage:
        """Return the truth of an aperture, colored by light paths."""
        image = self._reference.trace(aperture, Sampling())
        estimate = transported(self.scene, aperture, self.scene.transport)
        return replace(image, color=estimate.mean.astype(np.float32))
