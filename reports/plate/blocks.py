"""Blocks of a plate drawn by any process: a plan that fits into a message, and a function that draws one.

A block of hogels is a shard of every array of the store, and is there whole or not. Any process that sees the
store and the scene's file may draw any block, in any order, and may die: what it has not finished is drawn
again. Nothing is handed back but counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from pydantic import TypeAdapter

from xfrustum.reports.cluster.blocks import Blocks
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import HogelJob, Session, desk_of_thread
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.plate.description import described, document_of
from xfrustum.reports.plate.layout import Layout
from xfrustum.reports.plate.plate import (
    BlockWork,
    PlateFiles,
    draw_parts,
    layout_of,
    opened_store,
    source_of,
)
from xfrustum.reports.plate.sources import HogelSource
from xfrustum.reports.plate.store import PlateStore
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.plate_content import PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

FIRST_ENGINE_CLAIM = 1 << 40
"""Claim of the engine's first block; `draw_parts` claims blocks by their own numbers, which are smaller."""


@dataclass(frozen=True, kw_only=True)
class StoreBlocks(Blocks):
    """The blocks of a plate's store, and the hogels of them that are asked for.

    Attributes
    ----------
    layout
        Layout of the store.
    chosen
        Hogels that are asked for.
    """

    layout: Layout
    chosen: ApertureBlocks

    looks = 1

    def numbers(self, look: int) -> range:
        """Return the numbers of all blocks of the plate."""
        across, down = self.layout.blocks
        return range(across * down) if look == 0 else range(0)

    def hogels(self, look: int) -> int:
        """Return the number of hogels that are asked for."""
        return len(self.chosen) if look == 0 else 0

    def apertures(self, number: int) -> Sequence[Aperture]:
        """Return those of a block that are asked for."""
        return self.layout.part(number, self.chosen).apertures


@dataclass(frozen=True, kw_only=True)
class PlatePlan(HogelJob):
    """A plate to be drawn, as any process can take it up: small, immutable, and the same as JSON.

    Attributes
    ----------
    ticket
        The scene: a process that finds another one refuses.
    settings
        Settings of the cameras; None for truths.
    out
        Folder of the store.
    layout
        Layout of the store, by which any process sees what is finished.
    chosen
        Columns and rows, first and last, of rectangles of hogels; none for the whole plate.
    judged
        Whether hogels are judged, and their measures stored.
    """

    ticket: SceneTicket
    settings: DoubleFrustum | None
    out: Path
    layout: Layout
    chosen: tuple[tuple[int, int, int, int], ...] = ()
    judged: bool = False

    def to_json(self) -> str:
        """Return the plan as a JSON object."""
        return TypeAdapter(PlatePlan).dump_json(self).decode()

    @staticmethod
    def from_json(text: str) -> PlatePlan:
        """Return the plan that `to_json` wrote."""
        return TypeAdapter(PlatePlan).validate_json(text)

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "plate"

    @property
    def apertures(self) -> ApertureBlocks:
        """Hogels that are asked for."""
        plate = self.layout.plate
        if not self.chosen:
            return plate.apertures()
        blocks = tuple((range(left, right), range(top, bottom)) for left, right, top, bottom in self.chosen)
        return ApertureBlocks(plate, blocks)

    @property
    def blocks(self) -> Blocks:  # type: ignore[override]  # others hold their blocks, this one derives them
        """Blocks of the store."""
        return StoreBlocks(layout=self.layout, chosen=self.apertures)

    def finished(self, number: int) -> bool:
        """Return whether all hogels of a block that are asked for are there."""
        part = self.layout.part(number, self.apertures)
        return not _store(self.out, self.layout).state(part).missing

    def claims(self) -> Claims:
        """Return the claims of engines' workers, beside those of the processes that draw."""
        return Claims(self.out / "zarr.json", FIRST_ENGINE_CLAIM)

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[PlateSession]:
        """Open the scene, and what makes its hogels."""
        here = self.ticket.open() if scene is None else scene
        with source_of(here, self.settings, self.layout.content, judge=self.judged) as source:
            yield PlateSession(self, source)


class PlateSession(Session):
    """What makes the hogels of one plan; the store is opened at the first block."""

    def __init__(self, plan: PlatePlan, source: HogelSource) -> None:
        self._plan, self._source = plan, source
        self._store: PlateStore | None = None

    @property
    def document(self) -> dict[str, object]:
        """Everything that decides the pixels that this process makes, its device included."""
        return document_of(described(self._source))

    def make(self, number: int) -> None:
        """Draw what is missing of a block."""
        self.draw(number)

    def draw(self, number: int) -> PlateFiles:
        """Draw what is missing of a block, and return what became of its hogels.

        Raises
        ------
        InputError
            The store was begun with something else, such as another device.
        """
        plan = self._plan
        if self._store is None:
            self._store = opened_store(self._source, plan.out, plan.layout.side)
        part = self._store.layout.part(number, plan.apertures)
        with self._store.claims() as claims, progress_bar(0, "plate", "hogel", shown=False) as bar:
            work = BlockWork(store=self._store, claims=claims, bar=bar)
            draw_parts(self._source, work, [part])
        return work.files()


@lru_cache(maxsize=4)
def _store(out: Path, layout: Layout) -> PlateStore:
    """Return the store of a layout; a process asks for its files many times."""
    return PlateStore(out, layout)


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
    if not scene.source:
        raise InputError(f"{scene.name}: has no file or name by which other processes could open it")
    plan = new_plan(scene, settings, out, apertures, content, block=block, judge=judge)
    with source_of(scene, settings, plan.layout.content, judge=judge) as source:
        store = opened_store(source, out, block)
    return replace(plan, layout=store.layout)


def new_plan(  # noqa: PLR0913 - as `write_plate`
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path,
    apertures: ApertureBlocks | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
) -> PlatePlan:
    """Return the plan of a plate whose store is not there yet; parameters as for `write_plate`."""
    chosen = () if apertures is None else apertures.blocks
    return PlatePlan(
        ticket=SceneTicket.of(scene),
        settings=settings,
        out=out.absolute(),
        layout=layout_of(scene, content or PlateContent(), block, judged=judge),
        chosen=tuple((columns.start, columns.stop, rows.start, rows.stop) for columns, rows in chosen),
        judged=judge,
    )


def blocks_of(plan: PlatePlan) -> Iterator[int]:
    """Yield the numbers of the blocks that a plan asks for, without listing them and without the scene."""
    yield from plan.layout.touched(plan.apertures)


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
    session = desk_of_thread().session(plan)
    assert isinstance(session, PlateSession), "a plan opens sessions of its own kind"
    return session.draw(number)


def close() -> None:
    """Free what this thread has opened, if anything."""
    desk_of_thread().close()
