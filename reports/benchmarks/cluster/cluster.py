"""`xfrustum bench cluster`: efficiency of two workers, and the scheduler's share of the time."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from xfrustum.compare.scouting.strata import GrowingSample
from xfrustum.reports.benchmarks.cluster.forecast import (
    PLATES,
    WORKER_COUNTS,
    Forecast,
    SimulatedRun,
    breaking_workers,
    forecast,
)
from xfrustum.reports.benchmarks.records import BenchmarkedScene
from xfrustum.reports.cluster.blocks import SampleBlocks, hogels_per_block
from xfrustum.reports.cluster.parts import Parts
from xfrustum.reports.cluster.run import run_blocks
from xfrustum.reports.cluster.ticket import SceneTicket
from xfrustum.reports.common import provenance
from xfrustum.reports.common.formatting import digits
from xfrustum.reports.common.progress import progress_bar
from xfrustum.reports.common.summaries import Summarized
from xfrustum.reports.survey.hogels import HogelsJob
from xfrustum.reports.survey.survey import ROWS
from xfrustum.scenes.disk.durable import Aside, scratch_folder
from xfrustum.scenes.errors import InputError
from xfrustum.scenes.model.scene import Scene
from xfrustum.scenes.plate.double_frustum import DoubleFrustum
from xfrustum.tolerances import TOLERANCE_PX

RELATIVE_NEAR = 1e-3
"""The step back from the plate, as a fraction of the reach."""

HOGELS_PER_BLOCK = 4
"""Hogels of a block where real workers are timed: few, so that both end at nearly the same time."""

WORKERS = (1, 2)
"""Numbers of real workers."""

SIMULATED = ((64, 1.25), (512, 10.0))
"""Numbers of simulated workers, and the seconds that a block takes: such that 10,000 blocks take 200 s with
both, and the scheduler hands out 51 a second."""

BLOCKS = 10_000
"""Blocks of a simulation."""


@dataclass(frozen=True, kw_only=True)
class RealRun:
    """What some hogels took with real workers, after each had opened the scene.

    Attributes
    ----------
    workers, hogels
        Numbers of workers and of hogels.
    wall_s
        Seconds for the hogels.
    hogels_per_s
        Their quotient.
    """

    workers: int
    hogels: int
    wall_s: float
    hogels_per_s: float


@dataclass(frozen=True, kw_only=True)
class ClusterRecord:
    """JSON object of a `ClusterBenchmark`."""

    scene: BenchmarkedScene
    resolution: tuple[int, int]
    settings: DoubleFrustum
    runs: tuple[RealRun, ...]
    efficiency: float
    device_note: str
    simulated: tuple[SimulatedRun, ...]
    saturated: SimulatedRun
    hogels_per_block: int
    block_s: float
    breaking_workers: int
    forecasts: tuple[Forecast, ...]
    machine: dict[str, str]
    versions: dict[str, str]


DEVICE_NOTE = (
    "both workers share the device: two processes that draw on one GPU take turns, and a software renderer "
    "shares the processors with the tracers"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClusterBenchmark(Summarized[ClusterRecord]):
    """Real and simulated workers.

    Attributes
    ----------
    scene
        Scene with the resolution that was judged.
    settings
        Settings of the double frustum.
    runs
        One for each number of real workers.
    simulated
        One for each number of simulated workers.
    saturated
        Blocks that take no time, as fast as the scheduler hands them out.
    """

    scene: Scene
    settings: DoubleFrustum
    runs: tuple[RealRun, ...]
    simulated: tuple[SimulatedRun, ...]
    saturated: SimulatedRun

    @property
    def efficiency(self) -> float:
        """Hogels per second of the most workers, over those of one, times their number."""
        one, most = self.runs[0], self.runs[-1]
        return most.hogels_per_s / one.hogels_per_s * one.workers / most.workers

    @property
    def record(self) -> ClusterRecord:
        """Everything measured, and what follows for larger plates."""
        hogel_s = 1 / self.runs[0].hogels_per_s
        task_s = 1 / self.saturated.tasks_per_s
        each = {hogels: hogels_per_block(hogels, self.scene.frustum, 1) for hogels in PLATES}
        largest = each[max(PLATES)]
        return ClusterRecord(
            scene=BenchmarkedScene.of(self.scene),
            resolution=self.scene.frustum.resolution,
            settings=self.settings,
            runs=self.runs,
            efficiency=self.efficiency,
            device_note=DEVICE_NOTE,
            simulated=self.simulated,
            saturated=self.saturated,
            hogels_per_block=largest,
            block_s=largest * hogel_s,
            breaking_workers=breaking_workers(largest * hogel_s, self.saturated.tasks_per_s),
            forecasts=tuple(
                forecast(hogels, workers, hogel_s, each[hogels], task_s, 2 * workers)
                for hogels in PLATES
                for workers in WORKER_COUNTS
            ),
            machine=provenance.machine(),
            versions=provenance.versions(),
        )


def benchmark_cluster(
    scene: Scene, resolution: int = 128, hogels: int = 64, *, quick: bool = False, progress: bool = False
) -> ClusterBenchmark:
    """Measure surveys with one and two workers, and a scheduler with many simulated ones.

    Parameters
    ----------
    scene
        Scene whose hogels are judged.
    resolution
        W = H in pixels.
    hogels
        Number of hogels that real workers are timed with.
    quick
        Whether to simulate a fiftieth of the blocks, to see that everything runs.
    progress
        Whether to draw a bar on standard error.

    Raises
    ------
    InputError
        The scene has no triangles, or a process does not start.
    """
    if not len(scene.faces):
        raise InputError(f"scene {scene.name}: has no triangles to draw; choose one that has")
    # Dask takes a second to load, which no other benchmark may pay for.
    from xfrustum.reports.benchmarks.cluster.simulation import simulate  # noqa: PLC0415

    sized = replace(scene, frustum=replace(scene.frustum, resolution=(resolution, resolution)))
    settings = DoubleFrustum(near=RELATIVE_NEAR * scene.frustum.longest_reach)
    part = 50 if quick else 1
    with progress_bar(len(WORKERS) + len(SIMULATED) + 1, "bench", "run", shown=progress) as bar:

        def counted(made: RealRun) -> RealRun:
            bar.update()
            return made

        runs = tuple(counted(_real(sized, settings, workers, hogels)) for workers in WORKERS)
        simulated = []
        for workers, block_s in SIMULATED:
            simulated.append(simulate(workers // (8 if quick else 1), BLOCKS // part, block_s / part))
            bar.update()
        saturated = simulate(SIMULATED[0][0] // (8 if quick else 1), BLOCKS // part, 0.0)
        bar.update()
    return ClusterBenchmark(
        scene=sized, settings=settings, runs=runs, simulated=tuple(simulated), saturated=saturated
    )


def _real(scene: Scene, settings: DoubleFrustum, workers: int, hogels: int) -> RealRun:
    """Time some hogels with real workers; blocks before them let every worker open the scene."""
    from xfrustum.reports.cluster.cluster import machine_cluster  # noqa: PLC0415 - see above

    warm = 2 * workers * HOGELS_PER_BLOCK
    sample = GrowingSample(plate=scene.plate, first=hogels + warm)
    with Aside(scratch_folder(), folder=True) as aside:
        job = HogelsJob(
            ticket=SceneTicket.of(scene),
            settings=(settings,),
            tracer="embree",
            tolerance_px=TOLERANCE_PX,
            blocks=SampleBlocks(sample=sample, size=HOGELS_PER_BLOCK),
            parts=Parts(out=aside.path, name=ROWS),
        )
        job.parts.open({})
        numbers = job.blocks.numbers(0)
        first, rest = numbers[: 2 * workers], numbers[2 * workers :]
        with machine_cluster(workers, 1) as team:
            run_blocks(job, first, team, warm, "warm-up")
            begun = time.perf_counter()
            run_blocks(job, rest, team, hogels, "hogels")
            wall_s = time.perf_counter() - begun
    judged = sum(len(job.blocks.apertures(number)) for number in rest)
    return RealRun(workers=workers, hogels=judged, wall_s=wall_s, hogels_per_s=judged / wall_s)


def table(benchmark: ClusterBenchmark) -> str:
    """Return everything measured as text, and what follows for larger plates."""
    record = benchmark.record
    lines = [
        f"{record.scene.name}, {record.scene.triangles:,} triangles, hogels of {record.resolution[0]} x "
        f"{record.resolution[1]}; {record.machine['cores']} cores of {record.machine['processor']}",
        "",
        "workers of this machine",
        *(
            f"  {run.workers} worker{'s' if run.workers > 1 else ' '} {run.hogels_per_s:8.2f} hogels per "
            f"second ({run.hogels} in {run.wall_s:.1f} s)"
            for run in record.runs
        ),
        f"  efficiency of {record.runs[-1].workers}: {record.efficiency:.0%}; {record.device_note}",
        "",
        "simulated workers: the real scheduler and real messages, and blocks that sleep",
        *(_simulated_line(run) for run in (*record.simulated, record.saturated)),
        "",
        f"on paper: blocks of {record.hogels_per_block} hogels take {digits(record.block_s)} s; from "
        f"{record.breaking_workers:,} workers on, the scheduler is what breaks first",
        *(
            f"  {one.hogels:>10,} hogels, {one.workers:>3} workers: {_duration(one.wall_s):>9}"
            f" ({one.blocks:,} blocks, {one.scheduling_s:,.0f} s of the scheduler, "
            f"{one.rows_mib:,.0f} MiB of rows, {one.tasks_held:,} tasks held)"
            for one in record.forecasts
        ),
    ]
    return "\n".join(lines)


def _simulated_line(run: SimulatedRun) -> str:
    over = "" if run.overhead is None else f", {run.overhead:.1%} over the ideal {run.ideal_s:.0f} s"
    return (
        f"  {run.workers:>3} workers, {run.blocks:,} blocks of {digits(run.block_s)} s: "
        f"{run.wall_s:.1f} s{over}; {run.tasks_per_s:.0f} blocks per second; each takes "
        f"{run.scheduler_ms:.2f} ms of the scheduler and {run.client_ms:.2f} ms of the client; scheduler "
        f"{run.scheduler_mib:.0f} MiB ({run.scheduler_growth_mib:+.1f}), client "
        f"{run.client_growth_mib:+.1f} MiB"
    )


def _duration(seconds: float) -> str:
    """Write a time in the unit in which people would say it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"
