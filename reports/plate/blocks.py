"""Blocks of a plate drawn by any process: a plan that fits into a message, and a function that draws one.

A block of hogels is a shard of every array of the store, and is there whole or not. Any process that sees the
store and the scene's file may draw any block, in any order, and may die: what it has not finished is drawn
again. Nothing is handed back but counts.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter

from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.plate.layout import BlockGrid
from xfrustum.reports.plate.plate import BlockWork, PlateFiles, draw_parts, opened_store, source_of
from xfrustum.reports.plate.sources import HogelSource
from xfrustum.reports.plate.store import PlateStore
from xfrustum.scenes.appearance.sampling import Sampling, Transport
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.look import look_hash
from xfrustum.scenes.model.plate_content import PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.opening.catalogue import open_scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Plate


@dataclass(frozen=True, kw_only=True)
class PlatePlan:
    """A plate to be drawn, as any process can take it up: small, immutable, and the same as JSON.

    Attributes
    ----------
    scene
        Path or name of the scene.
    plate
        Plate of the scene.
    hash, look
        Hashes of its triangles and of its look: a process that finds others refuses.
    sampling, transport
        Sampling of color and light transport, which options may have changed.
    settings
        Settings of the cameras; None for truths.
    content
        The images that are stored.
    out
        Folder of the store.
    side
        Columns and rows of a block.
    chosen
        Columns and rows, first and last, of rectangles of hogels; none for the whole plate.
    judged
        Whether hogels are judged, and their measures stored.
    """

    scene: str
    plate: Plate
    hash: str
    look: str
    sampling: Sampling
    transport: Transport
    settings: DoubleFrustum | None
    content: PlateContent
    out: Path
    side: tuple[int, int]
    chosen: tuple[tuple[int, int, int, int], ...] = ()
    judged: bool = False

    def to_json(self) -> str:
        """Return the plan as a JSON object."""
        return TypeAdapter(PlatePlan).dump_json(self).decode()

    @staticmethod
    def from_json(text: str) -> PlatePlan:
        """Return the plan that `to_json` wrote."""
        return TypeAdapter(PlatePlan).validate_json(text)


def plan_plate(  # noqa: PLR0913 - as `write_plate`
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path,
    apertures: ApertureBlocks | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
) -> PlatePlan:
    """Make the store of a plate, or open it, and return the plan by which processes draw its blocks.

    Parameters
    ----------
    scene, settings, out, apertures, content, block, judge
        As for `write_plate`.

    Raises
    ------
    InputError
        As from `write_plate`; or the scene is not one that can be opened by name.
    """
    return begin_plate(scene, settings, out, apertures, content, block=block, judge=judge)[0]


def begin_plate(  # noqa: PLR0913 - as `write_plate`
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path,
    apertures: ApertureBlocks | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
) -> tuple[PlatePlan, PlateStore]:
    """Return the plan of a plate with its store, which says what has been mended; see `plan_plate`."""
    content = content or PlateContent()
    if not scene.source:
        raise InputError(f"{scene.name}: has no file or name by which other processes could open it")
    with source_of(scene, settings, content, judge=judge) as source:
        store = opened_store(source, out, block)
    plan = PlatePlan(
        scene=scene.source,
        plate=scene.plate,
        hash=scene.content_hash,
        look=look_hash(scene),
        sampling=scene.sampling,
        transport=scene.transport,
        settings=settings,
        content=content,
        out=out.absolute(),
        side=store.layout.side,
        judged=judge,
        chosen=()
        if apertures is None
        else tuple((c.start, c.stop, r.start, r.stop) for c, r in apertures.blocks),
    )
    return plan, store


def blocks_of(plan: PlatePlan) -> Iterator[int]:
    """Yield the numbers of the blocks that a plan asks for, without listing them and without the scene."""
    yield from BlockGrid(plate=plan.plate, side=plan.side).touched(_apertures(plan))


def draw_block(plan: PlatePlan, number: int) -> PlateFiles:
    """Draw what is missing of one block into the store, and return what became of its hogels.

    Any process may call this, at any time, in one thread: the scene and its OpenGL context are opened at the
    first call and kept for the next ones of the same plan. A block that another process is drawing is waited
    for.

    Raises
    ------
    InputError
        The scene that is found is another one; or as from `write_plate`.
    """
    opened = _opened(plan)
    part = opened.store.layout.part(number, _apertures(plan))
    with opened.store.claims() as claims, progress_bar(0, "plate", "hogel", shown=False) as bar:
        work = BlockWork(store=opened.store, claims=claims, bar=bar)
        draw_parts(opened.source, work, [part])
    return work.files()


@dataclass(frozen=True, kw_only=True)
class _Opened:
    """A plan that a thread has taken up, its renderer, and its store."""

    plan: PlatePlan
    source: HogelSource
    store: PlateStore
    held: ExitStack


class _OfThread(threading.local):
    """What this thread has opened last: an OpenGL context belongs to one thread."""

    opened: _Opened | None = None


_of_thread = _OfThread()


def _opened(plan: PlatePlan) -> _Opened:
    """Return the scene of a plan and what draws it, opened by this thread when first asked for."""
    found = _of_thread.opened
    if found is not None and found.plan == plan:
        return found
    close()
    named = open_scene(plan.scene)
    scene = replace(named, sampling=plan.sampling, transport=plan.transport)
    if (scene.content_hash, look_hash(scene)) != (plan.hash, plan.look):
        raise InputError(
            f"{plan.scene}: is not the scene that the plate was begun with; give all the same file"
        )
    held = ExitStack()
    source = source_of(scene, plan.settings, plan.content, judge=plan.judged)
    held.enter_context(source)
    try:
        store = opened_store(source, plan.out, plan.side)
    except BaseException:
        held.close()
        raise
    _of_thread.opened = _Opened(plan=plan, source=source, store=store, held=held)
    return _of_thread.opened


def close() -> None:
    """Free what this thread has opened, if anything."""
    found, _of_thread.opened = _of_thread.opened, None
    if found is not None:
        found.held.close()


def _apertures(plan: PlatePlan) -> ApertureBlocks:
    """Return the hogels that a plan asks for."""
    if not plan.chosen:
        return plan.plate.apertures()
    blocks = tuple((range(left, right), range(top, bottom)) for left, right, top, bottom in plan.chosen)
    return ApertureBlocks(plan.plate, blocks)
