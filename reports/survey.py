"""`xfrustum survey`: the share of a plate's hogels beyond a tolerance, and the worst hogels.

Hogels are judged all over the plate (`survey_rows`). The result has the counts and bounds of each
setting (`compare.sampling`), a sentence, a JSON object and a page.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from xfrustum.compare.sampling import (
    PathApertures,
    PlateSample,
    SampleExtent,
    SampleRequest,
    places_of,
)
from xfrustum.reference.truth import TruthBy, chosen_order
from xfrustum.reports import inspection, survey_rows
from xfrustum.reports.blocks import Engine, blocks_of, open_workers
from xfrustum.reports.common.outputs import (
    Staging,
    check_writable_folder,
    json_object,
    json_ready,
    progress_bar,
    raster_command,
    versions,
)
from xfrustum.reports.common.templates_environment import html_page, sentence
from xfrustum.reports.inspection import PlateMap
from xfrustum.reports.notebook import Figure, NotebookRepr, map_of, png
from xfrustum.reports.parts import ParquetParts, scene_description
from xfrustum.reports.plotting import MARK, log_axis, look, mark, plate_map, styled
from xfrustum.reports.plotting import Figure as Plot
from xfrustum.reports.survey_rows import (
    SurveyJob,
    SurveySession,
    counted_rows,
    hogels_per_block,
    rows_per_block,
    stats_of,
)
from xfrustum.reports.text import require_seen
from xfrustum.scenes import DoubleFrustum, InputError, Scene
from xfrustum.scenes.arguments import choice, one_of, real
from xfrustum.scenes.model.visibility import apertures_drawn
from xfrustum.scenes.representation import digits, percent, percent_up
from xfrustum.tolerances import MAX_WRONG, TOLERANCE_PX

#: template of sentences
WORDS = "survey-words.txt.j2"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Survey(NotebookRepr):
    """Result of a survey."""

    scene: Scene
    settings: tuple[DoubleFrustum, ...]
    #: statistics of each setting
    stats: tuple[survey_rows.SettingStats, ...]
    extent: SampleExtent
    #: largest displacement (p99) of a hogel within the limits, pixels
    tolerance_px: float
    #: order in which truths are computed
    truth_by: TruthBy
    #: number of processes
    workers: int
    wall_s: float

    @cached_property
    def best(self) -> int:
        """Index of the setting with fewest hogels beyond tolerance; the worst hogel breaks ties."""
        bad = [(each.beyond, *(hogel.badness for hogel in each.worst[:1])) for each in self.stats]
        return bad.index(min(bad))

    def at_most(self, stats: survey_rows.SettingStats) -> float | None:
        """Return the bound on the share beyond the tolerance; None while a part is missing."""
        return self.extent.at_most(stats.beyond)

    def bound_words(self, stats: survey_rows.SettingStats) -> str:
        """Return the bound in percent, rounded up; "-" without a bound."""
        share = self.at_most(stats)
        return "-" if share is None else percent_up(share)

    @property
    def exceeded(self) -> bool:
        """True if the bound exceeds `until`; without it, if any hogel is beyond the tolerance."""
        stats, limit = self.stats[self.best], self.extent.sample.until
        share = self.at_most(stats)
        return stats.beyond > 0 if limit is None else share is None or share > limit

    @property
    def sentence(self) -> str:
        """Result for the best setting, one sentence."""
        stats, sample = self.stats[self.best], self.extent.sample
        return sentence(
            WORDS,
            "sentence",
            survey=self,
            stats=stats,
            bound=self.bound_words(stats),
            limits=f"beyond {self.tolerance_px:g} px or {percent(MAX_WRONG)} wrong",
            unseen=sample.hogels - len(sample.population),
        )

    def summary(self) -> dict[str, Any]:
        """Return the record of `survey --json`: the best setting, then all settings in order."""
        sample = self.extent.sample
        settings = zip(self.settings, map(self._counts, self.stats), strict=True)
        record = {
            "scene": self.scene.name,
            "hash": self.scene.content_hash,
            "hogels": sample.hogels,
            "seeing": len(sample.population),
            "resolution": self.scene.frustum.resolution,
            **self._counts(self.stats[self.best]),
            "confidence": self.extent.confidence,
            "tolerance_px": self.tolerance_px,
            "limit": sample.until,
            "complete": self.extent.complete,
            "seed": sample.description["seed"],
            "truth_by": self.truth_by,
            "workers": self.workers,
            "wall_s": self.wall_s,
            "sentence": self.sentence,
            "settings": [{"settings": chosen, **counts} for chosen, counts in settings],
        }
        return json_object(record)

    def _counts(self, stats: survey_rows.SettingStats) -> dict[str, Any]:
        """Return counts, the bound and the worst hogel of a setting."""
        names = ("aperture", "displacement_p99_px", "surface_fraction")
        worst = [{name: getattr(hogel, name) for name in names} for hogel in stats.worst[:1]]
        return {
            "judged": stats.judged,
            "beyond": stats.beyond,
            "empty": stats.empty,
            "share_beyond_at_most": self.at_most(stats),
            "worst": worst[0] if worst else None,
        }

    def table(self) -> str:
        """Return the sentence, and one line per setting if there are several."""
        several = zip(self.settings, self.stats, strict=True) if len(self.settings) > 1 else ()
        lines = [
            sentence(WORDS, "setting", near=used.near, stats=stats, bound=self.bound_words(stats))
            for used, stats in several
        ]
        return "\n".join([self.sentence, *lines])

    def _said(self) -> str:
        return f"{self.scene.name!r}, {self.sentence}"

    def _figures(self) -> Sequence[Figure]:
        cells = self.stats[self.best].maps.get(survey_rows.P99)
        if cells is None or not np.isfinite(cells).any():
            return ()
        largest = digits(float(np.nanmax(cells)))
        caption = f"99th percentile of displacement over the plate, up to {largest} px; "
        caption += "black: not judged, or shows nothing"
        return (Figure(caption=caption, content=png(map_of(cells))),)


FILES = PAGE, DATA, INSPECTION = "index.html", "survey.json", inspection.PAGE

#: number of the worst hogels on the map of displacement
MARKED_HOGELS = 3
#: factor by which the axis of displacement extends beyond the values
DISTRIBUTION_MARGIN = 3.0

#: worst hogels with their pictures
Pictured = Sequence[tuple[survey_rows.WorstHogel, survey_rows.ShownHogel]]


def write_survey(answer: Survey, pictured: Pictured, out: Path) -> tuple[Path, ...]:
    """Write the page, the JSON object and the inspection page, all or nothing."""
    settings, maps = answer.settings[answer.best], answer.stats[answer.best].maps
    name = survey_rows.P99 if survey_rows.P99 in maps else survey_rows.SURFACE
    drawn = f"near {digits(settings.near)}, {settings.depth_label}"
    inspected = inspection.Inspection(
        command="survey",
        scene=answer.scene,
        intro=f"The worst of the {answer.extent.judged:,} hogels that were judged: {drawn}.",
        hogels=[hogel.inspected for _, hogel in pictured],
        plate_map=PlateMap(words=words_of(name).capitalize(), cells=maps[name]),
    )
    with Staging(out, FILES) as staging:
        staging.write(PAGE, render_page(answer, pictured))
        staging.write(DATA, answer.summary())
        inspection.write_inspection(staging.folder, inspected)
        with inspection.replacing_inspection(out):
            return staging.commit()


def render_page(answer: Survey, pictured: Pictured) -> str:
    """Return a self-contained HTML document, which depends only on the rows."""
    scene, settings = answer.scene, answer.settings[answer.best]
    maps = {f"map-{number}": figure for number, figure in enumerate(map_figures(answer))}
    drawn = {**maps, "distribution": distribution_figure(answer)}
    worst = scene.plate.aperture(*pictured[0][0].aperture) if pictured else scene.plate.middle
    values = {
        "answer": answer,
        "pictured": pictured,
        "maps": list(maps),
        "figures": drawn,
        "command": raster_command(scene, worst, settings),
        "versions": versions(),
    }
    return html_page("survey.html.j2", values)


def map_figures(answer: Survey) -> list[Plot]:
    """Draw maps of the best setting's measures, except measures that are zero everywhere."""
    stats, plate = answer.stats[answer.best], answer.scene.plate
    figures = []
    for name, values in stats.maps.items():
        if np.nanmax(values, initial=0.0) > 0:
            words = words_of(name) + (f", {answer.scene.units}" if name == "height_rms" else "")
            moved = name == survey_rows.P99
            figure = plate_map(plate, values, words, known=stats.known, logarithmic=moved)
            if moved:
                worst = [
                    (hogel.aperture, "one of the worst") for hogel in stats.worst[:MARKED_HOGELS]
                ]
                mark(figure, plate, worst, labels=1)
            figures.append(figure)
    return figures


def words_of(column: str) -> str:
    """Return the caption of a mapped column."""
    cause = column.removeprefix("cause_").removesuffix("_surface").replace("_", " ")
    return survey_rows.MAP_COLUMNS.get(column, f"wrong surfaces by {cause}, pixels")


def distribution_figure(answer: Survey) -> Plot:
    """Draw the share of hogels beyond each tolerance, one curve per setting."""
    shown, lines = [answer.tolerance_px], []
    for number, (settings, stats) in enumerate(zip(answer.settings, answer.stats, strict=True)):
        tolerances, shares = stats.share_beyond()
        shown += [*tolerances[:1], *tolerances[-1:]]
        line = {"color": look(number)[0], "shape": "hv"}
        name = f"near {digits(settings.near)}"
        lines.append({"x": tolerances, "y": shares, "mode": "lines", "line": line, "name": name})
    low, high = min(shown) / DISTRIBUTION_MARGIN, max(shown) * DISTRIBUTION_MARGIN
    tolerance = {
        "type": "line",
        "x0": answer.tolerance_px,
        "x1": answer.tolerance_px,
        "yref": "y domain",
    }
    layout = {
        "height": 380,
        "xaxis": {
            "title": "displacement (p99), px",
            "range": [np.log10(low), np.log10(high)],
            **log_axis([low, high]),
        },
        "yaxis": {
            "title": "share of judged hogels beyond",
            "tickformat": ".0%",
            "rangemode": "tozero",
        },
        "shapes": [{**tolerance, "y0": 0, "y1": 1, "line": {"color": MARK, "dash": "dot"}}],
    }
    return styled(lines, layout)


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

    Every hogel is drawn with each setting; `compare.sampling` defines the hogels beyond
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
    # Blocks depend on the order of truths. Nested, they are not named if the order differs.
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
