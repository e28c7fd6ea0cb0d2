"""A plate as a stream: any of its apertures drawn into a store, a few at a time, and never twice."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from tqdm import tqdm

from xfrustum.raster.plate.renderer import PlateRenderer
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.plate.store import PlateStore, open_store
from xfrustum.scenes.model.effects import Effect, Question, needed
from xfrustum.scenes.model.look import look_hash
from xfrustum.scenes.model.plate_content import ColorType, PlateContent, PlateHogel
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.frustum import Frustum
from xfrustum.scenes.plate.plate import Aperture, Plate

MAX_WAITING_HOGELS = 4
"""Hogels that may wait for the disk while others are drawn: several take it little longer than one."""

Span = tuple[int, int] | None
"""First and last index; None for all."""


@dataclass(frozen=True, kw_only=True)
class PlateFiles:
    """What became of the apertures that were asked for.

    Attributes
    ----------
    out
        The Zarr group.
    drawn, found
        Number of hogels that were drawn, and of those that had been finished before or by others meanwhile.
    damaged
        Number of drawn hogels that had been there, and were not whole.
    notes
        What was damaged and has been mended, in sentences.
    """

    out: Path
    drawn: int
    found: int
    damaged: int
    notes: tuple[str, ...]


def write_plate(  # noqa: PLR0913 - one parameter per option of the command
    scene: Scene,
    settings: DoubleFrustum,
    out: Path,
    apertures: Iterable[Aperture] | None = None,
    content: PlateContent | None = None,
    *,
    check: bool = False,
    progress: bool = False,
) -> PlateFiles:
    """Draw apertures of a plate that have not been drawn yet, each into a chunk of its own.

    Killed at any moment it loses no finished hogel; called again it goes on with the others and ends
    with the bytes of a run that was not disturbed. Any number of processes may draw one plate at once:
    each hogel is drawn by one of them, and each ends when all that it was asked for is finished.

    Parameters
    ----------
    scene, settings
        Scene that is drawn, and settings of its cameras.
    out
        Folder of a Zarr group, made where it does not exist.
    apertures
        Apertures in the order in which they are drawn; None for the whole plate.
    content
        Type of color, whether triangle numbers come along, and what is simulated.
    check
        Whether to read through every hogel that is there; without it, only its layout is looked at. What
        is damaged is drawn again.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        See `PlateRenderer` and `open_store`.
    """
    content = content or PlateContent()
    chosen = scene.plate.apertures() if apertures is None else apertures
    if not isinstance(chosen, ApertureBlocks):
        chosen = list(dict.fromkeys(chosen))
    with PlateRenderer(scene, settings, content) as renderer:
        store = open_store(out, scene, content, _document(described(renderer)))
        with (
            store.claims() as claims,
            progress_bar(len(chosen), "plate", "hogel", shown=progress) as bar,
        ):
            work = _Work(scene=scene, store=store, claims=claims, check=check, bar=bar)
            waiting: Sequence[Aperture] = chosen
            while waiting:
                for aperture in _written(renderer.hogels(work.taken(waiting)), store):
                    work.done(aperture)
                waiting, work.elsewhere = work.elsewhere, []
                if waiting:
                    # Nothing of ours is under way: others may be waited for, as they wait for nobody.
                    claims.wait(work.number(waiting[0]))
    return PlateFiles(
        out=out, drawn=work.drawn, found=work.found, damaged=work.damaged, notes=tuple(work.notes())
    )


@dataclass(kw_only=True)
class _Work:
    """Which hogels this process draws, and what became of them.

    Attributes
    ----------
    elsewhere
        Apertures that another process is drawing.
    drawn, found, damaged
        As in `PlateFiles`.
    """

    scene: Scene
    store: PlateStore
    claims: Claims
    check: bool
    bar: tqdm[Any]
    elsewhere: list[Aperture] = field(default_factory=list)
    drawn: int = 0
    found: int = 0
    damaged: int = 0

    def taken(self, apertures: Iterable[Aperture]) -> Iterator[Aperture]:
        """Yield those that are not finished and that nobody else is drawing, each claimed."""
        for aperture in apertures:
            number = self.number(aperture)
            if self._finished(aperture):
                self._count_found()
            elif not self.claims.take(number):
                self.elsewhere.append(aperture)
            # Another process that claimed it before may have finished it since.
            elif self._finished(aperture):
                self.claims.release(number)
                self._count_found()
            else:
                self.damaged += self.store.damaged(aperture) or self.store.finished(aperture)
                yield aperture

    def done(self, aperture: Aperture) -> None:
        """Count a hogel that has been written."""
        self.claims.release(self.number(aperture))
        self.drawn += 1
        self.bar.update()

    def number(self, aperture: Aperture) -> int:
        """Return the number of a hogel on its plate, row by row."""
        return aperture.row * self.scene.plate.hogels[0] + aperture.column

    def notes(self) -> Iterator[str]:
        """Yield what was damaged and has been mended."""
        for name in self.store.mended:
            yield f"{self.store.out}: the description of {name} was damaged and has been written again"
        if self.damaged:
            hogels = "hogel was" if self.damaged == 1 else "hogels were"
            yield f"{self.store.out}: {self.damaged} {hogels} damaged, and drawn again"

    def _finished(self, aperture: Aperture) -> bool:
        return self.store.finished(aperture) and (not self.check or self.store.readable(aperture))

    def _count_found(self) -> None:
        self.found += 1
        self.bar.update()


def _written(hogels: Iterable[PlateHogel], store: PlateStore) -> Iterator[Aperture]:
    """Write hogels while the next ones are drawn; yield each aperture that is finished."""
    waiting: deque[Future[Aperture]] = deque()

    def write(hogel: PlateHogel) -> Aperture:
        store.write(hogel)
        return hogel.aperture

    with ThreadPoolExecutor(MAX_WAITING_HOGELS, thread_name_prefix="plate") as writer:
        for hogel in hogels:
            if len(waiting) == MAX_WAITING_HOGELS:
                yield waiting.popleft().result()
            waiting.append(writer.submit(write, hogel))
        while waiting:
            yield waiting.popleft().result()


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
    """Type of color, and whether triangle numbers come along."""

    color: ColorType
    ids: bool


@dataclass(frozen=True, kw_only=True)
class SamplingDescription:
    """Number of sub-apertures over which color is averaged."""

    aperture: int


@dataclass(frozen=True, kw_only=True)
class RendererDescription:
    """Name of the device that draws, and version of the program."""

    device: str
    xfrustum: str


@dataclass(frozen=True, kw_only=True)
class PlateDescription:
    """Everything that decides a plate's pixels: what must agree to go on with a store.

    `sampling` is None, and not written, where each hogel is drawn through the middle of its aperture alone.
    """

    scene: SceneDescription
    plate: Plate
    frustum: Frustum
    settings: DoubleFrustum
    effects: tuple[Effect, ...]
    content: ContentDescription
    renderer: RendererDescription
    sampling: SamplingDescription | None = None


def described(renderer: PlateRenderer) -> PlateDescription:
    """Return everything that decides the pixels that a renderer draws."""
    scene = renderer.scene
    points = scene.sampling.aperture
    # More than the scene calls for changes no pixel.
    question = Question(camera=renderer.settings.camera, settings=(renderer.settings,))
    simulated = renderer.effects & needed(scene, question=question)
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
        settings=renderer.settings,
        effects=tuple(sorted(simulated)),
        content=ContentDescription(color=renderer.content.color, ids=renderer.content.ids),
        renderer=RendererDescription(
            device=renderer.device["renderer"], xfrustum=metadata.version("xfrustum")
        ),
        sampling=None if points == 1 else SamplingDescription(aperture=points),
    )


def _document(description: PlateDescription) -> dict[str, object]:
    """Return a description as it is written."""
    document: dict[str, object] = json_ready(description)
    return {key: value for key, value in document.items() if value is not None}


def blocks_of_apertures(plate: Plate, blocks: Sequence[tuple[Span, Span]]) -> ApertureBlocks:
    """Return the apertures of some blocks.

    Parameters
    ----------
    plate
        The plate.
    blocks
        Columns and rows of each.

    Raises
    ------
    InputError
        A block reaches beyond the plate.
    """
    found = []
    for block in blocks:
        (left, right), (top, bottom) = (
            (0, count - 1) if span is None else span for span, count in zip(block, plate.hogels, strict=True)
        )
        # Both corners first: a mistake is not found in the middle of the work.
        plate.aperture(left, top), plate.aperture(right, bottom)
        found.append((range(left, right + 1), range(top, bottom + 1)))
    return ApertureBlocks(plate, tuple(found))
