"""`xfrustum survey`: the share of a plate's hogels beyond a tolerance, and the worst hogels."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pyarrow as pa

from xfrustum.compare.sampling import PathApertures, PlateSample, SampleRequest, places_of
from xfrustum.compare.truths import TruthBy, chosen_order
from xfrustum.reports.blocks import Engine, blocks_of, open_workers
from xfrustum.reports.common.outputs import check_writable_folder, json_ready, progress_bar
from xfrustum.reports.parts import ParquetParts, scene_description
from xfrustum.reports.scene_check.sight import require_seen
from xfrustum.reports.survey.answer import FILES, Survey, write_survey
from xfrustum.reports.survey.rows import (
    SurveyJob,
    SurveySession,
    counted_rows,
    hogels_per_block,
    rows_per_block,
    stats_of,
)
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.arguments import choice, one_of, real
from xfrustum.scenes.model.visibility import apertures_drawn
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

#: name of the folder of the rows
ROWS = "survey.parquet"


def survey(  # noqa: PLR0913 - one keyword for each option of the command
    scene: Scene,
    settings: DoubleFrustum | Sequence[DoubleFrustum],
    out: Path,
    request: SampleRequest | None = None,
    *,
    tolerance_px: float = TOLERANCE_PX,
    tracer: str = "embree",
    truth_by: TruthBy | str = TruthBy.AUTO,
    engine: Engine | None = None,
    note: Callable[[str], object] = lambda line: None,
    progress: bool = False,
) -> Survey:
    """Judge hogels all over a plate; write survey.parquet, survey.json and the pages.

    Every hogel is drawn with each setting; `compare.beyond` defines the hogels beyond
    `tolerance_px`. `tracer` gives a second opinion on the truth. `truth_by` is the order in which
    truths are computed; it changes no row. `engine` judges the hogels, by default in one process
    per processor. `note` receives sentences.

    A stopped survey continues. Rows equal the rows of an undisturbed run, except the index of
    `device`, which identifies the worker's device.

    Raises InputError if scene, settings or folder are unusable, or the folder has another survey.
    """
    one_of(scene, Scene, "scene")
    request, engine = request or SampleRequest(), engine or Engine()
    if request.until is not None and not engine.part.everything:
        raise InputError(
            "--part needs the number of hogels beforehand, and --until finds it; use --all or "
            "--sample"
        )
    if not real(tolerance_px) > 0:
        raise InputError(f"--tolerance-px must be positive, not {tolerance_px}")
    check_writable_folder(out, FILES)
    require_seen(scene, scene.plate.apertures())
    drawn = _each(settings, scene)
    parts = ParquetParts(out=out.absolute(), name=ROWS)
    hogels = math.prod(scene.plate.hogels)
    everything = request.sample is None and request.until is None
    order = chosen_order(
        choice(TruthBy, truth_by, "truth_by"),
        scene,
        refusal="" if everything else "decides all hogels of a plate: give --all too",
        rows=rows_per_block(scene),
    )
    job = SurveyJob(
        scene=scene,
        parts=parts,
        tolerance_px=tolerance_px,
        settings=drawn,
        tracer=tracer,
        truth_by=order,
    )
    # Sample only hogels that can show something.
    population = None if everything else places_of(apertures_drawn(scene, drawn))
    sample = PlateSample.from_request(hogels, request, population, len(drawn))
    size = hogels_per_block(sample.first_size, scene.frustum, len(drawn))
    if order is TruthBy.DIRECTIONS:
        size = rows_per_block(scene) * scene.plate.hogels[0]
    work = {
        "settings": drawn,
        "tracer": tracer,
        "max_wrong": MAX_WRONG,
        "tolerance_px": tolerance_px,
    }
    work |= {"scene": scene_description(scene), "hogels": sample.description}
    # Blocks depend on the order of truths: a message on another order then does not name blocks.
    work["truths"] = {"--truth-by": order, order: {"block": size}}
    parts.open(json_ready(work))

    begun, rows = time.perf_counter(), list[pa.Table]()
    plate = scene.plate
    blocks = blocks_of(PathApertures(plate, sample.new_places(0)), size, 0)
    own = list(engine.part.of(blocks))
    with (
        open_workers(engine, len(blocks), draws=job.draws) as workers,
        progress_bar(sum(map(job.size, own)), job.name, job.unit, shown=progress) as bar,
    ):
        for look in range(sample.looks):
            # Only a growing sample, which job arrays refuse, has more than one look.
            if look:
                grown = PathApertures(plate, sample.new_places(look))
                own = blocks = blocks_of(grown, size, blocks[-1].number + 1)
                bar.total += sum(map(job.size, own))
            parts.tell_damaged((block.number for block in own), note)
            workers.make(job, own, bar)
            finished = blocks if engine.part.everything else list(filter(job.finished, blocks))
            rows += [counted_rows(parts.read(block.number)) for block in finished]
            stats = stats_of(plate.hogels, len(drawn), rows)
            complete = len(finished) == len(blocks)
            extent = sample.extent(stats[0].judged, look, complete=complete)
            if all(extent.decides(counts.beyond) for counts in stats):
                break
        answer = Survey(
            scene=scene,
            settings=drawn,
            stats=stats,
            extent=extent,
            tolerance_px=tolerance_px,
            truth_by=order,
            workers=workers.count,
            wall_s=time.perf_counter() - begun,
        )
        if extent.complete:
            shown = [
                (hogel, workers.ask(job, SurveySession.shown, hogel.aperture, answer.best))
                for hogel in stats[answer.best].worst
            ]
            write_survey(answer, shown, parts.out)
    return answer


def _each(
    settings: DoubleFrustum | Sequence[DoubleFrustum], scene: Scene
) -> tuple[DoubleFrustum, ...]:
    """Return the settings without repetition; InputError if a setting does not fit the scene."""
    drawn = (settings,) if isinstance(settings, DoubleFrustum) else tuple(dict.fromkeys(settings))
    if not drawn:
        raise InputError("a survey needs at least one setting; give --near or --nears")
    for setting in drawn:
        setting.check_against(scene.frustum)
    return drawn
