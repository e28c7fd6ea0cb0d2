"""Plates on the engine of `reports.cluster`: blocks drawn by worker processes, by a cluster, or in parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path

from xfrustum.reports.cluster.blocks import Blocks
from xfrustum.reports.cluster.claims import Claims
from xfrustum.reports.cluster.job import Job, Session
from xfrustum.reports.cluster.processes import first_device
from xfrustum.reports.cluster.run import Engine, open_team, run_blocks
from xfrustum.reports.plate import blocks as plate_blocks
from xfrustum.reports.plate.blocks import PlatePlan, begin_plate, blocks_of, draw_block
from xfrustum.reports.plate.layout import Layout
from xfrustum.reports.plate.plate import PlateFiles, layout_of, notes_of
from xfrustum.reports.plate.store import PlateStore
from xfrustum.scenes.model.plate_content import PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.scenes.plate.plate import Aperture

FIRST_ENGINE_CLAIM = 1 << 40
"""Claim of the engine's first block; `draw_block` claims blocks by their own numbers, which are smaller."""


class _EngineClaims(Claims):
    """Claims of blocks among the workers of all engines, beside those of the processes that draw them."""

    def take(self, number: int) -> bool:
        """Claim a block and return whether no other worker has."""
        return super().take(FIRST_ENGINE_CLAIM + number)

    def release(self, number: int) -> None:
        """Let go of a block."""
        super().release(FIRST_ENGINE_CLAIM + number)


@dataclass(frozen=True, kw_only=True)
class _PlateBlocks(Blocks):
    """The blocks of a plate's store, of which a plan asks for some."""

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
class PlateJob(Job):
    """A plate to be drawn, as it travels to workers.

    Attributes
    ----------
    plan
        The plate.
    layout
        Layout of its store, by which any process sees what is finished.
    """

    plan: PlatePlan
    layout: Layout

    @property
    def name(self) -> str:
        """Word by which the dashboard groups its tasks."""
        return "plate"

    @property
    def blocks(self) -> Blocks:  # type: ignore[override]  # others hold their blocks, this one derives them
        """Blocks of the store."""
        chosen = self.plan.plate.apertures()
        if self.plan.chosen:
            rectangles = tuple((range(a, b), range(c, d)) for a, b, c, d in self.plan.chosen)
            chosen = ApertureBlocks(self.plan.plate, rectangles)
        return _PlateBlocks(layout=self.layout, chosen=chosen)

    def finished(self, number: int) -> bool:
        """Return whether all hogels of a block that are asked for are there."""
        blocks = self.blocks
        assert isinstance(blocks, _PlateBlocks)
        part = self.layout.part(number, blocks.chosen)
        return not _store(self.plan.out, self.layout).state(part).missing

    def claims(self) -> Claims:
        """Return the claims of the engines' workers."""
        return _EngineClaims(self.plan.out / "zarr.json")

    @contextmanager
    def open(self, scene: Scene | None = None) -> Iterator[Session]:
        """Provide what draws blocks; the scene is opened by its path at the first one."""
        del scene
        try:
            yield _PlateSession(self.plan)
        finally:
            plate_blocks.close()


class _PlateSession(Session):
    """The plan that a process draws blocks of."""

    def __init__(self, plan: PlatePlan) -> None:
        self._plan = plan

    def make(self, number: int) -> None:
        """Draw what is missing of a block."""
        draw_block(self._plan, number)


@lru_cache(maxsize=4)
def _store(out: Path, layout: Layout) -> PlateStore:
    """Return the store of a layout; a process asks for its files many times."""
    return PlateStore(out, layout)


def write_plate_on(  # noqa: PLR0913 - one parameter per option of the command
    engine: Engine,
    scene: Scene,
    settings: DoubleFrustum | None,
    out: Path,
    apertures: ApertureBlocks | None = None,
    content: PlateContent | None = None,
    *,
    block: tuple[int, int] | None = None,
    judge: bool = False,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> PlateFiles:
    """Draw what is missing of a plate by several processes; the store is that of `write_plate`.

    Parameters
    ----------
    engine
        Where blocks are drawn.
    scene, settings, out, apertures, content, block, judge, progress
        As for `write_plate`.
    told
        Called with notes in words, such as the address of the dashboard.

    Raises
    ------
    InputError
        As from `write_plate`; or no scheduler answers, or a worker finds another scene.
    """
    with first_device(engine.devices):
        plan, store = begin_plate(scene, settings, out, apertures, content, block=block, judge=judge)
    layout = layout_of(scene, plan.content, plan.side, judged=judge)
    job = PlateJob(plan=plan, layout=layout)
    hogels = job.blocks.hogels(0)
    part = engine.part
    numbers = list(islice(blocks_of(plan), part.number - 1, None, part.count))
    chosen, missing, damaged = apertures or plan.plate.apertures(), 0, 0
    for number in numbers:
        state = store.state(layout.part(number, chosen))
        missing, damaged = missing + len(state.missing), damaged + len(state.damaged)
    with open_team(engine, len(numbers), scene, told) as team:
        run_blocks(job, numbers, team, hogels // part.count, "plate", progress=progress)
    asked = sum(len(job.blocks.apertures(number)) for number in numbers)
    return PlateFiles(
        out=out,
        drawn=missing,
        found=asked - missing,
        damaged=damaged,
        notes=tuple(notes_of(store, damaged)),
        table=store.table.folder if judge else None,
    )
