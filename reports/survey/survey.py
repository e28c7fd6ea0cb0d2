"""`xfrustum survey`: which share of a plate's hogels is beyond a tolerance, and where it is worst."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from xfrustum.compare.extent import apertures_drawn, require_seen
from xfrustum.compare.sampling import GrowingSample, clean_sample, places_of, risk_of_claim
from xfrustum.reports.blocks import Engine, open_workers
from xfrustum.reports.common.outputs import check_writable_folder, json_ready, progress_bar
from xfrustum.reports.parts import ParquetParts, scene_description
from xfrustum.reports.survey import rows
from xfrustum.reports.survey.answer import FILES, Extent, Survey, write_survey
from xfrustum.reports.verification.sources import ForeignRenderer
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.arguments import one_of, real
from xfrustum.scenes.arrays import Indices
from xfrustum.scenes.representation import percent
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

ROWS = "survey.parquet"  # folder of the rows
DEFAULT_SAMPLE = 300
"""Hogels of a sample unless another number is asked for: if none of them is beyond the limits, at most 1 %
of all are, with a confidence of 95 % (0.95 to the power 1/299 is 0.99)."""


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Which hogels of a plate are judged: all, so many, or as many as a bound needs."""

    sample: int | None = DEFAULT_SAMPLE  #: number of hogels of a sample; None for all
    #: Share at which the bound stops the survey; samples then grow from as many hogels as would do
    #: if none of them was beyond the tolerance.
    until: float | None = None
    seed: int = 0  #: start of the random numbers

    def __post_init__(self) -> None:
        if self.until is not None and not 0 < real(self.until) < 1:
            raise InputError(f"--until must be a share between 0 and 100 %, not {self.until}")


@dataclass(frozen=True, kw_only=True)
class Hogels:
    """Which hogels are judged: all of a population, or samples that grow; in blocks of `size`.

    Sampled are hogels that can show something; with `Chosen.sample` None, every hogel of the plate
    is judged.
    """

    population: Indices | range  #: places on the path of the plate
    sample: GrowingSample | None
    looks: int
    size: int

    @classmethod
    def from_scene(
        cls, scene: Scene, chosen: Chosen, settings: Sequence[DoubleFrustum | None]
    ) -> Hogels:
        """Return the hogels of a plate, of which something is claimed of each of several settings."""
        hogels, first = math.prod(scene.plate.hogels), chosen.sample
        population: Indices | range = range(hogels)
        drawn = [one for one in settings if one is not None]
        # Images of another renderer may show something in any hogel.
        if drawn and (first is not None or chosen.until is not None):
            population = places_of(apertures_drawn(scene, drawn))
        if chosen.until is not None:
            share = min(1.0, chosen.until * hogels / len(population))
            first = clean_sample(share, len(population), risk_of_claim(len(settings), look=0))
        sample, looks = None, 1
        if first is None or first >= len(population):
            first = len(population)
        else:
            sample = GrowingSample(hogels=len(population), first=first, seed=chosen.seed)
            looks = 1 if chosen.until is None else sample.looks
        size = rows.hogels_per_block(first, scene.frustum, len(settings))
        return cls(population=population, sample=sample, looks=looks, size=size)

    @property
    def description(self) -> dict[str, Any]:
        """Return what decides the blocks, beside the scene and the settings."""
        return {**vars(self), "population": len(self.population)}

    def blocks(self, look: int, first: int) -> list[rows.HogelBlock]:
        """Return the blocks that a look adds, numbered from the first on; the last may have fewer hogels."""
        if self.sample is not None:
            places: Sequence[int] = np.asarray(self.population)[
                self.sample.new_places(look)
            ].tolist()
        elif isinstance(self.population, range):  # of millions of hogels, which are never listed
            places = self.population
        else:
            places = self.population.tolist()
        begins = range(0, len(places), self.size)
        return [
            rows.HogelBlock(number=number, places=places[begin : begin + self.size])
            for number, begin in enumerate(begins, first)
        ]


def survey(  # noqa: PLR0913 - one keyword for each option of the command
    scene: Scene,
    settings: DoubleFrustum | Sequence[DoubleFrustum] | ForeignRenderer,
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

    Every hogel is drawn with each of the settings, or is one of another renderer's plate; by
    default a sample of `DEFAULT_SAMPLE` is judged. It is beyond `tolerance_px` by `compare.beyond`;
    `tracer` gives the truth a second opinion. Hogels are judged by `engine`, by default in as many
    processes as this one may use processors; `told` takes notes, a sentence each.

    Stopped at any moment and called again it goes on where it was, and ends with the rows of a run
    that was not disturbed but for one column: the index of `device` is that of the worker that took
    the block, so that with several GPUs it depends on who was free.

    InputError where the scene, settings or folder are not usable, or the folder holds something
    else.
    """
    one_of(scene, Scene, "scene")
    chosen, engine = chosen or Chosen(), engine or Engine()
    if chosen.until is not None and not engine.part.everything:
        raise InputError(
            "--part: how many hogels --until takes is known in the end; use --all or --sample"
        )
    if not real(tolerance_px) > 0:
        raise InputError(f"--tolerance-px must be positive, not {tolerance_px}")
    check_writable_folder(out, FILES)
    require_seen(scene, scene.plate.apertures())
    parts = ParquetParts(out=out.absolute(), name=ROWS)
    common: dict[str, Any] = {"scene": scene, "parts": parts, "tolerance_px": tolerance_px}
    job: rows.DrawnJob | rows.ForeignJob
    several: tuple[DoubleFrustum | None, ...]
    if isinstance(settings, ForeignRenderer):
        renderer = settings.with_layout(scene, told)
        state = renderer.state(scene.plate.apertures())
        job, several = rows.ForeignJob(renderer=renderer, state=state, **common), (None,)
        work: dict[str, Any] = {"images": renderer.description, "state of the images": state}
    else:
        drawn = _each(settings, scene)
        job, several = rows.DrawnJob(settings=drawn, tracer=tracer, **common), drawn
        work = {"settings": drawn, "tracer": job.tracer, "max_wrong": MAX_WRONG}
    hogels = Hogels.from_scene(scene, chosen, several)
    described = hogels.description
    work |= {"scene": scene_description(scene), "tolerance_px": tolerance_px, "hogels": described}
    parts.open(json_ready(work))

    begun, found = time.perf_counter(), [rows.SettingStats(scene.plate.hogels) for _ in several]
    blocks, sample = hogels.blocks(0, 0), hogels.sample

    def answer(look: int, *, complete: bool) -> Survey:
        return Survey(
            scene=scene,
            settings=several,
            tallies=tuple(found),
            extent=Extent(
                hogels=math.prod(scene.plate.hogels),
                seeing=len(hogels.population),
                judged=found[0].judged,
                look=look if chosen.until is not None and sample else None,
                seed=None if sample is None else sample.seed,
                complete=complete,
            ),
            tolerance_px=tolerance_px,
            limit=chosen.until,
            judged_by=f"beyond {tolerance_px:g} px or {percent(MAX_WRONG)} wrong",
            workers=workers.count,
            wall_s=time.perf_counter() - begun,
        )

    mine = list(engine.part.of(blocks))
    with (
        open_workers(engine, len(blocks), draws=job.draws) as workers,
        progress_bar(sum(map(job.size, mine)), job.name, job.unit, shown=progress) as bar,
    ):
        for look in range(hogels.looks):
            if look:  # the parts of a job array have but one
                blocks = mine = hogels.blocks(look, blocks[-1].number + 1)
                bar.total += sum(map(job.size, mine))
            parts.tell_damaged((block.number for block in mine), told)
            workers.make(job, mine, bar)
            finished = blocks if engine.part.everything else list(filter(job.finished, blocks))
            rows.add_rows(found, (parts.read(block.number) for block in finished))
            surveyed = answer(look, complete=len(finished) == len(blocks))
            if surveyed.decided:
                break
        if surveyed.extent.complete:
            worst = surveyed.tallies[surveyed.best].worst
            pictures = [
                workers.ask(job, rows.shown_hogel, one.aperture, surveyed.best) for one in worst
            ]
            surveyed = answer(look, complete=True)
            write_survey(surveyed, list(zip(worst, pictures, strict=True)), parts.out)
    return surveyed


def _each(
    settings: DoubleFrustum | Sequence[DoubleFrustum], scene: Scene
) -> tuple[DoubleFrustum, ...]:
    """Return the settings, each once; InputError where there are none, or one does not suit the scene."""
    drawn = (settings,) if isinstance(settings, DoubleFrustum) else tuple(dict.fromkeys(settings))
    if not drawn:
        raise InputError("a survey needs at least one setting; give --near or --nears")
    for one in drawn:
        one.check_against(scene.frustum)
    return drawn
