"""How fast are hogels judged? Hogels per second, CPU seconds by stage, and ratios."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tqdm import tqdm

from xfrustum.reports.benchmarks.judge_contestants import (
    COMPARING,
    DECIDING,
    DRAWN,
    LOOP,
    MEANINGS,
    MITSUBA,
    PLAIN,
    POINTS,
    RADIANCE,
    READ,
    RENDER,
    STAGES,
    STREAM,
    Run,
    judge_contestants,
    judging_stages,
    settings_of,
    sized,
    spread_over,
)
from xfrustum.reports.benchmarks.judge_stream import StreamRecord, lines_of
from xfrustum.reports.benchmarks.records import BenchmarkedScene
from xfrustum.reports.benchmarks.truth_contestants import versions
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

RESOLUTIONS = (128, 256, 512, 1024)
REPEAT = 5
HOGELS = 6
"""Hogels that each run judges: enough that a stream overlaps, and few enough for a million pixels each."""

RATIOS = ((STREAM, LOOP), (STREAM, PLAIN), (STREAM, RENDER), (STREAM, MITSUBA))
"""Pairs of contestants; the rate of the first is divided by that of the second."""

TRUTH = (DECIDING, POINTS)
"""Stages of a truth. The second opinion is none of them: it is asked for when somebody reads it."""

FRAME = (DRAWN, READ)


@dataclass(frozen=True, kw_only=True)
class JudgeRace:
    """The contestants at one resolution of one scene.

    Attributes
    ----------
    resolution
        W and H in pixels.
    hogels_per_second
        Rates by contestant, see `MEANINGS`; None of one that does not run here.
    ratios
        Quotients of median rates as "one/other"; None where the other does not run here.
    cpu_s
        CPU seconds of each stage of one judged hogel, of the process with all its threads; see `STAGES`.
    judging_over_drawing
        CPU seconds of truth and comparing over those of a frame, without colors and with them.
    """

    resolution: tuple[int, int]
    hogels_per_second: dict[str, Timing | None]
    ratios: dict[str, float | None]
    cpu_s: dict[str, float]
    judging_over_drawing: dict[str, float]

    @classmethod
    def of(cls, resolution: int, rates: Mapping[str, Timing], cpu_s: dict[str, float]) -> JudgeRace:
        """Return a race with its ratios."""
        return cls(
            resolution=(resolution, resolution),
            hogels_per_second={name: rates.get(name) for name in MEANINGS},
            ratios={
                f"{one}/{other}": rates[one].median / rates[other].median if other in rates else None
                for one, other in RATIOS
            },
            cpu_s=cpu_s,
            judging_over_drawing=judging_over_drawing(cpu_s),
        )


def judging_over_drawing(cpu_s: Mapping[str, float]) -> dict[str, float]:
    """Return truth and comparing over a frame, in CPU seconds, without colors and with them."""
    drawing = sum(cpu_s[stage] for stage in FRAME)
    without = sum(cpu_s[stage] for stage in (*TRUTH, COMPARING))
    return {"without radiance": without / drawing, "with radiance": (without + cpu_s[RADIANCE]) / drawing}


@dataclass(frozen=True, kw_only=True)
class JudgedScene:
    """A scene, the settings that it was drawn with, and its races."""

    scene: BenchmarkedScene
    settings: DoubleFrustum
    races: tuple[JudgeRace, ...]


@dataclass(frozen=True, kw_only=True)
class JudgeRecord:
    """JSON object of a `JudgeBenchmark`."""

    hogels: int
    repeat: int
    meanings: dict[str, str]
    stages: dict[str, str]
    scenes: tuple[JudgedScene, ...]
    stream: StreamRecord | None
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class JudgeBenchmark(Summarized[JudgeRecord]):
    """The contestants on some scenes, and what they were measured on.

    Attributes
    ----------
    hogels, repeat
        Hogels of each run; and measured runs of each contestant, after one that warms up.
    scenes
        The races of each scene.
    stream
        Many judged hogels in processes of their own; None where these were not asked for.
    machine, versions
        Names and values, for whoever repeats it.
    """

    hogels: int
    repeat: int
    scenes: tuple[JudgedScene, ...]
    stream: StreamRecord | None
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def record(self) -> JudgeRecord:
        """Everything measured."""
        return JudgeRecord(meanings=MEANINGS, stages=STAGES, **vars(self))


def benchmark_judge(
    scenes: Sequence[Scene],
    resolutions: Sequence[int] = RESOLUTIONS,
    hogels: int = HOGELS,
    repeat: int = REPEAT,
    *,
    progress: bool = False,
) -> JudgeBenchmark:
    """Measure how fast hogels of some scenes are judged, beside loops and bare renderers.

    Parameters
    ----------
    scenes
        Scenes to be judged; their own resolution and sampling do not matter.
    resolutions
        W = H in pixels of each race.
    hogels
        Hogels of each run, spread over the plate.
    repeat
        Number of runs of each contestant and of each stage, in turns, after it has warmed up.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        A scene has no triangles, a number is not positive, or there is no usable OpenGL.
    """
    for scene in scenes:
        if not len(scene.faces):
            raise InputError(f"scene {scene.name}: has no triangles to judge; choose one that has")
    if not resolutions or min(*resolutions, hogels, repeat) < 1:
        raise InputError("bench: resolutions, hogels and repetitions must be positive; give such as 256,512")
    turns = len(scenes) * len(resolutions) * (repeat + 1) * (len(MEANINGS) + len(STAGES))
    with progress_bar(turns, "bench", "run", shown=progress) as bar:
        judged = tuple(_judged(scene, resolutions, hogels, repeat, bar) for scene in scenes)
    return JudgeBenchmark(
        hogels=hogels,
        repeat=repeat,
        scenes=judged,
        stream=None,
        machine=provenance.machine(),
        versions={**provenance.versions(), **versions()},
    )


def _judged(
    scene: Scene, resolutions: Sequence[int], hogels: int, repeat: int, bar: tqdm[Any]
) -> JudgedScene:
    plain = replace(scene, sampling=Sampling())
    return JudgedScene(
        scene=BenchmarkedScene.of(scene),
        settings=settings_of(plain),
        races=tuple(_race(sized(plain, side), side, hogels, repeat, bar) for side in resolutions),
    )


def _race(scene: Scene, resolution: int, hogels: int, repeat: int, bar: tqdm[Any]) -> JudgeRace:
    with judge_contestants(scene, spread_over(scene, hogels)) as runs:
        seconds = race(runs, repeat, bar.update)
    bar.update((repeat + 1) * (len(MEANINGS) - len(seconds)))
    rates = {name: _rate(hogels, taken) for name, taken in seconds.items()}
    with judging_stages(scene, scene.plate.middle) as runs:
        cpu_s = stages_of(_cpu_race(runs, repeat, bar))
    return JudgeRace.of(resolution, rates, cpu_s)


def _rate(hogels: int, taken: Timing) -> Timing:
    """Return hogels per second, given the seconds of a run."""
    fastest, slowest = hogels / taken.lowest, hogels / taken.highest
    return replace(taken, median=hogels / taken.median, lowest=slowest, highest=fastest, low=None, high=None)


def _cpu_race(runs: Mapping[str, Run], repeat: int, bar: tqdm[Any]) -> dict[str, float]:
    """Return the median CPU seconds of each run, of all threads of the process; all take turns."""
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(repeat + 1):
        for name, run in runs.items():
            begun = time.process_time()
            run()
            if turn:
                taken[name].append(time.process_time() - begun)
            bar.update()
    return {name: statistics.median(values) for name, values in taken.items()}


def stages_of(parts: Mapping[str, float]) -> dict[str, float]:
    """Return the seconds of each stage, given those of `judging_stages`; a difference is never negative."""
    taken = dict(parts)
    taken[POINTS] = max(0.0, parts[POINTS] - parts[DECIDING])
    taken[READ] = max(0.0, parts[READ] - parts[DRAWN])
    taken[RADIANCE] = max(0.0, parts[RADIANCE] - parts[COMPARING])
    return {stage: taken[stage] for stage in STAGES}


def table(benchmark: JudgeBenchmark) -> str:
    """Return rates, ratios and stages as text, one column for each resolution."""
    machine = benchmark.machine
    lines = [
        f"{benchmark.hogels} hogels a run; {machine['cores']} cores of {machine['processor']}",
        f"median of {benchmark.repeat} after a warm-up (slowest to fastest), taking turns",
    ]
    for judged in benchmark.scenes:
        lines += ["", f"{judged.scene.name}, {judged.scene.triangles:,} triangles", *_lines(judged.races)]
    if benchmark.stream is not None:
        lines += ["", *lines_of(benchmark.stream)]
    legend = (f"{name}: {meaning}" for name, meaning in (MEANINGS | STAGES).items())
    return "\n".join((*lines, "", *legend))


def _lines(races: Sequence[JudgeRace]) -> list[str]:
    heads = [f"{side} x {side}" for side, _ in (race.resolution for race in races)]
    rows = [("judged hogels per second", *heads)]
    rows += [(name, *(_spread(race.hogels_per_second[name]) for race in races)) for name in MEANINGS]
    rows += [(pair, *(_number(race.ratios[pair]) for race in races)) for pair in races[0].ratios]
    rows += [("CPU ms of one hogel", *heads)]
    rows += [(stage, *(f"{1e3 * race.cpu_s[stage]:.1f}" for race in races)) for stage in STAGES]
    rows += [
        (f"(truth + comparing)/drawing {how}", *(f"{race.judging_over_drawing[how]:.2f}" for race in races))
        for how in races[0].judging_over_drawing
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(heads) + 1)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def _spread(rate: Timing | None) -> str:
    return "-" if rate is None else f"{rate.median:.2f} ({rate.lowest:.2f} to {rate.highest:.2f})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
