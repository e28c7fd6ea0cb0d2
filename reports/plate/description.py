"""The description of a plate: everything that decides its pixels, and must agree to go on with a store."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata
from typing import Protocol

from xfrustum.reports.common.json_ready import json_ready
from xfrustum.scenes.model.effects import Effect
from xfrustum.scenes.model.look import look_hash
from xfrustum.scenes.model.plate_content import Channel, ColorType, PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Plate


@dataclass(frozen=True, kw_only=True)
class SceneDescription:
    """The scene that a plate is drawn from, with the hashes of its triangles and of its look.

    `source` says where the scene came from; it decides no pixel, and need not agree.
    """

    name: str
    source: str | None
    units: str
    hash: str
    look: str


@dataclass(frozen=True, kw_only=True)
class ContentDescription:
    """Type of color, whether triangle numbers come along, all images if these two do not say it, measures."""

    color: ColorType
    ids: bool
    channels: tuple[Channel, ...] | None = None
    judged: bool | None = None


@dataclass(frozen=True, kw_only=True)
class SamplingDescription:
    """Number of sub-apertures over which color is averaged, and of a pixel's samples if there are several."""

    aperture: int
    supersample: int | None = None
    multisample: int | None = None


@dataclass(frozen=True, kw_only=True)
class TransportDescription:
    """Light transport that colors are the mean of, and the number of light paths per pixel."""

    shadows: bool
    interreflection: bool
    samples: int


@dataclass(frozen=True, kw_only=True)
class RendererDescription:
    """Name of the device that draws, and version of the program."""

    device: str
    xfrustum: str


@dataclass(frozen=True, kw_only=True)
class LayoutDescription:
    """Columns and rows of the blocks of hogels that are stored together; it decides no pixel."""

    block: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class PlateDescription:
    """Everything that decides a plate's pixels.

    `settings` is None for plates of truths. `sampling` is None where each hogel is drawn with one sample a
    pixel through the middle of its aperture, `transport` where no light paths were traced. What is None is
    not written.
    """

    scene: SceneDescription
    plate: Plate
    frustum: Frustum
    settings: DoubleFrustum | None
    effects: tuple[Effect, ...]
    content: ContentDescription
    renderer: RendererDescription
    sampling: SamplingDescription | None = None
    transport: TransportDescription | None = None
    layout: LayoutDescription | None = None


class Source(Protocol):
    """What a description asks of a source of hogels; see `sources`."""

    scene: Scene
    settings: DoubleFrustum | None
    content: PlateContent

    @property
    def judged(self) -> bool:
        """Whether the hogels come with measures."""

    @property
    def simulated(self) -> frozenset[Effect]:
        """Effects that change the pixels."""

    @property
    def renderer(self) -> str:
        """Name of the device or of the tracer."""

    @property
    def transported(self) -> bool:
        """Whether colors are means over light paths."""


def described(source: Source) -> PlateDescription:
    """Return everything that decides the pixels that a source draws; the layout is left open."""
    scene = source.scene
    transport = scene.transport
    return PlateDescription(
        scene=SceneDescription(
            name=scene.name,
            source=scene.source,
            units=scene.units,
            hash=scene.content_hash,
            look=look_hash(scene),
        ),
        plate=scene.plate,
        frustum=scene.frustum,
        settings=source.settings,
        effects=tuple(sorted(source.simulated)),
        content=_content(source.content, source.judged),
        renderer=RendererDescription(device=source.renderer, xfrustum=metadata.version("xfrustum")),
        sampling=_sampling(scene),
        transport=None
        if not source.transported
        else TransportDescription(
            shadows=transport.shadows, interreflection=transport.interreflection, samples=transport.samples
        ),
    )


def document_of(description: PlateDescription) -> dict[str, object]:
    """Return a description as it is written."""
    document: dict[str, object] = json_ready(description)
    for name in ("content", "sampling"):
        part = document[name]
        if isinstance(part, dict):
            document[name] = {key: value for key, value in part.items() if value is not None}
    return {key: value for key, value in document.items() if value is not None}


def _content(content: PlateContent, judged: bool) -> ContentDescription:
    usual = PlateContent(color=content.color, ids=content.ids).channels == content.channels
    return ContentDescription(
        color=content.color,
        ids=content.ids,
        channels=None if usual else content.channels,
        judged=judged or None,
    )


def _sampling(scene: Scene) -> SamplingDescription | None:
    sampling = scene.sampling
    if sampling.aperture == sampling.supersample == sampling.multisample == 1:
        return None
    return SamplingDescription(
        aperture=sampling.aperture,
        supersample=sampling.supersample if sampling.supersample > 1 else None,
        multisample=sampling.multisample if sampling.multisample > 1 else None,
    )
