"""How fast are many hogels at once, next to loops that anybody would write? Hogels per second, and ratios."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from xfrustum.raster.device.timer import StageTime
from xfrustum.reports.benchmarks.plate_contestants import (
    BARE,
    BARE_NUMBERED,
    BATCHED,
    COLOR,
    DISCARDED,
    MEANINGS,
    PLAIN,
    PLAIN_NUMBERED,
    plate_contestants,
)
from xfrustum.reports.benchmarks.records import BenchmarkedScene
from xfrustum.reports.common import provenance
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.common.timing import Timing, race
from xfrustum.scenes.appearance.sampling import Sampling
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum

RESOLUTION = 128
REPEAT = 5
RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""

RATIOS = (
    (BATCHED, PLAIN),
    (BATCHED, PLAIN_NUMBERED),
    (BATCHED, DISCARDED),
    (COLOR, BARE),
    (COLOR, BARE_NUMBERED),
)
"""Pairs of contestants; the rate of the first is divided by that of the second."""


@dataclass(frozen=True, kw_only=True)
class PlateRecord:
    """JSON object of a `PlateBenchmark`."""

    scene: BenchmarkedScene
    resolution: tuple[int, int]
    settings: DoubleFrustum
    row: int
    hogels: int
    meanings: dict[str, str]
    hogels_per_second: dict[str, Timing]
    ratios: dict[str, float]
    stages_s: dict[str, dict[str, Timing]]
    device: str
    machine: dict[str, str]
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class PlateBenchmark(Summarized[PlateRecord]):
    """The contestants on one row of one plate.

    Attributes
    ----------
    scene
        Scene with the resolution that was drawn.
    settings
        Settings of the double frustum.
    row
        Row of the plate; all its apertures were drawn.
    seconds
        Wall seconds for the whole row, by contestant.
    stages
        GPU and wall seconds of each stage of `BATCHED`, for the whole row.
    device, machine, versions
        Names and values, for whoever repeats it.
    """

    scene: Scene
    settings: DoubleFrustum
    row: int
    seconds: dict[str, Timing]
    stages: dict[str, dict[str, Timing]]
    device: str
    machine: dict[str, str]
    versions: dict[str, str]

    def rate(self, contestant: str) -> Timing:
        """Return hogels per second."""
        hogels, taken = self.scene.plate.hogels[0], self.seconds[contestant]
        return replace(
            taken, median=hogels / taken.median, lowest=hogels / taken.highest, highest=hogels / taken.lowest
        )

    @property
    def ratios(self) -> dict[str, float]:
        """Quotients of median rates as "one/other"."""
        return {f"{one}/{other}": self.rate(one).median / self.rate(other).median for one, other in RATIOS}

    @property
    def record(self) -> PlateRecord:
        """Everything measured."""
        return PlateRecord(
            scene=BenchmarkedScene.of(self.scene),
            resolution=self.scene.frustum.resolution,
            settings=self.settings,
            row=self.row,
            hogels=self.scene.plate.hogels[0],
            meanings=MEANINGS,
            hogels_per_second={name: self.rate(name) for name in self.seconds},
            ratios=self.ratios,
            stages_s=self.stages,
            device=self.device,
            machine=self.machine,
            versions=self.versions,
        )


def benchmark_plate(
    scene: Scene, resolution: int = RESOLUTION, repeat: int = REPEAT, *, progress: bool = False
) -> PlateBenchmark:
    """Race one row of a scene's plate, the middle one.

    Parameters
    ----------
    scene
        Scene to be drawn; its own resolution and sampling do not matter, for plain loops take one sample.
    resolution
        W = H in pixels.
    repeat
        Number of runs of each contestant after it has warmed up.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The scene has no triangles, or a number is not positive.
    """
    if not len(scene.faces):
        raise InputError(f"scene {scene.name}: has no triangles to draw; choose one that has")
    if min(resolution, repeat) < 1:
        raise InputError("bench: resolution and repetitions must be positive; give such as 128")
    film = replace(scene.frustum, resolution=(resolution, resolution))
    sized = replace(scene, frustum=film, sampling=Sampling())
    settings = DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)
    columns, row = scene.plate.hogels[0], scene.plate.middle.row
    apertures = [sized.plate.aperture(column, row) for column in range(columns)]
    runs_of_all = (repeat + 1) * len(MEANINGS)
    with (
        plate_contestants(sized, settings, apertures) as contestants,
        progress_bar(runs_of_all, "bench", "row", shown=progress) as bar,
    ):
        return PlateBenchmark(
            scene=sized,
            settings=settings,
            row=row,
            seconds=race(contestants.runs, repeat, bar.update),
            stages=_stages(contestants.measure, repeat),
            device=contestants.device,
            machine=provenance.machine(),
            versions=provenance.versions(),
        )


def _stages(measure: Callable[[], Mapping[str, StageTime]], repeat: int) -> dict[str, dict[str, Timing]]:
    # Everything has warmed up by now.
    runs = [measure() for _ in range(repeat)]
    return {
        name: {clock: Timing.of([getattr(run[name], clock) for run in runs]) for clock in ("gpu_s", "wall_s")}
        for name in runs[0]
    }


def table(benchmark: PlateBenchmark) -> str:
    """Return rates, ratios and stages as text."""
    machine, scene = benchmark.machine, benchmark.scene
    width, height = scene.frustum.resolution
    rates = {name: benchmark.rate(name) for name in benchmark.seconds}
    return "\n".join(
        (
            f"{scene.name}, {len(scene.faces):,} triangles, row {benchmark.row}: "
            f"{scene.plate.hogels[0]} hogels of {width} x {height}",
            f"{benchmark.device}; {machine['cores']} cores of {machine['processor']}",
            f"median of {rates[PLAIN].repetitions} after a warm-up (slowest to fastest), taking turns",
            "",
            "hogels per second",
            *(
                f"  {name:<18}{rate.median:9.1f} ({rate.lowest:.1f} to {rate.highest:.1f})"
                for name, rate in rates.items()
            ),
            "",
            *(f"  {pair:<34}{ratio:6.2f}" for pair, ratio in benchmark.ratios.items()),
            "",
            f"stages of {BATCHED}, ms a hogel: the device's own, and wall time of giving the orders",
            *(
                f"  {name:<18}"
                + "".join(f"{1e3 * clock.median / scene.plate.hogels[0]:9.3f}" for clock in clocks.values())
                for name, clocks in benchmark.stages.items()
            ),
            "",
            *(f"{name}: {meaning}" for name, meaning in MEANINGS.items()),
        )
    )
