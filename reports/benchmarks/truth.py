"""How fast is the truth, next to tracers that prove nothing? Million pixels per second, and ratios."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tqdm import tqdm

from xfrustum.reports.benchmarks.records import BenchmarkedScene
from xfrustum.reports.benchmarks.truth_contestants import (
    CERTIFIED,
    MEANINGS,
    MITSUBA,
    TRIMESH,
    TRUTH,
    Run,
    truth_contestants,
    versions,
)
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.common.timing import Stopwatch
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene

RESOLUTIONS = (512, 1024, 2048)
REPEAT = 9
RATIOS = ((CERTIFIED, MITSUBA), (CERTIFIED, TRIMESH), (TRUTH, MITSUBA), (TRUTH, TRIMESH))
"""Pairs of contestants; the rate of the first is divided by that of the second."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Million pixels per second over the repetitions."""

    median: float
    slowest: float
    fastest: float


@dataclass(frozen=True, kw_only=True)
class Race:
    """The contestants at one resolution.

    Attributes
    ----------
    resolution
        W and H in pixels.
    rates
        Rates by contestant, see `MEANINGS`; one that does not run here has none.
    """

    resolution: int
    rates: dict[str, Rate]

    @property
    def ratios(self) -> dict[str, float | None]:
        """Quotients of median rates as "one/other"; None where the other could not run here."""
        return {
            f"{one}/{other}": self.rates[one].median / self.rates[other].median
            if other in self.rates
            else None
            for one, other in RATIOS
        }


@dataclass(frozen=True, kw_only=True)
class TruthScene(BenchmarkedScene):
    """The scene that was traced, and from which aperture."""

    aperture: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class RaceRecord:
    """JSON object of a `Race`; a contestant that does not run here has None."""

    resolution: tuple[int, int]
    mpixel_per_s: dict[str, Rate | None]
    ratios: dict[str, float | None]


@dataclass(frozen=True, kw_only=True)
class TruthRecord:
    """JSON object of a `TruthBenchmark`."""

    scene: TruthScene
    repeat: int
    meanings: dict[str, str]
    races: tuple[RaceRecord, ...]
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class TruthBenchmark(Summarized[TruthRecord]):
    """The contestants on one scene and machine.

    Attributes
    ----------
    scene
        Scene at any resolution.
    repeat
        Measured repetitions, after one that warms up.
    races
        One for each resolution.
    machine, versions
        Names and values, for whoever repeats it.
    """

    scene: Scene
    repeat: int
    races: tuple[Race, ...]
    machine: dict[str, str]
    versions: dict[str, str]

    @property
    def record(self) -> TruthRecord:
        """Everything measured."""
        races = (
            RaceRecord(
                resolution=(race.resolution, race.resolution),
                mpixel_per_s={name: race.rates.get(name) for name in MEANINGS},
                ratios=race.ratios,
            )
            for race in self.races
        )
        return TruthRecord(
            scene=TruthScene(
                name=self.scene.name,
                hash=self.scene.content_hash,
                triangles=len(self.scene.faces),
                aperture=self.scene.plate.middle.index,
            ),
            repeat=self.repeat,
            meanings=MEANINGS,
            races=tuple(races),
            machine=self.machine,
            versions=self.versions,
        )


def benchmark_truth(
    scene: Scene, resolutions: Sequence[int] = RESOLUTIONS, repeat: int = REPEAT, *, progress: bool = False
) -> TruthBenchmark:
    """Measure the certified truth of a scene's middle aperture beside bare tracers.

    Parameters
    ----------
    scene
        Scene to be traced; its own resolution does not matter.
    resolutions
        W = H in pixels of each race.
    repeat
        Number of runs of each contestant after it has warmed up.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The scene has no triangles, or a resolution or the number of repetitions is not positive.
    """
    if not len(scene.faces):
        raise InputError(f"scene {scene.name}: has no triangles to trace; choose one that has")
    if not resolutions or min(*resolutions, repeat) < 1:
        raise InputError("bench: resolutions and repetitions must be positive; give such as 512,1024")
    with progress_bar(len(resolutions) * len(MEANINGS), "bench", "contestant", shown=progress) as bar:
        races = tuple(_race(scene, resolution, repeat, bar) for resolution in resolutions)
    return TruthBenchmark(
        scene=scene,
        repeat=repeat,
        races=races,
        machine=provenance.machine(),
        versions={**provenance.versions(), **versions()},
    )


def table(benchmark: TruthBenchmark) -> str:
    """Return the rates and ratios as text, one column for each resolution."""
    heads = [f"{race.resolution} x {race.resolution}" for race in benchmark.races]
    lines = [
        ("million pixels per second", *heads),
        *((name, *(_spread(race.rates.get(name)) for race in benchmark.races)) for name in MEANINGS),
        *(
            (pair, *(_number(race.ratios[pair]) for race in benchmark.races))
            for pair in benchmark.races[0].ratios
        ),
    ]
    widths = [max(len(line[column]) for line in lines) for column in range(len(heads) + 1)]
    rows = ("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)
    machine, scene = benchmark.machine, benchmark.scene
    legend = (f"{name}: {meaning}" for name, meaning in MEANINGS.items())
    return "\n".join(
        (
            f"{scene.name}, {len(scene.faces):,} triangles, middle aperture; "
            f"{machine['cores']} cores of {machine['processor']}",
            f"median of {benchmark.repeat} after a warm-up (slowest to fastest)",
            "",
            *(row.rstrip() for row in rows),
            "",
            *legend,
        )
    )


def _race(scene: Scene, resolution: int, repeat: int, bar: tqdm[Any]) -> Race:
    sized = replace(scene, frustum=replace(scene.frustum, resolution=(resolution, resolution)))
    contestants = truth_contestants(sized, sized.plate.middle)
    seconds: dict[str, list[float]] = {}
    for name, run in contestants.items():
        # One at a time, so that none pays for what another leaves behind in caches and heap.
        taken = [_timed(run) for _ in range(repeat + 1)]
        # The first builds structures and compiles kernels.
        seconds[name] = taken[1:]
        bar.update()
    mpixels = resolution**2 / 1e6
    return Race(
        resolution=resolution,
        rates={
            name: Rate(
                median=mpixels / statistics.median(taken),
                slowest=mpixels / max(taken),
                fastest=mpixels / min(taken),
            )
            for name, taken in seconds.items()
        },
    )


def _timed(run: Run) -> float:
    watch = Stopwatch()
    with watch.stage("run"):
        run()
    return watch.seconds["run"]


def _spread(rate: Rate | None) -> str:
    return "-" if rate is None else f"{rate.median:.2f} ({rate.slowest:.2f} to {rate.fastest:.2f})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
