"""Sources of a plate's hogels: drawn, drawn and judged, or traced; and what decides their pixels."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import metadata
from typing import Any

import numpy as np
import pyarrow as pa

from xfrustum.compare.metrics.comparison import ComparisonNumbers
from xfrustum.compare.metrics.radiance import transported
from xfrustum.compare.run import Judge, JudgedFrame, Wanted
from xfrustum.raster.plate.one_by_one import OneByOne, plate_hogel
from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.raster.rasterizer import Rasterizer, normals_of
from xfrustum.reference import Reference
from xfrustum.reports.common.outputs import json_ready
from xfrustum.reports.common.records import columns_of, named_columns
from xfrustum.scenes import Aperture, Certainty, DoubleFrustum, HogelImage, InputError
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.model.effects import ALL_EFFECTS, Effect, Question, needed
from xfrustum.scenes.model.plate_content import Channel, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene, is_shaded, look_hash

SOURCE = "source"
"""Key that says where the scene came from, in the description of the scene: for people, it need not agree."""


PLACES = ("column", "row", "x", "y")
"""Columns of a table of measures that say which hogel a row is about; all others are measures."""


@dataclass(frozen=True, kw_only=True)
class MeasuredHogel:
    """One hogel, its place on the plate, its aperture's in scene units, and what `compare --json` tells."""

    column: int
    row: int
    x: float
    y: float
    comparison: ComparisonNumbers = field(metadata=named_columns("{}"))


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedPlateHogel(PlateHogel):
    """A hogel's images with its measures."""

    measured: MeasuredHogel


def measures_of(scene: Scene) -> dict[str, str]:
    """Return the unit of each measure of a scene's hogels; colors are measured where it has an appearance."""
    nothing = dict.fromkeys(("surface", "triangle", "displacement_px", "height", "radiance"))
    counts = dict.fromkeys(("pixels", "judged", "covered", "at_plate"), 0)
    certainty = {kind.name.lower(): 0 for kind in Certainty}
    empty = ComparisonNumbers(**counts, **nothing, certainty=certainty)  # type: ignore[arg-type]
    found = {}
    for column in columns_of(MeasuredHogel, [MeasuredHogel(column=0, row=0, x=0.0, y=0.0, comparison=empty)]):
        name, numeric = column.name, pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
        if name not in PLACES and numeric and (is_shaded(scene) or not name.startswith("radiance")):
            length = scene.units if name.startswith("height") else "1"
            found[name] = "px" if name.startswith("displacement_px") else length
    return found


@dataclass(frozen=True, kw_only=True)
class HogelSource:
    """What makes the hogels of a scene, in the order of their apertures."""

    hogels: Callable[[Iterable[Aperture]], Iterator[PlateHogel]]
    description: dict[str, Any]


@contextmanager
def source_of(
    scene: Scene, settings: DoubleFrustum | None, content: PlateContent, *, judge: bool = False
) -> Iterator[HogelSource]:
    """Open what makes the hogels of a scene: with settings they are drawn, without they are traced."""
    if settings is None:
        if judge:
            raise InputError("--judge compares what is drawn with the truth: leave out --truth, or --judge")
        yield _traced(scene, content)
        return
    if Channel.CERTAINTY in content.channels:
        raise InputError("certainty is the truth's alone: leave it out of the channels, or add --truth")
    # More effects than the scene calls for change no pixel.
    visible = needed(scene, question=Question(camera=settings.camera, settings=(settings,)))
    if not judge:
        fine = scene.sampling != Sampling(aperture=scene.sampling.aperture)
        with (OneByOne if fine else PlateRenderer)(scene, settings, content) as drawing:
            device = str(drawing.device["renderer"])
            described = described_as(scene, content, device, drawing.effects & visible, settings)
            yield HogelSource(hogels=drawing.hogels, description=described)
        return
    settings.check_against(scene.frustum)
    with Judge(scene, effects=content.effects) as judging:

        def examined(rasterizer: Rasterizer) -> frozenset[Effect]:
            rasterizer.check_sampling(scene.sampling)
            return rasterizer.effects_for(settings)

        effects = judging.submit(examined).result() & visible
        described = described_as(scene, content, judging.device["renderer"], effects, settings)
        described["content"]["judged"] = True
        hogels = partial(_judged, judging, content, settings)
        yield HogelSource(hogels=hogels, description=described)


def _traced(scene: Scene, content: PlateContent) -> HogelSource:
    """Return truths, certified; their colors are means of light paths where the scene has any."""
    by_paths = scene.transport.simulated
    reference = Reference(scene, tracer="mitsuba" if by_paths else "embree", effects=content.effects)

    def colored(aperture: Aperture) -> HogelImage:
        image = reference.trace(aperture, Sampling())
        mean = transported(scene, aperture, scene.transport).mean
        return replace(image, color=mean.astype(np.float32))

    def hogels(apertures: Iterable[Aperture]) -> Iterator[PlateHogel]:
        images = map(colored, apertures) if by_paths else reference.stream(apertures)
        return (plate_hogel(image, content) for image in images)

    simulated = frozenset(reference.rendering().effects) & needed(scene)
    renderer = f"reference, {'colored by Mitsuba' if by_paths else 'certified'}"
    return HogelSource(
        hogels=hogels,
        description=described_as(scene, content, renderer, ALL_EFFECTS if by_paths else simulated, None),
    )


def _judged(
    judge: Judge, content: PlateContent, settings: DoubleFrustum, apertures: Iterable[Aperture]
) -> Iterator[PlateHogel]:
    """Draw and judge hogels; the images are those of a plate that is drawn alone, bit for bit."""
    colors = is_shaded(judge.scene)
    # Pixels are stored with color; whether it is compared is another question.
    wanted = Wanted(color=True, colored_truths=colors, radiance=colors)

    def stored(frame: JudgedFrame) -> JudgedPlateHogel:
        here, image = frame.aperture, frame.image
        if Channel.NORMAL in content.channels:
            image = replace(image, normal=normals_of(judge.scene, image.triangle))
        measured = MeasuredHogel(
            column=here.column, row=here.row, x=here.x, y=here.y, comparison=frame.comparison.numbers
        )
        return JudgedPlateHogel(**{**vars(plate_hogel(image, content)), "measured": measured})

    with closing(judge.frames(apertures, [settings], wanted, stored)) as frames:
        yield from frames


def described_as(
    scene: Scene,
    content: PlateContent,
    renderer: str,
    simulated: frozenset[Effect],
    settings: DoubleFrustum | None,
) -> dict[str, Any]:
    """Return everything that decides the pixels of hogels, as JSON; it must agree to go on with a store.

    What is None is left out: plates of truths have no `settings`, those with one sample a pixel through the
    middle of its aperture no `sampling`, and those without light paths no `transport`.
    """
    usual = PlateContent(color=content.color, ids=content.ids).channels == content.channels
    sampling, transport = scene.sampling, scene.transport
    finer = {"supersample": sampling.supersample, "multisample": sampling.multisample}
    sampled = sampling.aperture > 1 or max(finer.values()) > 1
    described: dict[str, Any] = {
        "scene": {
            "name": scene.name,
            SOURCE: scene.source,
            "units": scene.units,
            "hash": scene.content_hash,
            "look": look_hash(scene),
        },
        "plate": scene.plate,
        "frustum": scene.frustum,
        "settings": settings,
        "effects": sorted(simulated),
        "content": {"color": content.color, "ids": content.ids}
        | ({} if usual else {"channels": content.channels}),
        "renderer": {"device": renderer, "xfrustum": metadata.version("xfrustum")},
        "sampling": {"aperture": sampling.aperture, **{k: n for k, n in finer.items() if n > 1}}
        if sampled
        else None,
        "transport": {name: getattr(transport, name) for name in ("shadows", "interreflection", "samples")}
        if settings is None and transport.simulated
        else None,
    }
    return {key: value for key, value in json_ready(described).items() if value is not None}
