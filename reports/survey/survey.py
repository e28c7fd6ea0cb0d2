"""`xfrustum survey`: which share of a plate's hogels is beyond a tolerance, and where it is worst."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa

from xfrustum.compare.extent import require_seen
from xfrustum.compare.scouting.strata import (
    GrowingSample,
    clean_sample,
    confidence_of_each_setting,
    risk_of_look,
)
from xfrustum.reports.cluster.blocks import Blocks, SampleBlocks, Tiles, hogels_per_block
from xfrustum.reports.cluster.run import Engine, Team, open_team, run_blocks
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common.formatting import percent
from xfrustum.reports.common.json_ready import json_ready
from xfrustum.reports.common.outputs import check_writable_folder
from xfrustum.reports.parts import Parts
from xfrustum.reports.survey.answer import Extent, Survey
from xfrustum.reports.survey.foreign import ForeignJob, ForeignPlate
from xfrustum.reports.survey.hogels import HogelsJob, ShownHogel, worst_hogel
from xfrustum.reports.survey.page import FILES, Pictured, write_survey
from xfrustum.reports.survey.tally import Tally, tallies
from xfrustum.scenes.arguments import one_of, real
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

ROWS = "survey.parquet"
"""Folder of the rows."""

DEFAULT_SAMPLE = 300
"""Hogels of a sample unless another number is asked for: if none of them is beyond the limits, at most 1 %
of all are, with a confidence of 95 % (0.95 to the power 1/299 is 0.99)."""


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Which hogels of a plate are judged: all, so many, or as many as a bound needs.

    Attributes
    ----------
    sample
        Number of hogels of a sample; None for all.
    until
        Share at which the bound stops the survey; samples then grow from as many hogels as would do if none
        of them was beyond the tolerance.
    seed
        Start of the random numbers.

    Raises
    ------
    InputError
        A number is not possible.
    """

    sample: int | None = DEFAULT_SAMPLE
    until: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.until is not None and not 0 < real(self.until) < 1:
            raise InputError(f"--until must be a share between 0 and 100 %, not {self.until}")

    def blocks(self, scene: Scene, settings: int) -> Blocks:
        """Return the blocks of these hogels.

        Parameters
        ----------
        scene
            Scene of the plate.
        settings
            Number of settings, each of which is claimed something of.
        """
        plate, frustum = scene.plate, scene.frustum
        hogels = math.prod(plate.hogels)
        first = self.sample
        if self.until is not None:
            first = clean_sample(self.until, hogels, risk_of_look(0, confidence_of_each_setting(settings)))
        if first is None or first >= hogels:
            return Tiles.of(plate, hogels_per_block(hogels, frustum, settings))
        sample = GrowingSample(plate=plate, first=first, seed=self.seed)
        looks = 1 if self.until is None else sample.looks
        return SampleBlocks(sample=sample, size=hogels_per_block(first, frustum, settings), looks=looks)


def survey(  # noqa: PLR0913 - one keyword for each option of the command
    scene: Scene,
    settings: DoubleFrustum | Sequence[DoubleFrustum] | ForeignPlate,
    out: Path,
    chosen: Chosen | None = None,
    *,
    tolerance_px: float = TOLERANCE_PX,
    tracer: str = "embree",
    engine: Engine | None = None,
    told: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> Survey:
    """Judge hogels all over a plate, and write the rows, their page and survey.json.

    Stopped at any moment and called again it goes on where it was, and ends with the rows of a run that was
    not disturbed but for one column: the index of `device` is that of the worker that took the block, so
    that with several GPUs it depends on who was free. Several processes may do one survey at once.

    Parameters
    ----------
    scene
        Scene of the plate.
    settings
        Settings that every hogel is drawn with; or the plate of another renderer.
    out
        Folder, made where it does not exist.
    chosen
        Which hogels are judged; a sample of `DEFAULT_SAMPLE` by default.
    tolerance_px
        Displacement of 1 % of a hogel's points beyond which it is counted; it is counted too where more than
        `MAX_WRONG` of its pixels show the wrong surface.
    tracer
        Tracer that gives the truth a second opinion.
    engine
        Where hogels are judged; as many processes as this one may use processors by default.
    told
        Called with notes in words, such as the address of the dashboard.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The scene, settings or folder are not usable, or the folder holds something else.
    """
    one_of(scene, Scene, "scene")
    chosen, engine = chosen or Chosen(), engine or Engine()
    if chosen.until is not None and not engine.part.everything:
        raise InputError("--part: how many hogels --until takes is known in the end; use --all or --sample")
    if not real(tolerance_px) > 0:
        raise InputError(f"--tolerance-px must be positive, not {tolerance_px}")
    check_writable_folder(out, FILES)
    require_seen(scene, scene.plate.apertures())
    if isinstance(settings, ForeignPlate):
        settings = settings.found(scene, told)
    job, several = _job(scene, settings, chosen, tolerance_px, tracer, out)
    run = _Run(
        scene=scene, job=job, settings=several, chosen=chosen, tolerance_px=tolerance_px, engine=engine
    )
    return run.done(told, progress=progress)


Surveyed = HogelsJob | ForeignJob


def _job(
    scene: Scene,
    settings: DoubleFrustum | Sequence[DoubleFrustum] | ForeignPlate,
    chosen: Chosen,
    tolerance_px: float,
    tracer: str,
    out: Path,
) -> tuple[Surveyed, tuple[DoubleFrustum | None, ...]]:
    """Return the work, described in its folder, and the settings that are judged."""
    ticket, parts = SceneTicket.of(scene), Parts(out=out.absolute(), name=ROWS)
    work: dict[str, Any]
    job: Surveyed
    if isinstance(settings, ForeignPlate):
        blocks, state = chosen.blocks(scene, 1), settings.state(scene.plate)
        job = ForeignJob(
            ticket=ticket, plate=settings, state=state, tolerance_px=tolerance_px, blocks=blocks, parts=parts
        )
        several: tuple[DoubleFrustum | None, ...] = (None,)
        work = {"images": settings.description, "state of the images": state}
    else:
        drawn = (settings,) if isinstance(settings, DoubleFrustum) else tuple(dict.fromkeys(settings))
        if not drawn:
            raise InputError("a survey needs at least one setting; give --near or --nears")
        for one in drawn:
            one.check_against(scene.frustum)
        blocks = chosen.blocks(scene, len(drawn))
        job = HogelsJob(
            ticket=ticket,
            settings=drawn,
            tracer=tracer,
            tolerance_px=tolerance_px,
            blocks=blocks,
            parts=parts,
        )
        several = drawn
        work = {"settings": drawn, "tracer": tracer, "max_wrong": MAX_WRONG}
    hogels = blocks.description
    parts.open(
        json_ready({"scene": ticket.description, **work, "tolerance_px": tolerance_px, "hogels": hogels})
    )
    return job, several


@dataclass(kw_only=True, eq=False)
class _Run:
    """One survey under way."""

    scene: Scene
    job: Surveyed
    settings: tuple[DoubleFrustum | None, ...]
    chosen: Chosen
    tolerance_px: float
    engine: Engine
    tallies: list[Tally] = field(default_factory=list)

    def done(self, told: Callable[[str], object], *, progress: bool) -> Survey:
        """Judge what is not judged yet, and write the outcome where it is complete."""
        begun, blocks, part = time.perf_counter(), self.job.blocks, self.engine.part
        first = blocks.numbers(0)
        with open_team(self.engine, len(first), self.scene, told, draws=self.job.draws) as team:
            for look in range(blocks.looks):
                numbers = list(part.of(blocks.numbers(look)))
                damaged = sum(map(self.job.parts.damaged, numbers))
                if damaged:
                    folder = self.job.parts.folder
                    told(f"{damaged} of {len(numbers)} blocks in {folder} are damaged, and are made again")
                hogels = blocks.hogels(look) // part.count
                run_blocks(self.job, numbers, team, hogels, "survey", progress=progress)
                complete = part.everything or all(map(self.job.finished, blocks.numbers(look)))
                self._count(look)
                found = self._survey(look, complete, team, begun)
                if found.decided:
                    break
            if complete:
                pictures = self._pictured(found, team)
                found = self._survey(look, complete, team, begun)
        if complete:
            write_survey(found, pictures, self.job.parts.out)
        return found

    def _count(self, look: int) -> None:
        """Add the rows of a look to those of the looks before."""
        hogels = self.scene.plate.hogels
        self.tallies = tallies(self._tables(look), self.tallies, len(self.settings), hogels)

    def _tables(self, look: int) -> Iterator[pa.Table]:
        for number in self.job.blocks.numbers(look):
            if self.engine.part.everything or self.job.finished(number):
                yield self.job.parts.read(number)

    def _survey(self, look: int, complete: bool, team: Team, begun: float) -> Survey:
        blocks = self.job.blocks
        sampled = isinstance(blocks, SampleBlocks)
        return Survey(
            scene=self.scene,
            settings=self.settings,
            tallies=tuple(self.tallies),
            extent=Extent(
                hogels=math.prod(self.scene.plate.hogels),
                judged=self.tallies[0].judged,
                look=look if self.chosen.until is not None and sampled else None,
                seed=self.chosen.seed if sampled else None,
                complete=complete,
            ),
            tolerance_px=self.tolerance_px,
            limit=self.chosen.until,
            judged_by=f"beyond {self.tolerance_px:g} px or {percent(MAX_WRONG)} wrong",
            workers=team.workers,
            wall_s=time.perf_counter() - begun,
        )

    def _pictured(self, found: Survey, team: Team) -> list[Pictured]:
        """Return the worst hogels of the best setting with their pictures, drawn anew."""
        pictured = []
        for worst in found.tallies[found.best].worst:
            shown: ShownHogel = team.ask(self.job, worst_hogel, *worst.aperture, found.best)
            pictured.append(Pictured(worst=worst, pictures=shown.pictures, inspected=shown.inspected))
        return pictured
