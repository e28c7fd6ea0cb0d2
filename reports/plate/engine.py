"""Plates on the engine of `reports.cluster`: blocks drawn by worker processes, by a cluster, or in parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

from xfrustum.reports.cluster.run import Engine, open_team, run_blocks
from xfrustum.reports.plate.blocks import PlateSession, blocks_of, new_plan
from xfrustum.reports.plate.plate import PlateFiles, notes_of
from xfrustum.reports.plate.store import open_store
from xfrustum.scenes.model.plate_content import PlateContent
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.aperture_blocks import ApertureBlocks
from xfrustum.scenes.plate.double_frustum import DoubleFrustum


def document_asked(session: PlateSession) -> dict[str, object]:
    """Return what decides the pixels of a process; the question that a team of workers is asked."""
    return session.document


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

    The store names the device that the workers have, and workers with another one refuse to draw into it.

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
    plan = new_plan(scene, settings, out, apertures, content, block=block, judge=judge)
    part, missing, damaged, asked = engine.part, 0, 0, 0
    count = sum(1 for _ in islice(blocks_of(plan), part.number - 1, None, part.count))
    with open_team(engine, count, scene, told, draws=settings is not None) as team:
        store = open_store(out, plan.layout, team.ask(plan, document_asked), free=block is None)
        plan = replace(plan, layout=store.layout)
        numbers = list(islice(blocks_of(plan), part.number - 1, None, part.count))
        for number in numbers:
            state = store.state(plan.layout.part(number, plan.apertures))
            missing, damaged = missing + len(state.missing), damaged + len(state.damaged)
            asked += plan.size(number)
        run_blocks(plan, numbers, team, asked, "plate", progress=progress)
    return PlateFiles(
        out=out,
        drawn=missing,
        found=asked - missing,
        damaged=damaged,
        notes=tuple(notes_of(store, damaged)),
        table=store.table.folder if judge else None,
    )
